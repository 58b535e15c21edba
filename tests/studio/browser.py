"""The studio's server in a thread, and a headless browser with software WebGL."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import uvicorn

from omnimirror.studio.app import Studio, create_app

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
FAKE_CAMERA = ["--use-fake-device-for-media-stream"]


@contextmanager
def serving(studio: Studio, port: int = 0) -> Iterator[str]:
    """The address of a running server."""
    config = uvicorn.Config(create_app(studio), port=port, log_level="error", ws="websockets-sansio")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        until = time.monotonic() + 30
        while not server.started and time.monotonic() < until:
            time.sleep(0.01)
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}/"
    finally:
        server.should_exit = True
        thread.join(10)


def chromium() -> str:
    """Where the browser is, or a skip that says so."""
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    if not found:
        pytest.skip("there is no chromium here, which the tests of the page drive")
    return found


def open_page(browser, url: str, width: int = 400, height: int = 400, **options):
    """A page that has drawn something, if its address says what; its errors fail the test that closes it."""
    # Waiting for functions is eval, which the page's policy forbids; another test keeps the policy.
    context = browser.new_context(viewport={"width": width, "height": height}, bypass_csp=True, **options)
    page = context.new_page()
    page.set_default_timeout(60_000)
    page.problems = []
    page.on("pageerror", lambda e: page.problems.append(str(e)))
    page.goto(url)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    return page


def drop(page, path: Path) -> None:
    """Choose a file as a user would."""
    page.set_input_files("#file", path)
    page.wait_for_function(f"window.omnimirror.look.feed?.name === {path.name!r}")


def coordinates(page, width: int, height: int) -> np.ndarray:
    """Pixels (h, w, 2) of the picture that the shader takes for the view; NaN outside the field."""
    script = """([w, h]) => {
      const { look } = window.omnimirror;
      const { view } = look.viewIn(w, h);
      return { size: [view.width, view.height], values: Array.from(look.renderer.coordinates(view)) };
    }"""
    found = page.evaluate(script, [width, height])
    values = np.array(found["values"]).reshape(found["size"][1], found["size"][0], 4)
    return np.where(values[..., 2:3] > 0.5, values[..., :2], np.nan)


def drawn(page, width: int, height: int) -> np.ndarray:
    """The view (h, w, 4) as the shader draws it, RGBA."""
    script = """([w, h]) => {
      const { look } = window.omnimirror;
      const { view } = look.viewIn(w, h);
      look.renderer.draw(view);
      const copy = new OffscreenCanvas(view.width, view.height).getContext("2d");
      copy.drawImage(look.renderer.canvas, 0, 0);
      return { size: [view.width, view.height], values: Array.from(copy.getImageData(0, 0, view.width, view.height).data) };
    }"""  # noqa: E501
    found = page.evaluate(script, [width, height])
    return np.array(found["values"], np.uint8).reshape(found["size"][1], found["size"][0], 4)


def command(page, width: int, height: int) -> str:
    """The command line that the page shows for the view."""
    return page.evaluate("([w, h]) => window.omnimirror.look.viewIn(w, h).command", [width, height])


def look(page, **state) -> None:
    """Set what is looked at, by the state that the address holds too."""
    page.evaluate("(state) => window.omnimirror.store.set(state)", state)
