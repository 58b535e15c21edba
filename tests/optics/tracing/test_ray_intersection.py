"""Rays in space against the meridian, high precision, and difficult surfaces."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimirror.optics.mirrors import (
    Cone,
    ConicAsphere,
    EvenPolynomial,
    Hyperboloid,
    Paraboloid,
    Sphere,
)
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.tracing import reflection
from omnimirror.optics.tracing.meridian import Meridian
from tests.conftest import MIRRORS, M
from tests.everyday import few


def chief_rays(mirror, m, count=2000):
    """Return mirror points and directions of the meridian code over all azimuths, with eyes and ray
    directions."""
    rng = np.random.default_rng(4)
    x = mirror.rim_radius_mm * np.sqrt(rng.uniform(1e-4, 1, count))
    x[0] = mirror.rim_radius_mm
    rays, phi = Meridian(mirror, m).trace(x), rng.uniform(-np.pi, np.pi, count)

    def around(across, along):
        return np.stack([across * np.cos(phi), across * np.sin(phi), along], axis=-1)

    pupils = np.array([[0.0, 0.0, -m]]) if np.isfinite(m) else around(x, np.full(count, -60.0))
    lens_directions = around(np.sin(rays.theta), np.cos(rays.theta))
    return (
        pupils,
        lens_directions,
        around(x, rays.z),
        around(np.sin(rays.omega), -np.cos(rays.omega)),
    )


@pytest.mark.parametrize("lens", ["perspective", "orthographic"])
@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_skew_rays_match_meridian(kind, lens):
    mirror, m = MIRRORS[kind]
    if lens == "orthographic" and kind in ("cone", "equidistant"):
        pytest.skip(
            "made for a perspective lens; under an orthographic one a cone sees a single field angle"
        )
    pupils, lens_directions, points, directions = chief_rays(
        mirror, m if lens == "perspective" else np.inf
    )
    reflections = reflection.trace(mirror, pupils, lens_directions)
    assert reflections.valid.all()
    np.testing.assert_allclose(reflections.points, points, atol=1e-12, rtol=0)
    np.testing.assert_allclose(reflections.directions, directions, atol=2e-14, rtol=0)
    np.testing.assert_allclose(np.linalg.norm(reflections.normals, axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("kind", ["sphere", "hyperboloid", "paraboloid", "ellipsoid"])
def test_iteration_matches_quadratic(kind, monkeypatch):
    """The same conic, once as a quadric and once as a general surface, from arbitrary points."""
    mirror, _ = MIRRORS[kind]
    origins, directions = rays_from_anywhere(mirror, 4000)
    quadratic = reflection.intersect(mirror, origins, directions)
    short = reflection.intersect(mirror, origins, 1e-6 * directions)
    monkeypatch.setattr(reflection, "Conic", type(None))
    searched = reflection.intersect(mirror, origins, directions)
    np.testing.assert_array_equal(quadratic.valid, searched.valid)
    scaled = reflection.intersect(mirror, origins, 1e-6 * directions)
    for hits in (short, scaled):
        np.testing.assert_allclose(1e-6 * hits.distance, quadratic.distance, rtol=1e-7)
    assert 0.1 < quadratic.valid.mean() < 0.9
    np.testing.assert_allclose(
        quadratic.distance, searched.distance, rtol=1e-7
    )  # grazing rays are ill-conditioned
    np.testing.assert_allclose(
        np.nanmedian(abs(quadratic.distance - searched.distance)), 0.0, atol=1e-12
    )


def rays_from_anywhere(mirror, count, seed=5):
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3)) * [1.5 * M, 1.5 * M, 3 * M]
    targets = rng.uniform(-1, 1, (count, 3)) * mirror.rim_radius_mm
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize(
    "kind", few(sorted(MIRRORS), "cone", "conic-asphere", "equidistant", "sampled")
)
def test_intersection_is_first_and_from_front(kind):
    """Marching along each ray in steps of 0.01 rim radii finds no earlier and no missed
    intersection."""
    mirror, _ = MIRRORS[kind]
    origins, directions = rays_from_anywhere(mirror, 300)
    hits = reflection.intersect(mirror, origins, directions)
    steps = np.arange(0, 12 * M, M / 100)
    for o, d, t, valid in zip(origins, directions, hits.distance, hits.valid, strict=True):
        x, y, z = o[:, None] + d[:, None] * steps
        r = np.hypot(x, y)
        over = r <= mirror.rim_radius_mm
        height = np.where(over, z - mirror.sag(np.where(over, r, 0.0)), np.nan)
        crossings = np.flatnonzero(np.sign(height[1:]) * np.sign(height[:-1]) < 0)
        if crossings.size and height[crossings[0]] < 0:
            first = steps[crossings[0]]
            assert first <= t <= first + M / 100
        elif valid:  # only the rim itself can be missed
            assert np.hypot(*(o + t * d)[:2]) > mirror.rim_radius_mm - M / 100


@pytest.mark.parametrize(
    ("coefficients", "start"), [((2.0, -4.2, 2.6), -1.0), ((-2.0, 3.0), -10.0)]
)
def test_concave_zone_first_intersection(coefficients, start):
    """Rings with rising and falling slope: Newton's tangent would miss the first intersection, the
    parabola does not."""
    ring = EvenPolynomial(coefficients, 10.0, 10.0)
    assert reflection.hollowness(ring) > 0
    rng = np.random.default_rng(6)
    origins = np.stack(
        [rng.uniform(-30, 30, 80), rng.uniform(-3, 3, 80), np.full(80, start)], axis=-1
    )
    targets = np.stack(
        [rng.uniform(-9, 9, 80), rng.uniform(-2, 2, 80), rng.uniform(0, 4, 80)], axis=-1
    )
    hits = reflection.intersect(ring, origins, targets - origins)
    steps = np.linspace(0, 5, 50001)
    march = origins[:, :, None] + (targets - origins)[:, :, None] * steps
    r = np.hypot(march[:, 0], march[:, 1])
    height = np.where(r <= 10, march[:, 2] - ring.sag(np.minimum(r, 10.0)), np.nan)
    above = height > 0
    first = np.where(above.any(axis=1), steps[above.argmax(axis=1)], np.nan)
    is_above_front = np.array(
        [h[max(a.argmax() - 1, 0)] <= 0 for h, a in zip(height, above, strict=True)]
    )
    assert (hits.valid == (is_above_front & np.isfinite(first))).all()
    np.testing.assert_allclose(hits.distance[hits.valid], first[hits.valid], atol=2e-4)
    reflections = reflection.trace(ring, origins, targets - origins)
    assert (~reflections.valid & hits.valid).any()  # some end on the other side of the ring
    assert not (reflections.valid & ~hits.valid).any()
    unit = (targets - origins) / np.linalg.norm(targets - origins, axis=1, keepdims=True)
    outgoing = reflection.reflect(unit, hits.normals)
    onward = hits.points[:, :, None] + outgoing[:, :, None] * np.linspace(2e-3, 25.0, 12500)
    r = np.hypot(onward[:, 0], onward[:, 1])
    height = np.where(r <= 10, onward[:, 2] - ring.sag(np.minimum(np.nan_to_num(r), 10.0)), -1.0)
    is_hit_again = (height > 0).any(axis=1)
    assert ((reflections.valid == (hits.valid & ~is_hit_again)) | ~hits.valid).all()


def test_clearance_of_circles():
    """Any shape of crossings; a circle without a radius blocks nothing."""
    across = np.zeros((4, 2, 2))
    across[..., 0] = 0.3
    for radius in (0.0, -1.0):
        clearance = reflection.circle_clearance(across, radius)
        assert (clearance == np.inf).all()
        assert clearance.shape == (4, 2)
    # (r^2 - a^2) / (2 a)
    np.testing.assert_allclose(reflection.circle_clearance(across, 0.5), -0.16, rtol=1e-12)


@pytest.mark.parametrize(
    "mirror",
    [Sphere(50.0, 44.0), ConicAsphere(50.0, 0.0, 44.0), Hyperboloid(32.5, 74.5, 43.9), Cone(50.0, 44.0)],
)  # fmt: skip
def test_rays_from_the_surface(mirror):
    """A ray from the surface intersects it at its origin; a ray from inside the body does not."""
    origins = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, float(mirror.sag(30.0))]])
    normals = reflection.normals_at(mirror, origins)
    grid = reflection.normals_at(mirror, np.stack([origins] * 5))
    np.testing.assert_array_equal(grid, np.stack([normals] * 5))
    up = np.array([0.0, 0.0, 1.0])
    hits = reflection.intersect(mirror, origins, up)
    np.testing.assert_allclose(hits.distance, 0.0, atol=1e-12)
    assert not reflection.intersect(mirror, origins + 0.5 * up, up).valid.any()
    assert not reflection.intersect(mirror, origins, -up).valid.any()
    if isinstance(mirror, Cone):  # by iteration: beyond the surface by rounding
        hits = reflection.intersect(mirror, origins + 1e-13 * up, up)
        np.testing.assert_allclose(hits.distance, 0.0, atol=1e-12)


def test_tangent_ray_from_surface_does_not_intersect_it():
    bowl = EvenPolynomial((0.5, 0.1), 10.0, 10.0)
    assert not reflection.intersect(bowl, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]).valid.any()


def test_a_conic_ends_at_its_equator():
    """A sphere whose rim is 1 um from it, with 50 - z = 0.7 mm at the first radius."""
    mirror = Sphere(50.0, 49.999)
    up = reflection.intersect(mirror, [49.995, 0.0, 0.0], [0.0, 0.0, 1.0])
    assert up.distance == pytest.approx(50.0 - np.sqrt(50.0**2 - 49.995**2), rel=1e-9)
    for height, is_valid in ((49.5, True), (50.5, False)):
        hits = reflection.intersect(mirror, [100.0, 0.0, height], [-1.0, 0.0, 0.0])
        assert hits.valid == is_valid


def test_missing_rays_are_nan():
    sphere = Sphere(50.0, 44.0)
    cases = {
        "past the rim": ([0, 0, -100], [46, 0, 100]),
        "away": ([0, 0, -100], [0, 0, -1]),
        "from behind": ([0, 0, 100], [0, 0, -1]),
        "from inside": ([0, 0, 20], [0, 0, 1]),
        "in through the open back": ([100, 0, 60], [-1, 0, 0]),
        "not finite": ([np.nan, 0, 0], [0, 0, 1]),
        "no direction": ([0, 0, -100], [0, 0, 0]),
    }
    for mirror in (
        sphere,
        ConicAsphere(50.0, 0.0, 44.0),
        Hyperboloid(32.5, 74.5, 43.9),
        Cone(50.0, 44.0),
    ):
        for name, (origin, direction) in cases.items():
            with np.errstate(invalid="ignore"):
                reflections = reflection.trace(mirror, [origin], [direction])
            assert not reflections.valid[0], (mirror.KIND, name)
            assert np.isnan(reflections.points).all()
            assert np.isnan(reflections.directions).all()
    assert reflection.intersect(sphere, np.empty((0, 3)), np.empty((0, 3))).valid.shape == (0,)


@given(
    x=st.floats(-20, 20),
    y=st.floats(-20, 20),
    tip=st.floats(-12, 12),
    side=st.floats(-12, 12),
    kind=st.sampled_from(["sphere", "hyperboloid", "conic-asphere", "even-polynomial"]),
)
def test_misaligned_reflection_matches_high_precision(x, y, tip, side, kind):
    """Intersection by mpmath's root finder from the textbook sag, normal by its numerical
    derivative."""
    mirror, m = MIRRORS[kind]
    o, d = [mp.mpf(v) for v in (3.0, -2.0, -m)], [mp.mpf(v) for v in (x - 3.0, y + 2.0, m)]
    pose = MirrorPose(tilt_x_deg=tip, tilt_y_deg=side)
    mp.mp.dps = 30
    origin, direction = (
        pose.to_mirror([[float(v) for v in o]])[0],
        pose.rotate_to_mirror([[float(v) for v in d]])[0],
    )

    def sag(u, v):
        r2 = u * u + v * v
        match mirror:
            case Sphere(A, _):
                return A - mp.sqrt(mp.mpf(A) ** 2 - r2)
            case Hyperboloid(A, B, _):
                return -B + B / mp.mpf(A) * mp.sqrt(mp.mpf(A) ** 2 + r2)
            case EvenPolynomial(c, _, N):
                return N * sum(a * (r2 / mp.mpf(N) ** 2) ** (i + 1) for i, a in enumerate(c))
            case ConicAsphere(R, k, _, a, N):
                k1 = 1 + mp.mpf(k)
                conic = (R - mp.sqrt(mp.mpf(R) ** 2 - k1 * r2)) / k1
                return conic + N * sum(
                    c * (r2 / mp.mpf(N) ** 2) ** (i + 2) for i, c in enumerate(a)
                )

    at = [lambda t, i=i: mp.mpf(origin[i]) + t * mp.mpf(direction[i]) for i in range(3)]
    start = reflection.intersect(mirror, [origin], [direction]).distance[0]
    t = mp.findroot(lambda t: at[2](t) - sag(at[0](t), at[1](t)), start)
    p = [f(t) for f in at]
    n = mp.matrix([mp.diff(sag, (p[0], p[1]), (1, 0)), mp.diff(sag, (p[0], p[1]), (0, 1)), -1])
    n /= mp.norm(n)
    travel = mp.matrix([mp.mpf(v) for v in direction])
    travel /= mp.norm(travel)
    out = travel - 2 * (travel.T * n)[0] * n
    reflections = reflection.trace(mirror, [origin], [direction])
    np.testing.assert_allclose(reflections.points[0], [float(v) for v in p], atol=1e-12)
    np.testing.assert_allclose(reflections.directions[0], [float(v) for v in out], atol=1e-13)


def test_pose_rotation_convention():
    """Right-hand rule about X, then about Y, each through the vertex; then the shift."""
    tip, side = 20.0, 35.0
    (cx, sx), (cy, sy) = ((np.cos(a), np.sin(a)) for a in np.radians([tip, side]))
    about_x, about_y = MirrorPose(tilt_x_deg=tip), MirrorPose(tilt_y_deg=side)
    np.testing.assert_allclose(about_x.to_camera([[0, 1, 0]]), [[0, cx, sx]])
    np.testing.assert_allclose(about_y.to_camera([[0, 0, 1]]), [[sy, 0, cy]], atol=1e-16)
    both, point = MirrorPose(1.0, 2.0, 3.0, tip, side), np.array([[0.3, -0.2, 0.9]])
    turned = about_y.to_camera(about_x.to_camera(point))
    np.testing.assert_allclose(both.to_camera(point) - turned, [[1, 2, 3]])
    np.testing.assert_allclose(np.linalg.det(both.rotation()), 1.0)


def test_axis_has_azimuth_zero():
    cos, sin = reflection._unit_radial(
        np.array([0.0, 3.0]), np.array([0.0, -4.0]), np.array([0.0, 5.0])
    )
    np.testing.assert_allclose([cos, sin], [[1.0, 0.6], [0.0, -0.8]], rtol=1e-15)


def test_chunked_rays_match_single_rays():
    mirror = Sphere(50.0, 44.0)
    origins, directions = rays_from_anywhere(mirror, reflection.RAYS_PER_CHUNK + 3)
    full = reflection.intersect(mirror, origins, directions)
    for part in (slice(0, 2), slice(reflection.RAYS_PER_CHUNK - 1, reflection.RAYS_PER_CHUNK + 3)):
        chunk = reflection.intersect(mirror, origins[part], directions[part])
        for a, b in zip(chunk, full, strict=True):
            np.testing.assert_array_equal(a, b[part])


@pytest.mark.parametrize("distance", [1e-3, 0.5, 1.0, 100.0, 1e4])
@pytest.mark.parametrize(
    "mirror",
    [
        Sphere(50.0, 44.0),
        Paraboloid(40.0, 44.0),
        ConicAsphere(50.0, -0.3, 44.0, (0.01,), 44.0),
        Cone(50.0, 44.0),
    ],
)
def test_distance_in_units_of_direction(mirror, distance):
    """The hit of rays parallel to the axis is the sag, for any start height and direction length."""
    x = np.array([-43.9, -10.0, 5.0, 30.0])
    origins = np.stack([x, 0 * x, mirror.sag(abs(x)) - distance], axis=-1)
    for length in (1e-3, 1.0, 2.0):
        hits = reflection.intersect(mirror, origins, np.array([0.0, 0.0, length]))
        np.testing.assert_allclose(hits.distance, distance / length, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(hits.points[:, 2], mirror.sag(abs(x)), atol=1e-9)


def test_hollowness_margin():
    """z = 0.02 r^2 (3 - r^2 / 200) has the curvatures z''= 0.12 - 0.0012 r^2 along and z'/r = 0.12
    - 0.0004 r^2 around."""
    bowl = EvenPolynomial((0.6, -0.1), 20.0, 10.0)
    assert reflection.hollowness(bowl) == pytest.approx(
        1.5 * (12 * 0.1 * 20.0**2 / 10.0**3 - 2 * 0.6 / 10.0), rel=1e-12
    )
    assert reflection.hollowness(EvenPolynomial((0.6, -0.1), 9.0, 10.0)) == 0.0
    large = EvenPolynomial((0.6, -0.1), 2000.0, 1000.0)  # the same, 100 times as large
    assert reflection.hollowness(large) == pytest.approx(
        reflection.hollowness(bowl) / 100, rel=1e-12
    )
    dimple = EvenPolynomial((-0.3, 1.0), 10.0, 10.0)  # z'' = -0.06 at the vertex
    assert reflection.hollowness(dimple) == pytest.approx(1.5 * 0.06, rel=1e-12)
    rounded = EvenPolynomial(
        (-1e-13, 1.0), 10.0, 10.0
    )  # z'' = -2e-14 at the vertex, 1.2 at the rim
    assert reflection.hollowness(rounded) == 0.0
