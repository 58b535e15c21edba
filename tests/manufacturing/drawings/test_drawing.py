"""Drawings: true scale on paper, values of the sensor, and labels without overlap."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import Body, PartSpecification, TitleBlock, Workshop, draw_sheets
from omnimirror.manufacturing.body import Part
from omnimirror.manufacturing.drawings.mirror_view import fixed_words
from omnimirror.manufacturing.drawings.sheet import SHEETS, Sheet, fitting_scale, scale_words
from omnimirror.manufacturing.drawings.tables import mirror_rows, sag_rows
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rod, Tube
from omnimirror.optics.mirrors import EvenPolynomial
from omnimirror.optics.sensor_files import bundled_sensors
from tests.analysis.test_two_mirrors import SENSORS as FOLDED
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few

POINT = 72 / 25.4
TAPPED = Body(thread="M6", bore_depth_mm=12.0)


def pdf_streams(data):
    """Return the drawing commands of a PDF file, page by page."""
    for start in re.finditer(rb"/FlateDecode >>\s*stream\r?\n", data):
        yield zlib.decompressobj().decompress(data[start.end() :]).decode("latin-1")


def pdf_paths(data):
    """Return page size and polylines (n, 2) of a PDF file, in points."""
    box = [float(v) for v in re.search(rb"/MediaBox \[ ?([\d. ]+)\]", data)[1].split()]
    paths = []
    for text in pdf_streams(data):
        parts = re.findall(r"[\d.-]+ [\d.-]+ m\s(?:[\d.-]+ [\d.-]+ l\s)+", text)
        points = (re.findall(r"([\d.-]+) ([\d.-]+) [ml]", part) for part in parts)
        paths.extend(np.array(p, dtype=float) for p in points)
    return box[2:], paths


@pytest.mark.parametrize(
    ("size", "scale"), few([("A3", None), ("A3", 0.5), ("A4", None)], ("A3", 0.5))
)
@pytest.mark.parametrize("name", few(["paper-spherical", "paper-hyperboloidal"], "paper-spherical"))
def test_paper_lengths_match_the_scale(name, size, scale):
    sensor = om.load_sensor(name)
    drawing = draw_sheets(sensor, sheet=size, scale=scale)
    page, paths = pdf_paths(drawing.render("pdf"))
    sensor_scale, mirror_scale = drawing.scales
    np.testing.assert_allclose(page, np.array(SHEETS[size]) * POINT, atol=0.01)
    rim, m = sensor.mirror.rim_radius_mm, sensor.mirror_distance_mm
    z = float(sensor.mirror.sag(rim))
    extents = np.array([np.ptp(p, axis=0) for p in paths if len(p) > 1]) / POINT
    # the meridian of the mirror view is drawn above and below the axis, with the width of its sag
    matches = np.abs(extents - mirror_scale * np.array([z, rim])).max(axis=1) < 0.01
    assert matches.sum() >= 2
    # dimension lines have the lengths of their measures
    lengths = [(m, sensor_scale), (2 * rim, mirror_scale)]
    if mirror_scale == 1:  # its text is on the line, without an extension
        lengths.append((z, mirror_scale))
    for length, scale_of_view in lengths:
        along = np.sort(extents, axis=1)
        assert (np.abs(along - [0.0, scale_of_view * length]).max(axis=1) < 0.01).any(), length
    if scale:
        assert sensor_scale == scale


def test_drawn_rays_have_their_field_angles():
    """Measure the object-side chief rays of the sensor view on paper."""
    _, paths = pdf_paths(draw_sheets(om.load_sensor("paper-spherical")).render("pdf"))
    inner = [p for p in paths if len(p) == 4]  # world, mirror, lens, imager
    angles_deg = set()
    for p in inner:
        d = p[0] - p[1]
        if np.hypot(*d) > 20 and p[1, 0] > p[2, 0] > p[3, 0]:
            angles_deg.add(round(float(np.degrees(np.arctan2(abs(d[1]), -d[0]))), 1))
    assert {30.0, 60.0, 90.0, 120.0, 135.0} <= angles_deg


def texts(figure):
    """Return every text with its box (x0, y0, x1, y1) in mm."""
    figure.dpi = 300  # hinting widens small letters
    canvas = FigureCanvasAgg(figure)
    renderer = canvas.get_renderer()
    mm = 25.4 / figure.dpi
    labels = [t for t in figure.axes[0].texts if t.get_text().strip()]
    return [(t.get_text(), np.array(t.get_window_extent(renderer).extents) * mm) for t in labels]


def segments(figure):
    """Return the end points (n, 2, 2) in mm of all line segments of a sheet."""
    lines = [
        np.stack([line.get_xdata(), line.get_ydata()], axis=-1) for line in figure.axes[0].lines
    ]
    return np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])


def crosses(segments, box):
    """Return which segments (n, 2, 2) cross the interior of a box (x0, y0, x1, y1)."""
    low, high = box[:2], box[2:]
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(low - start) / along, (high - start) / along]), axis=0)
    is_outside = (along == 0) & ((start <= low) | (start >= high))
    enter = np.where(along == 0, -np.inf, ends[0]).max(axis=1)
    leave = np.where(along == 0, np.inf, ends[1]).min(axis=1)
    return (np.maximum(enter, 0) < np.minimum(leave, 1)) & ~is_outside.any(axis=1)


FULL = Body(8.0, bore_diameter_mm=6.0, bore_depth_mm=np.inf, flange_width_mm=5.0)
TUBE = Housing(shell=Tube())
WORKSHOP = Workshop(
    TitleBlock("OM-0042-017", "B", "2026-11-22", "", "Example AG", "A. Meier", "B. Huber"),
    PartSpecification(
        "aluminium EN AW-6061 T6",
        coating="Al, protected, R > 88 %",
        surface_roughness_nm=5.0,
        form_um=1.0,
        centring_mm=0.02,
        imperfections="5x0.16",
        diameter_tolerance_mm=0.02,
        thickness_tolerance_mm=0.05,
        back_flatness_mm=0.005,
    ),
    tolerances={
        "mirror.decentre_x_mm": 0.05,
        "mirror.decentre_y_mm": 0.04,
        "mirror.displacement_mm": 0.1,
        "mirror.tilt_x_deg": 0.1,
        "mirror.tilt_y_deg": 0.12,
        "mirror.vertex_radius_mm": 0.05,
        "mirror.conic": 0.005,
        "lens.focal_length_mm": 0.1,
        "imager.shift_x_px": 20.0,
    },
)
CASES = [
    (FOLDED["two-hyperboloids"], Body(), TUBE, "A3"),
    (om.load_sensor("paper-equidistant"), TAPPED, Housing(rod=Rod()), "A4"),
    (om.load_sensor("paraboloid-telecentric"), TAPPED, TUBE, "A4"),
    (sensor_of("cone"), FULL, Housing(CameraBody(40.0)), "A4"),
    (replace(sensor_of("sphere"), name=60 * "ab"), Body(), TUBE, "A4"),
    (replace(sensor_of("sphere"), name=" ".join(20 * ["$x_ yz"])), Body(), TUBE, "A3"),
]
SIMILAR_CASES = [
    (om.load_sensor("exact-equidistant"), TAPPED, TUBE, "A3"),
    (FOLDED["concave"], Body(), TUBE, "A3"),
    *((FOLDED[kind], Body(), Housing(), "A4") for kind in ("flat", "telecentric")),
    (om.load_sensor("paper-hyperboloidal"), TAPPED, Housing(rod=Rod()), "A4"),
    (om.load_sensor("prototype-spherical"), TAPPED, TUBE, "A4"),
    (sensor_of("sphere"), FULL, Housing(CameraBody(40.0)), "A3"),
    (sensor_of("sphere", "orthographic"), Body(), TUBE, "A3"),
    (sensor_of("cone"), Body(), Housing(rod=Rod()), "A3"),
    (
        replace(sensor_of("sphere"), housing=Housing(CameraBody(30.0), shell=Dome())),
        Body(),
        None,
        "A3",
    ),
    *(
        (s, TAPPED, TUBE, "A3")
        for s in map(om.load_sensor, bundled_sensors()[1:])
        if s.secondary is None
    ),
    *(
        (sensor_of(kind), FULL, Housing(CameraBody(40.0)), "A4")
        for kind in sorted(MIRRORS)
        if kind != "cone"
    ),
]


@pytest.mark.parametrize(
    "case",
    [*CASES, *(pytest.param(case, marks=pytest.mark.full) for case in SIMILAR_CASES)],
    ids=[f"{c[0].name[:30]}-{c[3]}-{i}" for i, c in enumerate([*CASES, *SIMILAR_CASES])],
)
def test_labels_do_not_overlap_and_are_inside_the_frame(case):
    """No label overlaps another one or a line, and all conform to ISO 3098."""
    sensor, body, housing, size = case
    width, height = SHEETS[size]
    drawing = draw_sheets(sensor, body, housing, size, workshop=WORKSHOP)
    assert len(drawing.figures) == (2 if sensor.secondary is None else 3)
    for figure in drawing.figures:
        boxes, lines = texts(figure), segments(figure)
        for label, (x0, y0, x1, y1) in boxes:
            assert 20 < x0 < x1 < width - 10, label
            assert 10 < y0 < y1 < height - 10, label
        for i, (a, box) in enumerate(boxes):
            for b, other in boxes[i + 1 :]:
                apart = (
                    box[0] >= other[2]
                    or other[0] >= box[2]
                    or box[1] >= other[3] - 0.7
                    or other[1] >= box[3] - 0.7
                )
                assert apart, f"{a!r} and {b!r}"
            letters = np.add(box, [0.4, 0.9, -0.4, -0.4])  # without descenders
            assert letters[1] >= letters[3] or not crosses(lines, letters).any(), a


@pytest.mark.parametrize("size", few(sorted(SHEETS), "A4"))
def test_letter_heights_conform_to_iso_3098(size):
    """Check font sizes in the files; capitals of DejaVu Sans have 0.729 of the font size."""
    drawing = draw_sheets(om.load_sensor("folded-hyperboloidal"), sheet=size, workshop=WORKSHOP)
    for sheet in range(3):
        svg = drawing.render("svg", sheet).decode()
        page = float(re.search(r'width="([\d.]+)pt"', svg)[1])
        assert page == pytest.approx(SHEETS[size][0] * POINT, abs=0.01)
        sizes = [float(s) for s in re.findall(r"font(?:-size)?: (?:[a-z0-9]+ )?([\d.]+)px", svg)]
        assert len(sizes) > 60
        assert min(sizes) * 0.729 / POINT >= 2.499
    fonts = [
        float(s)
        for text in pdf_streams(drawing.render("pdf"))
        for s in re.findall(r"/F\d+ ([\d.]+) Tf", text)
    ]
    assert len(fonts) > 200
    assert min(fonts) * 0.729 / POINT >= 2.499


def texts_of(drawing, sheet):
    return set(re.findall(r">([^<>]+)</text>", drawing.render("svg", sheet).decode()))


def test_part_sheet_contains_manufacturing_data():
    sensor = om.load_sensor("paper-hyperboloidal")
    body = Body(thread="M6", bore_depth_mm=12.0)
    labels = texts_of(draw_sheets(sensor, body, workshop=WORKSHOP), 1)
    volume = 2.70e-3 * body.volume_mm3(sensor.mirror)
    edge, radius = float(sensor.mirror.sag(43.9)), float(sensor.mirror.radius_t(0.0))
    assert labels >= {
        "Ø87.8 ± 0.02",
        "5 ± 0.05",
        f"({edge:.3f})",
        f"({edge + 5:.3f})",
        "M6, 12 deep",
        f"{radius:.9g} ± 0.05 mm",
        f"{-1 - (74.5422 / 32.51673) ** -2 + 0:.6g} ± 0.005".replace("-1.190", "-1.190"),
        "A",
        "B",
        "0.001",
        "0.005",
        "3/1000 nm",
        "4/3' (0.02 mm)",
        "5/5x0.16",
        "Rq 5 nm",
        "Ra 3.2",
        "Rq 0.005",
        "Al, protected, R &gt; 88 %",
        "aluminium EN AW-6061 T6",
        f"{volume:.3g} g",
        "0.2 × 45°",
        "ISO 2768-mK",
        "OM-0042-017",
        "B. Huber",
        "2026-11-22",
        "2/2",
        "part drawing",
    }


def test_unspecified_entries_refer_to_general_tolerances():
    labels = texts_of(draw_sheets(om.load_sensor("paper-spherical")), 1)
    assert labels >= {
        "3/ ISO 10110-11",
        "4/ ISO 10110-11",
        "5/ ISO 10110-11",
        "as agreed",
        "ISO 2768-mK",
        "Ø87.81",
    }
    assert not any("±" in word for word in labels)


def test_allocated_tolerances_are_on_the_sheets():
    """Position as ISO 1101 zones about the lens axis, spacing as a dimension, shape on the part
    sheet.
    """
    sensor = om.load_sensor("paper-spherical")
    allocated = Workshop(
        tolerances={**WORKSHOP.tolerances, "mirror.zernike_4_um": 0.3, "mirror.zernike_11_um": 0.4}
    )
    drawing = draw_sheets(sensor, workshop=allocated)
    tilt = 87.81 * np.tan(np.radians(0.1))
    assert texts_of(drawing, 0) >= {
        "180.429 ± 0.1",
        "Ø0.08",
        f"{tilt:.3g}",
        "C",
        "± 0.05 mm",
        "± 20 px",
    }
    assert texts_of(drawing, 1) >= {
        "49.9582 ± 0.05 mm",
        "0 ± 0.005",
        "3/- RMSt &lt; 289 nm",
        "4/3' (0.02 mm)",
    }


def test_data_file_matches_its_checksum(tmp_path):
    files = om.export(
        om.load_sensor("folded-spherical"), tmp_path, formats=["csv", "svg"], step_mm=2.0, digits=4
    )
    tables = {f.path.name: f.path for f in files if f.path.suffix == ".csv"}
    for name, mark in zip(sorted(tables), ("-mirror", "-secondary"), strict=True):
        svg = (tmp_path / f"folded-spherical{mark}-drawing.svg").read_text()
        labels = re.findall(r">([^<>]+)</text>", svg)
        at = labels.index(name)
        assert "".join(labels[at + 2 : at + 6]) == sha256(tables[name].read_bytes()).hexdigest()


def test_assembly_sheet_describes_the_sensor():
    drawing = draw_sheets(om.load_sensor("paper-spherical"), TAPPED, Housing(rod=Rod(4.0)))
    assert texts_of(drawing, 0) >= {"paper-spherical", "180.429", "12.271", "4.35 %", "1:1"}
    assert texts_of(drawing, 1) >= {"Ø87.81", "(26.122)", "M6, 12 deep", "drill Ø5"}
    assert 'width="1190.55' in drawing.render("svg").decode()


@pytest.mark.parametrize(
    ("shell", "label"),
    [
        (Dome(material="polycarbonate"), "polycarbonate, n = 1.5855"),
        (Tube(material="sapphire", medium="water"), "sapphire, n = 1.7682, in water, n = 1.3331"),
        (Tube(refractive_index=1.6), "n = 1.6"),
        (
            Dome(material="fused_silica", medium_index=1.2),
            "fused silica, n = 1.45846, in a medium of n = 1.2",
        ),
    ],
)
def test_cover_label_states_the_material(shell, label):
    sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(shell=shell))
    assert label in texts_of(draw_sheets(sensor), 0)
    assert sensor.meridian.cover.shell.index == pytest.approx(
        float(re.search(r"n = ([\d.]+\d)", label)[1])
    )


def test_sensor_without_housing_has_no_housing_lines():
    assert not any(
        "tube" in word for word in texts_of(draw_sheets(om.load_sensor("paper-spherical")), 0)
    )


def test_sheet_references_only_written_data_files(tmp_path):
    sensor = om.load_sensor("exact-equidistant")
    for formats, is_named in ((["svg"], False), (["svg", "csv"], True), (["dxf"], False)):
        folder = tmp_path / "-".join(formats)
        om.export(sensor, folder, formats=formats)
        texts = "".join(f.read_text() for f in folder.iterdir() if f.suffix in (".svg", ".dxf"))
        assert ("DATA FILE" in texts) == is_named
        assert ("sag.csv" in texts) == is_named
        assert ("in the data file" in texts) <= is_named


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_table_defines_all_formula_symbols(kind):
    for mirror in {sensor_of(kind).mirror, one_millimetre(sensor_of(kind).mirror)}:
        rows = mirror_rows(mirror)
        formula = " ".join(row[1] for row in rows if row[0] == "form" or not row[0])
        names = " ".join(row[0] for row in rows).split()
        for symbol in set(re.findall(r"(?<![a-zA-Z_])[NRkab](?![a-zA-Z])", formula)):
            assert symbol in names, formula
        assert ("N" in formula.split()) == ("N" in names)


def one_millimetre(mirror):
    """Return the mirror with N = 1 mm, if it has a normalization radius."""
    is_normalised = "normalization_radius_mm" in mirror.PARAMETERS
    return (
        EvenPolynomial((0.012, 2e-6), 30.0)
        if is_normalised and mirror.KIND == "even-polynomial"
        else mirror
    )


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_zero_is_formatted_without_sign(kind):
    part = Part(sensor_of(kind), Body())
    assert not any(re.fullmatch(r"-0(\.0*)?", word) for row in sag_rows(part, 14) for word in row)
    assert fixed_words(-1e-12, 4) == "0.0000"


def test_pdf_contains_all_sheets():
    data = draw_sheets(om.load_sensor("folded-spherical"), sheet="A4").render("pdf")
    assert len(re.findall(rb"/Type /Page\b", data)) == 3


def test_drawing_files_are_reproducible():
    sensor = om.load_sensor("paper-hyperboloidal")
    assert draw_sheets(sensor).render("pdf") == draw_sheets(sensor).render("pdf")


def test_scales_are_standard():
    for size in (3.0, 44.0, 230.0, 5000.0):
        scale = fitting_scale(size, size, 100.0, 100.0)
        assert size * scale <= 100.0 < size * scale * 2.6
        assert re.fullmatch(r"(1|2|5)0*:1|1:(1|2|5)0*", scale_words(scale))


@pytest.mark.parametrize("options", [{"sheet": "A5"}, {"scale": 1e-9}, {"scale": 1e6}])
def test_unknown_paper_is_rejected(options):
    with pytest.raises(InvalidParameter, match=r"A5|scale must"):
        draw_sheets(sensor_of("sphere"), **options)


def test_text_widths_match_matplotlib():
    sheet = Sheet("A3")
    sheet.figure.dpi = 600
    sheet.text(50, 50, "transparent tube Ø100 × 3")
    box = (
        sheet.figure.axes[0]
        .texts[0]
        .get_window_extent(FigureCanvasAgg(sheet.figure).get_renderer())
    )
    assert sheet.text_width("transparent tube Ø100 × 3") == pytest.approx(
        box.width * 25.4 / sheet.figure.dpi, rel=0.03
    )
