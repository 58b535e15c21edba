"""Comparison report and image: self-contained, with the curves of the evaluation."""

from __future__ import annotations

import re
from base64 import b64decode
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import omnimirror as om
from omnimirror.analysis.figures import side_by_side
from omnimirror.apps.reports import comparison as reports
from omnimirror.apps.reports.comparison import (
    RenderedImages,
    comparison_sheet,
    render_images,
    write_comparison,
)
from omnimirror.base.errors import InvalidParameter
from tests.commands import omnimirror

ROOM = om.Room(texel_mm=40.0)


def small(name):
    sensor = om.load_sensor(name)
    pixels = replace(
        sensor.imager, width_px=128, height_px=128, pixel_pitch_um=8 * sensor.imager.pixel_pitch_um
    )
    return replace(sensor, imager=pixels)


@pytest.fixture(scope="module")
def comparison():
    return om.compare(
        [small(n) for n in ("paper-spherical", "folded-spherical", "paraboloid-telecentric")]
    )


def test_page_contains_table_curves_and_images(comparison, tmp_path):
    page = write_comparison(comparison, tmp_path / "c.html", ROOM).read_text(encoding="utf-8")
    assert page.count("data:image/jpeg") == 6
    assert page.count("data:image/svg+xml") == 1
    reference = BytesIO()
    Image.new("RGB", (8, 8)).save(reference, "JPEG", quality=90)
    images = [
        Image.open(BytesIO(b64decode(data)))
        for data in re.findall(r'data:image/jpeg;base64,([^"]+)"', page)
    ]
    assert [image.width for image in images] == 3 * [128] + 3 * [1440]
    with Image.open(reference) as expected:
        assert all(image.quantization == expected.quantization for image in images)
    assert not re.search(r'(src|href)="(?!data:)', page)
    for row in comparison.rows:
        cells = re.search(
            rf"{re.escape(row.quantity.title)} <small>{row.quantity.unit}</small></th>(.*?)</tr>",
            page,
        )[1]
        assert re.findall(r">([^<]+)</td>", cells) == row.texts
    assert page.count('class="best"') == sum(sum(row.best) for row in comparison.rows)


@pytest.mark.full
def test_png_is_one_sheet(comparison, tmp_path):
    path = write_comparison(comparison, tmp_path / "c.png", ROOM)
    sheet = om.read_image(path)
    assert sheet.shape[1] == 1440
    assert sheet.shape[0] > 2 * 1440


def test_suffix_selects_page_or_sheet(comparison, tmp_path, monkeypatch):
    """With the images of the given scene, or of the bundled room."""
    scenes = []
    gradient = np.arange(3 * 4 * 5, dtype=np.uint8).reshape(4, 5, 3)
    monkeypatch.setattr(reports, "render_images", lambda _, scene: scenes.append(scene))
    monkeypatch.setattr(reports, "comparison_sheet", lambda *_: gradient)
    monkeypatch.setattr(reports, "comparison_html", lambda *_: "the page")
    sheet = om.read_image(write_comparison(comparison, tmp_path / "c.PNG", ROOM))
    np.testing.assert_array_equal(sheet, gradient)
    page = write_comparison(comparison, tmp_path / "c.HTML")
    assert page.read_text(encoding="utf-8") == "the page"
    assert scenes[0] is ROOM
    assert isinstance(scenes[1], om.Room)
    assert scenes[1] is not ROOM


def test_sheet_keeps_image_colours(comparison):
    """Uniform images, on white, in their order; the room is not rendered."""
    colours = [(255, 0, 0), (0, 255, 0), (0, 0, 255)], [(255, 255, 0), (0, 255, 255), (255, 0, 255)]
    circles = [np.full((64, 64, 3), colour, np.uint8) for colour in colours[0]]
    panoramas = [np.full((32, 144, 3), colour, np.uint8) for colour in colours[1]]
    sheet = comparison_sheet(comparison, RenderedImages(circles, panoramas))
    assert sheet.dtype == np.uint8
    assert sheet.shape[1:] == (1440, 3)
    assert (sheet[0] == 255).all()
    pixels = [np.argwhere((sheet == colour).all(axis=2)) for row in colours for colour in row]
    assert all(len(positions) > 5000 for positions in pixels)
    middles = [positions.mean(axis=0) for positions in pixels]
    assert [m[1] for m in middles[:3]] == sorted(
        m[1] for m in middles[:3]
    )  # circles from left to right
    assert [m[0] for m in middles[3:]] == sorted(
        m[0] for m in middles[3:]
    )  # panoramas from top to bottom
    assert max(m[0] for m in middles[:3]) < min(m[0] for m in middles[3:])


def test_other_suffixes_raise_before_rendering(comparison, tmp_path):
    for name in ("c.gif", "c", "c.htm"):
        with pytest.raises(InvalidParameter, match=rf"suffix \.html or \.png; got {name}"):
            write_comparison(comparison, tmp_path / name, None)
    assert not list(tmp_path.iterdir())


def test_panoramas_have_common_elevations(comparison):
    """Panoramas agree in the common field, including that of the folded sensor; black outside the
    field of a sensor."""
    single, folded, telecentric = (p.astype(int) for p in render_images(comparison, ROOM).panoramas)
    assert single.shape == folded.shape == telecentric.shape
    rows = slice(single.shape[0] // 4, single.shape[0] // 2)
    assert np.abs(single - folded)[rows].mean() < 3
    assert np.abs(single - folded[:, ::-1])[rows].mean() > 20
    assert not telecentric[: single.shape[0] // 8].any()


def test_curves_equal_evaluation(comparison):
    figure = side_by_side(comparison.sensors)
    lines = {
        line.get_gid(): line for ax in figure.axes for line in ax.get_lines() if line.get_gid()
    }
    for sensor in comparison.sensors:
        for column in (
            "h_px",
            "dh_domega_px_per_deg",
            "blur_t_deg",
            "blur_s_deg",
            "aspect",
            "viewpoint_z_mm",
        ):
            x, y = lines[f"{sensor.name}:{column}"].get_data()
            np.testing.assert_allclose(
                y[::60], getattr(om.evaluate(sensor, x[::60]), column), rtol=1e-9, atol=1e-12
            )
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == comparison.names


def test_command_line(tmp_path):
    run = omnimirror(
        "compare", "paper-spherical", "folded-spherical", "--csv", "c.csv", cwd=tmp_path
    )
    assert run.returncode == 0
    assert "Length from the lens" in run.stdout
    assert "112.1 *" in run.stdout
    assert (
        (tmp_path / "c.csv").read_text().startswith("quantity,paper-spherical,folded-spherical\n")
    )
    failure = omnimirror("compare", *["paper-spherical"] * 7, cwd=tmp_path)
    assert failure.returncode == 2
    assert "the number of sensors must be 1 to 6; got 7" in failure.stderr
