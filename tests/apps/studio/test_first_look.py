"""First view of an image: mirror detection, and selection of the mirror type by thumbnails."""

from __future__ import annotations

from urllib.parse import urlsplit

import av
import numpy as np
import pytest

from omnimirror.apps.studio._server_state import Sources, Studio
from omnimirror.io import read_image, write_image

from .browser import drop, open_page, serving, set_state, view_pixels
from .images import pattern, psnr

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
    page = open_page(browser, server, 1000, 900, asks=True)
    yield page
    assert page.problems == []
    page.context.close()


def state(page) -> dict:
    return page.evaluate("window.omnimirror.store.state")


def select_type(page, name: str) -> None:
    """Select a type of mirror by its thumbnail."""
    page.locator("#ask").wait_for(state="visible")
    page.locator("#ask .answers").get_by_role("button", name=name).click()


def drag_handle(page, name: str, right: float, down: float) -> None:
    """Drag a handle of the circle by a distance in screen px."""
    box = page.get_by_role("slider", name=name).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y + down, steps=4)
    page.mouse.up()


def test_mirror_is_detected_and_camera_type_requested_once(page, folder):
    """A user's ball in two clicks: its file, and the answer."""
    drop(page, folder / "ball.png")
    page.locator("#ask").wait_for(state="visible")
    assert state(page)["rim"] == CIRCLE
    sizes = page.evaluate("[...document.querySelectorAll('#ask canvas')].map((c) => c.height)")
    assert (sizes[0], sizes[4]) == (112, 84)  # fields of view of 180 and 135 deg, 224 px wide
    select_type(page, "Mirror ball camera level")
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


THUMBNAIL = """(i) => {
  const canvas = document.querySelectorAll("#ask canvas")[i];
  return [...canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data];
}"""


def test_thumbnails_agree_with_views_and_preview_is_temporary(page, folder):
    drop(page, folder / "ball.png")
    page.locator("#ask").wait_for(state="visible")
    before = state(page)
    (ball, _, _, convex, *_) = page.locator("#ask .answers button").all()
    thumbnail = np.reshape(page.evaluate(THUMBNAIL, 0), (112, 224, 4))
    ball.hover()
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:340'")
    view = view_pixels(page, 224, 112)
    assert psnr(thumbnail, view, view[..., 3] == 255) > 30
    convex.hover()
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:160'")
    page.locator("#modes").hover()
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'paper-spherical'")
    assert state(page) == before
    convex.focus()  # the keyboard also displays previews
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:160'")
    page.locator("#ask").get_by_role("button", name="Cancel").click()
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'paper-spherical'")
    assert page.locator("#ask").is_hidden()
    assert state(page) == before


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


def test_uncertain_outline_is_confirmed_or_corrected(page, folder):
    drop(page, folder / "waves.png")
    page.get_by_text("Is this the edge of the mirror?").wait_for()
    candidate = state(page)["rim"]
    page.wait_for_selector("#overlay .rim")  # dashed circle
    drag_handle(page, "Centre of the circle", 12, -8)
    moved = state(page)["rim"]
    assert moved[0] > candidate[0]
    assert moved[1] < candidate[1]
    page.get_by_role("button", name="Done").click()
    assert state(page)["rim"] == moved
    page.get_by_role("heading", name="Select the view that is upright").wait_for()
    page.locator("#ask").get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Fit circle").click()
    drag_handle(page, "Edge of the circle", 10, 10)
    assert state(page)["rim"][2] > moved[2]
    page.locator("#fit").get_by_role("button", name="Cancel").click()
    assert state(page)["rim"] == moved
    assert page.locator("#fit").is_hidden()


def test_outline_search_is_cancelled(page, folder):
    noise = np.random.default_rng(2).integers(0, 255, (1500, 1600, 3), np.uint8)
    write_image(folder / "noise.png", noise)
    drop(page, folder / "noise.png")
    page.locator("#busy-cancel").click()
    page.get_by_text("The circle is assumed; drag").wait_for()
    page.locator("#fit").get_by_role("button", name="Cancel").click()
    assert state(page)["rim"] is None
    assert page.locator("#busy").is_hidden()


def test_circle_set_during_the_search_is_kept(page, folder):
    """The answer of the server arrives after the user has set the circle."""
    answered = []
    with page.expect_request("**/api/outline*") as held:
        page.route("**/api/outline*", lambda route: answered.append(route))
        drop(page, folder / "ball.png")
    assert held.value.method == "POST"
    set_state(page, rim=[380.0, 220.0, 150.0])
    for route in answered:
        route.continue_()
    page.locator("#busy").wait_for(state="hidden")
    page.locator("#ask").wait_for(state="visible")  # the question that follows the outline
    assert state(page)["rim"] == [380.0, 220.0, 150.0]


def test_question_is_asked_after_outage(browser, folder):
    studio = Studio()
    with serving(studio) as address:
        page = open_page(browser, address, 1000, 900, asks=True)
        port = urlsplit(address).port
    drop(page, folder / "ball.png")
    page.locator("#banner").filter(has_text="does not respond").wait_for()
    assert page.locator("#ask").is_hidden()
    with serving(Studio(), port):
        page.locator("#ask").wait_for(state="visible")
        assert state(page)["rim"] == CIRCLE
    page.context.close()


def test_question_is_asked_for_videos_of_server(browser, folder):
    """The outline is detected in the current frame."""
    path = folder / "ball.mp4"
    image = read_image(folder / "ball.png")
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 700, 480, "yuv420p"
        for _ in range(20):
            frame = av.VideoFrame.from_ndarray(np.stack([image] * 3, axis=-1), format="rgb24")
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    with serving(Studio(Sources([str(path)]))) as address:
        page = open_page(browser, address, 1000, 900, asks=True)
        page.locator("#ask").wait_for(state="visible")
        assert state(page)["rim"] == [pytest.approx(c, abs=1) for c in (390, 215, 180)]
        select_type(page, "Mirror ball camera level")
        page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:340'")
        page.context.close()
