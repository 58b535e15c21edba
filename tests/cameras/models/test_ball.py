"""Mirror ball against 3-D reflection on a sphere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.frames import Mount


def reflected(offsets, ball_radius):
    """Return directions of parallel rays along +Z after reflection on a sphere at offsets (n, 2),
    by d - 2 (d n) n."""
    x, y = offsets.T / ball_radius
    normal = np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], axis=-1)  # towards the camera
    d = np.array([0.0, 0.0, 1.0])
    return d - 2 * (normal @ d)[:, None] * normal


def test_rays_are_those_of_a_reflecting_sphere():
    field_deg, rim = 260.0, 300.0
    ball = om.MirrorBall((400.0, 310.0), rim, field_deg, (801, 621), Mount("up", 0.0))
    offsets = np.random.default_rng(0).uniform(-210, 210, (300, 2))
    expected = reflected(offsets, rim / np.sin(np.radians(field_deg / 4)))
    rays = ball.backproject(offsets + ball.centre_px)
    np.testing.assert_allclose(rays.directions, expected, atol=1e-13)
    np.testing.assert_array_equal(rays.origins, 0.0)
    np.testing.assert_allclose(ball.project_directions(expected).pixels, offsets + ball.centre_px, atol=1e-9)


@given(st.floats(1, 360), st.floats(5, 5000))
def test_the_rim_sees_half_the_field(field_deg, rim):
    ball = om.MirrorBall((0.0, 0.0), rim, field_deg, (100_000, 10))
    z = ball.backproject([[rim, 0.0]]).directions[0, 2]
    assert np.degrees(np.arccos(np.clip(-z, -1, 1))) == pytest.approx(field_deg / 2, abs=1e-5)
    assert not ball.backproject([[rim * 1.001, 0.0]]).valid[0]


def test_equal_areas_of_the_picture_see_equal_solid_angles():
    ball = om.MirrorBall((500.0, 500.0), 400.0, 300.0, (1001, 1001))
    radii = 400 * np.sqrt(np.linspace(0, 1, 11))
    solid_angle = 2 * np.pi * -np.diff(np.cos(ball.omega_from_radius(radii)))
    np.testing.assert_allclose(solid_angle, solid_angle[0], rtol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [
        {"rim_radius_px": 0.0},
        {"rim_radius_px": np.inf},
        {"field_deg": 0.0},
        {"field_deg": 361.0},
        {"field_deg": np.nan},
        {"centre_px": (np.nan, 0.0)},
    ],
)
def test_what_is_no_ball_is_refused(wrong):
    good = {"centre_px": (5.0, 5.0), "rim_radius_px": 5.0, "field_deg": 260.0, "image_size": (11, 11)}
    with pytest.raises(InvalidParameter, match=next(iter(wrong))):
        om.MirrorBall(**(good | wrong))


@pytest.mark.parametrize("size", [(0, 5), (5.5, 5), (1_000_000, 5)])
def test_a_picture_without_a_sensible_size_is_refused(size):
    with pytest.raises(InvalidParameter, match="is not a whole number of pixels"):
        om.MirrorBall((5.0, 5.0), 5.0, 260.0, size)
