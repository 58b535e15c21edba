"""Levelling of known cameras from rendered images with a tilt."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibration.levelling import level_from_image
from omnimirror.cameras.camera import Mount


@pytest.mark.full
@pytest.mark.parametrize("tilt_deg", [(5.0, -3.0), (-9.0, 6.0)])
def test_vertical_edges_of_room_determine_tilt(tilt_deg):
    sensor = om.load_sensor("paper-spherical")
    coarse = replace(
        sensor.imager, width_px=512, height_px=512, pixel_pitch_um=2 * sensor.imager.pixel_pitch_um
    )
    sensor = replace(sensor, imager=coarse)
    rendering = om.render_image(
        replace(sensor, mount=Mount(pitch_deg=tilt_deg[0], roll_deg=tilt_deg[1])),
        om.Room(texel_mm=20.0),
        samples=1,
    )
    for image in (rendering, rendering[..., 0]):
        level = level_from_image(
            image, sensor, sensor.mount, sensor.imager.centre, sensor.rim_radius_px
        )
        assert (level.pitch_deg, level.roll_deg) == (
            pytest.approx(tilt_deg[0], abs=0.3),
            pytest.approx(tilt_deg[1], abs=0.3),
        )
        assert level.upright > 20
    assert (
        level_from_image(
            np.full((512, 512), 90, np.uint8), sensor, sensor.mount, sensor.imager.centre, 250.0
        )
        is None
    )


@pytest.mark.full
@pytest.mark.parametrize(
    "mount", [Mount("forward", pitch_deg=-20.0, roll_deg=4.0), Mount("up", pitch_deg=6.0)]
)
def test_tilt_of_ball_in_room(mount):
    ball = om.MirrorBall(
        centre_px=(349.5, 349.5),
        rim_radius_px=330.0,
        field_deg=340.0,
        image_size=(700, 700),
        mount=mount,
    )
    rendering = om.render_image(ball, om.Room(texel_mm=15.0), samples=2)
    ball = replace(ball, mount=Mount(mount.camera_looks))
    level = level_from_image(rendering, ball, ball.mount, ball.centre_px, ball.rim_radius_px)
    assert level.is_reliable
    assert (level.pitch_deg, level.roll_deg) == pytest.approx(
        (mount.pitch_deg, mount.roll_deg), abs=0.4
    )


def test_large_images_are_reduced():
    """Edges of three walls, vertical at known positions, drawn at four times the size."""
    levels = []
    for size in (720, 2880):
        ball = om.MirrorBall(
            centre_px=((size - 1) / 2,) * 2,
            rim_radius_px=0.48 * size,
            field_deg=300.0,
            image_size=(size, size),
            mount=Mount(pitch_deg=5.0, roll_deg=-3.0),
        )
        apart = size // 720  # pixel spacing of traced rays, which vary linearly in between
        v, u = np.mgrid[:720, :720] * apart + (apart - 1) / 2
        directions = ball.backproject(np.stack([u, v], axis=-1).reshape(-1, 2)).directions.reshape(
            720, 720, 3
        )
        directions = cv2.resize(directions, (size, size), interpolation=cv2.INTER_LINEAR)
        wall = np.floor(np.degrees(np.arctan2(directions[..., 1], directions[..., 0])) / 15) % 2
        image = np.where(np.abs(directions[..., 2]) < 0.6, 60 + 120 * wall, 110).astype(np.uint8)
        levels.append(level_from_image(image, ball, ball.mount, ball.centre_px, ball.rim_radius_px))
    for level in levels:
        assert (level.pitch_deg, level.roll_deg) == pytest.approx((5.0, -3.0), abs=0.1)
        assert level.is_reliable
