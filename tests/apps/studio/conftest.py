"""One or two browsers and one server for all page tests of a process."""

from __future__ import annotations

import pytest

from omnimirror.apps.studio._server_state import Studio

from .browser import FLAGS, REFUSED_CAMERA, serving


@pytest.fixture(scope="session")
def browser(launched):
    browser = launched(FLAGS)
    yield browser
    browser.close()


@pytest.fixture
def browser_without_camera(launched):
    """Browser whose user denies access to the camera."""
    browser = launched(FLAGS, REFUSED_CAMERA)
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def server():
    with serving(Studio()) as address:
        yield address


@pytest.fixture(autouse=True)
def _close_pages(request):
    """Close pages left open by a failing test; they would continue to draw on a core until the end
    of the run."""
    if "browser" not in request.fixturenames:
        yield
        return
    browser = request.getfixturevalue("browser")
    before = set(browser.contexts)  # including those of module fixtures
    yield
    for context in set(browser.contexts) - before:
        context.close()
