"""Moving images: videos, webcams, streams and their recordings, and touch gestures."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import pages, video_viewer
from omnimirror.apps.studio._server_state import Sources, Studio
from tests.commands import fails, omnimirror
from tests.io.synthetic import make_video
from tests.io.test_live_sources import HEAD, paced
from tests.io.test_live_sources import server as streaming

from .browser import command, open_page, serving, set_state, view_pixels
from .images import write_video

BALL = "31.5,23.5,23,280"  # in the videos of 64 x 48 px
SHADES = (20, 235)


@pytest.fixture(scope="module")
def film(tmp_path_factory) -> Path:
    """A video in a browser format: dark for 1 s, then bright for 1 s."""
    path = tmp_path_factory.mktemp("film") / "ride.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"g": "1"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(20):
            image = np.full((48, 64, 3), SHADES[i // 10], np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    return path


COUNT_CHANGES = """
window.changes = 0;
let before = null;
const look = () => {
  const shade = window.omnimirror.look.feed.video.currentTime < 1;
  if (shade !== before) window.changes += 1;
  before = shade;
  requestAnimationFrame(look);
};
look();
"""  # from dark to bright and back


def wait_for_image(page, name: str) -> None:
    page.wait_for_function(f"window.omnimirror.look.feed?.name === {name!r}")
    page.wait_for_selector("#view:visible")


def shade(page) -> float:
    """Return the brightness of the centre of the view."""
    return float(np.median(view_pixels(page, 40, 30)[8:22, 10:30, :3]))


def test_video_is_paused_and_its_command_writes_a_video(browser, server, film, tmp_path):
    page = open_page(browser, f"{server}#sensor=ball:280&mode=perspective&tilt=-60&hfov=40")
    page.set_input_files("#file", film)
    wait_for_image(page, "ride.mp4")
    set_state(page, rim=[31.5, 23.5, 23])
    page.get_by_role("button", name="Pause").click()
    for second, expected in ((0.5, SHADES[0]), (1.5, SHADES[1])):
        page.evaluate(
            "(s) => { const t = document.querySelector('#time'); t.value = s; t.dispatchEvent(new Event('input')); }",
            second,
        )
        page.wait_for_function("!window.omnimirror.look.feed.video.seeking")
        while shade(page) != pytest.approx(expected, abs=6):  # the frame follows the seek
            page.wait_for_timeout(20)
    assert page.locator("#time-words").inner_text() == "0:01 of 0:02"
    page.locator("#view").focus()
    page.keyboard.press("Space")
    page.get_by_role("button", name="Pause").wait_for()

    line = command(page, 40, 30)
    (tmp_path / film.name).write_bytes(film.read_bytes())
    run = omnimirror(*shlex.split(line)[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    with av.open(str(tmp_path / "perspective.mp4")) as container:
        frames = [f.to_ndarray(format="gray") for f in container.decode(video=0)]
    assert len(frames) == 20
    assert [np.median(f[8:22, 10:30]) for f in (frames[5], frames[15])] == pytest.approx(
        SHADES, abs=6
    )
    page.context.close()


def test_standalone_viewer_plays_embedded_video(browser, film, tmp_path):
    page_file = tmp_path / "ride.html"
    run = omnimirror("dewarp", film, "--ball", BALL, "-o", page_file)
    assert run.returncode == 0, run.stderr
    page = open_page(browser, f"{page_file.as_uri()}#mode=perspective&tilt=-60&hfov=40")
    wait_for_image(page, "ride.mp4")
    assert shade(page) in (pytest.approx(SHADES[0], abs=6), pytest.approx(SHADES[1], abs=6))
    page.context.close()


@pytest.mark.full
def test_standalone_viewer_requests_large_video_once(browser, film, tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "MAX_EMBEDDED_BYTES", 100)
    video = tmp_path / "my rides" / film.name
    video.parent.mkdir()
    video.write_bytes(film.read_bytes())
    camera = om.MirrorBall(
        centre_px=(31.5, 23.5), rim_radius_px=23.0, field_deg=280.0, image_size=(64, 48)
    )
    page_file = tmp_path / "ride.html"
    page_file.write_text(video_viewer(camera, "ball", ("--ball", BALL), video, page_file))
    assert '"media":"my%20rides/ride.mp4"' in page_file.read_text()
    page = open_page(browser, page_file.as_uri())
    page.get_by_text("Drop ride.mp4 here").wait_for()
    page.set_input_files("#file", video)
    wait_for_image(page, "ride.mp4")
    page.wait_for_function("location.hash.includes('source=kept')")
    page.reload()
    wait_for_image(page, "ride.mp4")
    assert page.problems == []
    page.context.close()


def test_unsupported_videos_are_rejected(film, tmp_path):
    old = write_video(tmp_path / "old.mp4")
    assert "got mpeg4" in fails("dewarp", old, "--ball", BALL, "-o", tmp_path / "v.html")
    assert "must have 1024 x 1024 px" in fails(
        "dewarp", film, "--sensor", "paper-spherical", "-o", tmp_path / "v.html"
    )
    assert "browsers support (.mp4" in fails(
        "dewarp", write_video(tmp_path / "old.avi"), "--ball", BALL, "-o", tmp_path / "v.html"
    )
    assert not (tmp_path / "v.html").exists()


SMALL_CAMERA = """
const asked = MediaDevices.prototype.getUserMedia;
MediaDevices.prototype.getUserMedia = function ({ video }) {
  return asked.call(this, { video: { ...video, width: 320, height: 240 } });
};
"""  # software rendering is slow for full-size images


def test_selected_webcam_is_restored_on_reload(browser, server):
    page = open_page(
        browser, f"{server}#sensor=ball:280", script=SMALL_CAMERA, permissions=["camera"]
    )
    page.get_by_role("button", name="Webcam").click()
    page.wait_for_selector("#webcams:visible")
    first = page.evaluate("window.omnimirror.look.feed.device")
    webcam = page.evaluate(
        "(d) => [...document.querySelector('#webcams').options].find((o) => o.value !== d).value",
        first,
    )
    page.select_option("#webcams", webcam)
    page.wait_for_function("(d) => window.omnimirror.look.feed.device === d", arg=webcam)
    assert command(page, 40, 30).startswith("omnimirror dewarp 1 ")
    page.wait_for_function("(d) => location.hash.includes(d)", arg=webcam)
    name = page.evaluate("window.omnimirror.look.feed.name")
    page.reload()  # after which some browsers assign another identifier to the same camera
    page.wait_for_function("(n) => window.omnimirror?.look.feed?.name === n", arg=name)
    assert page.problems == []
    page.context.close()


@pytest.mark.full
def test_denied_webcam_is_reported_and_image_remains(browser_without_camera, server, film):
    page = open_page(browser_without_camera, f"{server}#sensor=ball:280")
    page.set_input_files("#file", film)
    wait_for_image(page, "ride.mp4")
    page.get_by_role("button", name="Webcam").click()
    page.wait_for_function(
        "document.querySelector('#banner').textContent.startsWith('Camera access was denied.')"
    )
    assert page.evaluate("window.omnimirror.look.feed.name") == "ride.mp4"
    page.context.close()


def test_recording_is_video_of_view(browser, server, film, tmp_path):
    page = open_page(
        browser, f"{server}#sensor=ball:280&mode=perspective&tilt=-60&hfov=40", 420, 380
    )
    page.set_input_files("#file", film)
    wait_for_image(page, "ride.mp4")
    page.evaluate("window.omnimirror.look.feed.video.playbackRate = 4")
    page.get_by_role("button", name="Record").click()
    page.evaluate(COUNT_CHANGES)
    page.wait_for_function("window.changes > 8")
    with page.expect_download() as download:
        page.get_by_role("button", name="Stop recording").click()
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    assert path.suffix == ".mp4"  # supported by this browser
    with av.open(str(path)) as video:
        frames = [f.to_ndarray(format="gray") for f in video.decode(video=0)]
    width, height = page.evaluate(
        """() => {
          const { width, height } = window.omnimirror.look.renderer.canvas;
          return [width, height];
        }"""
    )
    assert abs(frames[0].shape[1] - width) <= 1  # even sides only
    assert abs(frames[0].shape[0] - height) <= 1
    assert len(frames) > 2
    shades = [float(np.median(f[f.shape[0] // 3 : -(f.shape[0] // 3)])) for f in frames]
    assert max(shades) == pytest.approx(SHADES[1], abs=10)
    assert min(shades) == pytest.approx(SHADES[0], abs=10)
    page.context.close()


def test_touch_gestures_zoom_and_pan(browser, server, film):
    page = open_page(
        browser,
        f"{server}#sensor=ball:280&mode=perspective",
        has_touch=True,
        reduced_motion="reduce",
    )
    page.set_input_files("#file", film)
    wait_for_image(page, "ride.mp4")
    page.locator("#view").scroll_into_view_if_needed()
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    session = page.context.new_cdp_session(page)

    def touch(kind: str, *positions: tuple[float, float]) -> None:
        points = [{"x": px, "y": py, "id": i} for i, (px, py) in enumerate(positions)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def view_state() -> dict:
        return page.evaluate("window.omnimirror.store.state")

    touch("touchStart", (x - 20, y))
    touch("touchStart", (x - 20, y), (x + 20, y))
    touch("touchMove", (x - 30, y), (x + 30, y))
    touch("touchMove", (x - 40, y), (x + 40, y))
    touch("touchEnd")
    half = np.degrees(2 * np.arctan(np.tan(np.radians(45)) / 2))  # magnified twice
    assert view_state()["hfov"] == pytest.approx(half, abs=1.5)
    assert view_state()["pan"] == pytest.approx(0, abs=0.5)
    assert page.evaluate("visualViewport.scale") == 1  # the view is magnified, not the page
    touch("touchStart", (x, y))
    touch("touchMove", (x + 30, y))
    touch("touchEnd")
    assert view_state()["pan"] < -2
    page.context.close()


@pytest.mark.full
def test_lost_stream_is_reported_and_reopened(browser, tmp_path):
    transport = make_video(tmp_path / "a.ts", 100, with_audio=False).read_bytes()
    half = transport[: len(transport) // 2]
    with (
        streaming(
            [HEAD, *paced(half, 1.5)], [], [], [], [HEAD, *paced(transport, 4.0), 20.0]
        ) as url,
        serving(Studio(Sources([url], live=[url]))) as address,
    ):
        page = open_page(browser, f"{address}#sensor=ball:280")
        wait_for_image(page, url)
        page.wait_for_function(
            f"document.querySelector('#banner').textContent.startsWith('{url} is disconnected')"
        )
        page.wait_for_function("document.querySelector('#banner').hidden")  # plays again
        assert page.locator("#view").is_visible()
        assert command(page, 40, 30).startswith(f"omnimirror dewarp {url} ")
        assert page.problems == []
        page.context.close()


@pytest.mark.full
def test_video_of_server_resumes_after_restart(browser, tmp_path):
    studio = Studio(Sources([str(write_video(tmp_path / "ride.mp4", 100))]))
    with serving(studio) as address:
        page = open_page(browser, address)
        page.wait_for_function("window.omnimirror.look.feed?.name === 'ride.mp4'")
    port = int(re.search(r":(\d+)/", address)[1])
    page.wait_for_function(
        "document.querySelector('#banner').textContent.includes('does not respond')"
    )
    with serving(Studio(studio.sources), port):
        page.wait_for_function("document.querySelector('#banner').hidden")
    page.context.close()
