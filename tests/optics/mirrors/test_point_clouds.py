"""Profiles estimated from point clouds and height grids, against the true mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError, SpecError
from omnimirror.manufacturing import format_grid_sag
from omnimirror.optics.mirrors import Cone, Hyperboloid, SampledProfile, Sphere
from omnimirror.optics.mirrors.measured import profile_of
from omnimirror.optics.sensor_files import load_sensor, parse_sensor

HYPERBOLOID = Hyperboloid(32.5, 74.5, 44.0)
DECENTRED_POINTS = "".join(
    f"{x},{y},{(x * x + y * y) / 90}\n" for x in range(20, 40) for y in range(20)
)
RADII = np.linspace(0.5, 39.0, 150)
SENSOR = """
[mirror]
kind = "sampled"
{entry}

[lens]
kind = "perspective"
focal_length_mm = 11.6
f_number = 4.0
focus_distance_mm = 212.0

[imager]
width_px = 1024
height_px = 1024
pixel_pitch_um = 5.2

[mount]
mirror_distance_mm = 160.0
"""


def cloud(mirror, scatter_mm, count=3000, above=False, seed=2, rim_mm=40.0):
    """Return points in machine axes: offsets of 3 and -2 mm, tilts of 0.8 and -0.5 deg."""
    rng = np.random.default_rng(seed)
    phi, r = rng.uniform(0, 2 * np.pi, count), rim_mm * np.sqrt(rng.uniform(0, 1, count))
    z = mirror.sag(r) + scatter_mm * rng.standard_normal(count)
    a, b = np.radians([0.8, -0.5])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    points = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1) @ (about_x @ about_y).T + [
        3.0,
        -2.0,
        100.0,
    ]
    return points * [1, -1, -1] if above else points


@pytest.mark.parametrize("above", [False, True])
def test_point_cloud_axis_estimated(above):
    x, z = profile_of(cloud(HYPERBOLOID, 1e-3, above=above))
    mirror = SampledProfile(x, z)
    assert mirror.rim_radius_mm == pytest.approx(40.0, abs=0.05)
    in_a_ring = 3000 / len(x)
    assert mirror.fit.uncertainty_mm == pytest.approx(1e-3 / np.sqrt(in_a_ring), rel=0.25)
    np.testing.assert_allclose(mirror.sag(RADII), HYPERBOLOID.sag(RADII), atol=1e-3)
    np.testing.assert_allclose(mirror.slope(RADII), HYPERBOLOID.slope(RADII), atol=1e-3)


@pytest.mark.long
def test_exact_cloud_defines_mirror():
    mirror = SampledProfile(*profile_of(cloud(HYPERBOLOID, 0.0)))
    np.testing.assert_allclose(mirror.sag(RADII), HYPERBOLOID.sag(RADII), atol=2e-5)
    np.testing.assert_allclose(mirror.slope(RADII), HYPERBOLOID.slope(RADII), atol=2e-5)


def test_sphere_keeps_machine_axes():
    mirror = SampledProfile(*profile_of(cloud(Sphere(50.0, 44.0), 1e-3)))
    at = RADII[mirror.rim_radius_mm > RADII]
    np.testing.assert_allclose(mirror.slope(at), Sphere(50.0, 44.0).slope(at), atol=1e-3)


def test_cloud_axis_robust_to_outliers():
    points = cloud(HYPERBOLOID, 1e-3)
    points[::750, 2] += 0.5
    mirror = SampledProfile(*profile_of(points))
    assert 0 < len(mirror.outliers) <= 8
    np.testing.assert_allclose(mirror.slope(RADII), HYPERBOLOID.slope(RADII), atol=2e-3)


def test_cone_cloud_is_pointed():
    x, z = profile_of(cloud(Cone(40.0, 44.0), 1e-4))
    mirror = SampledProfile(x, z, apex="pointed")
    np.testing.assert_allclose(mirror.slope(RADII[5:]), np.tan(np.radians(40.0)), atol=3e-3)


def test_sensor_file_names_cloud_or_grid(tmp_path):
    points = cloud(HYPERBOLOID, 0.0, count=1500)
    rows = "\n".join(f"{x:.9f}, {y:.9f}, {z:.9f}" for x, y, z in points)
    (tmp_path / "cloud.csv").write_text(f"x,y,z\n# mm\n{rows}\n")
    (tmp_path / "grid.dat").write_text(format_grid_sag(HYPERBOLOID, 65))
    for entry in ('cloud_csv = "cloud.csv"', 'grid_sag = "grid.dat"\nrim_radius_mm = 40.0'):
        (tmp_path / "s.toml").write_text(SENSOR.format(entry=entry))
        sensor = load_sensor(tmp_path / "s.toml")
        np.testing.assert_allclose(sensor.mirror.sag(RADII), HYPERBOLOID.sag(RADII), atol=1e-4)
        assert om.evaluate(sensor, [30.0]).x_mm[0] > 0


@pytest.mark.parametrize("entry", ["cloud_csv", "grid_sag", "profile_csv"])
def test_untrusted_text_must_not_name_files(entry):
    with pytest.raises(
        SpecError, match=f"{entry} must not name a file here; enter x_mm and z_mm instead"
    ):
        parse_sensor(SENSOR.format(entry=f'{entry} = "/etc/passwd"'), folder=None)


@pytest.mark.parametrize(
    ("entry", "text", "message"),
    [
        ("cloud_csv", "1,2,3\n" * 50, "at least 200 points; got 50"),
        (
            "cloud_csv",
            "1,2,3\n1,2\n",
            "line 2: the row must contain x, y, z, as the other rows; got '1,2'",
        ),
        ("cloud_csv", "1,2,3\n1,nan,2\n", "at least 200 points; got 1"),
        ("cloud_csv", "".join(f"{i % 20},{i // 20},0\n" for i in range(400)), "got flat points"),
        ("cloud_csv", DECENTRED_POINTS, "must surround its axis"),
        ("grid_sag", "", "must be a grid of heights"),
        ("grid_sag", "3 3 1 1 0 0 0\n1\n", "must be a grid of heights"),
        ("grid_sag", "3 3 1 1 9 0 0\n" + "1\n" * 9, "must be a grid of heights"),
        (
            "grid_sag",
            "2 2 1 1 0 0 0\n1\n2\nx\n4\n",
            "line 3: the line must contain z and further columns; got 'x'",
        ),
    ],
)
def test_invalid_clouds_and_grids_rejected(tmp_path, entry, text, message):
    (tmp_path / "f").write_text(text)
    (tmp_path / "s.toml").write_text(SENSOR.format(entry=f'{entry} = "f"'))
    with pytest.raises(OmnimirrorError, match=message):
        load_sensor(tmp_path / "s.toml")


@pytest.mark.parametrize(
    ("name", "count", "scatter_mm"),
    [
        ("paper-hyperboloidal", 4000, 2e-4),
        ("paper-hyperboloidal", 1000, 2e-4),
        ("paper-hyperboloidal", 500, 1e-3),
        ("paper-equidistant", 1000, 2e-4),
        ("paper-spherical", 500, 1e-3),
        ("paraboloid-telecentric", 1000, 5e-3),
    ],
)
def test_sparse_cloud_uncertainty(name, count, scatter_mm):
    """Also near the field limits: clouds have few points at the apex, and end at the rim."""
    sensor = load_sensor(name)
    low, high = sensor.field_deg
    omega = np.linspace(low + 0.02 * (high - low), high - 0.03 * (high - low), 12)
    points = cloud(sensor.mirror, scatter_mm, count, rim_mm=sensor.mirror.rim_radius_mm)
    measured = om.evaluate(replace(sensor, mirror=SampledProfile(*profile_of(points))), omega)
    true, sigmas = om.evaluate(sensor, omega), measured.standard_deviations()
    for column in ("h_px", "dh_domega_px_per_deg", "blur_t_px", "blur_s_px"):
        error = np.abs(getattr(measured, column) - getattr(true, column)) / sigmas[column]
        assert 0.1 < np.sqrt((error**2).mean()) < 3, column
        assert error.max() < 7, column
