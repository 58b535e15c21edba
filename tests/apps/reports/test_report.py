"""Demo report: complete, self-contained, and consistent with the evaluation."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps import reports as report
from omnimirror.apps.reports import write_demo
from tests.commands import fails, omnimirror


class Page(HTMLParser):
    """Parser that collects image sources and all addresses loaded by the page."""

    def __init__(self) -> None:
        super().__init__()
        self.pictures: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name in ("src", "href"):
                (self.pictures if value.startswith("data:") else self.fetched).append(value)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    run = omnimirror("demo", "-o", folder / "new")
    assert run.returncode == 0, run.stderr
    assert str(folder / "new" / "report.html") in run.stdout
    return folder / "new"


def test_page_is_self_contained(demo):
    page = Page()
    page.feed((demo / "report.html").read_text())
    assert page.fetched == []
    png = [p for p in page.pictures if p.startswith("data:image/png;base64,")]
    images = {base64.b64decode(p.split(",", 1)[1]) for p in png}
    assert images == {(demo / f"{n}.png").read_bytes() for n in ("circle", "panorama", "view")}
    assert len([p for p in page.pictures if p.startswith("data:image/svg+xml")]) >= 6


def test_numbers_equal_evaluation(demo):
    text = (demo / "report.html").read_text()
    r = om.evaluate(om.load_sensor("paper-spherical"))
    assert f"{r.floored_area_deg2.max():.3f} deg²" in text
    rows = re.findall(r"<tr>(<td>.*?)</tr>", text)
    assert len(rows) == len(r) == 28
    assert f"<td>{r.h_px[-1]:.2f}</td>" in rows[-1]
    csv = np.genfromtxt(demo / "evaluation.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(csv["viewpoint_z_mm"], r.viewpoint_z_mm)


def test_printed_commands_reproduce_images(demo, tmp_path):
    block = re.search(r"<pre>(.*?)</pre>", (demo / "report.html").read_text(), re.S)[1]
    commands = [line for line in block.splitlines() if line.startswith("omnimirror dewarp")]
    assert len(commands) == 2
    (tmp_path / "circle.png").write_bytes((demo / "circle.png").read_bytes())
    for command in commands:
        assert omnimirror(*command.split()[1:], cwd=tmp_path).returncode == 0
    for name in ("panorama", "view"):
        expected, result = (cv2.imread(str(folder / f"{name}.png")) for folder in (demo, tmp_path))
        np.testing.assert_array_equal(expected, result)


@pytest.mark.full
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("paraboloid-telecentric", "paraboloid, rim diameter 50 mm"),
        ("folded-spherical", "sphere, rim diameter 87.81 mm"),
    ],
)
def test_other_sensors(name, text, tmp_path):
    sensor = om.load_sensor(name)
    pixels = replace(
        sensor.imager, width_px=128, height_px=128, pixel_pitch_um=8 * sensor.imager.pixel_pitch_um
    )
    assert text in write_demo(replace(sensor, imager=pixels), tmp_path).read_text()


def test_unwritable_folder_prints_one_line(tmp_path):
    (tmp_path / "taken").write_text("a file")
    assert "cannot write" in fails("demo", "-o", tmp_path / "taken")


@pytest.mark.full
def test_obscuration_and_progress_are_reported(tmp_path, monkeypatch):
    from omnimirror.base.logs import forward_steps
    from omnimirror.optics.housing import CameraBody, Housing

    monkeypatch.setattr(report, "FIGURES_SHOWN", report.FIGURES_SHOWN[3:])
    sensor = om.load_sensor("paper-spherical")
    small = replace(
        sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2)
    )
    progress_calls = []
    steps = []
    with forward_steps(steps.append):
        page = write_demo(
            replace(small, housing=Housing(CameraBody(60.0))),
            tmp_path,
            blur=False,
            on_progress=lambda *arguments: progress_calls.append(arguments),
        )
    shares = [done / total for done, total in progress_calls]
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0.8 < shares[-1] < 1
    assert set(steps) == {"Rendering the image", "Drawing figures"}
    assert (
        "<dt>Obscured</dt><dd>camera 0 to 8.435 deg; total 0.71 % of the image</dd>"
        in page.read_text()
    )
