"""A browser or two, and one server, for all tests of the page in a process."""

from __future__ import annotations

import pytest

from omnimirror.apps.studio.studio import Studio

from .browser import FLAGS, REFUSED_CAMERA, serving


@pytest.fixture(scope="session")
def browser(launched):
    browser = launched(FLAGS)
    yield browser
    browser.close()


@pytest.fixture
def browser_without_camera(launched):
    """Whose user refuses the camera."""
    browser = launched(FLAGS, REFUSED_CAMERA)
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def server():
    with serving(Studio()) as address:
        yield address


@pytest.fixture(autouse=True)
def _close_pages(request):
    """A page that a failing test leaves open would go on drawing, on a core of its own, to the end of the run."""
    if "browser" not in request.fixturenames:
        yield
        return
    browser = request.getfixturevalue("browser")
    before = set(browser.contexts)  # those of a whole module among them
    yield
    for context in set(browser.contexts) - before:
        context.close()
