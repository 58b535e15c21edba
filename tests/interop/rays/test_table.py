"""Ray tables against rays that are traced here, by plane geometry alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.housing import CameraBody, Housing, Tube
from omnimirror.interop.rays.table import between_rays_deg
from omnimirror.mirrors.pose import MirrorPose
from tests.conftest import sensor_of

MISALIGNED = MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)


def coarse(sensor, pixels=64):
    imager = sensor.imager
    pitch = imager.pixel_pitch_um * imager.width_px / pixels
    return replace(sensor, imager=replace(imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch))


def by_a_ball(sensor):
    """Origins, directions (rows, columns, 3) of a sensor that looks up at a ball through a pinhole; NaN beside it."""
    width, height = sensor.image_size
    u, v = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    pitch = sensor.imager.pitch_mm
    way = np.stack([u * pitch, v * pitch, np.full_like(u, sensor.lens.image_distance)], axis=-1)
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    lens = np.array([0.0, 0.0, -sensor.mirror_distance_mm])
    radius = sensor.mirror.radius_mm
    centre = sensor.mirror_pose.to_camera([[0.0, 0.0, radius]])[0]
    b, c = way @ (lens - centre), (lens - centre) @ (lens - centre) - radius**2
    with np.errstate(invalid="ignore"):
        point = lens + (-b - np.sqrt(b**2 - c))[..., None] * way
    normal = (point - centre) / radius
    out = way - 2 * (way * normal).sum(-1, keepdims=True) * normal
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # lying on its back: forward is image top, left image right
    return point @ turn.T, out @ turn.T


@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
def test_rays_are_those_of_a_pinhole_and_a_ball(pose):
    sensor = replace(coarse(om.load_sensor("paper-spherical")), mirror_pose=pose)
    table = om.ray_table(sensor)
    origins, directions = by_a_ball(sensor)
    on = table.weights > 0
    assert on.sum() > 3000
    assert np.abs(table.origins - origins)[on].max() < 1e-6
    assert np.degrees(np.abs(table.directions - directions)[on]).max() < 1e-6
    assert not table.origins[~table.has_ray].any()
    assert not table.weights[~table.has_ray].any()


@pytest.mark.parametrize("kind", ["hyperboloid", "cone", "even-polynomial", "sampled"])
@pytest.mark.parametrize("housing", [None, Housing(shell=Tube(110.0, 4.0))], ids=["bare", "tube"])
def test_points_along_a_ray_are_seen_in_its_pixel(kind, housing):
    """By the projection, which solves for the reflection point instead of tracing away from it."""
    sensor = coarse(sensor_of(kind), 32)
    if housing is not None:
        sensor = replace(sensor, housing=housing)
    table = om.ray_table(sensor)
    rows, columns = np.nonzero(table.weights)
    assert len(rows) > 500
    for far in (300.0, 5000.0):
        found = sensor.project(table.origins[rows, columns] + far * table.directions[rows, columns])
        inside = found.valid
        assert inside.mean() > 0.9  # points behind the tube's far side or on the rim itself are not
        off = np.abs(found.pixels - np.stack([columns, rows], axis=-1))[inside]
        assert off.max() < 1e-4


def test_a_calibrated_camera_has_one_viewpoint():
    table = om.ray_table(om.Unified(0.9, (200.0, 200.0), (159.5, 119.5), (320, 240)), step=7)
    assert table.size == (46, 35)
    on = table.weights > 0
    assert not table.origins.any()
    assert np.allclose(np.linalg.norm(table.directions[on], axis=-1), 1)


def test_what_the_camera_body_hides_weighs_nothing():
    """It stands below the mirror, so a ray that leads down within its radius ends at it."""
    body = CameraBody(150.0)
    sensor = replace(coarse(om.load_sensor("paper-spherical")), housing=Housing(body))
    table, bare = om.ray_table(sensor), om.ray_table(replace(sensor, housing=Housing()))
    level = -sensor.mirror_distance_mm + body.height_mm
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = (level - table.origins[..., 2]) / table.directions[..., 2]
        at = table.origins + steps[..., None] * table.directions
    ends = table.has_ray & (steps > 0) & (np.hypot(at[..., 0], at[..., 1]) < body.diameter_mm / 2)
    assert ends.sum() > 50
    assert (table.weights == (table.has_ray & ~ends)).all()
    assert (table.directions == bare.directions).all()


def test_two_mirrors_hide_rings():
    """The second mirror's edge and the tube's lid stop what leads down nearer to the axis than they are wide."""
    sensor = coarse(replace(om.load_sensor("folded-spherical"), housing=Housing(shell=Tube())), 128)
    table = om.ray_table(sensor)
    omega = np.degrees(np.arccos(table.directions[table.has_ray] @ sensor.axis))
    rings = [ring.omega_deg for ring in sensor.obscured]
    assert max(high for _, high in rings) > sensor.field_deg[0] + 5
    hidden = np.any([(omega >= low) & (omega <= high) for low, high in rings], axis=0)
    assert ((table.weights[table.has_ray] == 0) == hidden).all()
    assert hidden.sum() > 50


@pytest.mark.parametrize("step", [0, 2000, 1.5, "2"])
def test_a_step_that_is_none(step):
    with pytest.raises(om.errors.InvalidParameter, match="step"):
        om.ray_table(om.load_sensor("paper-spherical"), step)


def test_the_error_between_rays_is_what_is_said():
    sensor = coarse(om.load_sensor("paper-spherical"), 200)

    table, said = om.ray_table(sensor, 5), between_rays_deg(om.ray_table(sensor, 5))
    d = table.directions
    mean = d[:-1, :-1] + d[1:, :-1] + d[:-1, 1:] + d[1:, 1:]
    there = table.has_ray
    inside = there[:-1, :-1] & there[1:, :-1] & there[:-1, 1:] & there[1:, 1:]
    v, u = np.nonzero(inside)
    true = sensor.backproject(np.stack([u, v], axis=-1) * 5.0 + 2.5)
    off = np.degrees(
        np.linalg.norm(np.cross(mean[inside], true.directions), axis=-1) / np.linalg.norm(mean[inside], axis=-1)
    )
    assert 0.5 * said < np.nanmax(off) < 1.1 * said
