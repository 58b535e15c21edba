"""DXF files read back and audited by ezdxf."""

from __future__ import annotations

import ezdxf
import numpy as np
import pytest

from omnimirror.manufacture.drawings.dxf import LAYERS, write_dxf
from tests.conftest import MIRRORS
from tests.manufacture.test_step import BODIES


def surface_points(entity):
    """Points (n, 2) as (z, x) along a curve of the MIRROR layer, evaluated by ezdxf."""
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
@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_the_section_is_the_mirror_and_the_file_is_clean(kind, body, tmp_path):
    mirror, _ = MIRRORS[kind]
    curve = write_dxf(tmp_path / "mirror.dxf", mirror, body, kind)
    doc = ezdxf.readfile(tmp_path / "mirror.dxf")
    audit = doc.audit()
    assert not audit.errors
    assert not audit.fixes
    assert doc.units == ezdxf.units.MM
    page = doc.modelspace()
    curves = page.query("*[layer=='MIRROR']")
    assert len(curves) == 2  # cut above the axis, seen from outside below it
    for entity in curves:
        points = surface_points(entity)
        r = np.abs(points[:, 1])
        z, slope, _ = mirror.profile(np.clip(r, 0, mirror.rim_radius_mm))
        worst = 1e3 * np.abs((points[:, 0] - z) / np.sqrt(1 + slope**2)).max()
        assert worst <= max(1.02 * curve.deviation_um, 1e-5)
        assert r.max() == pytest.approx(mirror.rim_radius_mm, abs=1e-9)
        assert r.min() == pytest.approx(body.start_mm(), abs=1e-7)
    assert {np.sign(surface_points(e)[100, 1]) for e in curves} == {1.0, -1.0}


@pytest.mark.parametrize(("name", "extra"), [("plain", []), ("tapped, with flange", ["5", "12", "95.8", "2"])])
def test_dimensions_are_real_and_measure_the_part(name, extra, tmp_path):
    mirror, _ = MIRRORS["hyperboloid"]
    body = BODIES[name]
    write_dxf(tmp_path / "mirror.dxf", mirror, body, "h")
    page = ezdxf.readfile(tmp_path / "mirror.dxf").modelspace()
    edge = float(mirror.sag(43.9))
    expected = [87.8, edge, body.thickness_mm, edge + body.thickness_mm, *map(float, extra)]
    measured = [d.get_measurement() for d in page.query("DIMENSION")]
    np.testing.assert_allclose(sorted(measured), sorted(expected), atol=1e-9)
    shown = {t.plain_text() for d in page.query("DIMENSION") for t in d.virtual_entities() if t.dxftype() == "MTEXT"}
    assert {"Ø87.8", f"{edge:.3f}"} <= shown


def test_layers_hatch_and_centre_line_are_there(tmp_path):
    mirror, _ = MIRRORS["even-polynomial"]
    write_dxf(tmp_path / "mirror.dxf", mirror, BODIES["tapped, with flange"], "E-DI")
    doc = ezdxf.readfile(tmp_path / "mirror.dxf")
    for layer in LAYERS:
        found = doc.layers.get(layer.name)
        assert (found.dxf.linetype, found.dxf.lineweight) == (layer.linetype, layer.width)
        assert doc.modelspace().query(f"*[layer=='{layer.name}']")
    (hatch,) = doc.modelspace().query("HATCH")
    boundary = np.array(hatch.paths[0].vertices)[:, :2]
    area = 0.5 * abs(
        np.dot(boundary[:, 0], np.roll(boundary[:, 1], 1)) - np.dot(boundary[:, 1], np.roll(boundary[:, 0], 1))
    )
    x = np.linspace(0, mirror.rim_radius_mm, 20001)
    section = np.trapezoid(float(mirror.sag(43.9)) + 8.0 - mirror.sag(x), x)
    bore = 2.5 * 12.0 + 2.5 * 2.5 / np.tan(np.radians(59)) / 2
    assert area == pytest.approx(section - bore + 4.0 * 2.0, rel=1e-4)
    notes = doc.modelspace().query("MTEXT[layer=='NOTES']")[0].plain_text()
    assert "quintic spline" in notes
    assert "M6 12 mm deep (drill 5 mm)" in notes
