"""Sag table and best-fit sphere against high-precision and brute-force computations."""

from __future__ import annotations

import tomllib

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import minimize

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import format_table, sag_table, table_points
from omnimirror.manufacturing.surface_approximation import best_fit_sphere
from omnimirror.optics.mirrors import EvenPolynomial, Flat, SampledProfile
from tests.conftest import MIRRORS, sensor_of


def read(text):
    lines = text.splitlines()
    head = tomllib.loads("\n".join(line[2:] for line in lines if line.startswith("# ")))
    names, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    return head, dict(zip(names, np.array(rows, dtype=float).T, strict=True))


def test_table_is_accurate_to_its_digits(any_sensor):
    x = table_points(any_sensor, step_mm=1.5)
    head, columns = read(format_table(any_sensor, x, digits=7))
    exact = sag_table(any_sensor, x)
    for name, value in exact.items():
        digits = 10 if name in ("slope", "curvature_per_mm") else 4 if name.endswith("_um") else 7
        finite = np.isfinite(value)
        np.testing.assert_allclose(columns[name][finite], value[finite], atol=0.51 * 10.0**-digits)
        np.testing.assert_array_equal(columns[name][~finite], value[~finite])
    assert head["points"] == len(x)
    assert head["mirror"] == any_sensor.mirror.KIND
    assert head["omnimirror"] == om.__version__
    assert head["rim_radius_mm"] == any_sensor.mirror.rim_radius_mm == columns["x_mm"][-1]
    assert ("vertex_radius_mm" in head) != any_sensor.mirror.is_pointed


def test_header_contains_conic_parameters():
    head, _ = read(format_table(sensor_of("hyperboloid"), [0.0, 1.0]))
    assert head["vertex_radius_mm"] == pytest.approx((0.7407 / 1.698) * 0.7407 * 43.9)
    assert head["conic_constant"] == pytest.approx(-1 - (0.7407 / 1.698) ** 2)
    assert "conic_constant" not in read(format_table(sensor_of("equidistant"), [0.0]))[0]


def test_table_defines_the_same_sampled_mirror(tmp_path):
    sensor = sensor_of("equidistant")
    (tmp_path / "sag.csv").write_text(
        format_table(sensor, table_points(sensor, step_mm=0.5), digits=9)
    )
    reread = SampledProfile.from_csv(tmp_path / "sag.csv")
    x = np.linspace(0, sensor.mirror.rim_radius_mm, 333)
    np.testing.assert_allclose(reread.sag(x), sensor.mirror.sag(x), atol=1e-8)


def test_angular_rows_have_equal_field_angle_steps():
    sensor = sensor_of("hyperboloid")
    columns = sag_table(sensor, table_points(sensor, step_deg=15))
    np.testing.assert_allclose(columns["omega_deg"][:-1], np.arange(0, 136, 15), atol=1e-9)
    assert columns["x_mm"][-1] == sensor.mirror.rim_radius_mm


def test_rim_row_is_not_repeated():
    sensor = om.load_sensor("prototype-spherical")  # 44 mm
    assert len(table_points(sensor, step_mm=4.4)) == 11
    assert len(table_points(sensor, step_mm=4.0)) == 12
    assert table_points(sensor, step_mm=100.0).tolist() == [0.0, 44.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step_mm": 0.0}, "must be positive"),
        ({"step_deg": -1.0}, "must be positive"),
        ({"step_mm": 1e-9}, "use a larger value"),
        ({"step_mm": 1.0, "step_deg": 1.0}, "must not be given together"),
    ],
)
def test_invalid_step_is_rejected(options, message):
    with pytest.raises(InvalidParameter, match=message):
        table_points(sensor_of("sphere"), **options)


@pytest.mark.parametrize("digits", [-1, 16, 2.5])
def test_invalid_digits_are_rejected(digits):
    with pytest.raises(InvalidParameter, match="digits must"):
        format_table(sensor_of("sphere"), [0.0], digits)


# -- best-fit sphere
# ---------------------------------------------------------------------------------


def test_best_fit_sphere_of_a_sphere():
    mirror, _ = MIRRORS["sphere"]
    for merit in ("least-squares", "min-departure"):
        sphere = best_fit_sphere(mirror, merit)
        assert sphere.radius_mm == pytest.approx(mirror.radius_mm, abs=1e-6)
        assert sphere.centre_z_mm == pytest.approx(mirror.radius_mm, abs=1e-6)
        assert sphere.peak_to_valley_um < 1e-3


@pytest.mark.parametrize(
    "kind", ["hyperboloid", "ellipsoid", "cone", "equidistant", "conic-asphere"]
)
def test_best_fit_sphere_is_optimal(kind):
    """Compare with a simplex search in both unknowns on independent points."""
    mirror, _ = MIRRORS[kind]
    x = mirror.rim_radius_mm * np.linspace(0, 1, 4001)
    z = mirror.sag(x)

    def departure(p):
        return p[0] - np.hypot(x, p[1] - z)

    def rms(p):
        return float(np.sqrt(np.average(departure(p) ** 2, weights=x)))

    def worst(p):
        return float(np.abs(departure(p)).max())

    for merit, function in (("least-squares", rms), ("min-departure", worst)):
        sphere = best_fit_sphere(mirror, merit)
        options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 5000, "maxfev": 5000}
        other = minimize(function, [50.0, 50.0], method="Nelder-Mead", options=options)
        minimum = function([sphere.radius_mm, sphere.centre_z_mm])
        assert minimum <= other.fun * (1 + 1e-4)
        assert 1e-3 * sphere.rms_um == pytest.approx(
            rms([sphere.radius_mm, sphere.centre_z_mm]), rel=1e-3
        )
        assert 1e-3 * sphere.peak_to_valley_um == pytest.approx(
            np.ptp(departure([sphere.radius_mm, sphere.centre_z_mm])), rel=1e-6
        )


def test_departure_is_positive_for_material_removal():
    """A paraboloid is inside its osculating sphere at the vertex towards the rim."""
    mirror = EvenPolynomial((0.01,), 30.0)
    sphere = best_fit_sphere(mirror)
    x = np.array([5.0, 17.0, 30.0])
    departure_um = sphere.departure_um(mirror, x)
    distance = np.hypot(x, sphere.centre_z_mm - mirror.sag(x))
    assert np.all((departure_um > 0) == (distance < sphere.radius_mm))
    np.testing.assert_allclose(departure_um, 1e3 * (sphere.radius_mm - distance), atol=1e-9)


def test_slope_departure_is_the_angle_between_normals():
    mirror, _ = MIRRORS["hyperboloid"]
    sphere = best_fit_sphere(mirror)
    with mp.workdps(30):
        A, B, c = mp.mpf(mirror.a_mm), mp.mpf(mirror.b_mm), mp.mpf(sphere.centre_z_mm)
        angles = []
        for x in np.linspace(0, 1, 2001)[1:] * mirror.rim_radius_mm:
            x = mp.mpf(float(x))
            z, slope = -B + B / A * mp.sqrt(A**2 + x**2), B / A * x / mp.sqrt(A**2 + x**2)
            normal, radius = (-slope, mp.mpf(1)), (-x, c - z)
            cosine = (normal[0] * radius[0] + normal[1] * radius[1]) / (
                mp.hypot(*normal) * mp.hypot(*radius)
            )
            angles.append(float(mp.acos(cosine)))
    assert sphere.slope_mrad == pytest.approx(1e3 * max(angles), rel=1e-4)


def test_concave_mirror_mirrors_the_convex_one():
    convex, hollow = (best_fit_sphere(EvenPolynomial((a,), 10.0)) for a in (0.001, -0.001))
    assert (hollow.radius_mm, hollow.centre_z_mm) == (-convex.radius_mm, -convex.centre_z_mm)
    assert hollow.peak_to_valley_um == convex.peak_to_valley_um
    x = np.linspace(0, 10, 5)
    over = hollow.departure_um(EvenPolynomial((-0.001,), 10.0), x)
    np.testing.assert_allclose(
        over, -convex.departure_um(EvenPolynomial((0.001,), 10.0), x), atol=1e-9
    )
    assert best_fit_sphere(Flat(10.0)).radius_mm == np.inf


def test_nearly_flat_mirror_and_unknown_criterion_are_rejected():
    with pytest.raises(InvalidParameter, match="nearly flat"):
        best_fit_sphere(EvenPolynomial((-1e-12,), 10.0))
    with pytest.raises(InvalidParameter, match="min-departure"):
        best_fit_sphere(MIRRORS["sphere"][0], "best")
