"""First view of an image: automatic mirror detection, and a single question about the camera."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.io import write_image

from .browser import drop, open_page, set_state
from .images import pattern

CIRCLE = [pytest.approx(390, abs=0.5), pytest.approx(215, abs=0.5), pytest.approx(180, abs=0.5)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A mirror off the image centre, the same under other illumination, and an image without a
    mirror."""
    folder = tmp_path_factory.mktemp("pictures")
    v, u = np.mgrid[:480, :700]
    azimuth = np.arctan2(v - 215, u - 390)
    disc = np.where(np.hypot(u - 390, v - 215) < 180, 120 + 80 * np.sign(np.sin(11 * azimuth)), 12)
    write_image(folder / "ball.png", disc.astype(np.uint8))
    write_image(folder / "evening.png", (0.8 * disc[:470]).astype(np.uint8))
    write_image(folder / "waves.png", pattern((500, 400)))
    return folder


@pytest.fixture
def page(browser, server):
    page = open_page(browser, server, 1000, 900)
    yield page
    assert page.problems == []
    page.context.close()


def state(page) -> dict:
    return page.evaluate("window.omnimirror.store.state")


def test_mirror_is_detected_and_camera_type_requested_once(page, folder):
    """A user's ball in two clicks: its file, and the answer."""
    drop(page, folder / "ball.png")
    page.get_by_text("The mirror was detected").wait_for()
    assert state(page)["rim"] == CIRCLE
    page.get_by_role("button", name="A mirror ball").click()
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:340'")
    assert state(page)["rim"] == CIRCLE
    assert (state(page)["looks"], state(page)["pan"]) == (
        "forward",
        -180,
    )  # direction of the photographer
    assert page.locator("#ask").is_hidden()
    page.get_by_text("Mirror detected automatically,").wait_for()
    page.wait_for_function(
        "document.querySelector('#command-line').textContent.includes('--ball 39')"
    )
    drop(page, folder / "evening.png")
    page.wait_for_function("Math.abs(window.omnimirror.store.state.rim?.[0] - 390) < 1")
    assert page.locator("#ask").is_hidden()  # already known


@pytest.mark.full
def test_changing_camera_keeps_detected_circle(page, folder):
    drop(page, folder / "ball.png")
    page.wait_for_function("window.omnimirror.store.state.rim")
    page.locator("#sensor").select_option("ball:340")
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:340'")
    page.wait_for_function("window.omnimirror.store.state.rim")
    assert state(page)["rim"] == CIRCLE
    set_state(page, rim=[380.0, 215.0, 180.0])
    page.get_by_text("Mirror detected automatically,").wait_for(state="detached")


def test_uncertain_outline_is_reported(page, folder):
    drop(page, folder / "waves.png")
    page.get_by_text("The mirror outline in this image is uncertain").wait_for()
    assert state(page)["rim"] is None
    page.get_by_role("button", name="Fit it manually").click()
    page.wait_for_selector("#overlay .handle")
    assert page.locator("#ask").is_hidden()
