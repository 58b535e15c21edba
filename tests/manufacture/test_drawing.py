"""The drawing: true to scale on paper, every number the sensor's, nothing on top of anything else."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import omnimirror as om
from omnimirror.errors import InvalidParameter
from omnimirror.housing import CameraBody, Dome, Housing, Rod, Tube
from omnimirror.manufacture import Body, draw_sheet
from omnimirror.manufacture.drawings.sheet import SHEETS, Sheet, fitting_scale, scale_words
from omnimirror.specs import bundled_sensors
from tests.analysis.meridional.test_two_mirrors import SENSORS as FOLDED
from tests.conftest import MIRRORS, sensor_of

POINT = 72 / 25.4
TAPPED = Body(thread="M6", bore_depth_mm=12.0)


def pdf_paths(data):
    """Size of the page and all polylines (n, 2) of a PDF file, in points."""
    box = [float(v) for v in re.search(rb"/MediaBox \[ ?([\d. ]+)\]", data)[1].split()]
    paths = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, flags=re.S):
        try:
            text = zlib.decompress(stream).decode("latin-1")
        except zlib.error:
            continue
        parts = re.findall(r"[\d.-]+ [\d.-]+ m\s(?:[\d.-]+ [\d.-]+ l\s)+", text)
        points = (re.findall(r"([\d.-]+) ([\d.-]+) [ml]", part) for part in parts)
        paths.extend(np.array(p, dtype=float) for p in points)
    return box[2:], paths


@pytest.mark.parametrize(("size", "scale"), [("A3", None), ("A3", 0.5), ("A4", None)])
@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_lengths_on_paper_are_true_to_the_scale(name, size, scale):
    sensor = om.load_sensor(name)
    drawing = draw_sheet(sensor, sheet=size, scale=scale)
    page, paths = pdf_paths(drawing.render("pdf"))
    np.testing.assert_allclose(page, np.array(SHEETS[size]) * POINT, atol=0.01)
    rim, m = sensor.mirror.rim_radius_mm, sensor.mirror_distance_mm
    z = float(sensor.mirror.sag(rim))
    extents = np.array([np.ptp(p, axis=0) for p in paths if len(p) > 1]) / POINT
    # the meridian of the mirror's view is drawn above and below the axis, as wide as its sag
    here = np.abs(extents - drawing.mirror_scale * np.array([z, rim])).max(axis=1) < 0.01
    assert here.sum() >= 2
    # dimension lines as long as what they measure
    for length, scale_of_view in (
        (m, drawing.sensor_scale),
        (2 * rim, drawing.mirror_scale),
        (z, drawing.mirror_scale),
    ):
        along = np.sort(extents, axis=1)
        assert (np.abs(along - [0.0, scale_of_view * length]).max(axis=1) < 0.01).any(), length
    if scale:
        assert drawing.sensor_scale == scale


def test_rays_on_paper_have_their_angles():
    """Chief rays of the view from the world to the mirror, measured on the paper."""
    _, paths = pdf_paths(draw_sheet(om.load_sensor("paper-spherical")).render("pdf"))
    inner = [p for p in paths if len(p) == 4]  # world, mirror, lens, imager
    found = set()
    for p in inner:
        d = p[0] - p[1]
        if np.hypot(*d) > 20 and p[1, 0] > p[2, 0] > p[3, 0]:
            found.add(round(float(np.degrees(np.arctan2(abs(d[1]), -d[0]))), 1))
    assert {30.0, 60.0, 90.0, 120.0, 135.0} <= found


def texts(drawing):
    """Every text with its box (x0, y0, x1, y1) in mm."""
    drawing.figure.dpi = 300  # hinting widens small letters
    canvas = FigureCanvasAgg(drawing.figure)
    renderer = canvas.get_renderer()
    mm = 25.4 / drawing.figure.dpi
    found = [t for t in drawing.figure.axes[0].texts if t.get_text().strip()]
    return [(t.get_text(), np.array(t.get_window_extent(renderer).extents) * mm) for t in found]


FULL = Body(8.0, bore_diameter_mm=6.0, bore_depth_mm=np.inf, flange_width_mm=5.0)
TUBE = Housing(shell=Tube())
CASES = [
    *((s, TAPPED, TUBE, "A3") for s in map(om.load_sensor, bundled_sensors()) if s.secondary is None),
    *((FOLDED[kind], Body(), TUBE, "A3") for kind in ("concave", "two-hyperboloids")),
    *((FOLDED[kind], Body(), Housing(), "A4") for kind in ("flat", "telecentric")),
    *((om.load_sensor(f"paper-{name}"), TAPPED, Housing(rod=Rod()), "A4") for name in ("hyperboloidal", "equidistant")),
    *((sensor_of(kind), FULL, Housing(CameraBody(40.0)), "A3") for kind in sorted(MIRRORS)),
    (sensor_of("sphere", "orthographic"), Body(), TUBE, "A3"),
    (replace(sensor_of("sphere"), name=60 * "ab", notes=70 * "$x_ yz "), Body(), TUBE, "A4"),
    (replace(sensor_of("cone"), notes=200 * "x"), Body(), Housing(rod=Rod()), "A3"),
    (replace(sensor_of("sphere"), housing=Housing(CameraBody(30.0), shell=Dome())), Body(), None, "A3"),
]


@pytest.mark.parametrize("case", CASES, ids=[f"{c[0].name[:30]}-{c[3]}-{i}" for i, c in enumerate(CASES)])
def test_no_words_touch_and_all_lie_inside_the_frame(case):
    sensor, body, housing, size = case
    boxes = texts(draw_sheet(sensor, body, housing, size))
    k = SHEETS[size][0] / 420
    width, height = SHEETS[size]
    for words, (x0, y0, x1, y1) in boxes:
        assert 20 * k < x0 < x1 < width - 10 * k, words
        assert 10 * k < y0 < y1 < height - 10 * k, words
    for i, (a, box) in enumerate(boxes):
        for b, other in boxes[i + 1 :]:
            apart = (
                box[0] >= other[2] or other[0] >= box[2] or box[1] >= other[3] - 0.7 * k or other[1] >= box[3] - 0.7 * k
            )
            assert apart, f"{a!r} and {b!r}"


def test_the_sheet_says_what_the_sensor_is():
    sensor = om.load_sensor("paper-spherical")
    svg = draw_sheet(sensor, TAPPED, Housing(rod=Rod(4.0))).render("svg").decode()
    shown = set(re.findall(r">([^<>]+)</text>", svg))
    for words in (
        "paper-spherical",
        "180.429",
        "12.271",
        "Ø87.81",
        "26.122",
        "M6, 12 deep",
        "drill Ø5",
        "4.35 %",
        "1:1",
    ):
        assert words in shown, words
    assert 'width="1190.55' in svg


def test_the_same_sensor_gives_the_same_file():
    sensor = om.load_sensor("paper-hyperboloidal")
    assert draw_sheet(sensor).render("pdf") == draw_sheet(sensor).render("pdf")


def test_scales_are_standard_ones():
    for size in (3.0, 44.0, 230.0, 5000.0):
        scale = fitting_scale(size, size, 100.0, 100.0)
        assert size * scale <= 100.0 < size * scale * 2.6
        assert re.fullmatch(r"(1|2|5)0*:1|1:(1|2|5)0*", scale_words(scale))


@pytest.mark.parametrize("options", [{"sheet": "A5"}, {"scale": 1e-9}, {"scale": 1e6}])
def test_paper_that_there_is_not_is_refused(options):
    with pytest.raises(InvalidParameter, match=r"A5|scale = "):
        draw_sheet(sensor_of("sphere"), **options)


def test_words_are_as_wide_as_measured():
    sheet = Sheet("A3")
    sheet.figure.dpi = 600
    sheet.text(50, 50, "transparent tube Ø100 × 3")
    box = sheet.figure.axes[0].texts[0].get_window_extent(FigureCanvasAgg(sheet.figure).get_renderer())
    assert sheet.text_width("transparent tube Ø100 × 3") == pytest.approx(box.width * 25.4 / sheet.figure.dpi, rel=0.03)
