"""The studio's server in a thread, and a headless browser with software WebGL."""

from __future__ import annotations

import base64
import os
import shutil
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.studio import Studio
from tests.serving import served

# Pages are put together without WebGL, which views alone are drawn by: software takes half of the time for most.
FLAGS = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
]  # fmt: skip
BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")  # the first takes half of the others' time
FAKE_CAMERA = ["--use-fake-device-for-media-stream=device-count=2,fps=5", "--use-fake-ui-for-media-stream"]  # granted
REFUSED_CAMERA = [FAKE_CAMERA[0], "--use-fake-ui-for-media-stream=deny"]
COARSE = {"device_scale_factor": 0.5}  # half as many dots a side: software draws a page in a quarter of the time
PATIENCE_MS = 300_000  # more than any machine needs
BASE64 = """(values) => {
  let text = "";
  const bytes = new Uint8Array(values.buffer);
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}"""
"""Thousands of numbers as one string: Playwright takes half a second for as many by themselves."""


def serving(studio: Studio, port: int = 0) -> AbstractContextManager[str]:
    """The address of a running server of the studio."""
    return served(create_app(studio), port)


def chromium() -> str:
    """Where the browser is, or a skip that says so."""
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if not found:
        pytest.skip("there is no chromium here, which the tests of the page drive")
    return found


def open_page(browser, url: str, width: int = 400, height: int = 400, script: str = "", **options):
    """A page that has drawn something, if its address says what; its errors fail the test that closes it.

    ``script`` runs before those of the page, after every reload too.
    """
    # Waiting for functions is eval, which the page's policy forbids; another test keeps the policy.
    viewport = {"width": width, "height": height}
    context = browser.new_context(viewport=viewport, bypass_csp=True, **COARSE | options)
    context.add_init_script(script)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
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
    script = f"""([w, h]) => {{
      const {{ look }} = window.omnimirror;
      const {{ view }} = look.viewIn(w, h);
      return {{ size: [view.width, view.height], values: ({BASE64})(look.renderer.coordinates(view)) }};
    }}"""
    values = _values(page.evaluate(script, [width, height]), np.float32)
    return np.where(values[..., 2:3] > 0.5, values[..., :2], np.nan).astype(float)


def drawn(page, width: int, height: int) -> np.ndarray:
    """The view (h, w, 4) as the shader draws it, RGBA."""
    script = f"""([w, h]) => {{
      const {{ look }} = window.omnimirror;
      const {{ view }} = look.viewIn(w, h);
      look.renderer.draw(view);
      const copy = new OffscreenCanvas(view.width, view.height).getContext("2d");
      copy.drawImage(look.renderer.canvas, 0, 0);
      const {{ data }} = copy.getImageData(0, 0, view.width, view.height);
      return {{ size: [view.width, view.height], values: ({BASE64})(data) }};
    }}"""
    return _values(page.evaluate(script, [width, height]), np.uint8)


def _values(found: dict, kind: type) -> np.ndarray:
    """What a script of the page gave, (h, w, 4)."""
    width, height = found["size"]
    return np.frombuffer(base64.b64decode(found["values"]), kind).reshape(height, width, 4)


def command(page, width: int, height: int) -> str:
    """The command line that the page shows for the view."""
    return page.evaluate("([w, h]) => window.omnimirror.look.viewIn(w, h).command", [width, height])


def look(page, **state) -> None:
    """Set what is looked at, by the state that the address holds too."""
    page.evaluate("(state) => window.omnimirror.store.set(state)", state)
