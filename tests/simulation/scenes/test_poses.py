"""Sensors at arbitrary poses in a scene, and the ground truth of their images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import pan_tilt_direction
from omnimirror.io.keyframes import Keyframes
from omnimirror.simulation.ground_truth_maps import ground_truth
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment
from omnimirror.simulation.scenes.room import ROOM
from omnimirror.simulation.scenes.scene import Pose, PosedScene


def small(name: str, pixels: int = 64) -> om.Sensor:
    sensor = om.load_sensor(name)
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels
    return replace(
        sensor,
        imager=replace(sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch),
    )


def test_pose_signs():
    forward, left, up = np.eye(3)
    np.testing.assert_allclose(
        Pose(pan_deg=30).to_scene(forward), pan_tilt_direction(np.radians(30), 0), atol=1e-12
    )
    np.testing.assert_allclose(
        Pose(tilt_deg=20).to_scene(forward), pan_tilt_direction(0, np.radians(20)), atol=1e-12
    )
    np.testing.assert_allclose(
        Pose(roll_deg=90).to_scene(up), -left, atol=1e-12
    )  # its up direction is to the right
    pose = Pose(1.0, -2.0, 3.0, 40.0, 15.0, -70.0)
    points = np.random.default_rng(1).normal(size=(9, 3))
    np.testing.assert_allclose(pose.to_sensor(pose.to_scene(points)), points, atol=1e-12)
    assert np.linalg.det(pose.rotation()) == pytest.approx(1.0)


def test_compiled_rotated_environment_matches_numpy():
    world = Environment(
        np.random.default_rng(2).uniform(0, 1, (16, 32, 3)).astype(np.float32), heading_deg=20.0
    )
    sensor, pose = small("paper-equidistant"), Pose(5.0, 6.0, 7.0, 40.0, -25.0, 12.0)
    light = expose(sensor, PosedScene(world, pose), samples=1)
    rays = sensor.backproject(
        np.stack(np.meshgrid(np.arange(64.0), np.arange(64.0)), axis=-1).reshape(-1, 2)
    )
    expected = world.radiance(
        np.zeros((int(rays.valid.sum()), 3)), rays.directions[rays.valid] @ pose.rotation().T
    )
    assert np.abs(light.reshape(-1, 3)[rays.valid] - expected).max() < 1e-3


def test_pan_matches_mount_rotation():
    """A camera rotated in its mount against the pan renders the image of the sensor without pan."""
    sensor, room = small("paper-spherical"), om.Room(texel_mm=20.0)
    rotated = replace(sensor, mount=replace(sensor.mount, forward_azimuth_deg=-90.0 - 40.0))
    panned = expose(rotated, PosedScene(room, Pose(pan_deg=40.0)), samples=4)
    np.testing.assert_allclose(panned, expose(sensor, room, samples=4), atol=0.02)
    assert (
        np.abs(expose(sensor, PosedScene(room, Pose(pan_deg=40.0)), samples=4) - panned).mean()
        > 0.02
    )


@pytest.mark.parametrize("pose", [Pose(), Pose(600.0, -300.0, 200.0, 50.0, 8.0, 5.0)])
def test_depth_round_trip(pose):
    sensor = small("paper-spherical", 128)
    truth = ground_truth(sensor, PosedScene(om.Room(texel_mm=40.0), pose))
    valid = np.isfinite(truth.depth_mm)
    np.testing.assert_array_equal(valid, np.isfinite(truth.directions).all(axis=-1))
    points = truth.points_mm[valid]
    scene_points = pose.to_scene(points)
    on_walls = np.isclose(scene_points, ROOM.low, atol=1e-6) | np.isclose(
        scene_points, ROOM.high, atol=1e-6
    )
    assert on_walls.any(axis=1).mean() > 0.7  # the rest is furniture
    assert (scene_points > np.array(ROOM.low) - 1e-6).all()
    assert (scene_points < np.array(ROOM.high) + 1e-6).all()
    back = sensor.project(points)
    rows, columns = np.nonzero(valid)
    np.testing.assert_allclose(
        back.pixels[back.valid], np.stack([columns, rows], -1)[back.valid], atol=1e-3
    )
    assert back.valid.mean() > 0.99


def test_distant_depth_is_infinite():
    truth = ground_truth(small("paper-spherical"), Environment(np.ones((4, 8, 3), np.float32)))
    assert np.isinf(truth.depth_mm[32, 32])
    assert np.isnan(truth.depth_mm[0, 0])


def test_scene_without_distance_raises():
    class Even:
        def radiance(self, origins_mm, directions):
            return np.ones((len(directions), 3), np.float32)

    with pytest.raises(InvalidParameter, match=r"method distance_mm\(\) for depth; got a Even"):
        ground_truth(small("paper-spherical"), Even())


def test_frames_match_poses():
    sensor, room = small("paper-spherical"), om.Room(texel_mm=40.0)
    path = Keyframes(
        {"x_mm": ((0.0, 0.0), (2.0, 800.0)), "pan_deg": ((0.0, 0.0), (2.0, 90.0))}, "linear"
    )
    sequence = om.ImageSequence(sensor, room, path, frame_rate=1.0, samples=1)
    np.testing.assert_array_equal(
        sequence.light(1), expose(sensor, PosedScene(room, Pose(400.0, pan_deg=45.0)), samples=1)
    )
    with pytest.raises(
        InvalidParameter, match=r"frame_rate must be between 0\.001 and 1e\+06; got 0\.0"
    ):
        om.ImageSequence(sensor, room, path, frame_rate=0.0)
