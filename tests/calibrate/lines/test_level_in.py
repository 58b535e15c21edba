"""Levels of cameras that are known, from pictures that were simulated with a lean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibrate.lines import level_in
from omnimirror.frames import Mount


@pytest.mark.full
@pytest.mark.parametrize("lean", [(5.0, -3.0), (-9.0, 6.0)])
def test_upright_edges_of_a_room_tell_how_its_camera_leaned(lean):
    sensor = om.load_sensor("paper-spherical")
    coarse = replace(sensor.imager, width_px=512, height_px=512, pixel_pitch_um=2 * sensor.imager.pixel_pitch_um)
    sensor = replace(sensor, imager=coarse)
    taken = om.take_picture(
        replace(sensor, mount=Mount(pitch_deg=lean[0], roll_deg=lean[1])), om.Room(texel_mm=20.0), samples=1
    )
    for picture in (taken, taken[..., 0]):
        level = level_in(picture, sensor, sensor.mount, sensor.imager.centre, sensor.rim_radius_px)
        assert (level.pitch_deg, level.roll_deg) == (pytest.approx(lean[0], abs=0.3), pytest.approx(lean[1], abs=0.3))
        assert level.upright > 20
    assert level_in(np.full((512, 512), 90, np.uint8), sensor, sensor.mount, sensor.imager.centre, 250.0) is None
