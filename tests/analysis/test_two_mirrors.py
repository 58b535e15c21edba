"""Two-mirror sensors against finite real rays, traced here from sags and the law of reflection
only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import (
    InvalidParameter,
    NotOneToOne,
    OutsideField,
    OutsideMirror,
    SelfObstruction,
)
from omnimirror.optics.lenses import Orthographic
from omnimirror.optics.mirrors import EvenPolynomial, Flat, Paraboloid, Secondary, Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.radiometry import Radiometry
from tests.conftest import M

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # eighth-order central difference
UNFOLDED = om.load_sensor("paper-spherical")
FOLDED = om.load_sensor("folded-spherical")
TWO_HYPERBOLOIDS = om.load_sensor("folded-hyperboloidal")


def with_secondary(mirror, distance=80.0, bore=8.0, mirror_distance=160.0):
    return replace(
        UNFOLDED,
        secondary=Secondary(mirror, distance, bore),
        mirror_distance_mm=mirror_distance,
        name=mirror.KIND,
    )


CONCAVE = with_secondary(EvenPolynomial((-1 / 600,), 30.0))
CONVEX = with_secondary(Sphere(150.0, 15.5))
ASPHERIC = with_secondary(EvenPolynomial((-1e-3, 4e-7), 26.0), mirror_distance=172.0)
TELECENTRIC = om.Sensor(
    Sphere(50.0, M),
    Orthographic(0.2, 4.0, 20.0),
    UNFOLDED.imager,
    secondary=Secondary(Paraboloid(60.0, 13.0), 90.0, 13.0),
)
SENSORS = {
    "flat": FOLDED,
    "two-hyperboloids": TWO_HYPERBOLOIDS,
    "concave": CONCAVE,
    "convex": CONVEX,
    "aspheric": ASPHERIC,
    "telecentric": TELECENTRIC,
}


# -- independent tracer: surfaces z(r), rays (point, direction) in the frame of the primary
# ----------


def surfaces(sensor):
    """Return heights of both surfaces above the vertex of the primary, as functions of the distance
    from the axis."""
    second = sensor.secondary
    return sensor.mirror.sag, lambda r: -second.distance_mm - second.mirror.sag(r)


def bounce(surface, hit, travel):
    """Return the direction after reflection in a surface z(r) at a point, with its slope from
    finite differences."""
    r, h = np.hypot(*hit[:2]), 2e-2
    k = np.arange(1, 5)
    slope = float(WEIGHTS @ (surface(np.abs(r + k * h)) - surface(np.abs(r - k * h)))) / h
    c, s = hit[:2] / r if r > 0 else (1.0, 0.0)
    n = np.array([slope * c, slope * s, -1.0]) / np.hypot(slope, 1)
    return travel - 2 * (travel @ n) * n


def intersect(surface, start, travel, reach):
    """Return the first intersection of a ray with a surface."""

    def clearance(t):
        p = start + t * travel
        return float(p[2] - surface(np.hypot(p[0], p[1])))

    return start + brentq(clearance, 1e-9, reach, xtol=1e-13) * travel


def to_lens(sensor, obj, d, x, y):
    """Return the ray (point, direction) towards the lens of light that hits the primary at (x, y)."""
    first, second = surfaces(sensor)
    hit = np.array([x, y, float(first(np.hypot(x, y)))])
    travel = -d if obj is None else (hit - obj) / np.linalg.norm(hit - obj)
    travel = bounce(first, hit, travel)
    drop = (hit[2] + sensor.secondary.distance_mm) / -travel[2]
    hit = intersect(second, hit, travel, 1.2 * drop)
    return hit, bounce(second, hit, travel)


def extrapolated(estimate):
    """Return the limit of an even function of the spacing, from three spacings."""
    a, b, c = (estimate(s) for s in (0.4, 0.2, 0.1))
    ab, bc = (4 * b - a) / 3, (4 * c - b) / 3
    return (16 * bc - ab) / 15


def crossing_height(chief, ray, axes):
    """Return the height z of the intersection of a ray with the chief ray, projected to the plane
    of two axes."""
    (p, a), (q, b) = chief, ray
    i = list(axes)
    t = np.linalg.solve(np.stack([a[i], -b[i]], axis=1), (q - p)[i])[0]
    return (p + t * a)[2]


@pytest.mark.parametrize("distance", [np.inf, 5 * M], ids=["infinite", "5M"])
@pytest.mark.parametrize("kind", SENSORS)
def test_two_mirror_images_match_ray_intersections(kind, distance):
    sensor = SENSORS[kind]
    low, high = sensor.field_deg
    omega = np.linspace(low + 1, high - 1, 6)
    result = om.evaluate(sensor, omega, object_distance_mm=distance)
    lens_z = sensor.secondary.lens_height(sensor.mirror_distance_mm)
    reference = -sensor.secondary.distance_mm if np.isinf(lens_z) else lens_z
    for i, angle in enumerate(np.radians(omega)):
        x = result.x_mm[i]
        d = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        obj = (
            None
            if np.isinf(distance)
            else np.array([x, 0.0, float(sensor.mirror.sag(x))]) + distance * d
        )
        chief = to_lens(sensor, obj, d, x, 0.0)
        if np.isinf(lens_z):
            np.testing.assert_allclose(chief[1], [0, 0, 1], atol=1e-9)
            assert result.h_px[i] == pytest.approx(0.2 * chief[0][0] / 5.2e-3, rel=1e-9)
        else:  # the chief ray reaches the lens at the stated viewing angle
            at_lens = chief[0] + (lens_z - chief[0][2]) / chief[1][2] * chief[1]
            np.testing.assert_allclose(at_lens, [0, 0, lens_z], atol=1e-8)
            assert np.degrees(np.arctan2(-chief[1][0], chief[1][2])) == pytest.approx(
                result.theta_deg[i], abs=1e-9
            )

        def tangential(spacing, chief=chief, obj=obj, d=d, x=x):
            rays = (to_lens(sensor, obj, d, x + side * spacing, 0.0) for side in (-1, 1))
            return np.mean([1 / (reference - crossing_height(chief, ray, (0, 2))) for ray in rays])

        def sagittal(spacing, obj=obj, d=d, x=x):
            psi = spacing / x
            p, r = to_lens(sensor, obj, d, x * np.cos(psi), x * np.sin(psi))
            return 1 / (reference - (p - p[1] / r[1] * r)[2])  # with its counterpart from -psi

        assert 1 / result.distance_t_mm[i] == pytest.approx(extrapolated(tangential), rel=3e-6), (
            omega[i]
        )
        assert 1 / result.distance_s_mm[i] == pytest.approx(extrapolated(sagittal), rel=3e-6), (
            omega[i]
        )


@pytest.mark.parametrize("looks", ["up", "down", "forward"])
@pytest.mark.parametrize("kind", [k for k in SENSORS if k != "telecentric"])
def test_pixel_rays_match_traced_rays(kind, looks):
    """Trace from the lens via both mirrors in the camera frame: X right, Y down, Z forward."""
    sensor = SENSORS[kind]
    sensor = replace(
        sensor, mount=replace(sensor.mount, camera_looks=looks, forward_azimuth_deg=25.0)
    )
    rng = np.random.default_rng(3)
    edges_px = np.array(sensor._edges_mm) / sensor.imager.pitch_mm
    radius, phi = rng.uniform(*edges_px, 8), rng.uniform(0, 2 * np.pi, 8)
    pixels = sensor.imager.centre + np.stack([radius * np.cos(phi), radius * np.sin(phi)], axis=-1)
    pixels = pixels[(np.abs(pixels - 511.5) < 511).all(axis=1)]
    origins, directions, valid = sensor.backproject(pixels)
    assert valid.all()
    second = sensor.secondary
    to_secondary = sensor.mirror_distance_mm - second.distance_mm
    vertex = np.array([0.0, 0.0, to_secondary - second.distance_mm])  # vertex of the primary
    for pixel, origin, direction in zip(pixels, origins, directions, strict=True):
        on_imager = (pixel - sensor.imager.centre) * sensor.imager.pitch_mm
        ray = np.array([*on_imager, sensor.lens.image_distance])
        ray /= np.linalg.norm(ray)
        hit = intersect(
            lambda r: to_secondary + second.mirror.sag(r),
            np.zeros(3),
            ray,
            1.1 * to_secondary / ray[2],
        )
        ray = bounce(lambda r: to_secondary + second.mirror.sag(r), hit, ray)
        hit = intersect(
            lambda r: vertex[2] - sensor.mirror.sag(r), hit, ray, 1.5 * second.distance_mm / -ray[2]
        )
        ray = bounce(lambda r: vertex[2] - sensor.mirror.sag(r), hit, ray)
        rotation = sensor.mount.rotation()
        np.testing.assert_allclose(rotation @ (hit - vertex), origin, atol=1e-8)
        np.testing.assert_allclose(rotation @ ray, direction, atol=1e-9)


@given(
    share=st.floats(0.35, 0.6), fraction=st.floats(0, 1), distance=st.sampled_from([np.inf, 300.0])
)
@settings(max_examples=30)
def test_flat_fold_changes_obscuration_only(share, fraction, distance):
    m = UNFOLDED.mirror_distance_mm
    folded = replace(UNFOLDED, secondary=Secondary(Flat(32.0), share * m, 12.0))
    low, high = folded.field_deg
    omega = np.array([low + fraction * (high - low)])
    single, double = (
        om.evaluate(s, omega, object_distance_mm=distance) for s in (UNFOLDED, folded)
    )
    for name, column in single.columns().items():
        np.testing.assert_allclose(
            getattr(double, name), column, rtol=1e-10, atol=1e-11, err_msg=name
        )


def test_confocal_hyperboloids_have_single_viewpoint():
    """Each maps angles by tan(Omega/2) = K tan(theta/2), without astigmatism at any distance; so
    does their combination."""
    for distance in (np.inf, 200.0):
        result = om.evaluate(
            TWO_HYPERBOLOIDS, np.linspace(25, 135, 50), object_distance_mm=distance
        )
        assert np.ptp(result.viewpoint_z_mm) < 1e-11
        np.testing.assert_allclose(result.distance_t_mm, result.distance_s_mm, rtol=1e-12)
    ratio = np.tan(np.radians(result.omega_deg / 2)) / np.tan(np.radians(result.theta_deg / 2))
    first, second = TWO_HYPERBOLOIDS.mirror, TWO_HYPERBOLOIDS.secondary.mirror

    def factor(mirror):
        e = np.hypot(mirror.a_mm, mirror.b_mm) / mirror.b_mm
        return (e + 1) / (e - 1)

    np.testing.assert_allclose(
        ratio, factor(first) * factor(second), rtol=1e-7
    )  # a_mm of the file has 7 digits


@pytest.mark.parametrize("kind", SENSORS)
def test_mapping_rate_is_derivative(kind):
    sensor = SENSORS[kind]
    low, high = sensor.field_deg
    omega, step = np.linspace(low + 0.1, high - 0.1, 23), 0.02
    h = {k: om.evaluate(sensor, omega + k * step).h_px for k in (-2, -1, 1, 2)}
    rate = (8 * (h[1] - h[-1]) - (h[2] - h[-2])) / (12 * step)
    np.testing.assert_allclose(om.evaluate(sensor, omega).dh_domega_px_per_deg, rate, rtol=1e-8)


# -- obscurations
# ------------------------------------------------------------------------------------


def test_field_starts_at_secondary_edge():
    sensor = with_secondary(Sphere(150.0, 25.0), bore=4.0)
    rays = sensor.meridian.trace(sensor.meridian.x_min)
    second = sensor.secondary
    rim_z = float(second.height(np.array(second.mirror.rim_radius_mm)))
    at_rim = rays.x + (rays.z - rim_z) * np.tan(rays.omega)
    assert float(at_rim) == pytest.approx(second.mirror.rim_radius_mm, rel=1e-9)


def test_field_starts_at_wider_bore():
    assert FOLDED.meridian.x_min == pytest.approx(FOLDED.secondary.bore_radius_mm, abs=1e-9)
    low, _ = FOLDED.field_deg
    with pytest.raises(OutsideField, match=f"omega must be {low:.6g} to .* got 5"):
        om.evaluate(FOLDED, [5.0])
    with pytest.raises(OutsideMirror, match=r"x must be 5 to .* got 2"):
        om.evaluate(FOLDED, x_mm=[2.0])
    limits = [
        [511.5 + 60, 511.5],
        [511.5 + 70, 511.5],
    ]  # the image of the bore has a radius of 65 px
    assert FOLDED.backproject(limits).valid.tolist() == [False, True]


def test_camera_front_obscures_field():
    """Rays between the mirrors pass the front of the camera 20 mm before the vertex, located by a
    similar triangle."""
    sensor = replace(UNFOLDED, secondary=Secondary(Flat(26.0), 100.0, 7.0))
    lens_z = UNFOLDED.mirror_distance_mm - 200.0
    assert lens_z < -19
    rays = sensor.meridian.trace(sensor.meridian.x_min)
    virtual_lens = -UNFOLDED.mirror_distance_mm
    at_front = rays.x * (lens_z - virtual_lens) / (rays.z - virtual_lens)
    x = rays.x + (rays.z + 100.0) * np.tan(rays.omega)
    assert min(float(at_front) - 7.0, float(x) - 26.0) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("sensor", "error", "message"),
    [
        (with_secondary(EvenPolynomial((-0.01,), 20.0)), NotOneToOne, "its rays cross the axis"),
        (with_secondary(Sphere(150.0, 10.0)), SelfObstruction, r"it ends at x = 3\d\.\d+ mm"),
        (
            with_secondary(Flat(25.0), bore=43.9),
            SelfObstruction,
            "must not obscure the whole mirror",
        ),
        (
            with_secondary(Flat(25.0), 70.0, 1.0),
            SelfObstruction,
            r"bore_radius_mm must be greater than [34]\.\d+",
        ),
        (
            with_secondary(Flat(25.0), 160.0),
            InvalidParameter,
            "distance_mm must be less than mirror_distance_mm .* got 160",
        ),
        (
            with_secondary(EvenPolynomial((-1 / 900, -1e-4), 40.0), 20.0),
            InvalidParameter,
            r"must be greater than \d+",
        ),
        (
            replace(TELECENTRIC, secondary=Secondary(Flat(44.0), 90.0, 13.0)),
            NotOneToOne,
            "requires a convex secondary",
        ),
        (
            replace(TELECENTRIC, secondary=Secondary(Paraboloid(60.0, 13.0), 90.0, 8.0)),
            SelfObstruction,
            "bore_radius_mm must be greater than",
        ),
        (
            with_secondary(Sphere(15.6, 15.55)),
            SelfObstruction,
            "secondary: rim_radius_mm must be less than",
        ),
    ],
)
def test_invalid_secondaries_rejected(sensor, error, message):
    with pytest.raises(error, match=message):
        sensor.field_deg  # noqa: B018


def test_two_mirror_image_is_not_reversed():
    """The same scene, folded and not: one image is the other reversed, except for the obscuration
    of the fold."""
    room = om.Room(texel_mm=40.0)
    small = replace(UNFOLDED.imager, width_px=128, height_px=128, pixel_pitch_um=41.6)
    assert (UNFOLDED.mount.camera_looks, FOLDED.mount.camera_looks) == (
        "up",
        "down",
    )  # both mirrors face down
    single, double = (
        om.render_image(replace(s, imager=small), room, samples=1).astype(int)
        for s in (UNFOLDED, FOLDED)
    )
    is_valid = np.hypot(*np.mgrid[-63.5:64, -63.5:64]) > 12
    assert np.mean(np.abs(single[:, ::-1] - double)[is_valid]) < 0.5
    assert np.mean(np.abs(single - double)[is_valid]) > 10


def test_single_mirror_functions_reject_two_mirrors():
    with pytest.raises(
        InvalidParameter,
        match="radiometry must be omitted unless the camera is a sensor with one mirror",
    ):
        om.expose(FOLDED, om.Room(texel_mm=40.0), samples=1, radiometry=Radiometry())
    with pytest.raises(InvalidParameter, match="mirror_pose is not supported with a secondary"):
        replace(FOLDED, mirror_pose=MirrorPose(decentre_x_mm=0.1))
