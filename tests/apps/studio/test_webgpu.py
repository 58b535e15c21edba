"""Views drawn with WebGPU against those drawn with WebGL2 and by the Python dewarper, and the choice
of the renderer."""

from __future__ import annotations

import av
import numpy as np
import pytest

import omnimirror as om
from omnimirror.io import write_image
from tests.everyday import few

from .browser import FLAGS, WEBGPU_FLAGS, drop, open_page, set_state, view_pixels
from .images import pattern
from .test_moving import wait_for_image
from .test_view import CALIBRATED, STATES, check, choose, load

SIZE = (
    121,
    91,
)  # odd: the rows of blocks that share derivatives depend on the direction of drawing
ROOM_STATE = "sensor=paper-spherical&source=room&mode=perspective&pan=40&hfov=75"
NOISE = np.random.default_rng(3).integers(0, 256, (480, 640, 4)).astype(np.uint8)
IMAGES = {"smooth": pattern((640, 480)), "noise": NOISE[..., :3], "transparent": NOISE}
RESTING = {"zoom": 1, "tilt": 0, "distance": float("inf")}
DRAWINGS = {
    "resting": "look.renderer.draw(view);",
    "moving": "look.renderer.draw(view, true);",
    "several cameras": """
      const half = Math.floor(view.height / 2);
      const parts = view.parts.map((part) => ({ ...part, height: half }));
      const below = parts.map((part) => ({ ...part, top: half }));
      const turned = look.camera.tilted({ pitch: 20, roll: -10 });
      const sheet = [{ camera: look.camera, parts }, { camera: turned, parts: below }];
      look.renderer.drawSheet(sheet, view.width, view.height);""",
    "restored image": """
      const other = new OffscreenCanvas(look.feed.width, look.feed.height);
      const context = other.getContext("2d");
      context.filter = "invert(1)";
      context.drawImage(look.feed.image, 0, 0);
      const restored = await createImageBitmap(other, { premultiplyAlpha: "none" });
      look.renderer.setRestored(restored);
      look.renderer.draw(view, false, 0.4);
      look.renderer.setRestored(null);""",
    "another image": """
      const image = document.createElement("canvas");
      [image.width, image.height] = [90, 70];
      const context = image.getContext("2d");
      for (let x = 0; x < 90; x++) {
        context.fillStyle = `rgb(${2 * x} ${255 - 2 * x} ${(37 * x) % 256})`;
        context.fillRect(x, 0, 1, 70);
      }
      const feed = { image, width: 90, height: 70 };
      const camera = look.camera.fitted({ u: 44, v: 35, radius: 33 }, [90, 70]);
      const parts = view.parts.map((part) => ({ ...part, width: Math.floor(view.width / 2) }));
      look.renderer.draw(view);
      look.renderer.add({ ...view, parts }, { camera, feed }, "other");
      look.renderer.retainImages([]);""",
}


def open_renderer(browser, server: str, name: str, state: str = ""):
    """Return a page that draws with the named renderer; skip the test without an adapter."""
    page = open_page(browser, f"{server}?renderer={name.lower()}#{state}")
    page.add_style_tag(
        content="#frame { height: 30px !important; min-height: 0 !important; max-width: 40px }"
    )
    has_adapter = "navigator.gpu?.requestAdapter().then((adapter) => adapter !== null) ?? false"
    if name == "WebGPU" and not page.evaluate(has_adapter):
        page.context.close()
        pytest.skip("this browser has no adapter for WebGPU")
    assert selected_renderer(page) == name
    return page


def selected_renderer(page) -> str:
    """Return the name of the renderer after its selection."""
    return page.evaluate(
        """async () => {
          await window.omnimirror.look.drawing.selected;
          return window.omnimirror.look.renderer.name;
        }"""
    )


@pytest.fixture(scope="module")
def webgpu_browser(launched):
    browser = launched(WEBGPU_FLAGS)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def renderers(webgpu_browser, server):
    """Two pages, with WebGL2 and with WebGPU."""
    pages = [open_renderer(webgpu_browser, server, name) for name in ("WebGL2", "WebGPU")]
    yield pages
    for page in pages:
        assert page.problems == []
        page.context.close()


def check_equal(pages, states, drawing: str = DRAWINGS["resting"]) -> None:
    """Check that the views of both pages differ by at most one grey level."""
    for name in states:
        views = []
        for page in pages:
            set_state(page, **RESTING | STATES[name])
            views.append(view_pixels(page, *SIZE, draw=drawing).astype(int))
        assert views[0][..., :3].std() > 10, name
        difference = np.abs(views[0] - views[1])
        assert difference.max() <= 1, f"{name}: {difference.max()} grey levels"


@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("drawing", DRAWINGS)
def test_renderers_differ_by_at_most_one_grey_level(image, drawing, renderers, tmp_path):
    write_image(tmp_path / f"{image}.png", IMAGES[image])
    for page in renderers:
        drop(page, tmp_path / f"{image}.png")
        choose(page, "ball:280", looks="forward")
        set_state(page, rim=[330.5, 251.25, 215.0])
    states = STATES if drawing in ("resting", "moving") else ("perspective", "near panorama")
    check_equal(renderers, states, DRAWINGS[drawing])


@pytest.mark.parametrize("camera", few(CALIBRATED, "not-central-stretched"))
def test_renderers_agree_for_cameras_without_symmetry(camera, renderers, tmp_path):
    path, image = tmp_path / f"{camera}.toml", tmp_path / "image.png"
    om.save_camera(CALIBRATED[camera], path)
    write_image(image, pattern(CALIBRATED[camera].image_size))
    for page in renderers:
        set_state(page, rim=None, looks=None)
        drop(page, image)
        load(page, path)
    check_equal(renderers, ("panorama", "near wall", "near dome"))


def test_renderers_agree_for_video_frames(renderers, tmp_path):
    """Untagged videos of this size have the primaries of BT.601, which WebGPU converts."""
    path, image = tmp_path / "colours.mp4", pattern((320, 240))
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"g": "1"})
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for i in range(10):
            frame = av.VideoFrame.from_ndarray(np.roll(image, 20 * i, axis=1), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    views = []
    for page in renderers:
        choose(page, "ball:280", looks="forward")
        page.set_input_files("#file", path)
        wait_for_image(page, path.name)
        set_state(page, rim=[160, 120, 110], **RESTING | STATES["perspective"])
        page.evaluate(
            """async () => {
              const { video } = window.omnimirror.look.feed;
              video.pause();
              video.currentTime = 0.55;
              await new Promise((done) => video.addEventListener("seeked", done, { once: true }));
              window.omnimirror.look.refresh(true);
            }"""
        )
        views.append(view_pixels(page, *SIZE).astype(int))
    assert views[0][..., :3].std(axis=(0, 1)).min() > 10
    assert np.abs(views[0] - views[1]).max() <= 1


@pytest.mark.parametrize("states", [("panorama", "near wall", "dome")])
def test_views_with_webgpu_match_command_line(states, renderers, tmp_path):
    page = renderers[1]
    choose(page, "paper-hyperboloidal")
    check(page, tmp_path, om.load_sensor("paper-hyperboloidal").image_size, states)
    camera = CALIBRATED["not-central-stretched"]
    om.save_camera(camera, tmp_path / "stretched.toml")
    set_state(page, looks=None)
    load(page, tmp_path / "stretched.toml")
    check(page, tmp_path, camera.image_size, states)


def test_lost_device_is_replaced_by_webgl2(webgpu_browser, server):
    page = open_renderer(webgpu_browser, server, "WebGPU", ROOM_STATE)
    page.wait_for_selector("#view:visible")
    assert page.locator("#renderer").text_content() == "The view is drawn with WebGPU."
    before, address = view_pixels(page, *SIZE), page.url
    page.evaluate("window.omnimirror.look.renderer.device.destroy()")
    page.wait_for_function("window.omnimirror.look.renderer.name === 'WebGL2'")
    assert page.locator("#renderer").text_content() == "The view is drawn with WebGL2."
    assert np.abs(view_pixels(page, *SIZE).astype(int) - before).max() <= 1
    assert page.url == address
    assert page.locator("#view > canvas").count() == 1
    set_state(page, pan=-30)  # the view follows further changes
    assert np.abs(view_pixels(page, *SIZE).astype(int) - before).max() > 50
    assert page.problems == []
    page.context.close()


@pytest.mark.parametrize("choice", ["webgl2", "", "webgpu without its script"])
def test_webgl2_draws_where_webgpu_is_not_used(choice, webgpu_browser, server):
    """By request, with a software adapter, which is used only on request, and after a failure."""
    page = open_page(webgpu_browser, server)
    fetched = []
    page.on("request", lambda request: fetched.append(request.url))
    page.route("**/webgpu.js", lambda route: route.abort())
    page.goto(f"{server}?renderer={choice.split(' ')[0]}#{ROOM_STATE}")
    page.wait_for_selector("#view:visible")
    assert selected_renderer(page) == "WebGL2"
    assert any(url.endswith("/webgpu.js") for url in fetched) == choice.startswith("webgpu")
    assert view_pixels(page, *SIZE)[..., 3].all()
    assert page.problems == []
    page.context.close()


@pytest.mark.parametrize("flags", [[], WEBGPU_FLAGS[3:]], ids=["no adapter", "no GPU compositing"])
def test_webgl2_draws_where_webgpu_is_missing_or_unusable(flags, launched, server):
    """Without compositing on the GPU, 2D canvases cannot copy a WebGPU canvas."""
    browser = launched([*FLAGS, *flags])
    page = open_page(browser, f"{server}?renderer=webgpu#{ROOM_STATE}")
    page.wait_for_selector("#view:visible")
    assert selected_renderer(page) == "WebGL2"
    is_tried = "performance.getEntriesByType('resource').some((e) => e.name.endsWith('webgpu.js'))"
    assert page.evaluate(is_tried) == bool(flags)
    assert view_pixels(page, *SIZE)[..., 3].all()
    assert page.problems == []
    browser.close()


def test_page_with_an_embedded_image_draws_with_webgl2(webgpu_browser, tmp_path):
    om.show(pattern((1024, 1024)), om.load_sensor("paper-spherical")).save(tmp_path / "page.html")
    page = webgpu_browser.new_page()
    fetched = []
    page.on("request", lambda request: fetched.append(request.url))
    page.goto(f"{(tmp_path / 'page.html').as_uri()}?renderer=webgpu")
    page.wait_for_selector("#view:visible")
    assert selected_renderer(page) == "WebGL2"
    assert not any("webgpu.js" in url for url in fetched)
    page.close()
