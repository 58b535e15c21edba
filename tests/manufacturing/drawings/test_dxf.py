"""DXF files, read and audited by ezdxf."""

from __future__ import annotations

import ezdxf
import numpy as np
import pytest

import omnimirror as om
from omnimirror.manufacturing import Body, PartSpecification, TitleBlock, Workshop, draw_sheets
from omnimirror.manufacturing.body import Part, parts_of
from omnimirror.manufacturing.drawings.dxf import LAYERS, write_dxf
from omnimirror.manufacturing.drawings.sheet import SHEETS
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few
from tests.manufacturing.formats.test_step import BODIES


def surface_points(entity):
    """Return points (n, 2) as (z, x) along a curve of the MIRROR layer, evaluated by ezdxf."""
    match entity.dxftype():
        case "LINE":
            start, end = entity.dxf.start, entity.dxf.end
            return np.array([start.lerp(end, t) for t in np.linspace(0, 1, 200)])[:, :2]
        case "ARC":
            angles = np.linspace(entity.dxf.start_angle, entity.dxf.end_angle, 200)
            return np.array([(p.x, p.y) for p in entity.vertices(angles)])
        case "SPLINE":
            curve = entity.construction_tool()
            return np.array([(p.x, p.y) for p in curve.points(np.linspace(0, curve.max_t, 400))])


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "cone", "sampled"))
def test_section_matches_the_mirror_and_passes_the_audit(kind, body, tmp_path):
    mirror, _ = MIRRORS[kind]
    curve = write_dxf(tmp_path / "mirror.dxf", Part(sensor_of(kind), body))
    doc = ezdxf.readfile(tmp_path / "mirror.dxf")
    audit = doc.audit()
    assert not audit.errors
    assert not audit.fixes
    assert doc.units == ezdxf.units.MM
    page = doc.modelspace()
    curves = page.query("*[layer=='MIRROR']")
    assert len(curves) == 2  # section above the axis, external view below it
    for entity in curves:
        points = surface_points(entity)
        r = np.abs(points[:, 1])
        z, slope, _ = mirror.profile(np.clip(r, 0, mirror.rim_radius_mm))
        worst = 1e3 * np.abs((points[:, 0] - z) / np.sqrt(1 + slope**2)).max()
        assert worst <= max(1.02 * curve.deviation_um, 1e-5)
        assert r.max() == pytest.approx(mirror.rim_radius_mm, abs=1e-9)
        assert r.min() == pytest.approx(body.start_mm(), abs=1e-7)
    assert {np.sign(surface_points(e)[100, 1]) for e in curves} == {1.0, -1.0}


@pytest.mark.parametrize(
    ("name", "extra"), [("plain", []), ("tapped, with flange", ["5", "12", "95.8", "2"])]
)
def test_dimensions_measure_the_part(name, extra, tmp_path):
    mirror, _ = MIRRORS["hyperboloid"]
    body = BODIES[name]
    write_dxf(tmp_path / "mirror.dxf", Part(sensor_of("hyperboloid"), body))
    page = ezdxf.readfile(tmp_path / "mirror.dxf").modelspace()
    edge = float(mirror.sag(43.9))
    expected = [87.8, edge, body.thickness_mm, edge + body.thickness_mm, *map(float, extra)]
    measured = [d.get_measurement() for d in page.query("DIMENSION")]
    np.testing.assert_allclose(sorted(measured), sorted(expected), atol=1e-9)
    texts = {
        t.plain_text()
        for d in page.query("DIMENSION")
        for t in d.virtual_entities()
        if t.dxftype() == "MTEXT"
    }
    assert {"Ø87.8", f"{edge:.3f}"} <= texts


def test_layers_hatch_and_centre_line(tmp_path):
    mirror, _ = MIRRORS["even-polynomial"]
    write_dxf(
        tmp_path / "mirror.dxf", Part(sensor_of("even-polynomial"), BODIES["tapped, with flange"])
    )
    doc = ezdxf.readfile(tmp_path / "mirror.dxf")
    for layer in LAYERS:
        layer_entry = doc.layers.get(layer.name)
        assert (layer_entry.dxf.linetype, layer_entry.dxf.lineweight) == (
            layer.linetype,
            layer.width,
        )
        assert doc.modelspace().query(f"*[layer=='{layer.name}']")
    (hatch,) = doc.modelspace().query("HATCH")
    boundary = np.array(hatch.paths[0].vertices)[:, :2]
    area = 0.5 * abs(
        np.dot(boundary[:, 0], np.roll(boundary[:, 1], 1))
        - np.dot(boundary[:, 1], np.roll(boundary[:, 0], 1))
    )
    x = np.linspace(0, mirror.rim_radius_mm, 20001)
    section = np.trapezoid(float(mirror.sag(43.9)) + 8.0 - mirror.sag(x), x)
    bore = 2.5 * 12.0 + 2.5 * 2.5 / np.tan(np.radians(59)) / 2
    assert area == pytest.approx(section - bore + 4.0 * 2.0, rel=1e-4)
    notes = doc.modelspace().query("MTEXT[layer=='NOTES']")[0].plain_text()
    assert "quintic spline" in notes
    assert "M6 12 mm deep (drill 5 mm)" in notes


@pytest.mark.parametrize("size", few(sorted(SHEETS), "A4"))
def test_layout_matches_the_sheet(size, tmp_path):
    """Texts have the positions and heights of the sheet; lines are within the paper."""
    sensor, making = (
        om.load_sensor("folded-hyperboloidal"),
        PartSpecification("brass", back_flatness_mm=0.005),
    )
    workshop = Workshop(TitleBlock("OM-1"), mirror=making)
    parts = parts_of(sensor, Body())
    write_dxf(tmp_path / "mirror.dxf", parts[0], workshop, sheet=size, sheet_number=(2, 3))
    doc = ezdxf.readfile(tmp_path / "mirror.dxf")
    assert not doc.audit().errors
    layout = doc.layout(size)
    figure = draw_sheets(sensor, Body(), sheet=size, workshop=workshop).figures[1]
    expected = sorted((t.get_text(), *t.get_position()) for t in figure.axes[0].texts)
    texts = list(layout.query("TEXT"))
    labels = sorted(
        (t.dxf.text, *list(t.get_placement()[-1] or t.get_placement()[1])[:2]) for t in texts
    )
    assert [text for text, *_ in labels] == [text for text, *_ in expected]
    np.testing.assert_allclose([at for _, *at in labels], [at for _, *at in expected], atol=1e-6)
    assert min(t.dxf.height for t in texts) == pytest.approx(2.5)
    points = np.concatenate(
        [np.array(line.get_points("xy")) for line in layout.query("LWPOLYLINE")]
    )
    assert ((points >= 0) & (points <= SHEETS[size])).all()
    assert (layout.dxf.paper_width, layout.dxf.paper_height) == SHEETS[size]


def test_dimensions_include_tolerances_and_counterbore(tmp_path):
    sensor = om.load_sensor("folded-hyperboloidal")
    making = PartSpecification(diameter_tolerance_mm=0.02, thickness_tolerance_mm=0.05)
    (part, _) = parts_of(sensor)
    write_dxf(tmp_path / "mirror.dxf", part, Workshop(mirror=making))
    page = ezdxf.readfile(tmp_path / "mirror.dxf").modelspace()
    measured = [d.get_measurement() for d in page.query("DIMENSION")]
    assert {14.0, 49.69, 6.0, 87.8} <= {round(float(m), 6) for m in measured}
    texts = {
        t.plain_text()
        for d in page.query("DIMENSION")
        for t in d.virtual_entities()
        if t.dxftype() == "MTEXT"
    }
    assert {"Ø87.8±0.02", "5±0.05"} <= {
        text.replace(" ", "").replace("\n", "") for text in texts
    }, texts


def test_rotated_text_matches_the_sheet(tmp_path):
    """Rotated texts are centred at their dimension line, by the extents that ezdxf computes."""
    from ezdxf import bbox

    write_dxf(tmp_path / "mirror.dxf", Part(sensor_of("cone"), Body()))
    page = ezdxf.readfile(tmp_path / "mirror.dxf").layouts.get("A3")
    upright = [text for text in page.query("TEXT") if text.dxf.rotation]
    assert upright
    lines = [np.array(line.get_points())[:, :2] for line in page.query("LWPOLYLINE")]
    for text in upright:
        box = bbox.extents([text])
        neighbours = [
            p
            for p in lines
            if len(p) == 2 and 0.3 < p[0, 0] - box.extmax.x < 3 and np.ptp(p[:, 0]) < 1e-6
        ]
        assert any(abs(p[:, 1].mean() - box.center.y) < 0.6 for p in neighbours), text.dxf.text
