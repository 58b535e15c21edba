"""Interactive view in a notebook: its frame shows the Dewarper view without server requests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.image_sensor import Imager
from tests.apps.studio.browser import set_state, view_pixels
from tests.apps.studio.images import psnr

SENSOR = replace(om.load_sensor("paper-spherical"), imager=Imager(256, 256, 20.8))


def test_notebook_frame_displays_view(browser, tmp_path):
    """Embedding as in Jupyter: HTML in HTML, from another origin."""
    image = om.render_image(SENSOR, om.Room(texel_mm=20), samples=1)
    html = om.show(image, SENSOR, height_px=300)
    (tmp_path / "notebook.html").write_text(f"<p>In [1]</p>{html._repr_html_()}", encoding="utf-8")
    context = browser.new_context(viewport={"width": 700, "height": 500}, bypass_csp=True)
    page, problems = context.new_page(), []
    page.on("pageerror", lambda e: problems.append(str(e)))
    page.on("request", lambda r: problems.append(r.url) if r.url.startswith("http") else None)
    page.goto((tmp_path / "notebook.html").as_uri())
    frame = page.locator("iframe").element_handle().content_frame()
    frame.wait_for_function("window.omnimirror?.look.feed")
    set_state(frame, mode="perspective", pan=40, tilt=-10, hfov=60)
    pixels = view_pixels(frame, 160, 120)
    view = om.screens.Plane((160, 120), pan_deg=40, tilt_deg=-10, hfov_deg=60)
    expected = om.Dewarper(SENSOR, view)(image)
    assert psnr(pixels[..., :3], expected, pixels[..., 3] > 0) > 40
    assert not problems
    context.close()


def test_notebook_view_is_a_standalone_page(tmp_path):
    html = om.show(np.zeros((256, 256), np.uint8), SENSOR)
    html.save(tmp_path / "look.html")
    assert (tmp_path / "look.html").read_text() == html.page


def test_show_accepts_files(tmp_path):
    om.write_image(tmp_path / "a.png", np.full((256, 256, 3), 7, np.uint8))
    assert om.show(tmp_path / "a.png", SENSOR).page == om.show(str(tmp_path / "a.png"), SENSOR).page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"image": np.zeros((8, 8), np.uint8)},
            "must have 256 x 256 px, the image size of the camera; got 8 x 8 px",
        ),
        ({"image": [1, 2]}, "the image must be an array of uint8"),
        ({"camera": "paper-spherical"}, "camera must be a sensor or a camera"),
        ({"height_px": 5}, "height_px must be between 120 and 4000; got 5"),
    ],
)
def test_unsupported_objects_are_rejected(arguments, message):
    with pytest.raises(om.base.errors.InvalidParameter, match=message):
        om.show(**{"image": np.zeros((256, 256), np.uint8), "camera": SENSOR} | arguments)
