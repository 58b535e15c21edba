"""Ray tables against rays traced independently."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.interop.ray_tables import interpolation_error_deg
from omnimirror.optics.housing import CameraBody, Housing, Tube
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import sensor_of

MISALIGNED = MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)


def coarse(sensor, pixels=64):
    imager = sensor.imager
    pitch = imager.pixel_pitch_um * imager.width_px / pixels
    return replace(
        sensor, imager=replace(imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch)
    )


def trace_sphere(sensor):
    """Trace a spherical mirror above a pinhole camera; return origins and directions, NaN outside."""
    width, height = sensor.image_size
    u, v = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    pitch = sensor.imager.pitch_mm
    ray = np.stack([u * pitch, v * pitch, np.full_like(u, sensor.lens.image_distance)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    lens = np.array([0.0, 0.0, -sensor.mirror_distance_mm])
    radius = sensor.mirror.radius_mm
    centre = sensor.mirror_pose.to_camera([[0.0, 0.0, radius]])[0]
    b, c = ray @ (lens - centre), (lens - centre) @ (lens - centre) - radius**2
    with np.errstate(invalid="ignore"):
        point = lens + (-b - np.sqrt(b**2 - c))[..., None] * ray
    normal = (point - centre) / radius
    out = ray - 2 * (ray * normal).sum(-1, keepdims=True) * normal
    turn = np.array(
        [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
    )  # upwards camera: forward is image top, left is image right
    return point @ turn.T, out @ turn.T


@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
def test_rays_of_a_spherical_mirror(pose):
    sensor = replace(coarse(om.load_sensor("paper-spherical")), mirror_pose=pose)
    table = om.ray_table(sensor)
    origins, directions = trace_sphere(sensor)
    on = table.weights > 0
    assert on.sum() > 3000
    assert np.abs(table.origins - origins)[on].max() < 1e-6
    assert np.degrees(np.abs(table.directions - directions)[on]).max() < 1e-6
    assert not table.origins[~table.has_ray].any()
    assert not table.weights[~table.has_ray].any()


@pytest.mark.parametrize("kind", ["hyperboloid", "cone", "even-polynomial", "sampled"])
@pytest.mark.parametrize("housing", [None, Housing(shell=Tube(110.0, 4.0))], ids=["bare", "tube"])
def test_points_along_a_ray_project_to_its_pixel(kind, housing):
    """The projection solves for the reflection point and is independent of ray tracing."""
    sensor = coarse(sensor_of(kind), 32)
    if housing is not None:
        sensor = replace(sensor, housing=housing)
    table = om.ray_table(sensor)
    rows, columns = np.nonzero(table.weights)
    assert len(rows) > 500
    for distance_mm in (300.0, 5000.0):
        image = sensor.project(
            table.origins[rows, columns] + distance_mm * table.directions[rows, columns]
        )
        inside = image.valid
        assert inside.mean() > 0.9  # except behind the tube and at the rim
        error = np.abs(image.pixels - np.stack([columns, rows], axis=-1))[inside]
        assert error.max() < 1e-4


def test_calibrated_camera_has_a_single_viewpoint():
    table = om.ray_table(
        om.Unified(
            xi=0.9, focal_px=(200.0, 200.0), centre_px=(159.5, 119.5), image_size=(320, 240)
        ),
        step=7,
    )
    assert table.size == (46, 35)
    on = table.weights > 0
    assert not table.origins.any()
    assert np.allclose(np.linalg.norm(table.directions[on], axis=-1), 1)


def test_rays_to_the_camera_body_have_weight_0():
    """Downward rays within the radius of the body below the mirror are obscured."""
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


def test_obscuration_rings_of_two_mirrors():
    """The second mirror and the lid of the tube obscure rings about the axis."""
    sensor = coarse(replace(om.load_sensor("folded-spherical"), housing=Housing(shell=Tube())), 128)
    table = om.ray_table(sensor)
    omega = np.degrees(np.arccos(table.directions[table.has_ray] @ sensor.axis))
    rings = [ring.omega_deg for ring in sensor.obscured]
    assert max(high for _, high in rings) > sensor.field_deg[0] + 5
    obscured = np.any([(omega >= low) & (omega <= high) for low, high in rings], axis=0)
    assert ((table.weights[table.has_ray] == 0) == obscured).all()
    assert obscured.sum() > 50


@pytest.mark.parametrize("step", [0, 2000, 1.5, "2"])
def test_invalid_step_raises(step):
    with pytest.raises(om.base.errors.InvalidParameter, match="step"):
        om.ray_table(om.load_sensor("paper-spherical"), step)


def test_interpolation_error_estimate():
    sensor = coarse(om.load_sensor("paper-spherical"), 200)
    table = om.ray_table(sensor, 5)
    estimate = interpolation_error_deg(table)
    d = table.directions
    mean = d[:-1, :-1] + d[1:, :-1] + d[:-1, 1:] + d[1:, 1:]
    has_ray = table.has_ray
    inside = has_ray[:-1, :-1] & has_ray[1:, :-1] & has_ray[:-1, 1:] & has_ray[1:, 1:]
    v, u = np.nonzero(inside)
    true = sensor.backproject(np.stack([u, v], axis=-1) * 5.0 + 2.5)
    error = np.degrees(
        np.linalg.norm(np.cross(mean[inside], true.directions), axis=-1)
        / np.linalg.norm(mean[inside], axis=-1)
    )
    assert 0.5 * estimate < np.nanmax(error) < 1.1 * estimate
