"""One browser and one server for all tests of the page in a process."""

from __future__ import annotations

import pytest

from omnimirror.studio.studio import Studio

from .browser import FAKE_CAMERA, FLAGS, chromium, serving


@pytest.fixture(scope="session")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="the page is driven by Playwright, which is not here")
    executable = chromium()
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS + FAKE_CAMERA)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def server():
    with serving(Studio()) as address:
        yield address
