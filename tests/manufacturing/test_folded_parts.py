"""Export of folded sensors: both mirrors, lens files, and values on the drawing."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import quad

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import Body, image_shifts, sag_table
from omnimirror.manufacturing.body import MIN_WALL_MM, parts_of
from omnimirror.manufacturing.formats.zmx import field_angles, write_zmx
from omnimirror.optics.housing import CameraBody, Housing, Rod, Tube
from tests.analysis.test_two_mirrors import FOLDED, SENSORS, UNFOLDED
from tests.everyday import few
from tests.manufacturing.formats.test_step import read, volume
from tests.manufacturing.formats.test_zmx import parse_zmx, sag_of

QUICK = ["stl", "dxf", "zmx", "gridsag", "csv", "svg"]


@pytest.mark.parametrize("kind", few(["flat", "aspheric", "telecentric"], "flat"))
def test_both_mirrors_are_exported(kind, tmp_path):
    files = om.export(
        SENSORS[kind], tmp_path, formats=QUICK, grid_points=33, chord_tolerance_um=50.0
    )
    names = [file.path.name.replace(SENSORS[kind].name, "s") for file in files]
    assert sorted(names) == [
        "s-drawing.svg",
        "s-mirror-drawing.svg",
        "s-sag.csv",
        "s-secondary-drawing.svg",
        "s-secondary-sag.csv",
        "s-secondary.dat",
        "s-secondary.dxf",
        "s-secondary.stl",
        "s.dat",
        "s.dxf",
        "s.stl",
        "s.zmx",
    ]
    assert all(file.path.stat().st_size > 500 for file in files)


def test_single_file_export_writes_both_mirrors(tmp_path):
    files = om.export(FOLDED, tmp_path / "part.step", secondary_body=Body(3.0))
    assert [file.path.name for file in files] == ["part.step", "part-secondary.step"]
    primary, secondary = (read(file.path) for file in files)
    assert volume(secondary) == pytest.approx(np.pi * 20.5**2 * 3, rel=1e-9)
    mirror, back = FOLDED.mirror, float(FOLDED.mirror.sag(43.905)) + 5
    pierced = quad(lambda x: 2 * np.pi * x * (back - float(mirror.sag(x))), 5.0, 43.905)[
        0
    ]  # from the bore outwards
    body = parts_of(FOLDED, secondary_body=Body(3.0))[0].body
    pierced -= (
        np.pi * ((body.counterbore_diameter_mm / 2) ** 2 - 5.0**2) * body.counterbore_depth_mm
    )
    assert volume(primary) == pytest.approx(pierced, rel=1e-7)
    assert volume(primary) == pytest.approx(body.volume_mm3(mirror), rel=1e-7)


@pytest.mark.parametrize("name", ["folded-spherical", "folded-hyperboloidal"])
def test_counterbore_clears_lens_and_rays(name):
    """Chief rays from the secondary mirror and the lens clear the body, and the minimum wall
    remains.
    """
    sensor = om.load_sensor(name)
    body, mirror = parts_of(sensor)[0].body, sensor.mirror
    corners = body.outline(mirror)
    lens = sensor.secondary.lens_height(sensor.mirror_distance_mm)
    back = body.back_mm(mirror)
    floor = back - body.counterbore_depth_mm
    assert floor <= lens - 1.5  # the lens is in the wide part
    assert body.counterbore_diameter_mm >= 14.0
    r = np.linspace(body.bore_mm / 2, body.counterbore_diameter_mm / 2, 50)
    assert (floor - mirror.sag(r)).min() >= MIN_WALL_MM - 1e-9
    rays = sensor.meridian.trace(np.linspace(sensor.meridian.x_min, mirror.rim_radius_mm, 200))
    x, z = rays.first.x, sensor.secondary.height(rays.first.x)
    for radius, height in corners[corners[:, 0] < 0.9 * mirror.rim_radius_mm]:
        if height < lens:
            at = x * (lens - height) / (lens - z)  # towards the lens centre
            assert (at < radius).all()


def test_plane_mirror_section_has_no_zero_dimension(tmp_path):
    from ezdxf.filemanagement import readfile

    om.export(FOLDED, tmp_path / "part.dxf")
    drawing = readfile(tmp_path / "part-secondary.dxf")
    assert not drawing.audit().errors
    lengths = sorted(float(d.get_measurement()) for d in drawing.modelspace().query("DIMENSION"))
    assert lengths == pytest.approx([5.0, 41.0])


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_lens_file_chief_rays_have_the_listed_field_angles(kind, tmp_path):
    """Trace from each field point by reflection at the surfaces of the file."""
    sensor = SENSORS[kind]
    write_zmx(tmp_path / "s.zmx", sensor)
    system, surfaces = parse_zmx(tmp_path / "s.zmx")
    assert [s.get("GLAS", ["none"])[0] for s in surfaces] == [
        "none",
        "none",
        "MIRROR",
        "MIRROR",
        "none",
    ]
    telecentric = system["FTYP"][1] == "1"
    with mp.workdps(25):
        secondary, primary = sag_of(surfaces[2]), sag_of(surfaces[3])
        to_secondary, back = (mp.mpf(surfaces[i]["DISZ"][0]) for i in (1, 2))
        assert float(back) == -sensor.secondary.distance_mm
        for omega, height in zip(field_angles(sensor), system["YFLN"], strict=False):
            h = mp.mpf(height)
            slope = (
                mp.mpf(0) if telecentric else -h / mp.mpf(surfaces[0]["DISZ"][0])
            )  # undeviated at the lens centre
            y, z = (h if telecentric else mp.mpf(0)), mp.mpf(0)
            dy, dz = slope / mp.hypot(slope, 1), 1 / mp.hypot(slope, 1)
            for vertex, sag, guess in (
                (to_secondary, secondary, to_secondary),
                (to_secondary + back, primary, back),
            ):
                t = mp.findroot(lambda t: z + t * dz - vertex - sag(y + t * dy), guess / dz)  # noqa: B023
                y, z = y + t * dy, z + t * dz
                n = mp.diff(sag, y)
                across = (dy * n - dz) / (1 + n**2)
                dy, dz = dy - 2 * across * n, dz + 2 * across
            assert float(mp.degrees(mp.acos(dz))) == pytest.approx(omega, abs=1e-6)


@pytest.mark.parametrize("kind", ["concave", "two-hyperboloids"])
def test_table_field_angles_match_pixel_rays(kind):
    """Compare points of the secondary with the ray of the pixel at the same viewing angle."""
    sensor = SENSORS[kind]
    x = np.linspace(0.0, sensor.secondary.mirror.rim_radius_mm, 23)
    table = sag_table(sensor, x, secondary=True)
    w = sensor.mirror_distance_mm - sensor.secondary.distance_mm + table["sag_mm"]
    h = sensor.lens.image_height(x, w) / sensor.imager.pitch_mm
    pixels = np.stack([511.5 + h, np.full_like(h, 511.5)], axis=-1)
    _, directions, valid = sensor.backproject(pixels)
    inside = h < 511  # inside the image
    np.testing.assert_array_equal(np.isfinite(table["omega_deg"])[inside], valid[inside])
    assert valid.sum() > 5
    omega = np.degrees(np.arccos(directions[valid] @ sensor.axis))
    np.testing.assert_allclose(table["omega_deg"][valid], omega, atol=1e-9)


def test_fold_displacement_counts_twice():
    """Compare with the unfolded sensor: lens and mirror change one path, the fold both.

    The field angle of the maximum is the last of the steps before the rim.
    """
    alone = {s.name: s.px_per_unit for s in image_shifts(UNFOLDED)}["mirror distance"]
    folded = {s.name: s.px_per_unit for s in image_shifts(FOLDED)}
    assert folded["lens distance"] == pytest.approx(alone, rel=5e-3)
    assert folded["mirror distance"] == pytest.approx(folded["lens distance"], rel=1e-6)
    assert folded["secondary distance"] == pytest.approx(2 * folded["lens distance"], rel=1e-6)


def test_central_obscuration_matches_invalid_pixels():
    (ring,) = FOLDED.obscured
    assert ring.omega_deg == (0.0, pytest.approx(FOLDED.field_deg[0]))
    u, v = np.meshgrid(np.arange(0.5, 1024, 4), np.arange(0.5, 1024, 4))
    inside = np.hypot(u - 511.5, v - 511.5) < FOLDED.rim_radius_px
    _, _, valid = FOLDED.backproject(np.stack([u[inside], v[inside]], axis=-1))
    assert ring.image_percent == pytest.approx(100 * (1 - valid.mean()), abs=0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"body": Body(bore_diameter_mm=6.0, bore_depth_mm=np.inf)},
            "bore_diameter_mm must be at least 10",
        ),
        ({"body": Body(thread="M6")}, "with bore_depth_mm = inf"),
        ({"housing": Housing(rod=Rod())}, "not supported with a secondary"),
        (
            {"housing": Housing(CameraBody(20.0), shell=Tube())},
            "set bore_radius_mm of the secondary",
        ),
    ],
)
def test_invalid_folded_parts_are_rejected(options, message, tmp_path):
    with pytest.raises(InvalidParameter, match=message):
        om.export(FOLDED, tmp_path, formats=["svg"], **options)
    assert not list(tmp_path.iterdir())


def test_secondary_thickness_requires_a_secondary(tmp_path, capsys):
    options = ["--formats", "csv", "--set", "body.secondary_thickness_mm=3"]
    with pytest.raises(SystemExit, match=r"^[12]$"):
        main(["export", "paper-spherical", "-o", str(tmp_path / "out"), *options])
    assert "which has one mirror" in capsys.readouterr().err
