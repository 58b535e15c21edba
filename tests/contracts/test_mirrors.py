"""Contract of all mirrors."""

from __future__ import annotations

import re
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from omnimirror.base.errors import InvalidParameter, OutsideMirror
from omnimirror.optics.mirrors import (
    MIRRORS,
    Cone,
    ConicAsphere,
    Ellipsoid,
    EvenPolynomial,
    Hyperboloid,
    Mirror,
    Paraboloid,
    SampledProfile,
    SlopeSpline,
    Sphere,
)
from omnimirror.optics.mirrors.prescribed_mapping import MappingMirror
from omnimirror.optics.testing import MIRROR_CHECKS
from tests.conftest import MIRRORS as EXAMPLES
from tests.everyday import few


def exact_sag(mirror: Mirror):
    """Return the sag in 30 digits from the textbook equation of each shape; None if unavailable."""
    match mirror:
        case Sphere(A, _):
            return lambda x: A - mp.sqrt(A**2 - x**2)
        case Hyperboloid(A, B, _):
            return lambda x: -B + B / mp.mpf(A) * mp.sqrt(mp.mpf(A) ** 2 + x**2)
        case Paraboloid(s, _):
            return lambda x: x**2 / (2 * mp.mpf(s))
        case Ellipsoid(A, B, _):
            return lambda x: B - B * mp.sqrt(1 - (x / mp.mpf(A)) ** 2)
        case Cone(slope, _):
            return lambda x: x * mp.tan(mp.radians(slope))
        case EvenPolynomial(c, _, N):
            return lambda x: N * sum(a * (x / mp.mpf(N)) ** (2 * i + 2) for i, a in enumerate(c))
        case ConicAsphere(R, k, _, a, N):
            return lambda x: (
                (R - mp.sqrt(R**2 - (1 + mp.mpf(k)) * x**2)) / (1 + mp.mpf(k))
                + N * sum(c * (x / mp.mpf(N)) ** (2 * i + 4) for i, c in enumerate(a))
            )
        case SampledProfile() | SlopeSpline():  # the samples of conftest are those of a sphere
            return lambda x: mp.mpf("49.9582") - mp.sqrt(mp.mpf("49.9582") ** 2 - x**2)


def exact_mapping(mirror: MappingMirror):
    """Return Omega(theta) of direction mappings by their definition."""
    Theta = mp.radians(mirror.theta_max_deg)
    unit, top = mp.tan(Theta), mp.radians(getattr(mirror, "omega_max_deg", 122))
    return {
        "equidistant": lambda t: top * mp.tan(t) / unit,
        "equiangular": lambda t: top * t / Theta,
        "conformal": lambda t: 2 * mp.atan(mp.tan(top / 2) * mp.tan(t / 2) / mp.tan(Theta / 2)),
        "unit-aspect": lambda t: 2 * mp.atan(mp.tan(top / 2) * mp.tan(t) / unit),
        "equiareal": lambda t: 2 * mp.asin(mp.sin(top / 2) * mp.tan(t) / unit),
        "tabulated-mapping": lambda t: 2 * mp.asin(mp.sin(top / 2) * mp.tan(t) / unit),
        "rectifying": lambda t: mp.atan(mp.tan(top) * mp.tan(t) / unit),
    }[mirror.KIND]


def exact_points(mirror: MappingMirror):
    """Return x, sag, slope and curvature in 30 digits: ln(rho/m) by quadrature, scaled by the rim."""
    omega, Theta = exact_mapping(mirror), mp.radians(mirror.theta_max_deg)

    def rho(theta):
        return mp.exp(mp.quad(lambda t: mp.tan((omega(t) + t) / 2), [0, theta]))

    def slope(theta):
        return mp.tan((omega(theta) - theta) / 2)

    m = mirror.rim_radius_mm / (rho(Theta) * mp.sin(Theta))
    for theta in (Theta / 20, Theta / 2, Theta * mp.mpf("0.99")):
        r = m * rho(theta)
        dx = r * (mp.cos(theta) + mp.tan((omega(theta) + theta) / 2) * mp.sin(theta))
        yield r * mp.sin(theta), r * mp.cos(theta) - m, slope(theta), mp.diff(slope, theta) / dx


def exact_finite_points(mirror: MappingMirror):
    """Return the same from the law of reflection z' = tan((Omega - theta)/2) in x and z, by Taylor
    series."""
    unit, m, M = (
        mp.tan(mp.radians(mirror.theta_max_deg)),
        mp.mpf(mirror.design_distance),
        mirror.rim_radius_mm,
    )
    top, rim_z = mp.radians(mirror.omega_max_deg), M / unit - m

    def omega(x, z):
        t = x / (m + z) / unit
        if mirror.KIND == "ground-plane":
            H = mp.mpf(mirror.plane_distance_mm)
            return mp.atan2((M + (H + rim_z) * mp.tan(top)) * t - x, z + H)
        R = mp.mpf(mirror.cylinder_radius_mm)
        low, high = -R / mp.tan(mp.radians(mirror.omega_min_deg)), rim_z - (R - M) / mp.tan(top)
        return mp.atan2(R - x, z - low - (high - low) * t)

    def law(x, z):
        return mp.tan((omega(x, z) - mp.atan(x / (m + z))) / 2)

    solution = mp.odefun(lambda x, y: [law(x, y[0])], 0, [mp.mpf(0)])
    for x in (mp.mpf(2), mp.mpf(21), mp.mpf("43.5")):
        z = solution(x)[0]
        yield x, z, law(x, z), mp.diff(lambda s, x=x, z=z: law(x + s, z + s * law(x, z)), 0)


@pytest.mark.parametrize(
    "kind",
    few(sorted(EXAMPLES), *(kind for kind in EXAMPLES if kind not in ("cylinder", "ground-plane"))),
)
def test_sag_and_derivatives_agree_with_textbook_equation(kind):
    mirror, _ = EXAMPLES[kind]
    mp.mp.dps = 15 if kind in ("ground-plane", "cylinder") else 30  # slow with 30 digits
    if kind in ("ground-plane", "cylinder"):
        points = exact_finite_points(mirror)
    elif isinstance(mirror, MappingMirror):
        points = exact_points(mirror)
    else:
        sag, xs = exact_sag(mirror), map(mp.mpf, np.linspace(0.05, 0.99, 8) * mirror.rim_radius_mm)
        points = ((x, sag(x), mp.diff(sag, x), mp.diff(sag, x, 2)) for x in xs)
    # quintic splines: about 120 points of the sag or slope of a sphere, and 62 of a mapping, which
    # has one more derivative
    of_points = (1e-9, 5e-8, 5e-6)
    tolerances = {
        "sampled": of_points,
        "slope-spline": of_points,
        "tabulated-mapping": (1e-9, 2e-8, 1e-6),
    }
    tolerance = tolerances.get(kind, (1e-13, 1e-13, 1e-12))
    for x, *exact in points:
        for name, value, truth, rel in zip(
            ("sag", "slope", "curvature"), mirror.profile(float(x)), exact, tolerance, strict=True
        ):
            assert float(value) == pytest.approx(float(truth), rel=rel, abs=1e-14), (
                f"{name} at x = {x}"
            )


def test_every_registered_mirror_is_tested():
    assert set(EXAMPLES) == set(MIRRORS)


@pytest.mark.parametrize("check", MIRROR_CHECKS)
def test_every_mirror_meets_contract(any_mirror, check):
    check(any_mirror)


def test_vertex_is_origin(any_mirror):
    assert float(any_mirror.sag(0.0)) == pytest.approx(0.0, abs=1e-13)
    assert any_mirror.is_pointed == (any_mirror.KIND in ("cone", "cylinder"))
    if not any_mirror.is_pointed:
        assert float(any_mirror.slope(0.0)) == 0.0


def test_radii_agree_with_intersections_of_adjacent_normals(any_mirror):
    """R_s: intersection of the normal with the axis. R_t: intersection of neighbouring normals."""
    for x in np.linspace(0.2, 0.9, 5) * any_mirror.rim_radius_mm:
        z, slope = float(any_mirror.sag(x)), float(any_mirror.slope(x))
        assert float(any_mirror.radius_s(x)) == pytest.approx(np.hypot(x, x / slope), rel=1e-12)
        if any_mirror.KIND == "cone":
            assert np.isinf(any_mirror.radius_t(x))
            continue
        estimates = []
        for step in (0.02, 0.01):
            ends = [
                (
                    x + s * step,
                    float(any_mirror.sag(x + s * step)),
                    float(any_mirror.slope(x + s * step)),
                )
                for s in (-1, 1)
            ]
            (x1, z1, s1), (x2, z2, s2) = ends  # normals: x + s (z - z0) = x0
            zc = ((x1 + s1 * z1) - (x2 + s2 * z2)) / (s1 - s2)
            xc = x1 - s1 * (zc - z1)
            estimates.append(np.hypot(xc - x, zc - z))
        limit = (4 * estimates[1] - estimates[0]) / 3
        assert float(any_mirror.radius_t(x)) == pytest.approx(limit, rel=1e-6)


def test_radii_are_equal_at_smooth_apex(any_mirror):
    if any_mirror.is_pointed:
        pytest.skip("a cone has no smooth apex")
    assert float(any_mirror.radius_s(0.0)) == pytest.approx(
        float(any_mirror.radius_t(0.0)), rel=1e-12
    )
    near = 1e-4 * any_mirror.rim_radius_mm
    assert float(any_mirror.radius_s(near)) == pytest.approx(
        float(any_mirror.radius_s(0.0)), rel=1e-6
    )


@pytest.mark.parametrize(
    ("kind", "name", "low", "high", "unit"),
    [
        ("hyperboloid", "a_mm", 1e-3, 1e6, " mm"),
        ("hyperboloid", "b_mm", 1e-3, 1e6, " mm"),
        ("sphere", "radius_mm", 1e-3, 1e6, " mm"),
        ("ellipsoid", "a_mm", 1e-3, 1e6, " mm"),
        ("ellipsoid", "b_mm", 1e-3, 1e6, " mm"),
        ("paraboloid", "vertex_radius_mm", 1e-3, 1e6, " mm"),
        ("cone", "slope_deg", 0.1, 89.9, " deg"),
        ("even-polynomial", "normalization_radius_mm", 1e-3, 1e5, " mm"),
        ("conic-asphere", "normalization_radius_mm", 1e-3, 1e5, " mm"),
        ("conic-asphere", "vertex_radius_mm", 1e-3, 1e6, " mm"),
        ("conic-asphere", "conic", -1e3, 1e3, ""),
    ],
)
def test_conic_constants_out_of_bounds_are_rejected(kind, name, low, high, unit):
    for value in (low - 0.1 * abs(low), high + 0.5):
        with pytest.raises(
            InvalidParameter,
            match=re.escape(f"{name} must be between {low:g} and {high:g}{unit}; got {value:g}"),
        ):
            replace(EXAMPLES[kind][0], **{name: value})


@pytest.mark.parametrize("kind", ["even-polynomial", "conic-asphere"])
def test_coefficients_out_of_bounds_are_rejected(kind):
    coefficients = EXAMPLES[kind][0].PARAMETERS["coefficients"]
    assert (coefficients.low, coefficients.high) == (-1e9, 1e9)  # rounded in messages
    for value in (-1.001e9, 1.001e9):
        with pytest.raises(
            InvalidParameter,
            match=re.escape(f"coefficients[1] must be between -1e+09 and 1e+09; got {value:g}"),
        ):
            replace(EXAMPLES[kind][0], coefficients=(0.0, value))


@pytest.mark.parametrize(
    ("mirror", "reach"),
    [
        (Sphere(50.0, 40.0), 50.0),
        (Ellipsoid(60.0, 120.0, 40.0), 60.0),
        (Ellipsoid(60.0, 20.0, 40.0), 60.0),
        (ConicAsphere(40.0, -0.36, 40.0), 50.0),  # 40 / sqrt(1 - 0.36)
        (ConicAsphere(40.0, 0.5625, 30.0), 32.0),  # 40 / sqrt(1 + 0.5625)
        (ConicAsphere(40.0, -1.0, 30.0), None),
        (ConicAsphere(40.0, -1.1, 30.0), None),
        (Paraboloid(40.0, 30.0), None),
        (Hyperboloid(30.0, 40.0, 30.0), None),
    ],
)
def test_conics_end_at_their_equator(mirror, reach):
    """Values beyond it are NaN, without a warning, and the rim must be within it."""
    if reach is None:
        assert replace(mirror, rim_radius_mm=1e4).rim_radius_mm == 1e4
        return
    within = replace(mirror, rim_radius_mm=0.999 * reach)
    assert np.isfinite(within.profile(0.999 * reach)).all()
    assert np.isnan(within.profile(1.001 * reach)).all()
    with pytest.raises(
        OutsideMirror, match=f"rim_radius_mm must be less than {reach:g} mm, where the .* ends"
    ):
        replace(mirror, rim_radius_mm=1.001 * reach)


def test_coefficients_are_in_mm_by_default():
    """z = 0.01 x^2 + 0.001 x^4, and x^2 / 50 + 0.001 x^4, at 2 mm."""
    assert float(EvenPolynomial((0.01, 0.001), 4.0).sag(2.0)) == pytest.approx(0.056, rel=1e-12)
    asphere = ConicAsphere(25.0, -1.0, 4.0, (0.001,))
    np.testing.assert_allclose(asphere.profile(2.0), (0.096, 0.112, 0.04 + 0.048), rtol=1e-12)


@pytest.mark.parametrize("slope_deg", [20.0, 45.0, 60.0])
def test_virtual_pinholes_of_a_cone_are_images_of_the_lens(slope_deg):
    """The lens at (0, -m) reflected at the plane z = x tan(beta) of one half of the meridian."""
    x, z = np.cos(np.radians(slope_deg)), np.sin(np.radians(slope_deg))
    lens = np.array([0.0, -180.0])
    image = 2 * (lens @ [x, z]) * np.array([x, z]) - lens
    radius, height = Cone(slope_deg, 20.0).pinhole_ring(180.0)
    assert (-radius, height) == pytest.approx(tuple(image), abs=1e-10)
