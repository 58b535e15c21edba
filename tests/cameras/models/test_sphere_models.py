"""Unified sphere and related models, against the equations of their papers and of OpenCV, written
out here.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import DoubleSphere, EnhancedUnified, Unified

# -- Unified sphere and related models, against the equations of their papers and of OpenCV, written out here

FOCAL, CENTRE, SIZE, SKEW = (231.0, 228.0), (318.0, 242.0), (640, 480), 0.7
LENS = (-0.11, 0.03, -0.004, 0.002, -0.003)


def directions_within(omega_max, count=500, seed=1):
    """Return vectors (n, 3) of length 10 to 1000 within omega_max (radians) of Z."""
    rng = np.random.default_rng(seed)
    omega, phi = rng.uniform(0, omega_max, count), rng.uniform(0, 2 * np.pi, count)
    unit = np.stack(
        [np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), np.cos(omega)], axis=-1
    )
    return unit * rng.uniform(10, 1000, (count, 1))


def pixels_of(x, y):
    """Apply OpenCV's matrix K."""
    return np.stack([FOCAL[0] * x + SKEW * y + CENTRE[0], FOCAL[1] * y + CENTRE[1]], axis=-1)


def omnidir(points, xi, k1, k2, k3, p1, p2):
    """``projectPoints`` of OpenCV's omnidir, with k3 of OpenCV's pinhole model."""
    x, y, z = (points / np.linalg.norm(points, axis=1, keepdims=True)).T
    x, y = x / (z + xi), y / (z + xi)
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return pixels_of(
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    )


def enhanced(points, alpha, beta):
    """Khomutenko et al., equation 9."""
    x, y, z = points.T
    d = np.sqrt(beta * (x**2 + y**2) + z**2)
    depth = alpha * d + (1 - alpha) * z
    return pixels_of(x / depth, y / depth)


def double_sphere(points, xi, alpha):
    """Usenko et al., equations 40 to 42."""
    x, y, z = points.T
    d1 = np.sqrt(x**2 + y**2 + z**2)
    d2 = np.sqrt(x**2 + y**2 + (xi * d1 + z) ** 2)
    depth = alpha * d2 + (1 - alpha) * (xi * d1 + z)
    return pixels_of(x / depth, y / depth)


def of_kind(kind, *shape):
    """Return a model with variable optics, and the pixels of its paper."""
    paper = {Unified: omnidir, EnhancedUnified: enhanced, DoubleSphere: double_sphere}[kind]
    return lambda optics: model_of(kind, *shape, skew_px=SKEW, optics=optics), lambda points: paper(
        points, *shape
    )


def model_of(kind, *shape, **others):
    """Return a model with the parameters of its paper."""
    names = {
        Unified: ("xi", "k1", "k2", "k3", "p1", "p2"),
        EnhancedUnified: ("alpha", "beta"),
        DoubleSphere: ("xi", "alpha"),
    }[kind]
    values = dict(zip(names, shape, strict=False))
    return kind(**values, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, **others)


CASES = {
    "unified": (*of_kind(Unified, 0.9, *LENS), 1.9),
    "unified-far": (*of_kind(Unified, 1.9, *LENS), 1.8),
    "enhanced": (*of_kind(EnhancedUnified, 0.57, 1.2), 2.2),
    "double": (*of_kind(DoubleSphere, -0.3, 0.6), 2.0),
    "double-ahead": (*of_kind(DoubleSphere, 0.6, 0.3), 2.0),
}


@pytest.mark.parametrize(("model", "paper", "omega_max"), CASES.values(), ids=CASES)
@pytest.mark.parametrize("optics", ["mirror", "fisheye"])
def test_pixels_equal_papers(model, paper, omega_max, optics):
    """The axis of the papers points forward. That of a mirror points backward, and its frame is not
    a rotation of the camera frame."""
    camera, points = model(optics), directions_within(omega_max)
    projection = camera.image(points * [1, 1, -1] if optics == "mirror" else points)
    assert projection.valid.all()
    np.testing.assert_allclose(projection.pixels, paper(points), rtol=1e-11, atol=1e-9)


def test_distant_paraboloid_equals_unified_model():
    """Reflection on ``z = (x^2 - p^2) / 2p`` about its focus: r = p tan(Omega / 2) exactly."""
    p, x = 30.0, np.linspace(0, 60, 40)
    focus_directions = np.stack(
        [x, 0 * x, (x**2 - p**2) / (2 * p)], axis=-1
    )  # from the focus to the mirror points
    camera = Unified(
        xi=1.0, focal_px=(8.0 * p, 8.0 * p), centre_px=(500.0, 500.0), image_size=(1001, 1001)
    )
    projection = camera.image(focus_directions)
    np.testing.assert_allclose(projection.pixels[:, 0] - 500.0, 8.0 * x, atol=1e-9)


def test_hyperboloid_sensor_equals_unified_model():
    """A hyperboloid observed from its second focus, by its rays: focal distance and eccentricity
    determine xi."""
    sensor = om.load_sensor("paper-hyperboloidal")
    symmetry = sensor.symmetry
    omega = np.linspace(0.2, symmetry.omega_max, 50)
    radius = symmetry.radius_px(omega)
    e = np.sqrt(-sensor.mirror.conic)
    xi = 2 * e / (1 + e * e)
    shape = Unified(
        xi=xi, focal_px=(1.0, 1.0), centre_px=(0.0, 0.0), image_size=(2, 2)
    )._projected_radius(omega)
    np.testing.assert_allclose(radius / shape, radius[-1] / shape[-1], rtol=2e-3)


@pytest.mark.parametrize(
    ("model", "end_deg"),
    [
        (
            Unified(xi=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE),
            180.0,
        ),  # all but one direction
        (Unified(xi=0.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE), 90.0),  # a pinhole
        (Unified(xi=0.5, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE), 120.0),
        (Unified(xi=2.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE), 120.0),
        (
            EnhancedUnified(alpha=0.0, beta=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE),
            90.0,
        ),
        (
            EnhancedUnified(alpha=0.5, beta=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE),
            180.0,
        ),
        (
            EnhancedUnified(
                alpha=1 / 3, beta=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE
            ),
            120.0,
        ),
        (
            EnhancedUnified(
                alpha=2 / 3, beta=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE
            ),
            120.0,
        ),
        (DoubleSphere(xi=0.0, alpha=0.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE), 90.0),
        (
            DoubleSphere(xi=0.0, alpha=2 / 3, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE),
            120.0,
        ),
        (
            DoubleSphere(xi=0.5, alpha=0.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE),
            120.0,
        ),  # the unified sphere
        (DoubleSphere(xi=0.5, alpha=0.5, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE), 180.0),
    ],
)
def test_field_ends_at_expected_angle(model, end_deg):
    assert np.degrees(model.model_end) == pytest.approx(end_deg, abs=1e-6)
    assert model.model_end < np.radians(end_deg)  # where r still increases


OMEGA = np.linspace(0.0, np.pi, 200_001)[1:-1]
SECTION = np.stack([np.sin(OMEGA), 0 * OMEGA, np.cos(OMEGA)], axis=-1)


@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.6, 0.9])
@pytest.mark.parametrize(
    ("kind", "other"), [(DoubleSphere, x) for x in (-0.6, 0.3, 0.8)] + [(EnhancedUnified, 1.7)]
)
def test_field_ends_at_maximum_radius(kind, other, alpha):
    """Along a fine section: the end of growth, or a sign change of the depth and thus of the
    radius."""
    shape = (other, alpha) if kind is DoubleSphere else (alpha, other)
    radius = (of_kind(kind, *shape)[1](SECTION)[:, 0] - CENTRE[0]) / FOCAL[0]
    grows = (np.diff(radius) > 0) & (radius[1:] > 0)
    end = OMEGA[-1] if grows.all() else OMEGA[np.argmin(grows)]
    assert model_of(kind, *shape).model_end == pytest.approx(end, abs=2 * OMEGA[0])


@pytest.mark.parametrize(
    ("kind", "shape", "paper"),
    [
        (Unified, (0.9,), (0.9, 0, 0, 0, 0, 0)),
        (EnhancedUnified, (0.57, 1.2), None),
        (DoubleSphere, (-0.3, 0.6), None),
    ],
)
def test_model_defaults(kind, shape, paper):
    points = directions_within(1.8)
    expected = of_kind(kind, *(paper or shape))[1](points)
    expected[:, 0] -= SKEW * (expected[:, 1] - CENTRE[1]) / FOCAL[1]
    projection = model_of(kind, *shape).image(points * [1, 1, -1])
    np.testing.assert_allclose(projection.pixels, expected, rtol=1e-11, atol=1e-9)


@given(st.floats(0, 3), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1))
def test_distortion_limits_field(xi, k1, k2):
    camera = Unified(
        xi=xi,
        focal_px=(200.0, 200.0),
        centre_px=(1000.0, 1000.0),
        image_size=(2001, 2001),
        k1=k1,
        k2=k2,
    )
    radius = camera.radius_from_omega(np.linspace(0, camera.omega_max, 500))
    assert (np.diff(radius) > 0).all()
    pixels = np.stack([1000 + np.linspace(0, 1000, 200), np.full(200, 1000.0)], axis=-1)
    rays = camera.backproject(pixels)
    projection = camera.project_directions(rays.directions[rays.valid])
    assert projection.valid.all()
    np.testing.assert_allclose(projection.pixels, pixels[rays.valid], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Unified(xi=-0.1, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE),
            r"xi must be between 0 and 10000; got -0\.1",
        ),
        (
            lambda: Unified(xi=1.0, focal_px=(0.0, 1.0), centre_px=CENTRE, image_size=SIZE),
            "focal_px",
        ),
        (
            lambda: Unified(xi=1.0, focal_px=FOCAL, centre_px=(1.0, np.nan), image_size=SIZE),
            "centre_px",
        ),
        (
            lambda: Unified(xi=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, k1=np.inf),
            r"k1 must be between -1e\+12 and 1e\+12; got inf",
        ),
        (
            lambda: Unified(
                xi=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, optics="lens"
            ),
            "optics must be one of mirror, fisheye; got 'lens'",
        ),
        (
            lambda: Unified(
                xi=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE, rim_radius_px=0.0
            ),
            r"rim_radius_px must be greater than 0 px and at most 1e\+06 px; got 0\.0",
        ),
        (
            lambda: EnhancedUnified(
                alpha=1.1, beta=1.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE
            ),
            r"alpha must be between 0 and 1; got 1\.1",
        ),
        (
            lambda: EnhancedUnified(
                alpha=0.5, beta=0.0, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE
            ),
            r"beta must be between 0\.0001 and 10000; got 0\.0",
        ),
        (
            lambda: DoubleSphere(
                xi=1.2, alpha=0.5, focal_px=FOCAL, centre_px=CENTRE, image_size=SIZE
            ),
            r"xi must be between -1 and 1; got 1\.2",
        ),
    ],
)
def test_invalid_model_raises(make, message):
    with pytest.raises(InvalidParameter, match=message):
        make()


# -- Mirror ball against 3-D reflection on a sphere ------------------------------------------------


def reflected(offsets, ball_radius):
    """Return directions of parallel rays along +Z after reflection on a sphere at offsets (n, 2),
    by d - 2 (d n) n."""
    x, y = offsets.T / ball_radius
    normal = np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], axis=-1)  # towards the camera
    d = np.array([0.0, 0.0, 1.0])
    return d - 2 * (normal @ d)[:, None] * normal


def test_rays_equal_reflecting_sphere():
    field_deg, rim = 260.0, 300.0
    ball = om.MirrorBall(
        centre_px=(400.0, 310.0),
        rim_radius_px=rim,
        field_deg=field_deg,
        image_size=(801, 621),
        mount=Mount("up", 0.0),
    )
    offsets = np.random.default_rng(0).uniform(-210, 210, (300, 2))
    expected = reflected(offsets, rim / np.sin(np.radians(field_deg / 4)))
    rays = ball.backproject(offsets + ball.centre_px)
    np.testing.assert_allclose(rays.directions, expected, atol=1e-13)
    np.testing.assert_array_equal(rays.origins, 0.0)
    np.testing.assert_allclose(
        ball.project_directions(expected).pixels, offsets + ball.centre_px, atol=1e-9
    )


@given(st.floats(1, 360), st.floats(5, 5000))
def test_rim_is_at_half_field(field_deg, rim):
    ball = om.MirrorBall(
        centre_px=(0.0, 0.0), rim_radius_px=rim, field_deg=field_deg, image_size=(100_000, 10)
    )
    z = ball.backproject([[rim, 0.0]]).directions[0, 2]
    assert np.degrees(np.arccos(np.clip(-z, -1, 1))) == pytest.approx(field_deg / 2, abs=1e-5)
    assert not ball.backproject([[rim * 1.001, 0.0]]).valid[0]


def test_mirror_ball_is_equal_area():
    ball = om.MirrorBall(
        centre_px=(500.0, 500.0), rim_radius_px=400.0, field_deg=300.0, image_size=(1001, 1001)
    )
    radii = 400 * np.sqrt(np.linspace(0, 1, 11))
    solid_angle = 2 * np.pi * -np.diff(np.cos(ball.omega_from_radius(radii)))
    np.testing.assert_allclose(solid_angle, solid_angle[0], rtol=1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {"rim_radius_px": 0.0},
        {"rim_radius_px": np.inf},
        {"field_deg": 0.0},
        {"field_deg": 361.0},
        {"field_deg": np.nan},
        {"centre_px": (np.nan, 0.0)},
    ],
)
def test_invalid_mirror_ball_raises(changes):
    good = {
        "centre_px": (5.0, 5.0),
        "rim_radius_px": 5.0,
        "field_deg": 260.0,
        "image_size": (11, 11),
    }
    with pytest.raises(InvalidParameter, match=next(iter(changes))):
        om.MirrorBall(**(good | changes))


@pytest.mark.parametrize("size", [(0, 5), (5.5, 5), (1_000_000, 5)])
def test_invalid_image_size_raises(size):
    with pytest.raises(
        InvalidParameter, match="image width must be an integer between 1 and 100000 px"
    ):
        om.MirrorBall(centre_px=(5.0, 5.0), rim_radius_px=5.0, field_deg=260.0, image_size=size)


@pytest.mark.parametrize("model", [DoubleSphere, EnhancedUnified])
def test_symmetric_mixing_has_no_warning(model):
    """At alpha = 0.5, rays opposite to the axis are projected to infinity."""
    shape = {"xi": -0.2} if model is DoubleSphere else {"beta": 1.1}
    camera = model(
        alpha=0.5, focal_px=(400.0, 400.0), centre_px=(320.0, 240.0), image_size=(640, 480), **shape
    )
    corner_px = np.hypot(320.5, 240.5)
    assert camera.field_radius_px == pytest.approx(corner_px, rel=1e-3)
