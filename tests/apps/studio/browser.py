"""Studio server in a thread, and a headless browser with software WebGL."""

from __future__ import annotations

import base64
import os
import shutil
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from omnimirror.apps.studio._server_state import Studio
from omnimirror.apps.studio.app import create_app
from tests.serving import served

# WebGL is used by the views only and not for compositing, because software rendering takes half of
# the time of most tests.
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
]
WEBGPU_FLAGS = [
    *(flag for flag in FLAGS if flag != "--disable-gpu-compositing"),  # 2D canvases copy the view
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
]
BROWSERS = (
    "chromium-headless-shell",
    "chromium",
    "google-chrome",
)  # the first is twice as fast as the others
FAKE_CAMERA = [
    "--use-fake-device-for-media-stream=device-count=2,fps=5",
    "--use-fake-ui-for-media-stream",
]  # granted
REFUSED_CAMERA = [FAKE_CAMERA[0], "--use-fake-ui-for-media-stream=deny"]
COARSE = {
    "device_scale_factor": 0.5
}  # half the resolution per side: software rendering takes 25 % of the time
TIMEOUT_MS = 300_000  # sufficient for slow machines
BASE64 = """(values) => {
  let text = "";
  const bytes = new Uint8Array(values.buffer);
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}"""
"""Large arrays as one base64 string, because Playwright takes 0.5 s for thousands of numbers."""


def serving(studio: Studio, port: int = 0) -> AbstractContextManager[str]:
    """Return the address of a running studio server."""
    return served(create_app(studio), port)


def chromium() -> str:
    """Return the path of the browser; skip the test if it is missing."""
    path = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if not path:
        pytest.skip("there is no chromium here, which the tests of the page drive")
    return path


def open_page(
    browser,
    url: str,
    width: int = 400,
    height: int = 400,
    script: str = "",
    *,
    asks: bool = False,
    **options,
):
    """Return a page after its first drawing, if its address has content; page errors fail the test
    that closes it.

    ``script`` runs before the scripts of the page, also after each reload. ``asks`` enables the
    question for the mirror type of new images.
    """
    # The page policy forbids eval, which waiting for functions requires; the policy is covered by a
    # separate test.
    viewport = {"width": width, "height": height}
    context = browser.new_context(viewport=viewport, bypass_csp=True, **COARSE | options)
    context.add_init_script(script)
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.problems = []
    page.on("pageerror", lambda e: page.problems.append(e.stack or str(e)))
    page.goto(url)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    if not asks:
        page.evaluate("window.omnimirror.look.first.known()")
    return page


def cancel_fit(page) -> None:
    """Wait for the question about an uncertain outline, and cancel it."""
    page.locator("#fit").get_by_role("button", name="Cancel").click()


def drop(page, path: Path) -> None:
    """Select a file as a user does."""
    page.set_input_files("#file", path)
    page.wait_for_function(f"window.omnimirror.look.feed?.name === {path.name!r}")


def coordinates(page, width: int, height: int) -> np.ndarray:
    """Return source pixels (h, w, 2) computed by the shader for the view; NaN outside the field."""
    script = f"""async ([w, h]) => {{
      const {{ look }} = window.omnimirror;
      const {{ view }} = look.viewIn(w, h);
      const values = await look.renderer.coordinates(view);
      return {{ size: [view.width, view.height], values: ({BASE64})(values) }};
    }}"""
    values = _values(page.evaluate(script, [width, height]), np.float32)
    return np.where(values[..., 2:3] > 0.5, values[..., :2], np.nan).astype(float)


def view_pixels(
    page, width: int, height: int, draw: str = "look.renderer.draw(view);"
) -> np.ndarray:
    """Return the view (h, w, 4) drawn by the shader, RGBA; ``draw`` is a script that draws it."""
    script = f"""async ([w, h]) => {{
      const {{ look }} = window.omnimirror;
      const {{ view }} = look.viewIn(w, h);
      {draw}
      const copy = new OffscreenCanvas(view.width, view.height).getContext("2d");
      copy.drawImage(look.renderer.canvas, 0, 0);
      const {{ data }} = copy.getImageData(0, 0, view.width, view.height);
      return {{ size: [view.width, view.height], values: ({BASE64})(data) }};
    }}"""
    return _values(page.evaluate(script, [width, height]), np.uint8)


def _values(result: dict, kind: type) -> np.ndarray:
    """Return the result of a page script, (h, w, 4)."""
    width, height = result["size"]
    return np.frombuffer(base64.b64decode(result["values"]), kind).reshape(height, width, 4)


def command(page, width: int, height: int) -> str:
    """Return the command line displayed for the view."""
    return page.evaluate("([w, h]) => window.omnimirror.look.viewIn(w, h).command", [width, height])


def set_state(page, **state) -> None:
    """Set the state of the view, as stored in the address."""
    page.evaluate("(state) => window.omnimirror.store.set(state)", state)
