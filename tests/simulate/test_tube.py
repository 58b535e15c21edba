"""Tubes: against closed forms in the meridian, Snell's law and the conservation of light."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.design.manufacture.supports import Support, hardware_of, obscuration, tube_of, tube_shift_mm
from omnimirror.errors import InvalidParameter
from omnimirror.simulate import Environment, expose
from omnimirror.simulate.tube import ThroughTube, Tube
from omnimirror.tracing.walls import through_tube, wall_transmission

UP = np.array([0.0, 0.0, 1.0])


def test_in_the_meridian_rays_are_shifted_and_keep_their_direction():
    omega = np.radians([60.0, 90.0, 120.0, 135.0])
    points = np.stack([np.linspace(0, 40, 4), np.zeros(4), np.linspace(0, 10, 4)], axis=-1)
    directions = np.stack([np.sin(omega), np.zeros(4), -np.cos(omega)], axis=-1)
    passage = through_tube(points, directions, UP, 60.0, 3.0, 1.49)
    np.testing.assert_allclose(passage.directions, directions, atol=1e-12)
    shift = np.linalg.norm(np.cross(passage.points - points, directions), axis=1)
    np.testing.assert_allclose(shift, tube_shift_mm(np.degrees(omega), 3.0, 1.49), atol=1e-12)


def test_skew_rays_keep_what_a_cylinder_keeps():
    """Snell's law at a cylinder keeps the part along the axis; and twice the same moment about it, by symmetry."""
    chance = np.random.default_rng(2)
    points, directions = chance.uniform(-30, 30, (50, 3)), chance.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    passage = through_tube(points, directions, UP, 60.0, 3.0, 1.49)
    np.testing.assert_allclose(passage.directions[:, 2], directions[:, 2], atol=1e-12)
    moments = [np.cross(p, d)[:, 2] for p, d in ((points, directions), (passage.points, passage.directions))]
    np.testing.assert_allclose(*moments, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(passage.directions, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*passage.points.T[:2]), 60.0)
    np.testing.assert_allclose(np.hypot(*passage.met.T[:2]), 57.0)


def test_a_ghost_shows_the_other_side_at_the_strength_of_the_reflection():
    half = np.zeros((64, 128, 3), np.float32)
    half[:, :64] = 1.0  # bright on the left, y > 0
    seen = ThroughTube(Environment(half), Tube(60.0)).radiance(np.zeros((2, 3)), np.array([[0, 1.0, 0], [0, -1.0, 0]]))
    passed = float(wall_transmission(0.0, 1.49))
    np.testing.assert_allclose(seen[:, 0], [passed, (1 - passed) * passed], atol=1e-6)


def test_rays_along_the_axis_pass_as_they_are_and_no_ray_may_start_outside():
    passage = through_tube(np.zeros((1, 3)), UP[None], UP, 60.0, 3.0, 1.49)
    np.testing.assert_array_equal(passage.directions, UP[None])
    assert passage.passed == 1
    world = Environment(np.ones((4, 8, 3), np.float32))
    with pytest.raises(InvalidParameter, match="inner radius is 57 mm"):
        ThroughTube(world, Tube(60.0)).radiance(np.array([[58.0, 0, 0]]), np.array([[1.0, 0, 0]]))


@pytest.mark.parametrize("support", [Support("rod", diameter_mm=6.0), Support("tube")])
def test_supports_hide_in_pictures_what_their_drawing_says(support):
    sensor = om.load_sensor("paper-spherical")
    light = expose(sensor, Environment(np.ones((4, 8, 3), np.float32)), 1, hardware=hardware_of(sensor, support))
    hidden = [r for r in obscuration(sensor, support) if r.part in ("rod", "tube's base")]
    dark = int((light[512, :, 0] < 0.5)[512 - 450 : 512 + 450].sum())
    (ring,) = hidden
    assert dark == pytest.approx(2 * sensor.rim_radius_px * np.sqrt(ring.picture_percent / 100), abs=2)
    if support.kind == "tube":
        assert tube_of(sensor, support).wall_mm == support.wall_mm
