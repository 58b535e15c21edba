"""3-D view of a design against independent computations for its pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio._bench_evaluation import (
    RAYS,
    SPACE_PROFILE_NODES,
    TURNS,
    answer,
    space_blocks,
)
from omnimirror.apps.studio._bench_sensors import aligned_sensor
from omnimirror.apps.studio._http_messages import unframed
from omnimirror.apps.studio.bench_messages import DesignRequest, DesignResponse
from omnimirror.cameras.frames import Mount
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.image_sensor import ImagerPose
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.mirrors.as_built import MirrorPose

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
    straight = aligned_sensor(sensor)
    heights = om.evaluate(
        straight, straight.field_deg[0] + np.linspace(0, 0.99, 7) * np.ptp(straight.field_deg)
    ).h_px
    return {block.name: values for block, values in space_blocks(sensor, heights)}


def rays_of(sensor: om.Sensor) -> dict[str, np.ndarray]:
    return dict(zip(RAYS, blocks_of(sensor)["rays"], strict=True))


def places(rays: dict[str, np.ndarray], node: str) -> np.ndarray:
    return np.stack([rays[f"{node}_{axis}"] for axis in "xyz"], axis=-1)


@pytest.mark.parametrize("name", SENSORS)
def test_rays_have_directions_of_their_pixels(name):
    sensor = SENSORS[name]
    rays = rays_of(sensor)
    pixels = np.stack([rays["u_px"], rays["v_px"]], axis=-1)
    seen = np.isfinite(rays["omega_deg"]) & (rays["is_hidden"] == 0)
    assert seen.sum() > 0.6 * len(seen)
    origins, directions, valid = sensor.backproject(pixels[seen])
    assert valid.all()
    begin = np.where(
        np.isfinite(places(rays, "wall")), places(rays, "wall"), places(rays, "mirror")
    )[seen]
    np.testing.assert_allclose(begin, origins, atol=1e-8)
    way = places(rays, "end")[seen] - begin
    length = np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(way / length[:, None], directions, atol=1e-9)
    np.testing.assert_allclose(length, om.Room().distance_mm(origins, directions), rtol=1e-9)
    np.testing.assert_allclose(
        np.cos(np.radians(rays["omega_deg"][seen])), directions @ sensor.axis, atol=1e-12
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
    lens, second, met, end = (places(rays, node) for node in ("lens", "second", "mirror", "end"))
    came, left = met - (lens if sensor.secondary is None else second), end - met
    between = (
        -(came * left).sum(axis=1) / np.linalg.norm(came, axis=1) / np.linalg.norm(left, axis=1)
    )
    np.testing.assert_allclose(np.cos(2 * np.radians(rays["incidence_deg"])), between, atol=1e-9)


def test_obscuration_matches_sensor():
    sensor = SENSORS["dome"]
    rays = rays_of(sensor)
    hidden = np.any(
        [*sensor.obscured_by(np.stack([rays["u_px"], rays["v_px"]], axis=-1)).values()], axis=0
    )
    np.testing.assert_array_equal(rays["is_hidden"] > 0, hidden)
    assert 0 < hidden.sum() < len(hidden)


def test_parts_have_their_positions():
    pose = MirrorPose(1.5, -0.5, 0.2, 0.5, 1.0)
    found = blocks_of(replace(SPHERE, mirror_pose=pose))
    radius, height = found["part mirror"]
    assert len(radius) == SPACE_PROFILE_NODES
    np.testing.assert_allclose(height, SPHERE.mirror.sag(radius))
    frame = found["frame mirror"].T  # axes and origin, as columns
    there = np.array([radius[-1], 0.0, height[-1]]) @ frame[:, :3].T + frame[:, 3]
    np.testing.assert_allclose(
        there, SPHERE.mount.rotation() @ pose.to_camera([radius[-1], 0.0, height[-1]]), atol=1e-9
    )
    np.testing.assert_allclose(found["part lens"][1], -SPHERE.mirror_distance_mm)
    assert found["rays"].shape[1] == 7 * TURNS
    bored = blocks_of(SENSORS["bored"])["part mirror"]
    assert bored[0].min() >= SENSORS["bored"].secondary.bore_radius_mm
    dome = SENSORS["dome"].obstructions.housing.shell
    r, z = blocks_of(SENSORS["dome"])["part dome"]
    away = np.hypot(r, z - dome.centre_mm)
    inner, outer = dome.radii_mm
    np.testing.assert_allclose(
        away[np.isfinite(away)], np.repeat([inner, outer], np.isfinite(away).sum() // 2)
    )


@pytest.mark.parametrize("wanted", [False, True])
def test_3d_view_is_returned_on_request(wanted):
    plain = {
        "slot": 0,
        "number": 1,
        "follows_mapping": False,
        "object_distance_mm": None,
        "requirements": None,
    }
    tables = om.optics.sensor_files.tables_of(SENSORS["decentred"])
    ask = DesignRequest(
        **plain, include_section=False, include_squares=False, include_3d=wanted, tables=tables
    )
    told, values = unframed(answer(ask), DesignResponse)
    names = [block.name for block in told.blocks]
    assert ("rays" in names) == ("room" in names) == ("part mirror" in names) == wanted
    assert len(values) == 4 * sum(block.rows * len(block.columns) for block in told.blocks)


def test_oversized_sensor_has_rays():
    big = replace(SPHERE, mirror=Sphere(5996.0, 5269.0), mirror_distance_mm=21_651.0)
    rays = rays_of(big)
    assert np.isfinite(places(rays, "end")).all()
