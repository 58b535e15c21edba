"""Prescribed-mapping mirrors: the evaluated mapping equals the prescribed one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Orthographic, Perspective
from omnimirror.optics.mirrors import (
    Conformal,
    CylinderMapping,
    Equiangular,
    Equiareal,
    Equidistant,
    GroundPlane,
    Paraboloid,
    Rectifying,
    Sphere,
    TabulatedMapping,
    UnitAspect,
)
from omnimirror.optics.mirrors.prescribed_mapping import MappingMirror, PerspectiveMeridian
from omnimirror.optics.sensor_files import format_sensor, parse_sensor

M = 43.9


def sensor_of(mirror: MappingMirror) -> om.Sensor:
    imager = Imager(1024, 1024, 5.2)
    if mirror.theta_max_deg == 0:
        return om.Sensor(mirror, Orthographic(0.0592, 4.0, 22.0), imager)
    return om.Sensor(
        mirror, Perspective(11.6, 4.0, 210.0), imager, mirror_distance_mm=mirror.design_distance
    )


def omega_and_rays(
    mirror: MappingMirror, low: float = 1e-3
) -> tuple[om.Sensor, np.ndarray, np.ndarray, np.ndarray]:
    """Return field angles (radians), relative image heights, and mirror points, from om.evaluate."""
    sensor = sensor_of(mirror)
    start, end = sensor.field_deg
    result = om.evaluate(sensor, np.linspace(start + low * (end - start), end, 200))
    return (
        np.radians(result.omega_deg),
        result.h_px / sensor.rim_radius_px,
        result.x_mm,
        result.z_mm,
    )


# 40-digit values of m/M for 135 deg at 12 deg; the far plane to 75 deg
DISTANCES = [
    (Equidistant, 135.0, 3.92426760151),
    (Equiangular, 135.0, 3.91625328435),
    (Conformal, 135.0, 3.55007544592),
    (UnitAspect, 135.0, 3.55612053404),
    (Equiareal, 135.0, 4.07235176766),
    (Rectifying, 75.0, 4.23651210948),
]


@pytest.mark.parametrize(("cls", "omega", "m"), DISTANCES, ids=lambda v: getattr(v, "KIND", ""))
def test_lens_distance_matches_high_precision(cls, omega, m):
    assert cls(omega, 12.0, 1.0).design_distance == pytest.approx(m, abs=6e-12)
    assert cls(omega, 12.0, M).design_distance == pytest.approx(m * M, abs=6e-12 * M)


MAPPINGS = {
    Equidistant: lambda o: o,
    Equiareal: lambda o: np.sin(o / 2),
    UnitAspect: lambda o: np.tan(o / 2),
    Rectifying: np.tan,
}
"""Image heights up to scale, for any lens."""


@pytest.mark.parametrize("theta", [12.0, 35.0, 0.5, 0.0])
@pytest.mark.parametrize("cls", MAPPINGS, ids=lambda c: c.KIND)
def test_evaluation_matches_prescribed_mapping(cls, theta):
    omega, tau, _, _ = omega_and_rays(cls(75.0 if cls is Rectifying else 135.0, theta, M))
    height = MAPPINGS[cls]
    np.testing.assert_allclose(tau, height(omega) / height(omega[-1]), rtol=1e-9)


@pytest.mark.parametrize("theta", [12.0, 35.0])
@pytest.mark.parametrize(
    ("cls", "viewing"),
    [(Equiangular, lambda o: o), (Conformal, lambda o: 2 * np.arctan(np.tan(o / 2)))],
    ids=["equiangular", "conformal"],
)
def test_mappings_of_the_viewing_angle(cls, viewing, theta):
    omega, tau, _, _ = omega_and_rays(cls(135.0, theta, M))
    Theta = np.radians(theta)
    angle = np.arctan(tau * np.tan(Theta))
    if cls is Equiangular:
        np.testing.assert_allclose(angle / Theta, omega / omega[-1], rtol=1e-9)
    else:
        np.testing.assert_allclose(
            np.tan(angle / 2) / np.tan(Theta / 2),
            np.tan(omega / 2) / np.tan(omega[-1] / 2),
            rtol=1e-9,
        )


@pytest.mark.parametrize("theta", [12.0, 0.0])
@pytest.mark.parametrize(
    ("omega_max", "H"), [(70.0, 60.0), (70.0, 600.0), (70.0, 1e6), (89.9, 800.0)]
)
def test_ground_plane_mapping_to_scale(omega_max, H, theta):
    """True intersections of the chief rays with the plane: radii are proportional to image heights."""
    omega, tau, x, z = omega_and_rays(GroundPlane(omega_max, theta, M, plane_distance_mm=H))
    radius = x + (z + H) * np.tan(omega)
    np.testing.assert_allclose(radius / radius[-1], tau, rtol=1e-9)
    assert np.degrees(omega[-1]) == pytest.approx(omega_max, abs=1e-9)


@pytest.mark.parametrize("theta", [12.0, 0.0])
@pytest.mark.parametrize(
    ("low", "high", "R"),
    [(50.0, 115.0, 60.0), (50.0, 115.0, 800.0), (50.0, 115.0, 1e6), (2.0, 150.0, 800.0)],
)
def test_cylinder_mapping_to_scale(low, high, R, theta):
    mirror = CylinderMapping(high, theta, M, omega_min_deg=low, cylinder_radius_mm=R)
    omega, tau, x, z = omega_and_rays(mirror)
    height = z - (R - x) / np.tan(omega)
    centre = -R / np.tan(np.radians(low))
    np.testing.assert_allclose((height - centre) / (height[-1] - centre), tau, rtol=1e-9)
    assert mirror.is_pointed
    assert sensor_of(mirror).field_deg == pytest.approx((low, high), abs=1e-9)


@pytest.mark.parametrize(
    ("mirror", "max_terms"),
    [
        (GroundPlane(89.9, 12.0, M, plane_distance_mm=800.0), 65),
        (GroundPlane(89.99, 0.0, M, plane_distance_mm=800.0), 65),
        (CylinderMapping(165.0, 12.0, M, omega_min_deg=1.0, cylinder_radius_mm=800.0), 129),
    ],
    ids=["ground plane", "far ground plane", "cylinder"],
)
def test_concentrated_field_needs_few_terms(mirror, max_terms):
    """A design evaluates hundreds of mirrors: 513 terms, and the equations of 512 nodes, took 1
    minute."""
    size = np.abs(mirror._solution.series.coef)
    assert len(size) <= max_terms
    assert size[-4:].max() <= 1e-15 * size.max()


@pytest.mark.parametrize("H", [60.0, 600.0])
def test_plane_points_project_to_scale(H):
    """Forward projection by the true reflection of each point, independent of mappings."""
    mirror = GroundPlane(70.0, 12.0, M, plane_distance_mm=H)
    sensor = sensor_of(mirror)
    rim_z = float(mirror.sag(M))
    radii = np.linspace(0.1, 0.999, 9) * (M + (H + rim_z) * np.tan(np.radians(70)))
    world = np.stack([radii, np.zeros(9), np.full(9, -H)], axis=-1) @ sensor.mount.rotation().T
    pixels = sensor.project(world).pixels
    h = np.hypot(*(pixels - 511.5).T)
    np.testing.assert_allclose(h / radii, h[0] / radii[0], rtol=1e-9)


def test_closed_forms_match_quadrature():
    for mirror in (
        Equiangular(130.0, 14.0, 1.0),
        Equiangular(130.0, 14.0, 1.0, 20.0),
        UnitAspect(135.0, 12.0, 1.0),
    ):
        quadrature = PerspectiveMeridian.solve(mirror._omega, mirror._domega, mirror._theta_max)
        assert mirror.design_distance == pytest.approx(quadrature.distance, rel=1e-12)
        x = np.linspace(0, 1, 50)
        for closed_form, expected in zip(mirror.profile(x), quadrature.profile(x), strict=True):
            np.testing.assert_allclose(closed_form, expected, rtol=1e-12, atol=1e-15)


def test_orthographic_mappings_are_conics():
    x = np.linspace(0, M, 60)
    half = np.radians(135) / 2
    sphere, paraboloid = Sphere(M / np.sin(half), M), Paraboloid(M / np.tan(half), M)
    for mirror, conic in (
        (Equiareal(135.0, 0.0, M), sphere),
        (UnitAspect(135.0, 0.0, M), paraboloid),
        (Conformal(135.0, 0.0, M), paraboloid),
    ):
        for closed_form, expected in zip(mirror.profile(x), conic.profile(x), strict=True):
            np.testing.assert_allclose(closed_form, expected, rtol=1e-12, atol=1e-15)
    k = np.radians(135) / M  # Eq. 22 with the corrected sign
    np.testing.assert_allclose(
        Equidistant(135.0, 0.0, M).sag(x), -2 / k * np.log(np.cos(k * x / 2)), rtol=1e-12
    )
    flat = np.tan(np.radians(75)) / M  # quadrature of the law of reflection
    nodes, weights = np.polynomial.legendre.leggauss(60)
    slope = np.tan(np.arctan(flat * x[:, None] * (nodes + 1) / 2) / 2)
    np.testing.assert_allclose(Rectifying(75.0, 0.0, M).sag(x), slope @ weights * x / 2, rtol=1e-12)


def test_finite_distances_converge_to_distant():
    x = np.linspace(0, M, 30)
    near, far = GroundPlane(75.0, 12.0, M, 1e7), Rectifying(75.0, 12.0, M)
    np.testing.assert_allclose(near.sag(x), far.sag(x), atol=1e-4)
    assert near.design_distance == pytest.approx(far.design_distance, rel=1e-6)


@pytest.mark.parametrize("theta", [12.0, 0.0])
@pytest.mark.parametrize("cls", [Equidistant, Equiangular, Equiareal])
def test_central_field_gap_yields_pointed_mirror(cls, theta):
    """The field starts at 30 deg, obscured below by the camera: the mapping distributes it over the
    whole image."""
    mirror = cls(135.0, theta, M, omega_min_deg=30.0)
    omega, tau, _, _ = omega_and_rays(mirror)
    low = np.radians(30)
    if cls is Equiareal:
        expected = np.sqrt((np.cos(low) - np.cos(omega)) / (np.cos(low) - np.cos(omega[-1])))
    elif cls is Equidistant or theta == 0:
        expected = (omega - low) / (omega[-1] - low)
    else:
        expected = np.tan((omega - low) / (omega[-1] - low) * np.radians(theta)) / np.tan(
            np.radians(theta)
        )
    np.testing.assert_allclose(tau, expected, rtol=1e-9)
    assert mirror.is_pointed
    assert np.isfinite(om.best_focus(sensor_of(mirror)).value)


@given(
    omega=st.floats(20, 160),
    theta=st.floats(1, 40),
    cls=st.sampled_from([Equidistant, Equiangular, Conformal, UnitAspect, Equiareal]),
)
def test_reachable_fields_are_attained(omega, theta, cls):
    if not theta + 2 < omega < 178 - theta:
        return
    mirror = cls(omega, theta, M)
    meridian = sensor_of(mirror).meridian
    assert np.degrees(meridian.omega_max) == pytest.approx(omega, rel=1e-10)
    assert np.degrees(meridian.theta_max) == pytest.approx(theta, rel=1e-10)
    rays = meridian.trace(np.linspace(0.01, 1, 40) * M)
    mapped = mirror.mapping(rays.x / rays.w / np.tan(np.radians(theta)))[0]
    np.testing.assert_allclose(mapped, rays.omega, rtol=1e-10)


# -- user-defined mapping --------------------------------------------------------------------------


def test_mapping_function_defines_mirror():
    def height(omega):
        return omega - 0.12 * np.sin(omega)

    for theta in (12.0, 0.0):
        mirror = TabulatedMapping.from_function(height, 140.0, theta, M)
        omega, tau, _, _ = omega_and_rays(mirror)
        np.testing.assert_allclose(tau, height(omega) / height(omega[-1]), rtol=1e-9)
        assert parse_sensor(format_sensor(sensor_of(mirror))).mirror == mirror


def test_mapping_file_relative_to_sensor_file(tmp_path):
    omega = np.linspace(20, 120, 51)
    rows = "\n".join(f"{o},{3 * (o - 20)}" for o in omega)
    (tmp_path / "mapping.csv").write_text(f"omega_deg,height\n{rows}\n")
    expected = Equidistant(120.0, 10.0, M, omega_min_deg=20.0)
    sensor = om.Sensor(
        expected,
        Perspective(11.6, 4.0, 210.0),
        Imager(1024, 1024, 5.2),
        mirror_distance_mm=expected.design_distance,
    )
    text = format_sensor(sensor).replace(
        '"equidistant"', '"tabulated-mapping"\nmapping_csv = "mapping.csv"'
    )
    text = text.replace("omega_max_deg = 120.0\n", "").replace("omega_min_deg = 20.0\n", "")
    (tmp_path / "s.toml").write_text(text)
    mirror = om.load_sensor(tmp_path / "s.toml").mirror
    assert mirror.KIND == "tabulated-mapping"
    np.testing.assert_allclose(
        mirror.sag(np.linspace(0, M, 9)), expected.sag(np.linspace(0, M, 9)), rtol=1e-11, atol=1e-12
    )
    (tmp_path / "s.toml").write_text(text.replace("mapping_csv", "height = [0.0]\nmapping_csv"))
    with pytest.raises(OmnimirrorError, match="mapping_csv must not be combined with height"):
        om.load_sensor(tmp_path / "s.toml")
    (tmp_path / "s.toml").write_text(text.replace("mapping.csv", "mapin.csv"))
    with pytest.raises(OmnimirrorError, match=r"cannot read the mapping .*mapin\.csv"):
        om.load_sensor(tmp_path / "s.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"height": (1.0, 2, 3, 4, 5, 6)}, "height must start with 0, at the image centre; got 1"),
        ({"height": (0.0, 1, 2, 2, 5, 6)}, r"height must increase; got 2 and 2 in rows 3 and 4"),
        (
            {"omega_deg": (0.0, 10, 5, 20, 30, 40)},
            r"omega_deg must increase; got 10 and 5 in rows 2 and 3",
        ),
        ({"height": (0.0, 1.0)}, "equally many values; got 6 and 2"),
        ({"omega_deg": (0.0, 1.0), "height": (0.0, 1.0)}, "at least 6"),
        (
            {"theta_max_deg": 50.0},
            "omega_max_deg must be 50 to 130 deg with theta_max_deg = 50.* got 40",
        ),
    ],
)
def test_invalid_mapping_tables_rejected(change, message):
    good = {
        "omega_deg": (0.0, 10, 20, 25, 30, 40),
        "height": (0.0, 1, 2, 3, 4, 5),
        "theta_max_deg": 12.0,
    }
    with pytest.raises(InvalidParameter, match=message):
        TabulatedMapping(**{**good, **change}, rim_radius_mm=M)


def test_invalid_mapping_functions_rejected():
    with pytest.raises(InvalidParameter, match="height must increase"):
        TabulatedMapping.from_function(np.sin, 120.0, 12.0, M)
    with pytest.raises(InvalidParameter, match="must be smooth"):
        TabulatedMapping.from_function(lambda o: o + np.maximum(o - 1, 0), 120.0, 12.0, M)
    with pytest.raises(InvalidParameter, match="must return finite heights"):
        TabulatedMapping.from_function(lambda o: np.where(o > 1, np.nan, o), 120.0, 12.0, M)


# -- infeasible mappings ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Equiareal(170.0, 12.0, M),
            "omega_max_deg must be 12 to 168 deg .* got 170",
        ),
        (
            lambda: Rectifying(95.0, 12.0, M),
            "omega_max_deg must be less than 90 deg for the rectifying mapping; got 95",
        ),
        (
            lambda: GroundPlane(90.0, 12.0, M, 500.0),
            "omega_max_deg must be less than .* for the ground-plane mapping; got 90",
        ),
        (
            lambda: Equidistant(60.0, 12.0, M, 70.0),
            "omega_min_deg must be less than omega_max_deg = 60; got 70",
        ),
        (
            lambda: CylinderMapping(110.0, 12.0, M, 50.0, 40.0),
            "cylinder_radius_mm must be greater than rim_radius_mm = .* got 40",
        ),
    ],
)
def test_unreachable_fields_rejected(make, message):
    with pytest.raises(InvalidParameter, match=message):
        make()


@pytest.mark.parametrize("mirror", [Equidistant(120.0, 12.0, 44.0), Equiareal(120.0, 12.0, 44.0)])
def test_profile_evaluates_mapping_once(mirror):
    """A table yields an initial value, derivatives refine it to rounding: the reference is the
    mapping itself."""
    calls = []
    smooth = mirror._meridian
    mirror_with_count = PerspectiveMeridian(
        lambda theta: calls.append("angle_and_height") or smooth.angle_and_height(theta),
        lambda theta: calls.append("field_and_height") or smooth.field_and_height(theta),
        smooth.theta_max,
    )
    x = np.sort(np.random.default_rng(4).uniform(0, 1, 500))
    mirror_with_count.profile(x)  # with its table
    calls.clear()
    z, slope, _ = mirror_with_count.profile(x)
    assert calls == ["field_and_height"]
    theta = np.arctan2(x, mirror_with_count.distance + z)
    assert np.abs(np.arctan(slope) - (smooth.angle_and_height(theta)[0] - theta) / 2).max() < 1e-14
