"""Studio page in Firefox: views equal those of Python, without errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import _standalone_page, standalone_page
from omnimirror.io import read_image, write_image
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_writer import VideoWriter
from omnimirror.optics.mirrors import Sphere

from .browser import command, view_pixels
from .firefox import running
from .images import pattern, psnr, python_view

VIEW, DESIGN_TAB = "window.omnimirror.look", "window.omnimirror.tabs.design"

RECORD_DOWNLOADS = """((create) => {
  const blobs = new Map();
  window.saved = new Map();
  URL.createObjectURL = (blob) => {
    const url = create(blob);
    blobs.set(url, blob);
    return url;
  };
  HTMLAnchorElement.prototype.click = function () {
    window.saved.set(this.download, blobs.get(this.href));
  };
})(URL.createObjectURL.bind(URL))"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with running(tmp_path_factory.mktemp("firefox")) as page:
        page.size(1280, 900)
        yield page
        assert page.problems == []


@pytest.mark.parametrize(
    ("mode", "name"),
    [
        pytest.param("panorama", "a.png", marks=pytest.mark.full),
        ("perspective", "b.jpg"),
        pytest.param("dome", "c.png", marks=pytest.mark.full),
    ],
)
def test_views_match_command_line(page, server, tmp_path, mode, name):
    sensor = om.load_sensor("paper-spherical")
    write_image(tmp_path / name, pattern(sensor.image_size))
    page.open("about:blank")  # a change of the fragment alone does not load the page
    page.open(f"{server}#sensor=paper-spherical&mode={mode}&pan=40&tilt=10&hfov=70")
    page.wait(f"{VIEW}.sensor.camera")
    page.choose("#file", tmp_path / name)
    page.wait(f"{VIEW}.feed?.name === {name!r}")
    expected = python_view(command(page, 240, 160), tmp_path)(read_image(tmp_path / name))
    pixels = view_pixels(page, 240, 160)
    both = (pixels[..., 3] > 0) & (expected.max(axis=-1) > 0)
    assert both.mean() > 0.4
    assert psnr(pixels[..., :3], expected, both) > 40


def test_slider_updates_plots(page, server):
    page.open("about:blank")
    page.open(f"{server}#tab=design")
    page.wait(f"{DESIGN_TAB}.evaluations[0].summary")
    before = page.evaluate(f"{DESIGN_TAB}.evaluations[0].summary.field_deg[1]")
    page.click('#design input[type="range"]')
    page.click('#design input[type="number"]')
    focused = "document.activeElement.matches('#design input[type=number]')"
    page.wait(focused)
    page.keys("\ue009a\ue000", "45", "\ue007")  # Control and a, a number, Enter
    page.wait(f"{DESIGN_TAB}.evaluations[0].summary.field_deg[1] !== {before}")
    assert page.evaluate(f"{DESIGN_TAB}.history.now.tables.mirror.radius_mm") == 45.0
    sensor = om.load_sensor("paper-spherical")
    sensor = replace(sensor, mirror=Sphere(45.0, sensor.mirror.rim_radius_mm))
    assert page.evaluate(f"{DESIGN_TAB}.evaluations[0].summary.field_deg[1]") == pytest.approx(
        sensor.field_deg[1]
    )
    curves = (
        "[...document.querySelectorAll('#design .uplot canvas')].filter((c) => c.width > 0).length"
    )
    assert page.evaluate(curves) >= 8


def test_calibrate_tab_opens(page, server):
    page.open("about:blank")
    page.open(f"{server}#tab=calibrate")
    page.wait("document.querySelector('#calibrate .desk')")
    assert page.evaluate("document.querySelector('#banner').hidden")


def open_empty(page, server: str) -> None:
    """Open the empty page without the state of earlier tests."""
    page.open("about:blank")
    page.open(server)
    page.evaluate("(localStorage.clear(), sessionStorage.clear())")
    page.open("about:blank")
    page.open(server)
    page.wait(f"{VIEW}.sensor.camera")


def test_first_image_is_detected_and_its_mirror_type_selected(page, server, tmp_path):
    v, u = np.mgrid[:480, :700]
    sectors = 120 + 80 * np.sign(np.sin(11 * np.arctan2(v - 215, u - 390)))
    disc = np.where(np.hypot(u - 390, v - 215) < 180, sectors, 12)
    write_image(tmp_path / "ball.png", disc.astype(np.uint8))
    open_empty(page, server)
    page.choose("#file", tmp_path / "ball.png")
    page.wait("!document.querySelector('#ask').hidden")
    circle = page.evaluate("window.omnimirror.store.state.rim")
    np.testing.assert_allclose(circle, [390, 215, 180], atol=0.5)
    page.click("#ask .answers button")
    page.wait(f"{VIEW}.sensor.camera.model.id === 'ball:340'")
    assert (view_pixels(page, 200, 100)[..., 3] > 0).mean() > 0.5


def test_uncertain_outline_is_confirmed(page, server, tmp_path):
    write_image(tmp_path / "waves.png", pattern((500, 400)))
    open_empty(page, server)
    page.choose("#file", tmp_path / "waves.png")
    page.wait("!document.querySelector('#fit').hidden")
    page.click("#fit-done")
    page.wait("!document.querySelector('#ask').hidden")
    assert page.evaluate("window.omnimirror.store.state.rim.length") == 3


def test_video_is_displayed(page, server, tmp_path):
    with VideoWriter(tmp_path / "ride.webm", (320, 240), 10) as video:
        for level in range(40, 240, 20):
            video.write(frame_of_image(np.full((240, 320, 3), level, np.uint8)))
    open_empty(page, server)
    page.choose("#file", tmp_path / "ride.webm")
    page.wait(f"{VIEW}.feed?.name === 'ride.webm'")
    assert page.evaluate(f"[{VIEW}.feed.width, {VIEW}.feed.height]") == [320, 240]


def test_angle_is_measured_and_light_probe_exported(page, server, tmp_path):
    sensor = om.load_sensor("paper-spherical")
    write_image(tmp_path / "room.png", pattern(sensor.image_size))
    open_empty(page, server)
    page.choose("#file", tmp_path / "room.png")
    page.wait(f"{VIEW}.feed?.name === 'room.png' && !document.querySelector('#view').hidden")
    page.click("#measure")
    for _ in range(2):
        page.click("#measure-add")
    page.wait("/Angle [1-9]/.test(document.querySelector('#measured').textContent)")
    page.click("#measure-done")
    page.wait("document.querySelector('#measure-bar').hidden")

    page.evaluate(RECORD_DOWNLOADS)
    page.click("#export summary")
    page.click("#export button[data-probe][data-format=hdr]")
    page.wait("window.saved.has('room-light-probe.hdr')")
    data = page.evaluate(
        "window.saved.get('room-light-probe.hdr').arrayBuffer()"
        ".then((bytes) => Array.from(new Uint8Array(bytes)))"
    )
    (tmp_path / "probe.hdr").write_bytes(bytes(data))
    expected = om.light_probe(read_image(tmp_path / "room.png"), sensor).radiance
    error = np.abs(read_image(tmp_path / "probe.hdr") - expected).max(axis=-1)
    assert (error <= 2**-7 * expected.max(axis=-1)).all()


def test_webgl2_is_used_without_an_adapter_for_webgpu(page, server):
    page.open("about:blank")
    page.open(f"{server}?renderer=webgpu#sensor=paper-spherical&source=room")
    page.wait(f"{VIEW}.feed && !document.querySelector('#view').hidden")
    has_adapter = "navigator.gpu?.requestAdapter().then((adapter) => adapter !== null) ?? false"
    name = page.evaluate(f"{VIEW}.drawing.selected.then(() => {VIEW}.renderer.name)")
    assert name == ("WebGPU" if page.evaluate(has_adapter) else "WebGL2")
    assert (view_pixels(page, 120, 80)[..., 3] > 0).mean() > 0.4


def test_design_is_exported(page, server):
    page.open("about:blank")
    page.open(f"{server}#tab=design")
    page.wait(f"{DESIGN_TAB}.evaluations[0].summary")
    page.evaluate(RECORD_DOWNLOADS)
    page.evaluate(
        "[...document.querySelectorAll('button')].find((b) => b.textContent === 'Export…').click()"
    )
    page.wait("document.querySelector('dialog[open]')")
    page.evaluate(
        "[...document.querySelectorAll('dialog[open] button')]"
        ".find((b) => b.ariaLabel?.startsWith('Download Sag table')).click()"
    )
    page.wait("window.saved.has('paper-spherical-sag.csv')")
    table = page.evaluate("window.saved.get('paper-spherical-sag.csv').text()")
    heights = [float(line.split(",")[0]) for line in table.splitlines()[1:] if line[:1].isdigit()]
    assert heights[0] == 0
    assert heights == sorted(heights)
    assert len(heights) > 20


def test_page_without_server_displays_views_and_designs(page, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_standalone_page, "SHOWN_SAMPLES", 1)
        patch.setattr(_standalone_page, "Room", lambda: om.Room(texel_mm=40.0))
        (tmp_path / "look.html").write_text(standalone_page(["paper-spherical"]), encoding="utf-8")
    page.open((tmp_path / "look.html").as_uri())
    page.wait(f"{VIEW}.sensor.camera")
    page.click("#try")
    page.wait(f"{VIEW}.feed")
    assert (view_pixels(page, 200, 100)[..., 3] > 0).mean() > 0.5
    page.click('#tabs button[value="design"]')
    page.wait(f"{DESIGN_TAB}.evaluations[0].summary")
    curve = page.evaluate(f"[...{DESIGN_TAB}.evaluations[0].block('curves').column('blur_s_px')]")
    sensor = om.load_sensor("paper-spherical")
    expected = om.evaluate(sensor, np.linspace(*sensor.field_deg, len(curve))).blur_s_px
    np.testing.assert_allclose(curve, expected, rtol=1e-6, atol=1e-5)
