"""Calibration model of a sensor behind a tube or dome: derivatives against differences of its
images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.optics.mirrors.mirror import MirrorPose

POSE = MirrorPose(0.3, -0.2, 0.1, 0.2, 0.1)
FREE = ("focal", "decentre", "tilt", "distance", "shape", "centre")


TUBE, DOME = Tube(110.0, 4.0), Dome(medium="water", tilt_x_deg=1.0)


@pytest.mark.parametrize(
    ("distant", "shell"),
    [
        pytest.param(False, DOME, id="dome", marks=pytest.mark.full),
        pytest.param(True, TUBE, id="tube, far"),
        pytest.param(True, DOME, id="dome, far", marks=pytest.mark.full),
        pytest.param(False, TUBE, id="tube", marks=pytest.mark.full),
    ],
)
def test_images_are_projections_and_derivatives_are_differences(shell, distant):
    sensor = replace(
        om.load_sensor("paper-spherical"), housing=Housing(shell=shell), mirror_pose=POSE
    )
    model = om.SensorModel(sensor, free=FREE)
    points = 400 * np.random.default_rng(1).normal(size=(60, 3))
    image = model.image(points, distant=distant)
    assert image.valid.sum() > 50
    world = points @ sensor.mount.rotation().T
    projection = (sensor.project_directions if distant else sensor.project)(world)
    np.testing.assert_allclose(
        image.pixels[projection.valid], projection.pixels[projection.valid], atol=1e-9
    )
    points = points[image.valid]  # the search for a solution of the others is slow and unsuccessful
    image = model.image(points, distant=distant)
    values = np.array([p.value for p in model.parameters])
    for k, parameter in enumerate(model.parameters):
        step = 1e-3 * parameter.scale * np.eye(len(values))[k]
        up, down = (
            model.with_parameters(values + s * step).image(points, distant=distant) for s in (1, -1)
        )
        rate = (up.pixels - down.pixels) / (2e-3 * parameter.scale)
        error = np.abs(rate - image.d_parameters[:, :, k]) * parameter.scale
        assert np.nanmax(error) < 1e-7, parameter.name
    for k, axis in enumerate(np.eye(3)):
        up, down = (model.image(points + s * 0.01 * axis, distant=distant) for s in (1, -1))
        error = np.abs((up.pixels - down.pixels) / 0.02 - image.d_points[:, :, k])
        assert np.nanmax(error) < 1e-6
