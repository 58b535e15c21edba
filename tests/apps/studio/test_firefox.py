"""Studio page in Firefox: views equal those of Python, without errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import _standalone_page, standalone_page
from omnimirror.io import read_image, write_image
from omnimirror.optics.mirrors import Sphere

from .browser import command, view_pixels
from .firefox import running
from .images import pattern, psnr, python_view

VIEW, BENCH = "window.omnimirror.look", "window.omnimirror.tabs.design"


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
    page.wait(f"{BENCH}.evaluations[0].summary")
    before = page.evaluate(f"{BENCH}.evaluations[0].summary.field_deg[1]")
    page.click('#design input[type="range"]')
    page.click('#design input[type="number"]')
    focused = "document.activeElement.matches('#design input[type=number]')"
    page.wait(focused)
    page.keys("\ue009a\ue000", "45", "\ue007")  # Control and a, a number, Enter
    page.wait(f"{BENCH}.evaluations[0].summary.field_deg[1] !== {before}")
    assert page.evaluate(f"{BENCH}.history.now.tables.mirror.radius_mm") == 45.0
    sensor = om.load_sensor("paper-spherical")
    sensor = replace(sensor, mirror=Sphere(45.0, sensor.mirror.rim_radius_mm))
    assert page.evaluate(f"{BENCH}.evaluations[0].summary.field_deg[1]") == pytest.approx(
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
    page.wait(f"{BENCH}.evaluations[0].summary")
    curve = page.evaluate(f"[...{BENCH}.evaluations[0].block('curves').column('blur_s_px')]")
    sensor = om.load_sensor("paper-spherical")
    expected = om.evaluate(sensor, np.linspace(*sensor.field_deg, len(curve))).blur_s_px
    np.testing.assert_allclose(curve, expected, rtol=1e-6, atol=1e-5)
