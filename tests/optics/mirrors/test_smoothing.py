"""Measured profiles: smoothing by the noise, outlier detection, interpolation of exact points,
predicted uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, NotOneToOne
from omnimirror.optics.mirrors import SampledProfile, SlopeSpline, Sphere
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from omnimirror.optics.tracing.meridian import Meridian, first_non_increasing_x

R, M = 50.0, 43.905
SENSOR = replace(om.load_sensor("paper-spherical"), mirror=Sphere(R, M))
OMEGA = np.array([0.0, 15.0, 60.0, 100.0, 125.0, 134.0])
EXPECTED = om.evaluate(SENSOR, OMEGA)


def points(step):
    x = np.append(np.arange(0.0, 43.9, step), 44.0)
    return x, R - np.sqrt(R * R - x * x)


def sensor_of(x, z, **options):
    return replace(SENSOR, mirror=SampledProfile(tuple(x), tuple(z), M, **options))


def noise(n, seed):
    return np.random.default_rng(seed).standard_normal(n)


def test_exact_points_interpolated():
    """Same result as without smoothing: slope and curvature of a spline through all of them."""
    x, z = points(0.05)
    mirror = SampledProfile(tuple(x), tuple(z), M)
    assert mirror.fit.uncertainty_mm == 0
    assert mirror.outliers == ()
    at = np.linspace(0, 40, 301)
    np.testing.assert_allclose(mirror.slope(at), at / np.sqrt(R * R - at * at), atol=1e-11)
    np.testing.assert_allclose(mirror.curvature(at), R**2 / (R * R - at * at) ** 1.5, rtol=2e-8)


@pytest.mark.parametrize("step", [0.02, 0.5, 1.0, 4.0, 8.0])
def test_exact_points_not_smoothed(step):
    x, z = points(step)
    mirror = SampledProfile(tuple(x), tuple(z))
    assert mirror.fit.uncertainty_mm == 0
    np.testing.assert_allclose(mirror.sag(x), z, atol=1e-12)


@pytest.mark.parametrize(
    ("step", "scatter_nm", "resolution", "blur_px", "h_px"),
    [(0.1, 10.0, 3e-3, 0.01, 0.01), (0.1, 50.0, 5e-3, 0.03, 0.03), (0.02, 100.0, 1e-2, 0.03, 0.03)],
)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_estimated_and_smoothed(step, scatter_nm, resolution, blur_px, h_px, seed):
    """Without smoothing, 10 nm at 0.1 mm spacing caused 45 % of the resolution and 1.9 px of blur."""
    x, z = points(step)
    sensor = sensor_of(x, z + scatter_nm * 1e-6 * noise(len(x), seed))
    assert sensor.mirror.fit.uncertainty_mm * 1e6 == pytest.approx(scatter_nm, rel=0.15)
    evaluation = om.evaluate(sensor, OMEGA)
    np.testing.assert_allclose(
        evaluation.dh_domega_px_per_deg, EXPECTED.dh_domega_px_per_deg, rtol=resolution
    )
    np.testing.assert_allclose(evaluation.blur_t_px, EXPECTED.blur_t_px, atol=blur_px)
    np.testing.assert_allclose(evaluation.h_px, EXPECTED.h_px, atol=h_px)


def test_rounded_heights_noise_estimate():
    """Z rounded to 1 um at 0.5 mm spacing: 56 % of the resolution without smoothing."""
    x, z = points(0.5)
    sensor = sensor_of(x, np.round(z, 3))
    assert sensor.mirror.fit.uncertainty_mm == pytest.approx(1e-3 / np.sqrt(12), rel=0.25)
    evaluation = om.evaluate(sensor, OMEGA)
    np.testing.assert_allclose(
        evaluation.dh_domega_px_per_deg, EXPECTED.dh_domega_px_per_deg, rtol=0.02
    )


@pytest.mark.parametrize("error_nm", [5.0, 1000.0, -300.0])
@pytest.mark.parametrize("index", [0, 3, 700, 2190])
def test_outlier_among_exact_points_rejected(error_nm, index):
    """5 nm at 20 um spacing caused resolutions of -1865 to 3110 px/deg without rejection."""
    x, z = points(0.02)
    z[index] += error_nm * 1e-6
    sensor = sensor_of(x, z)
    assert sensor.mirror.outliers == (index,)
    evaluation = om.evaluate(sensor, OMEGA)
    np.testing.assert_allclose(
        evaluation.dh_domega_px_per_deg, EXPECTED.dh_domega_px_per_deg, rtol=1e-6
    )


def test_outliers_among_noisy_points_rejected():
    x, z = points(0.1)
    z = z + 1e-5 * noise(len(x), 4)
    for i, deviation in ((20, 2e-4), (200, -1e-3), (201, -1e-3), (430, 5e-4)):
        z[i] += deviation
    assert sensor_of(x, z).mirror.outliers == (20, 200, 201, 430)


def test_specified_uncertainty_used_or_rejected():
    x, z = points(0.1)
    noisy = z + 5e-5 * noise(len(x), 5)
    assert SampledProfile(
        tuple(x), tuple(noisy), M, uncertainty_um=0.05
    ).fit.uncertainty_mm == pytest.approx(5e-5, 0.1)
    with pytest.raises(InvalidParameter, match=r"scatter by 0.0\d+ um .* got 0.001"):
        SampledProfile(tuple(x), tuple(noisy), M, uncertainty_um=0.001)
    exact = SampledProfile(tuple(x), tuple(noisy), M, uncertainty_um=0.0)
    np.testing.assert_allclose(exact.sag(x[:-1]), (noisy - noisy[0])[:-1], atol=1e-12)
    with pytest.raises(
        NotOneToOne, match=r"must be less than .*, where the field angle .* stops increasing"
    ):
        om.evaluate(replace(SENSOR, mirror=exact))


def test_standard_deviations_match_repeated_measurements():
    """Compared with repeated simulated measurements: the error of each column, including that of
    smoothing."""
    x, z = points(0.25)
    columns = (
        "h_px",
        "dh_domega_px_per_deg",
        "blur_t_px",
        "blur_s_px",
        "viewpoint_z_mm",
        "floored_area_deg2",
    )
    omega = OMEGA[1:]
    runs, sigmas = [], []
    for seed in range(24):
        result = om.evaluate(sensor_of(x, z + 2e-4 * noise(len(x), seed)), omega)
        runs.append(result)
        if seed < 8:
            sigmas.append(result.standard_deviations())
    true = om.evaluate(SENSOR, omega)
    for name in columns:
        errors = np.sqrt(
            np.mean([(getattr(r, name) - getattr(true, name)) ** 2 for r in runs], axis=0)
        )
        ratio = errors / np.median([s[name] for s in sigmas], axis=0)
        assert (ratio > 0.6).all(), name
        assert (ratio < 2.5).all(), name
        assert 0.8 < np.median(ratio) < 1.5, name


def test_nominal_mirror_has_no_standard_deviations(tmp_path):
    x, z = points(0.1)
    for sensor in (SENSOR, sensor_of(x, z)):
        result = om.evaluate(sensor, OMEGA)
        assert result.standard_deviations() == {}
        result.to_csv(tmp_path / "a.csv", deviations=True)
        assert "_sd" not in (tmp_path / "a.csv").read_text()


def test_files_contain_standard_deviations(tmp_path):
    import json

    x, z = points(0.1)
    result = om.evaluate(sensor_of(x, z + 1e-5 * noise(len(x), 6)), OMEGA)
    sigmas = result.standard_deviations()
    result.to_json(tmp_path / "a.json")
    result.to_csv(tmp_path / "a.csv", deviations=True)
    report = json.loads((tmp_path / "a.json").read_text())["standard_deviations"]
    np.testing.assert_array_equal(report["blur_t_px"], sigmas["blur_t_px"])
    table = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["blur_t_px_sd"], sigmas["blur_t_px"])
    assert sigmas["omega_deg"].max() == 0
    assert 0 < sigmas["dh_domega_px_per_deg"].max() < 0.01


@pytest.mark.parametrize("m", [180.0, np.inf])
def test_ripple_between_nodes_detected(m):
    """Its steepest points are between the 1025 nodes, where the mapping appeared one-to-one."""
    x = np.linspace(0.0, 41.0, 4097)
    node = 0.5 * 41.0  # a node; points in between are raised
    bump = 2e-6 * np.exp(-(((x - node - 0.5 * 41 / 1024) / 0.008) ** 2))
    mirror = SampledProfile(tuple(x), tuple(x**2 / 100 + bump), uncertainty_um=0.0)
    at = np.linspace(node - 0.05, node + 0.05, 20001)
    rays_curvature = mirror.curvature(at)
    assert rays_curvature.min() < 0 < mirror.curvature(np.linspace(0, 41, 1025)).min()
    position = first_non_increasing_x(mirror, m)
    assert position == pytest.approx(node + 0.02, abs=0.03)
    with pytest.raises(NotOneToOne, match=r"less than 20\.5"):
        Meridian(mirror, m).omega_max  # noqa: B018


@pytest.mark.parametrize("m", [180.0, np.inf])
def test_monotonicity_proof_matches_fine_scan(m):
    rng = np.random.default_rng(7)
    x = np.linspace(0, 10, 21)
    for _ in range(30):
        mirror = SampledProfile(
            tuple(x), tuple(x**2 / 60 + 2e-4 * rng.standard_normal(21)), uncertainty_um=0.0
        )
        at = np.linspace(0, 10, 20001)
        z, slope, curvature = mirror.profile(at)
        growth = (
            curvature
            if np.isinf(m)
            else 2 * curvature * ((m + z) ** 2 + at**2) + (m + z - at * slope) * (1 + slope**2)
        )
        falls = growth < 0
        position = first_non_increasing_x(mirror, m)
        assert (position is None) == (not falls.any())


def test_monotonicity_proof_only_for_polynomials():
    assert first_non_increasing_x(Sphere(R, M), 180.0) is None
    assert first_non_increasing_x(SlopeSpline((0.0, 0.1, 0.2, 0.3, 0.4, 0.5), 10.0), 180.0) is None


def test_uncertainty_in_sensor_file():
    x, z = points(0.5)
    sensor = sensor_of(x, z + 1e-3 * noise(len(x), 8), uncertainty_um=1.0)
    parsed = parse_sensor(format_sensor(sensor))
    assert parsed == sensor
    assert "uncertainty_um" not in format_sensor(sensor_of(x, z))
