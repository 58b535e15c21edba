"""Mapping, aspect ratio and viewpoints against laws of optics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.analysis.cross_section import image_curves
from omnimirror.analysis.focus import (
    distances_from_lens,
    imaging_characteristics,
    viewpoint_angle_error,
    virtual_images,
)
from omnimirror.base.errors import InvalidParameter, OmnimirrorError, OutsideField, OutsideMirror
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Orthographic, Perspective
from omnimirror.optics.mirrors import Cone, EvenPolynomial, Hyperboloid, Paraboloid, Sphere
from omnimirror.optics.tracing.meridian import trace_chief_rays
from tests.conftest import M

SPH, EDI, SVP = (
    om.load_sensor(f"paper-{n}") for n in ("spherical", "equidistant", "hyperboloidal")
)
FIELD = np.linspace(0, 135, 271)


@given(a=st.floats(0.2, 3), b=st.floats(0.5, 6), rim=st.floats(0.3, 2))
def test_hyperboloid_has_single_viewpoint_and_aspect_cos_theta(a, b, rim):
    mirror = Hyperboloid(a * M, b * M, rim * M)
    lens = Perspective(11.6, 4.0, 200.0)
    sensor = om.Sensor(
        mirror, lens, Imager(1024, 1024, 5.2), mirror_distance_mm=mirror.single_viewpoint_distance
    )
    result = om.evaluate(sensor, np.linspace(*sensor.field_deg, 50))
    focus = np.hypot(a, b) * M - b * M  # of the other sheet, which is the mirror: at z = C - B
    scale = M * max(1.0, a, b, rim)
    np.testing.assert_allclose(result.viewpoint_z_mm, focus, atol=1e-12 * scale)
    np.testing.assert_allclose(result.aspect, np.cos(np.radians(result.theta_deg)), rtol=1e-9)
    np.testing.assert_allclose(
        result.q_t_mm, result.q_s_mm, rtol=1e-9
    )  # stigmatic at all distances


def test_paper_hyperboloid_single_viewpoint_accuracy():
    z = om.evaluate(SVP, FIELD).viewpoint_z_mm
    assert np.ptp(z) <= 1e-12 * M


def test_orthographic_paraboloid_is_conformal():
    result = om.evaluate(om.load_sensor("paraboloid-telecentric"), np.linspace(0, 105, 50))
    np.testing.assert_allclose(result.aspect, 1, rtol=1e-12)
    np.testing.assert_allclose(result.viewpoint_z_mm, 19.18 / 2, rtol=1e-12)


def test_orthographic_sphere_is_equiareal():
    sensor = om.Sensor(Sphere(50.0, 47.0), Orthographic(0.05, 4.0, 25.0), Imager(1024, 1024, 5.2))
    area = om.evaluate(sensor, np.linspace(0, 139, 50)).area_px2
    np.testing.assert_allclose(area, area[0], rtol=1e-12)


def test_equidistant_mirrors_are_linear():
    exact = om.evaluate(om.load_sensor("exact-equidistant"), FIELD)
    np.testing.assert_allclose(
        exact.dh_domega_px_per_deg, exact.dh_domega_px_per_deg[0], rtol=1e-11
    )
    paper = om.evaluate(EDI, FIELD)
    nonlinearity_px = paper.h_px - paper.h_px[-1] * FIELD / 135
    assert np.abs(nonlinearity_px).max() / paper.h_px[-1] == pytest.approx(0.0049, abs=5e-5)


@pytest.mark.parametrize("sensor", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
def test_solid_angle_sums_to_field(sensor):
    """The image area per square degree, integrated over the image, is the solid angle of the field."""
    r = om.evaluate(sensor, np.linspace(0, 135, 4001))
    per_ring = (
        2 * np.pi * r.h_px * r.dh_domega_px_per_deg / r.area_px2
    )  # square degrees per degree of Omega
    total = np.trapezoid(per_ring[1:], r.omega_deg[1:])
    assert total == pytest.approx(
        2 * np.pi * (1 - np.cos(np.radians(135))) * (180 / np.pi) ** 2, rel=1e-6
    )


@pytest.mark.parametrize("distance", [np.inf, 300.0, 25.0])
def test_axial_object_imaged_on_axis(distance):
    """At 25 mm, a concave mirror of 50 mm has its image at infinity, which is on the axis too."""
    for mirror in (Sphere(50.0, 44.0), EvenPolynomial((-0.01,), 5.0)):
        rays = trace_chief_rays(mirror, 180.0, [0.0])
        images = virtual_images(rays, distance)
        assert (images.x_t.tolist(), images.x_s.tolist()) == ([0.0], [0.0])


def test_characteristics_of_a_conformal_mapping():
    """h = 100 tan(Omega/2) magnifies by 50/cos^2(Omega/2) px per radian in all directions, on both
    sides of the axis; parallax divides each extent."""
    omega = np.radians([-90.0, -10.0, 0.0, 10.0, 90.0])
    rate = 50 / np.cos(omega / 2) ** 2
    expected = rate * np.pi / 180
    for t, s in ((1.0, 1.0), (2.0, 4.0)):
        parallax = () if t == 1 else (t, s)
        result = imaging_characteristics(omega, 100 * np.tan(omega / 2), rate, *parallax)
        np.testing.assert_allclose(result.height, expected / t, rtol=1e-12)
        np.testing.assert_allclose(result.width, expected / s, rtol=1e-12)
        np.testing.assert_allclose(result.area, expected**2 / (s * t), rtol=1e-12)
        np.testing.assert_allclose(result.aspect, t / s, rtol=1e-12)


@pytest.mark.parametrize(
    ("distance", "text"),
    [
        (0.0, "0"),
        (-0.5, "-0.5"),
        (np.nan, "nan"),
        ([0.5, -1.0], "-1"),
        ([-3.0, -2.0], "-3"),
        ([3.0, 0.0], "0"),
        (-np.inf, "-inf"),
    ],
)
def test_virtual_images_require_positive_distances(distance, text):
    rays = trace_chief_rays(Sphere(50.0, 44.0), 180.0, [10.0, 20.0])
    with pytest.raises(
        InvalidParameter,
        match=f"^object_distance_mm must be greater than 0, or inf; got {text}$",
    ):
        virtual_images(rays, distance)
    assert virtual_images(rays, [0.5, 1e-3]).object_distance.tolist() == [0.5, 1e-3]


@pytest.mark.parametrize("distance", [np.inf, 300.0])
@pytest.mark.parametrize("m", [180.0, np.inf])
def test_images_on_both_sides_of_the_axis_are_symmetric(m, distance):
    """Spherical mirror: 1/q_t - 1/p = 2/(R cos gamma), 1/q_s - 1/p = 2 cos gamma / R. Distances from a
    lens at infinity are counted from the vertex."""
    left, right = (
        trace_chief_rays(Sphere(50.0, 44.0), m, sign * np.array([0.0, 10.0, 30.0]))
        for sign in (-1.0, 1.0)
    )
    images = virtual_images(right, distance)
    cos = np.cos(right.gamma)
    np.testing.assert_allclose(1 / images.q_t - 1 / distance, 2 / (50 * cos), rtol=1e-12)
    np.testing.assert_allclose(1 / images.q_s - 1 / distance, 2 * cos / 50, rtol=1e-12)
    backward = np.sin(right.theta), np.cos(right.theta)
    for q, x, z in ((images.q_t, images.x_t, images.z_t), (images.q_s, images.x_s, images.z_s)):
        np.testing.assert_allclose(x, right.x + q * backward[0], rtol=1e-12)
        np.testing.assert_allclose(z, right.z + q * backward[1], rtol=1e-12)
    mirrored = virtual_images(left, distance)
    np.testing.assert_allclose([mirrored.x_t, mirrored.x_s], [-images.x_t, -images.x_s], rtol=1e-12)
    np.testing.assert_allclose([mirrored.z_t, mirrored.z_s], [images.z_t, images.z_s], rtol=1e-12)
    lens = 0.0 if np.isinf(m) else m
    np.testing.assert_allclose(
        distances_from_lens(right, images), [lens + images.z_t, lens + images.z_s], rtol=1e-12
    )


def test_viewpoint_is_axis_intersection():
    r = om.evaluate(SPH, [30.0, 90.0, 120.0])
    omega = np.radians(r.omega_deg)
    np.testing.assert_allclose(
        (r.viewpoint_z_mm - r.z_mm) * np.sin(omega), r.x_mm * np.cos(omega), atol=1e-12
    )


def test_angle_error_matches_point_seen_from_viewpoint():
    """Place the object on the real ray, compute its direction from V0, and compare the angles."""
    rays = SPH.meridian.trace(SPH.meridian.x_from_omega(np.radians([10.0, 60.0, 90.0, 130.0])))
    v0, n = 11.5, 7 * M
    x, z = rays.x + n * np.sin(rays.omega), rays.z - n * np.cos(rays.omega)
    apparent = np.arctan2(x, v0 - z)
    np.testing.assert_allclose(
        rays.omega - viewpoint_angle_error(rays, v0, n), apparent, atol=1e-14
    )
    assert np.all(viewpoint_angle_error(rays, v0, np.inf) == 0)


@pytest.mark.parametrize(("n", "worst", "v0"), [(40, 0.91, 0.2541), (7, 4.75, 0.2623)])
def test_best_viewpoint_of_sphere_matches_paper(n, worst, v0):
    best = om.best_viewpoint(SPH, n * M, image_radius_px=500, linearised=True)
    assert best.worst_px == pytest.approx(worst, abs=0.005)
    assert best.z_mm / M == pytest.approx(v0, abs=5e-5)
    assert best.error_px.max() == pytest.approx(
        -best.error_px.min(), rel=1e-6
    )  # minimax: equal extremes of both signs


@pytest.mark.parametrize(
    ("name", "n", "worst"),
    [
        ("spherical", 40, 0.917),
        ("spherical", 20, 1.810),
        ("spherical", 10, 3.528),
        ("spherical", 7, 4.930),
        ("spherical", 3, 10.46),
        ("spherical", 1, 23.48),
        ("equidistant", 7, 5.581),
    ],
)
def test_single_viewpoint_error_exact(name, n, worst):
    """Compared with a scan of viewpoints: objects at n M from the mirror, projected as if from V0."""
    sensor = om.load_sensor(f"paper-{name}")
    best = om.best_viewpoint(sensor, n * M, image_radius_px=500)
    assert best.worst_px == pytest.approx(worst, rel=6e-4)
    omega = np.linspace(*sensor.field_deg, 301)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    x, z = rays.x + n * M * np.sin(rays.omega), rays.z - n * M * np.cos(rays.omega)
    scale = 500 / sensor.rim_radius_px
    fine = np.linspace(0, sensor.field_deg[1], 40001)
    heights = om.evaluate(sensor, fine).h_px * scale

    def max_error(v0):
        apparent = np.degrees(np.arctan2(x, v0 - z))
        return np.abs(
            sensor.image_height_px(rays) * scale - np.interp(apparent, fine, heights)
        ).max()

    assert max_error(best.z_mm) == pytest.approx(worst, rel=1e-3)
    viewpoints = best.z_mm + M * np.linspace(-0.02, 0.02, 81)
    assert min(max_error(v0) for v0 in viewpoints) >= best.worst_px * (1 - 1e-3)


@pytest.mark.parametrize("name", ["spherical", "equidistant"])
def test_single_viewpoint_errors_agree_for_distant_objects(name):
    sensor = om.load_sensor(f"paper-{name}")
    true, linear = (om.best_viewpoint(sensor, 1e6, linearised=b) for b in (False, True))
    np.testing.assert_allclose(true.error_px, linear.error_px, rtol=2e-4, atol=1e-7)


def test_best_viewpoint_requires_distance():
    for bad in (0.0, -3.0, float("inf"), float("nan"), [1.0, 2.0], "far"):
        with pytest.raises(InvalidParameter, match="object_distance_mm"):
            om.best_viewpoint(SPH, bad)


def test_input_kinds_give_equal_rows():
    by_angle = om.evaluate(SPH, [0.0, 45.0, 90.0, 135.0])
    by_x = om.evaluate(SPH, x_mm=by_angle.x_mm)
    by_h = om.evaluate(SPH, h_px=by_angle.h_px)
    phi = np.radians(30)
    by_pixel = om.evaluate(SPH, pixels=511.5 + by_angle.h_px[:, None] * [np.cos(phi), np.sin(phi)])
    for name, column in by_angle.columns().items():
        for result in (by_x, by_h, by_pixel):
            np.testing.assert_allclose(
                getattr(result, name), column, rtol=1e-9, atol=1e-9, err_msg=name
            )


@pytest.mark.parametrize("flipped", [False, True])
def test_scaled_image_uses_scaled_pixels(flipped):
    """Heights and pixels of the image scaled to 500 px at the rim, as input and output."""
    lens = replace(SPH.lens, k1=-0.3, p1=0.002)
    mount = replace(SPH.mount, image_flipped=flipped)
    for sensor in (SPH, replace(SPH, lens=lens, mount=mount)):
        by_angle = om.evaluate(sensor, [0.0, 45.0, 135.0], image_radius_px=500)
        result = om.evaluate(sensor, h_px=by_angle.h_px, image_radius_px=500)
        np.testing.assert_allclose(result.h_px, by_angle.h_px, atol=1e-9)
        np.testing.assert_allclose(result.omega_deg, by_angle.omega_deg, atol=1e-9)
    assert om.evaluate(SPH, h_px=[500.0], image_radius_px=500).omega_deg[0] == pytest.approx(
        SPH.field_deg[1]
    )
    pixels = 511.5 + np.array([[300.0, 400.0], [-250.0, 0.0]])
    np.testing.assert_allclose(
        om.evaluate(SPH, pixels=pixels, image_radius_px=500).h_px, [500.0, 250.0], atol=1e-9
    )


def test_rows_follow_input_order():
    r = om.evaluate(SPH, [120.0, 3.0, 3.0])
    assert r.omega_deg.tolist() == [120.0, 3.0, 3.0]
    assert r.x_mm[1] == r.x_mm[2] < r.x_mm[0]
    assert len(om.evaluate(SPH, 90)) == 1
    assert len(om.evaluate(SPH)) == 28  # every 5 deg


def test_object_distances_per_row():
    result = om.evaluate(SPH, [60.0, 60.0], object_distance_mm=[5 * M, np.inf])
    assert result.q_t_mm[0] == om.evaluate(SPH, [60.0], object_distance_mm=5 * M).q_t_mm[0]
    assert result.q_t_mm[1] == om.evaluate(SPH, [60.0]).q_t_mm[0]


@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"omega_deg": [136.0]}, OutsideField, "omega must be 0 to .* got 136"),
        ({"omega_deg": [float("nan")]}, OutsideField, "omega must be 0 to .* got nan"),
        ({"x_mm": [44.0]}, OutsideMirror, "x must be 0 to .* got 44"),
        ({"h_px": [600.0]}, OutsideField, "theta must be at most .* got 14"),
        ({"pixels": [[0.0, 0.0]]}, OutsideField, "theta must be at most .* got 1"),
        ({"pixels": [1.0, 2.0, 3.0]}, InvalidParameter, r"pixels must be pairs .* got \(3,\)"),
        (
            {"omega_deg": [1.0], "x_mm": [1.0]},
            InvalidParameter,
            "omega_deg and x_mm must not be given together",
        ),
        (
            {"omega_deg": [1.0], "object_distance_mm": 0.0},
            InvalidParameter,
            "object_distance_mm must be at least 1e-09 mm, or inf; got 0",
        ),
        (
            {"omega_deg": [1.0], "object_distance_mm": -5.0},
            InvalidParameter,
            "object_distance_mm must be at least 1e-09 mm, or inf; got -5",
        ),
        (
            {"omega_deg": [1.0, 2.0, 3.0], "object_distance_mm": [100.0, -5.0, -7.0]},
            InvalidParameter,
            "object_distance_mm",
        ),
        (
            {"omega_deg": [1.0], "object_distance_mm": [1.0, 2.0]},
            InvalidParameter,
            "each of the 1 field angles; got 2",
        ),
        (
            {"omega_deg": [1.0], "focus_mm": 11.0},
            InvalidParameter,
            "focus_distance_mm must be greater than .* got 11",
        ),
        (
            {"omega_deg": [1.0], "mode": "rough"},
            InvalidParameter,
            "mode must be one of exact, paper; got 'rough'",
        ),
        (
            {"omega_deg": [1.0], "tolerance_px": 0.0},
            InvalidParameter,
            r"tolerance_px must be greater than 0 px and finite; got 0\.0",
        ),
        (
            {"omega_deg": [1.0], "wavelength_nm": -1.0},
            InvalidParameter,
            "wavelength_nm must be 100 to 20000 nm; got -1",
        ),
        (
            {"omega_deg": [1.0], "focus_mm": "auto", "merit": "best"},
            InvalidParameter,
            "merit must be one of worst_floored_area_deg2, mean_floored_area_deg2, worst_blur_area_deg2",
        ),
        (
            {"omega_deg": [1.0, 2.0], "focus_mm": "auto", "object_distance_mm": [9.0, 8.0]},
            InvalidParameter,
            "'auto'",
        ),
    ],
)
def test_invalid_arguments_rejected(kwargs, error, message):
    with pytest.raises(error, match=message):
        om.evaluate(SPH, **kwargs)


def test_unusable_mirror_rejected_at_first_evaluation():
    sensor = replace(SPH, mirror=Sphere(44.0, 43.9))  # nearly a hemisphere with a grazing rim
    with pytest.raises(OmnimirrorError, match="views the mirror edge-on"):
        om.evaluate(sensor, [10.0])
    with pytest.raises(InvalidParameter, match="mirror_distance_mm"):
        om.Sensor(Paraboloid(20.0, 20.0), Perspective(11.6, 4.0, 200.0), Imager(10, 10, 5.0))


@pytest.mark.parametrize("m", [176.0, 5.0])
def test_cone_rays_pass_virtual_pinhole_ring(m):
    """Real rays, reflected in 3-D from tangent planes of the cone, and extended behind it."""
    cone = Cone(50.0, 43.9)
    sensor = om.Sensor(
        cone, Perspective(11.6, 4.0, 300.0), Imager(1024, 1024, 5.2), mirror_distance_mm=m
    )
    radius, height = cone.pinhole_ring(m)
    x = np.linspace(1, 43.9, 12)
    phi = np.linspace(0, 6, 12)
    radial, axial = (
        np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=-1),
        np.array([0.0, 0.0, 1.0]),
    )
    tangent = np.tan(np.radians(50.0))
    points = x[:, None] * radial + (x * tangent)[:, None] * axial
    normals = (tangent * radial - axial) / np.hypot(tangent, 1)
    from_lens = points + m * axial
    reflected = from_lens - 2 * (from_lens * normals).sum(axis=1, keepdims=True) * normals
    reflected /= np.linalg.norm(reflected, axis=1, keepdims=True)
    to_pinhole = -radius * radial + height * axial - points  # on the far side of the axis
    np.testing.assert_allclose(np.cross(to_pinhole, reflected), 0, atol=1e-11 * m)
    result = om.evaluate(sensor, x_mm=x, object_distance_mm=700.0)
    np.testing.assert_allclose(np.cos(np.radians(result.omega_deg)), -reflected[:, 2], atol=1e-13)
    assert np.isinf(result.radius_t_mm).all()
    np.testing.assert_allclose(result.q_t_mm, 700.0, rtol=1e-13)  # a plane mirror in the meridian
    np.testing.assert_allclose(result.radius_s_mm, x / np.sin(np.radians(50.0)), rtol=1e-13)


def test_cone_single_viewpoint_only_at_tip():
    """The ring shrinks with m, as does the spread of axis intersections of the rays."""
    spread = []
    for m in (10.0, 1.0, 0.1):
        cone = om.Sensor(
            Cone(50.0, 43.9),
            Perspective(11.6, 4.0, 300.0),
            Imager(1024, 1024, 5.2),
            mirror_distance_mm=m,
        )
        low, high = cone.field_deg
        angles = np.linspace(low + 0.3 * (high - low), high, 9)
        spread.append(np.ptp(om.evaluate(cone, angles).viewpoint_z_mm))
        assert cone.mirror.pinhole_ring(m)[0] == pytest.approx(m * np.sin(np.radians(100.0)))
    np.testing.assert_allclose(np.divide(spread[:-1], spread[1:]), 10, rtol=0.3)


@pytest.mark.parametrize("name", ["paper-hyperboloidal", "paraboloid-telecentric"])
def test_subset_of_angles_gives_equal_rows(name):
    sensor = om.load_sensor(name)
    result = om.evaluate(
        sensor, [10.0, 40.0, 70.0, 90.0], object_distance_mm=[500.0, 600.0, 700.0, 800.0]
    )
    subset, separate = (
        result[1:3],
        om.evaluate(sensor, [40.0, 70.0], object_distance_mm=[600.0, 700.0]),
    )
    assert len(subset) == 2
    assert np.array_equal(subset.object_distance_mm, separate.object_distance_mm)
    for column, values in separate.columns().items():
        np.testing.assert_allclose(subset.columns()[column], values, rtol=1e-12)


@pytest.mark.parametrize("name", ["paper-hyperboloidal", "paraboloid-telecentric"])
def test_virtual_images_match_evaluation(name):
    sensor = om.load_sensor(name)
    far, near = om.evaluate(sensor), om.evaluate(sensor, object_distance_mm=220.0)
    for curve, expected in zip(image_curves(far, 220.0), image_curves(near), strict=True):
        np.testing.assert_allclose(curve, expected, rtol=1e-12)
