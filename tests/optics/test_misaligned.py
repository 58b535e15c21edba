"""Sensors with a decentred, tilted or displaced mirror, as cameras."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, NotOneToOne, SpecError
from omnimirror.cameras.camera import Mount
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few

SPH = om.load_sensor("paper-spherical")
POSES = [
    MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0),
    MirrorPose(-6.0, 4.0, -5.0, -5.0, 7.0),
    MirrorPose(0, 0, 2.0, 0, 1e-9),
]
SMALL_MISALIGNMENT = MirrorPose(
    decentre_x_mm=1e-300
)  # misaligned by a negligible amount, which selects tracing in space


def pixels_all_over(sensor, count=600):
    width, height = sensor.image_size
    return np.random.default_rng(3).uniform(-0.5, [width - 0.5, height - 0.5], (count, 2))


@pytest.mark.full
def test_thread_safety_of_ray_tracing():
    """Regression test: one call in ten failed when OpenBLAS divided products of this size among its
    threads."""
    sensor = replace(SPH, mirror_pose=POSES[0])
    pixels = np.stack(np.meshgrid(*[np.linspace(0, 1023, 520)] * 2), axis=-1).reshape(-1, 2)
    expected = sensor.backproject(pixels)
    with ThreadPoolExecutor(3) as pool:
        for rays in pool.map(lambda _: sensor.backproject(pixels), range(24)):
            np.testing.assert_array_equal(rays.origins, expected.origins)
            np.testing.assert_array_equal(rays.directions, expected.directions)


@pytest.mark.parametrize("lens", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    "kind", few(sorted(MIRRORS), "cone", "conic-asphere", "sampled", "equidistant")
)
def test_skew_trace_of_aligned_mirror_matches_meridian(kind, lens):
    if lens == "orthographic" and kind in ("cone", "equidistant"):
        pytest.skip("made for a perspective lens")
    sensor = sensor_of(kind, lens)
    in_space = replace(sensor, mirror_pose=SMALL_MISALIGNMENT)
    assert in_space.symmetry is None
    pixels = pixels_all_over(sensor)
    plane, solid = sensor.backproject(pixels), in_space.backproject(pixels)
    np.testing.assert_array_equal(plane.valid, solid.valid)
    np.testing.assert_allclose(plane.origins, solid.origins, atol=1e-12, rtol=0)
    np.testing.assert_allclose(plane.directions, solid.directions, atol=1e-12, rtol=0)
    away = np.random.default_rng(2).normal(size=(600, 3))
    one, other = sensor.project_directions(away), in_space.project_directions(away)
    np.testing.assert_array_equal(one.valid, other.valid)
    np.testing.assert_allclose(one.pixels, other.pixels, atol=1e-9, rtol=0)
    one, other = sensor.project(200 * away), in_space.project(200 * away)
    np.testing.assert_array_equal(one.valid, other.valid)
    np.testing.assert_allclose(one.pixels, other.pixels, atol=1e-9, rtol=0)


@pytest.mark.parametrize("lens", ["perspective", "orthographic"])
@pytest.mark.parametrize("pose", POSES, ids=["some", "much", "hardly"])
@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_rays_project_to_their_pixels(kind, pose, lens):
    sensor = replace(sensor_of(kind, lens), mirror_pose=pose)
    pixels = pixels_all_over(sensor)
    if lens == "orthographic" and kind == "cone":  # a single direction
        with pytest.raises(NotOneToOne):
            sensor.backproject(pixels)
        return
    origins, directions, valid = sensor.backproject(pixels)
    assert valid.mean() > 0.5
    back = sensor.project_directions(directions[valid])
    assert back.valid.all()
    np.testing.assert_allclose(back.pixels, pixels[valid], atol=1e-8, rtol=0)
    for distance_mm in (60.0, 3e3):
        back = sensor.project(origins[valid] + distance_mm * directions[valid])
        assert back.valid.all()
        np.testing.assert_allclose(back.pixels, pixels[valid], atol=1e-8, rtol=0)


@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "conic-asphere", "hyperboloid", "sampled"))
def test_projected_points_on_back_projected_rays(kind):
    """The pixel of any direction or point projects back to it; directions without a pixel are not
    observed."""
    sensor = replace(sensor_of(kind), mirror_pose=POSES[0])
    away = np.random.default_rng(2).normal(size=(3000, 3))
    projection = sensor.project_directions(away)
    rays = sensor.backproject(projection.pixels[projection.valid])
    assert rays.valid.all()
    unit = away[projection.valid] / np.linalg.norm(away[projection.valid], axis=1, keepdims=True)
    np.testing.assert_allclose(rays.directions, unit, atol=1e-9)
    hidden = away[~projection.valid] / np.linalg.norm(
        away[~projection.valid], axis=1, keepdims=True
    )
    lattice = np.stack(np.meshgrid(*[np.arange(0, 1024, 8.0)] * 2), axis=-1).reshape(-1, 2)
    lattice_rays = sensor.backproject(lattice)
    nearest = (hidden @ lattice_rays.directions[lattice_rays.valid].T).max(axis=1)
    assert (nearest < np.cos(np.radians(0.5))).mean() > 0.9  # except near the rim
    near = sensor.project(150 * away)
    rays = sensor.backproject(near.pixels[near.valid])
    to_points = 150 * away[near.valid] - rays.origins
    np.testing.assert_allclose(
        rays.directions, to_points / np.linalg.norm(to_points, axis=1, keepdims=True), atol=1e-9
    )


@given(
    x=st.floats(-3, 3),
    y=st.floats(-3, 3),
    z=st.floats(-4, 4),
    tip=st.floats(-4, 4),
    side=st.floats(-4, 4),
    orientation=st.sampled_from(["up", "down", "forward"]),
    flipped=st.booleans(),
)
def test_random_misalignments_round_trip(x, y, z, tip, side, orientation, flipped):
    sensor = replace(
        SPH, mirror_pose=MirrorPose(x, y, z, tip, side), mount=Mount(orientation, 30.0, flipped)
    )
    pixels = np.array([[511.5, 500.0], [300.0, 700.0], [900.0, 400.0]])
    origins, directions, valid = sensor.backproject(pixels)
    assert valid.all()
    np.testing.assert_allclose(sensor.project_directions(directions).pixels, pixels, atol=1e-8)
    np.testing.assert_allclose(sensor.project(origins + 500 * directions).pixels, pixels, atol=1e-8)


def test_tilted_sphere_equals_shifted_sphere():
    """A tilt of a sphere about its vertex only moves its centre; the image is equal except at the
    rim."""
    A, tip, side = SPH.mirror.radius_mm, np.radians(1.5), np.radians(-2.5)
    centre = A * np.array([np.sin(side) * np.cos(tip), -np.sin(tip), np.cos(side) * np.cos(tip)])
    tilted = replace(SPH, mirror_pose=MirrorPose(tilt_x_deg=1.5, tilt_y_deg=-2.5))
    moved = replace(SPH, mirror_pose=MirrorPose(centre[0], centre[1], centre[2] - A))
    pixels = pixels_all_over(SPH)
    pixels = pixels[np.hypot(*(pixels - 511.5).T) < 450]
    one, other = tilted.backproject(pixels), moved.backproject(pixels)
    np.testing.assert_allclose(one.origins, other.origins, atol=1e-11)
    np.testing.assert_allclose(one.directions, other.directions, atol=1e-12)


def test_displaced_mirror_equals_changed_distance():
    displaced = replace(SPH, mirror_pose=MirrorPose(displacement_mm=3.0))
    farther = replace(SPH, mirror_distance_mm=SPH.mirror_distance_mm + 3.0)
    assert displaced.symmetry is not None
    pixels = pixels_all_over(SPH)
    one, other = displaced.backproject(pixels), farther.backproject(pixels)
    np.testing.assert_array_equal(one.directions, other.directions)
    away = np.array([0.0, 0.0, 3.0])
    np.testing.assert_allclose(one.origins, other.origins + away, atol=1e-13)
    points = 300 * np.random.default_rng(2).normal(size=(50, 3))
    projection, expected = displaced.project(points + away), farther.project(points)
    np.testing.assert_allclose(projection.pixels, expected.pixels, atol=1e-9)
    wall = om.Dewarper(displaced, om.screens.Plane((64, 48), distance_mm=150.0))
    np.testing.assert_allclose(wall.coordinates(), wall.coordinates(exact=True), atol=0.01)
    one, other = om.evaluate(displaced), om.evaluate(farther)
    for name, column in one.columns().items():
        np.testing.assert_allclose(column, other.columns()[name], rtol=1e-13)
    assert om.best_focus(displaced).focus_mm == pytest.approx(om.best_focus(farther).focus_mm)


@pytest.mark.parametrize("lens", ["perspective", "orthographic"])
def test_decentred_mirror_shifts_image(lens):
    """A shift of 1 mm to the right moves the image to the right, by the scale of the lens."""
    sensor = sensor_of("sphere", lens)
    moved = replace(sensor, mirror_pose=MirrorPose(decentre_x_mm=1.0, decentre_y_mm=-0.5))
    scale = (
        sensor.lens.image_height(np.ones(1), np.full(1, sensor.mirror_distance_mm))[0]
        / sensor.imager.pitch_mm
    )
    before, after = (s.project_directions([s.axis]).pixels[0] for s in (sensor, moved))
    np.testing.assert_allclose(after - before, [scale, -scale / 2], rtol=0.15)


@pytest.mark.parametrize(
    "view",
    [
        om.screens.Cylinder((720, 180), -60, 30),
        om.screens.Plane((320, 240), pan_deg=40, hfov_deg=80),
        om.screens.Plane((320, 240), distance_mm=300.0),
        om.screens.DomeMaster((240, 240), 120.0),
    ],
    ids=["panorama", "perspective", "near wall", "dome"],
)
def test_dewarping_of_misaligned_sensor_is_exact(view):
    sensor = replace(SPH, mirror_pose=POSES[0])
    dewarper = om.Dewarper(sensor, view)
    quick, exact = dewarper.coordinates(), dewarper.coordinates(exact=True)
    np.testing.assert_array_equal(np.isnan(quick), np.isnan(exact))
    assert np.nanmax(abs(quick - exact)) < 0.005
    aligned = om.Dewarper(SPH, view).coordinates()
    assert np.nanmax(abs(quick - aligned)) > 5  # a significant effect


def test_meridional_evaluation_rejects_misaligned_sensor():
    sensor = replace(SPH, mirror_pose=MirrorPose(tilt_x_deg=0.5))
    for function in (
        om.evaluate,
        om.best_focus,
        lambda s: om.best_viewpoint(s, 300.0),
        lambda s: s.field_deg,
    ):
        with pytest.raises(
            InvalidParameter, match=r"'paper-spherical' must be aligned .*sensor\.aligned\(\)"
        ):
            function(sensor)
    assert sensor.aligned() == SPH
    with pytest.raises(InvalidParameter, match="for a camera without axial symmetry"):
        om.Dewarper(
            sensor, om.screens.Plane((32, 24), distance_mm=300.0), viewpoint="single"
        ).coordinates()


POSE_TABLE = "\n[mirror_pose]\ndecentre_x_mm = 0.25\ntilt_y_deg = -0.5\n"


def test_pose_file_round_trip():
    sensor = parse_sensor(format_sensor(SPH) + POSE_TABLE)
    assert sensor.mirror_pose == MirrorPose(decentre_x_mm=0.25, tilt_y_deg=-0.5)
    assert parse_sensor(format_sensor(sensor)) == sensor
    assert "mirror_pose" not in format_sensor(SPH)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "tilt_y_deg = -0.5",
            "tilt_deg = 1.0",
            r"unknown entry mirror_pose.tilt_deg; did you mean tilt_\w_deg\?",
        ),
        ("-0.5", "-70.0", "mirror_pose.tilt_y_deg must be greater than or equal to -60"),
        ("0.25", '"left"', "mirror_pose.decentre_x_mm must be a valid number; got 'left'"),
        ("[mirror_pose]", "[miror_pose]", r"unknown entry miror_pose; did you mean mirror_pose\?"),
    ],
)
def test_invalid_pose_error_reports_line(old, new, message):
    with pytest.raises(SpecError, match=message):
        parse_sensor(format_sensor(SPH) + POSE_TABLE.replace(old, new))
