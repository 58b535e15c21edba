"""3-D view of a design against independent computations for its pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio._design_evaluation import (
    RAYS,
    SPACE_PROFILE_NODES,
    TURNS,
    answer,
    space_blocks,
)
from omnimirror.apps.studio._design_sensors import aligned_sensor
from omnimirror.apps.studio._http_messages import unframed
from omnimirror.apps.studio.design_messages import DesignRequest, DesignResponse
from omnimirror.cameras.camera import Mount
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.image_sensor import ImagerPose
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose

SPHERE = om.load_sensor("paper-spherical")
SENSORS = {
    **{
        name: om.load_sensor(name)
        for name in ("paper-hyperboloidal", "exact-equidistant", "paraboloid-telecentric")
    },
    "folded": om.load_sensor("folded-spherical"),
    "bored": om.load_sensor("folded-hyperboloidal"),
    "hanging": replace(
        SPHERE, mount=Mount("down", 30.0, image_flipped=True, pitch_deg=8.0, roll_deg=-5.0)
    ),
    "decentred": replace(SPHERE, mirror_pose=MirrorPose(1.5, -0.5, 0.2, 0.5, 1.0)),
    "leaning imager": replace(SPHERE, imager_pose=ImagerPose(1.0, -0.5, 3.0)),
    "tube": replace(SPHERE, housing=Housing(CameraBody(60.0), shell=Tube(tilt_x_deg=1.0))),
    "dome": replace(SPHERE, housing=Housing(CameraBody(40.0), Rod(4.0), Dome(), Rim(3.0))),
}


def blocks_of(sensor: om.Sensor) -> dict[str, np.ndarray]:
    aligned = aligned_sensor(sensor)
    heights = om.evaluate(
        aligned, aligned.field_deg[0] + np.linspace(0, 0.99, 7) * np.ptp(aligned.field_deg)
    ).h_px
    return {block.name: values for block, values in space_blocks(sensor, heights)}


def rays_of(sensor: om.Sensor) -> dict[str, np.ndarray]:
    return dict(zip(RAYS, blocks_of(sensor)["rays"], strict=True))


def node_points(rays: dict[str, np.ndarray], node: str) -> np.ndarray:
    return np.stack([rays[f"{node}_{axis}"] for axis in "xyz"], axis=-1)


@pytest.mark.parametrize("name", SENSORS)
def test_rays_have_directions_of_their_pixels(name):
    sensor = SENSORS[name]
    rays = rays_of(sensor)
    pixels = np.stack([rays["u_px"], rays["v_px"]], axis=-1)
    is_visible = np.isfinite(rays["omega_deg"]) & (rays["is_hidden"] == 0)
    assert is_visible.sum() > 0.6 * len(is_visible)
    origins, directions, valid = sensor.backproject(pixels[is_visible])
    assert valid.all()
    start = np.where(
        np.isfinite(node_points(rays, "wall")),
        node_points(rays, "wall"),
        node_points(rays, "mirror"),
    )[is_visible]
    np.testing.assert_allclose(start, origins, atol=1e-8)
    path = node_points(rays, "end")[is_visible] - start
    length = np.linalg.norm(path, axis=1)
    np.testing.assert_allclose(path / length[:, None], directions, atol=1e-9)
    np.testing.assert_allclose(length, om.Room().distance_mm(origins, directions), rtol=1e-9)
    np.testing.assert_allclose(
        np.cos(np.radians(rays["omega_deg"][is_visible])), directions @ sensor.axis, atol=1e-12
    )


@pytest.mark.parametrize(
    "name", [name for name, sensor in SENSORS.items() if sensor.housing.shell is None]
)
def test_rays_satisfy_reflection_law(name):
    sensor = SENSORS[name]
    rays = rays_of(sensor)
    on_mirror = np.stack([rays["x_mm"], rays["y_mm"], rays["z_mm"]], axis=-1)
    np.testing.assert_allclose(
        sensor.mirror.sag(np.hypot(*on_mirror.T[:2])), on_mirror[:, 2], atol=1e-9
    )
    lens, second, mirror_point, end = (
        node_points(rays, node) for node in ("lens", "second", "mirror", "end")
    )
    incoming, outgoing = (
        mirror_point - (lens if sensor.secondary is None else second),
        end - mirror_point,
    )
    between = (
        -(incoming * outgoing).sum(axis=1)
        / np.linalg.norm(incoming, axis=1)
        / np.linalg.norm(outgoing, axis=1)
    )
    np.testing.assert_allclose(np.cos(2 * np.radians(rays["incidence_deg"])), between, atol=1e-9)


def test_obscuration_matches_sensor():
    sensor = SENSORS["dome"]
    rays = rays_of(sensor)
    is_obscured = np.any(
        [*sensor.obscured_by(np.stack([rays["u_px"], rays["v_px"]], axis=-1)).values()], axis=0
    )
    np.testing.assert_array_equal(rays["is_hidden"] > 0, is_obscured)
    assert 0 < is_obscured.sum() < len(is_obscured)


def test_parts_have_their_positions():
    pose = MirrorPose(1.5, -0.5, 0.2, 0.5, 1.0)
    blocks = blocks_of(replace(SPHERE, mirror_pose=pose))
    radius, height = blocks["part mirror"]
    assert len(radius) == SPACE_PROFILE_NODES
    np.testing.assert_allclose(height, SPHERE.mirror.sag(radius))
    frame = blocks["frame mirror"].T  # axes and origin, as columns
    rim_point = np.array([radius[-1], 0.0, height[-1]]) @ frame[:, :3].T + frame[:, 3]
    np.testing.assert_allclose(
        rim_point,
        SPHERE.mount.rotation() @ pose.to_camera([radius[-1], 0.0, height[-1]]),
        atol=1e-9,
    )
    np.testing.assert_allclose(blocks["part lens"][1], -SPHERE.mirror_distance_mm)
    assert blocks["rays"].shape[1] == 7 * TURNS
    bored_mirror = blocks_of(SENSORS["bored"])["part mirror"]
    assert bored_mirror[0].min() >= SENSORS["bored"].secondary.bore_radius_mm
    dome = SENSORS["dome"].obstructions.housing.shell
    r, z = blocks_of(SENSORS["dome"])["part dome"]
    distance_mm = np.hypot(r, z - dome.centre_mm)
    inner, outer = dome.radii_mm
    np.testing.assert_allclose(
        distance_mm[np.isfinite(distance_mm)],
        np.repeat([inner, outer], np.isfinite(distance_mm).sum() // 2),
    )


@pytest.mark.parametrize("is_requested", [False, True])
def test_3d_view_is_returned_on_request(is_requested):
    defaults = {
        "slot": 0,
        "number": 1,
        "follows_mapping": False,
        "object_distance_mm": None,
        "requirements": None,
    }
    tables = om.optics.sensor_files.tables_of(SENSORS["decentred"])
    request = DesignRequest(
        **defaults,
        include_section=False,
        include_squares=False,
        include_3d=is_requested,
        tables=tables,
    )
    response, values = unframed(answer(request), DesignResponse)
    names = [block.name for block in response.blocks]
    assert ("rays" in names) == ("room" in names) == ("part mirror" in names) == is_requested
    assert len(values) == 4 * sum(block.rows * len(block.columns) for block in response.blocks)


def test_oversized_sensor_has_rays():
    oversized = replace(SPHERE, mirror=Sphere(5996.0, 5269.0), mirror_distance_mm=21_651.0)
    rays = rays_of(oversized)
    assert np.isfinite(node_points(rays, "end")).all()
