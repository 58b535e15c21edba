"""User interaction with the page, and the resulting display."""

from __future__ import annotations

import shlex
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import _look_routes
from omnimirror.apps.studio._server_state import Sources, Studio
from omnimirror.apps.studio._uploads import encoded
from omnimirror.io import read_image, write_image
from tests.commands import fails, omnimirror

from .browser import cancel_fit, command, drop, open_page, serving, set_state, view_pixels
from .images import pattern, psnr, python_view

WEB = Path(__file__).parents[3] / "web"
AXE = WEB / "node_modules" / "axe-core" / "axe.min.js"


DROP_UNREADABLE = """(name) => {
  const file = Object.assign(new File(["x"], name), {
    slice: () => ({ arrayBuffer: () => Promise.reject(new DOMException("gone", "NotReadableError")) }),
  });
  document.dispatchEvent(Object.assign(new Event("drop", { cancelable: true }), { dataTransfer: { files: [file] } }));
}"""
"""Drop a file that has been deleted in the meantime."""


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    """An image of a room with signs on its walls."""
    path = tmp_path_factory.mktemp("room") / "circle.png"
    write_image(
        path, om.render_image(om.load_sensor("paper-spherical"), om.Room(texel_mm=15.0), samples=1)
    )
    return path


@pytest.fixture
def coarse_room(monkeypatch) -> None:
    """Render the demo room with one sample per pixel."""
    render = lambda sensor: om.render_image(sensor.camera, om.Room(texel_mm=15.0), samples=1)  # noqa: E731
    monkeypatch.setattr(_look_routes, "render_room", lambda sensor: encoded(render(sensor), ".png"))


def state(page) -> dict:
    return page.evaluate("window.omnimirror.store.state")


def test_empty_page_offers_demo_room_with_correct_handedness(browser, server, room, coarse_room):
    page = open_page(browser, server)
    assert page.get_by_text("Drop an image or video here").is_visible()
    page.get_by_role("button", name="Try the demo room").click()
    page.wait_for_function("window.omnimirror.look.feed")
    assert page.locator("#view").is_visible()
    set_state(page, mode="perspective", hfov=70, tilt=8)
    pixels = cv2.cvtColor(view_pixels(page, 280, 210), cv2.COLOR_RGBA2GRAY)
    upright = om.Dewarper(
        om.load_sensor("paper-spherical"), om.screens.Plane((280, 210), 0, 8, 0, 70), "cubic"
    )
    sign = cv2.cvtColor(upright(read_image(room)), cv2.COLOR_RGB2GRAY)
    correct, mirrored = (
        cv2.matchTemplate(pixels, s, cv2.TM_CCOEFF_NORMED).max()
        for s in (sign, sign[:, ::-1].copy())
    )
    assert correct > 0.95
    assert correct > mirrored + 0.1
    assert page.problems == []
    page.context.close()


def test_view_controls_work_and_survive_reload(browser, server, room):
    page = open_page(browser, f"{server}#mode=perspective", reduced_motion="reduce")
    drop(page, room)
    page.wait_for_selector("#view:visible")
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 30)
    page.mouse.up()
    view_state = state(page)
    assert view_state["pan"] < -5  # the centre moved to the right with the pointer
    assert view_state["tilt"] > 2
    page.mouse.wheel(0, -300)
    page.wait_for_function(f"window.omnimirror.store.state.hfov < {view_state['hfov'] - 5}")
    page.locator("#view").focus()
    page.keyboard.press("ArrowRight")
    assert state(page)["pan"] > view_state["pan"]
    page.keyboard.press("3")
    assert state(page)["mode"] == "dome"
    page.keyboard.press("2")

    circle = page.locator("#overlay")
    box = circle.bounding_box()
    circle.scroll_into_view_if_needed()
    circle.dblclick(
        position={"x": box["width"] * 0.8, "y": box["height"] * 0.5}
    )  # left of the room
    rays = om.load_sensor("paper-spherical").backproject([[1024 * 0.8 - 0.5, 511.5]])
    direction = rays.directions[0]
    assert state(page)["pan"] == pytest.approx(
        np.degrees(np.arctan2(-direction[1], direction[0])), abs=1
    )
    assert state(page)["tilt"] == pytest.approx(np.degrees(np.arcsin(direction[2])), abs=1)

    before = state(page)
    page.wait_for_function(
        f"location.hash.includes('pan={before['pan']}') && location.hash.includes('source=kept')"
    )
    page.reload()
    page.wait_for_function("window.omnimirror?.look.feed")
    assert state(page) == before
    assert page.problems == []
    page.context.close()


def loupe_pixels(page, x: int, y: int) -> np.ndarray:
    """Return the colour (3,) at a screen offset from the loupe centre, magnified four times."""
    script = """([x, y]) => {
      const loupe = document.querySelector(".loupe");
      if (loupe.hidden) throw new Error("there is no loupe");
      const scale = 4 * document.querySelector("#overlay").getScreenCTM().a;
      const at = [x, y].map((d) => Math.round(66 + d * scale / 4));
      return [...loupe.getContext("2d").getImageData(...at, 1, 1).data.slice(0, 3)];
    }"""
    return np.array(page.evaluate(script, [x, y]), float)


def test_circle_is_fitted_by_dragging_handles(browser, server, tmp_path):
    write_image(tmp_path / "other.png", pattern((500, 400)))
    page = open_page(browser, server, 1000, 900, device_scale_factor=1)
    drop(page, tmp_path / "other.png")
    cancel_fit(page)
    page.get_by_role("button", name="Fit circle").click()
    page.wait_for_selector("#overlay .handle")
    to_screen = "([u, v]) => { const p = new DOMPoint(u, v).matrixTransform(document.querySelector('#overlay').getScreenCTM()); return [p.x, p.y]; }"  # noqa: E501
    page.mouse.move(*page.evaluate(to_screen, [249.5, 199.5]))
    page.mouse.down()
    page.mouse.move(*page.evaluate(to_screen, [279.5, 189.5]))
    assert np.abs(loupe_pixels(page, 12, 20) - pattern((500, 400))[193, 282]).max() < 8
    page.mouse.up()
    assert page.locator(".loupe").is_hidden()
    u, v, radius = state(page)["rim"]
    assert (u, v) == (pytest.approx(279.5, abs=1), pytest.approx(189.5, abs=1))
    assert radius == 192
    page.get_by_label("Radius").fill("150")
    page.keyboard.press("Enter")
    assert state(page)["rim"][2] == 150
    page.context.close()


@pytest.mark.full
def test_circle_is_detected_with_one_click(browser, server, tmp_path):
    """Image of another size than the sensor's, off its centre."""
    v, u = np.mgrid[:480, :700]
    azimuth = np.arctan2(v - 215, u - 390)
    disc = np.where(np.hypot(u - 390, v - 215) < 180, 120 + 80 * np.sign(np.sin(11 * azimuth)), 12)
    write_image(tmp_path / "off.png", disc.astype(np.uint8))
    page = open_page(browser, server, 1000, 900)
    drop(page, tmp_path / "off.png")
    page.wait_for_function("window.omnimirror.store.state.rim")
    set_state(page, rim=None)
    page.get_by_text("is assumed: fit the circle").wait_for()
    page.get_by_role("button", name="Detect circle").click()
    page.get_by_text("Circle detected; confidence 9").wait_for()
    assert state(page)["rim"] == [
        pytest.approx(390, abs=0.5),
        pytest.approx(215, abs=0.5),
        pytest.approx(180, abs=0.5),
    ]
    page.get_by_text("is assumed").wait_for(state="detached")
    page.context.close()


@pytest.mark.full
def test_circle_is_fitted_by_keyboard(browser, server, tmp_path):
    write_image(tmp_path / "other.png", pattern((500, 400)))
    page = open_page(browser, server, 1000, 900)
    drop(page, tmp_path / "other.png")
    cancel_fit(page)
    page.get_by_text("is assumed: fit the circle").wait_for()
    small = page.locator("#overlay").bounding_box()["width"]
    page.get_by_role("button", name="Fit circle").click()
    page.wait_for_selector("#overlay .handle")
    assert page.locator("#overlay").bounding_box()["width"] > 1.5 * small
    centre = page.get_by_role("slider", name="Centre of the circle")
    centre.press("ArrowRight")
    centre.press("Shift+ArrowUp")
    page.wait_for_function("window.omnimirror.store.state.rim?.join() === '250.5,189.5,192'")
    page.get_by_role("slider", name="Edge of the circle").press("ArrowLeft")
    page.wait_for_function("window.omnimirror.store.state.rim?.join() === '250.5,189.5,191'")
    page.wait_for_selector("#overlay [aria-valuetext='191.0 px']")
    page.get_by_text("is assumed").wait_for(state="detached")
    page.get_by_role("button", name="Fit circle").click()
    assert page.locator("#overlay").bounding_box()["width"] == pytest.approx(small)
    page.context.close()


def test_first_tab_key_skips_header(browser, server, room):
    page = open_page(browser, server)
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "stage"
    assert page.evaluate("location.hash") == ""
    page.context.close()


@pytest.mark.full
def test_files_named_by_command_exist_or_are_offered(browser, server, coarse_room, tmp_path):
    page = open_page(browser, f"{server}#source=room")
    page.wait_for_selector("#command:visible")
    assert "save circle.png first" in page.locator("#command-title").inner_text()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save image").click()
    download.value.save_as(tmp_path / download.value.suggested_filename)
    set_state(page, mode="perspective", hfov=60)
    line = command(page, 96, 72)
    run = omnimirror(*shlex.split(line)[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    expected, pixels = read_image(tmp_path / "perspective.png"), view_pixels(page, 96, 72)
    assert (
        psnr(pixels[..., :3], expected[..., :3], (pixels[..., 3] > 0) & (expected[..., 3] > 0)) > 40
    )
    write_image(tmp_path / "--output=x.png", pattern((64, 64)))
    drop(page, tmp_path / "--output=x.png")
    arguments = shlex.split(command(page, 96, 72))
    assert arguments[2] == "./--output=x.png"
    page.get_by_role(
        "button", name="Save sensor file"
    ).wait_for()  # the same sensor with a smaller imager
    assert page.get_by_role("button", name="Save image").is_hidden()
    page.context.close()


@pytest.mark.full
def test_server_images_have_relative_paths(browser, tmp_path, monkeypatch):
    (tmp_path / "room").mkdir()
    write_image(tmp_path / "room" / "circle.png", pattern((1024, 1024)))
    monkeypatch.chdir(tmp_path)
    with serving(Studio(Sources(["room/circle.png"], [tmp_path / "room"]))) as address:
        page = open_page(browser, address)
        page.wait_for_selector("#command:visible")
        assert shlex.split(command(page, 96, 72))[2] == "room/circle.png"
        page.locator("#sources").select_option("0/circle.png")
        page.wait_for_function("window.omnimirror.store.state.source === 'server:0/circle.png'")
        assert shlex.split(command(page, 96, 72))[2] == "room/circle.png"
        page.context.close()


def test_cameras_of_server_are_selectable_and_linked(browser, tmp_path):
    files = [str(tmp_path / f"{name}.png") for name in ("door", "yard", "hall")]
    for grey, path in zip((60, 120, 180), files, strict=True):
        write_image(path, np.full((300, 300, 3), grey, np.uint8))
    with serving(Studio(Sources([*files, files[0]]))) as address:
        page = open_page(browser, f"{address}#sensor=ball:280")
        page.wait_for_function("window.omnimirror.look.feed?.name === 'door.png'")
        assert page.locator("#sources option").all_inner_texts()[-3:] == [
            "door.png",
            "yard.png",
            "hall.png",
        ]
        page.locator("#sources").select_option(label="hall.png")
        page.wait_for_function("window.omnimirror.look.feed?.name === 'hall.png'")
        page.reload()
        page.wait_for_function("window.omnimirror?.look.feed?.name === 'hall.png'")
        page.context.close()


@pytest.mark.full
@pytest.mark.parametrize("distance", [None, 400])
def test_minified_view_matches_command_line(distance, browser, server, room, tmp_path):
    page = open_page(browser, server)
    drop(page, room)
    (tmp_path / "circle.png").write_bytes(room.read_bytes())
    for mode in ("panorama", "dome", "ground", "perspective"):
        set_state(page, mode=mode, hfov=120, distance=distance or float("inf"))
        dewarper = python_view(command(page, 240, 180), tmp_path)
        pixels, expected = view_pixels(page, 240, 180), dewarper(read_image(room))
        both = (pixels[..., 3] > 0) & (expected.max(axis=-1) > 0)
        assert psnr(pixels[..., :3], expected, both) > 40, mode
    page.context.close()


def test_snapshot_contains_equivalent_command(browser, server, room, tmp_path):
    page = open_page(browser, f"{server}#mode=perspective&pan=35&tilt=-12&hfov=45")
    drop(page, room)
    page.wait_for_selector("#view:visible")
    with page.expect_download() as download:
        page.get_by_role("button", name="Snapshot").click()
    download.value.save_as(tmp_path / "snapshot.png")
    data = (tmp_path / "snapshot.png").read_bytes()
    offset = data.index(b"iTXtComment")
    (length,) = struct.unpack(">I", data[offset - 4 : offset])
    line = data[offset + 4 : offset + 4 + length].split(b"\0")[-1].decode()
    (tmp_path / "circle.png").write_bytes(room.read_bytes())
    run = omnimirror(*shlex.split(line)[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    result, expected = (
        read_image(tmp_path / "snapshot.png"),
        read_image(tmp_path / "perspective.png"),
    )
    assert result.shape == expected.shape
    assert (
        psnr(result[..., :3], expected[..., :3], (result[..., 3] > 0) & (expected[..., 3] > 0)) > 38
    )
    page.context.close()


@pytest.mark.full
@pytest.mark.parametrize("mode", ["panorama", "perspective", "dome", "planet", "ground", "mosaic"])
def test_displayed_commands_reproduce_views(mode, browser, server, tmp_path):
    page = open_page(browser, f"{server}#mode={mode}&pan=35&tilt=-12&hfov=70&zoom=1.5&distance=800")
    write_image(tmp_path / "circle.png", pattern((1024, 1024)))
    drop(page, tmp_path / "circle.png")
    page.wait_for_selector("#view:visible")
    run = omnimirror(*shlex.split(command(page, 320, 240))[1:], cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    pixels, expected = view_pixels(page, 320, 240), read_image(tmp_path / f"{mode}.png")
    assert pixels.shape == expected.shape
    assert ((pixels[..., 3] > 0) != (expected[..., 3] > 0)).mean() < 0.002
    assert (
        psnr(pixels[..., :3], expected[..., :3], (pixels[..., 3] > 0) & (expected[..., 3] > 0)) > 40
    )
    page.context.close()


def test_invalid_files_are_reported_and_image_remains(browser, server, room, tmp_path):
    page = open_page(browser, server)
    drop(page, room)
    (tmp_path / "notes.png").write_text("no picture")
    page.set_input_files("#file", tmp_path / "notes.png")
    page.wait_for_selector("#banner:visible")
    assert "notes.png: it must be an undamaged image file" in page.locator("#banner").inner_text()
    assert page.evaluate("window.omnimirror.look.feed.name") == room.name
    (tmp_path / "bad.toml").write_text("[mirror]\nkind = 'spher'\n[lens]\n[imager]\n")
    page.set_input_files("#calibration", tmp_path / "bad.toml")
    page.wait_for_function(
        "document.querySelector('#banner').textContent.includes('did you mean sphere?')"
    )
    for name in ("gone.png", "gone.toml", "gone.omnimirror"):
        page.evaluate(DROP_UNREADABLE, name)
        page.wait_for_function(
            f"document.querySelector('#banner').textContent.includes('{name} cannot be read.')"
        )
    assert page.evaluate("window.omnimirror.look.feed.name") == room.name
    assert page.problems == []
    page.evaluate("Promise.reject(new RangeError('nobody handles this')), null")
    page.wait_for_function(
        "document.querySelector('#banner').textContent.includes('An internal error occurred')"
    )
    page.context.close()


def test_standalone_viewer_matches_command_line(browser, room, tmp_path):
    viewer = tmp_path / "look.html"
    run = omnimirror(
        "dewarp", room, "--sensor", "paper-spherical", "--camera-looks", "down", "-o", viewer
    )
    assert run.returncode == 0, run.stderr
    page = open_page(browser, f"{viewer.as_uri()}#mode=perspective&pan=60&tilt=20&hfov=50")
    page.wait_for_function("window.omnimirror.look.feed")
    (tmp_path / "circle.png").write_bytes(room.read_bytes())
    line = command(page, 200, 150)
    assert "--camera-looks down" in line
    expected = python_view(line, tmp_path)(read_image(room))
    pixels = view_pixels(page, 200, 150)
    both = (pixels[..., 3] > 0) & (expected.max(axis=-1) > 0)
    assert psnr(pixels[..., :3], expected, both) > 40
    assert not page.get_by_role("button", name="Webcam").is_visible()
    assert not page.get_by_role("button", name="Design").is_visible()
    assert page.problems == []
    page.context.close()


def test_viewer_rejects_invalid_image(tmp_path):
    write_image(tmp_path / "small.png", np.zeros((8, 8, 3), np.uint8))
    sensor = ("--sensor", "paper-spherical")
    assert "1024 x 1024" in fails(
        "dewarp", tmp_path / "small.png", *sensor, "-o", tmp_path / "v.html"
    )
    assert "the file does not exist" in fails(
        "dewarp", tmp_path / "ride.png", *sensor, "-o", tmp_path / "v.html"
    )
    assert "requires one image or one video file" in fails(
        "dewarp", "rtsp://door/1", *sensor, "-o", tmp_path / "v.html"
    )
    assert not (tmp_path / "v.html").exists()


def test_page_respects_content_security_policy(browser, server):
    """Under the content security policy, no function of the page is blocked."""
    context = browser.new_context()
    page = context.new_page()
    messages = []
    page.on("console", lambda m: messages.append(m.text))
    page.goto(server)
    page.get_by_text("Drop an image or video here").wait_for()
    assert [text for text in messages if "Content Security Policy" in text] == []
    context.close()


@pytest.mark.full
def test_narrow_page_has_no_overflow(browser, server, room):
    page = open_page(browser, server, 360, 740, device_scale_factor=1)
    header = page.locator("header")
    for mode in ("panorama", "perspective", "ground", "mosaic"):
        set_state(page, mode=mode)
        assert page.evaluate("document.scrollingElement.scrollWidth") == 360, mode
        assert header.bounding_box()["height"] < 60  # one row
        if mode == "panorama":
            drop(page, room)
            page.get_by_role("button", name="Fit circle").click()
    set_state(page, sensor="ball:300")
    page.wait_for_selector("#ball-row:visible")
    set_state(page, tab="design")
    page.wait_for_selector("#design .compare tbody td")
    assert header.bounding_box()["height"] < 60
    page.get_by_role("button", name="Export…").click()
    dialog = page.get_by_role("dialog", name="Export")
    dialog.get_by_role("button", name="Download Drawing (PDF)").scroll_into_view_if_needed()
    assert page.evaluate("document.scrollingElement.scrollWidth") == 360
    page.keyboard.press("Escape")
    set_state(page, tab="look")
    selector = ":is(main, header) [hidden]:not([type=file])"
    page.evaluate(
        "(ever) => document.querySelectorAll(ever).forEach((e) => (e.hidden = false))", selector
    )
    assert (
        page.evaluate("document.scrollingElement.scrollWidth") == 360
    )  # with all optional elements
    page.context.close()


@pytest.mark.parametrize(
    ("is_empty", "scheme"),
    [
        pytest.param(True, "light", id="empty, light", marks=pytest.mark.full),
        pytest.param(True, "dark", id="empty, dark", marks=pytest.mark.full),
        pytest.param(False, "light", id="with a picture, light", marks=pytest.mark.full),
        pytest.param(False, "dark", id="with a picture, dark"),
    ],
)
def test_accessibility(is_empty, scheme, browser, server, room):
    if not AXE.exists():
        pytest.skip("axe-core is not here: `npm ci` in web/, or `make node`, fetches it")
    page = open_page(browser, server, color_scheme=scheme)
    if not is_empty:
        drop(page, room)
        page.get_by_role("button", name="Fit circle").click()
    page.add_script_tag(path=AXE)
    violations = page.evaluate(
        "axe.run({ rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"
    )
    serious = {
        v["id"]: v["nodes"][0]["html"] for v in violations if v["impact"] in ("serious", "critical")
    }
    assert serious == {}
    page.context.close()
