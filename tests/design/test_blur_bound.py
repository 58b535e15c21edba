"""Lower bound of blur: no mirror is below it, one reaches it, and both agree by different formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.design._design_problem import DesignProblem
from omnimirror.design.optimiser import optimise
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Orthographic, Perspective
from omnimirror.optics.mirrors import Conformal, Equiareal, Equidistant, SlopeSpline, Sphere
from tests.everyday import few

M, THETA = 43.9, 12.0


def sensor_with(mirror, rim_distance, focal_length_mm=11.6, f_number=4.0):
    lens = Perspective(focal_length_mm, f_number, 210.0)
    m = rim_distance - float(mirror.sag(mirror.rim_radius_mm))
    return om.Sensor(mirror, lens, Imager(1024, 1024, 5.2), mirror_distance_mm=m, name="mirror")


def paper(omega_max=135.0, **lens):
    slope = np.tan(np.radians((omega_max - THETA) / 2))
    return sensor_with(
        Sphere(M * np.sqrt(1 + 1 / slope**2), M), M / np.tan(np.radians(THETA)), **lens
    )


def worst(sensor, distance=np.inf, **options):
    """Return the largest single blur (deg) over the field."""
    result = om.evaluate(
        sensor, np.linspace(*sensor.field_deg, 1501), object_distance_mm=distance, **options
    )
    return max(np.abs(result.blur_t_deg).max(), np.abs(result.blur_s_deg).max())


def sensor_at_bound(bound, sensor):
    """Return the sensor with the mirror and focus of the bound."""
    u = np.linspace(0.0, 1.0, 401)
    slopes = make_interp_spline(bound.x_mm, bound.slope, k=5)(u * bound.x_mm[-1])
    slopes[0] = 0.0
    mirror = SlopeSpline(tuple(slopes), float(bound.x_mm[-1]))
    if sensor.lens.TELECENTRIC:
        return replace(sensor, mirror=mirror, lens=sensor.lens.focused_at(bound.focus_mm))
    rim = sensor.mirror_distance_mm + float(sensor.mirror.sag(sensor.mirror.rim_radius_mm))
    m = rim - float(mirror.sag(mirror.rim_radius_mm))
    return replace(
        sensor, mirror=mirror, mirror_distance_mm=m, lens=sensor.lens.focused_at(bound.focus_mm)
    )


def blur_of(sensor, omega, distance):
    """Return tangential and sagittal blur (2, n), deg, at the object distance."""
    evaluation = om.evaluate(sensor, omega, object_distance_mm=distance)
    return np.abs([evaluation.blur_t_deg, evaluation.blur_s_deg])


def test_blur_bound_of_paper_case():
    """Extremal by shooting in another program: t = 0.5769094 deg, in focus at 221.30 mm."""
    bound = om.blur_bound(paper(), mode="paper", image_radius_px=500.0)
    assert bound.blur_deg == pytest.approx(0.5769094, abs=2e-7)
    assert bound.focus_mm == pytest.approx(221.300, abs=1e-3)
    np.testing.assert_allclose(bound.t_deg, -bound.blur_deg, rtol=1e-9)  # over the whole field
    assert bound.s_deg[0] == pytest.approx(-bound.blur_deg, rel=1e-6)
    assert bound.s_deg[-1] == pytest.approx(bound.blur_deg, rel=1e-9)
    assert bound.is_reached


@pytest.mark.parametrize("distance", [np.inf, 250.0, 60.0])
@pytest.mark.parametrize("omega_max", few([80.0, 110.0, 135.0, 140.0], 110.0))
def test_blur_bound_is_attained_by_a_mirror(omega_max, distance):
    """Its blur by the evaluation, which traces the surface and is independent of the formulas of
    the bound."""
    sensor = paper(omega_max)
    bound = om.blur_bound(sensor, distance)
    attained = sensor_at_bound(bound, sensor)
    assert attained.field_deg == pytest.approx((0.0, omega_max), abs=1e-5)
    if bound.is_reached:
        blurs_deg = blur_of(attained, np.linspace(0, omega_max, 1001), distance)
        assert blurs_deg.max() == pytest.approx(bound.blur_deg, rel=5e-4)
        assert worst(attained, distance) == pytest.approx(bound.blur_deg, rel=5e-4)
    tangential, _ = blur_of(attained, np.linspace(0.5, omega_max, 300), distance)
    np.testing.assert_allclose(tangential[:-30], bound.blur_deg, rtol=2e-5)
    np.testing.assert_allclose(
        tangential, bound.blur_deg, rtol=5e-4
    )  # except at the end of the spline


def test_blur_bound_is_attained_with_telecentric_lens():
    lens = Orthographic(0.0592, 4.0, 22.0)
    sensor = om.Sensor(
        Sphere(M / np.sin(np.radians(60)), M), lens, Imager(1024, 1024, 5.2), name="mirror"
    )
    for distance in (np.inf, 200.0):
        bound = om.blur_bound(sensor, distance)
        assert bound.is_reached
        attained = sensor_at_bound(bound, sensor)
        blurs_deg = blur_of(attained, np.linspace(*attained.field_deg, 1001), distance)
        assert blurs_deg.max() == pytest.approx(bound.blur_deg, rel=2e-5)


@pytest.mark.parametrize("seed", few(range(20), *range(6)))
def test_no_mirror_has_less_blur_than_bound(seed):
    """Mirrors of all kinds at their best focus, and perturbations of the mirror that reaches the
    bound."""
    rng, distance = np.random.default_rng(seed), (np.inf, 80.0, 15.0)[seed % 3]
    omega_max, theta, F = rng.uniform(60, 150), rng.uniform(4, 20), rng.uniform(2, 8)
    kind = [Equidistant, Equiareal, "sphere", Conformal, "waves"][seed % 5]
    far = M / np.tan(np.radians(theta))
    slope = np.tan(np.radians((omega_max - theta) / 2))
    mirror = (
        Sphere(M * np.sqrt(1 + 1 / slope**2), M)
        if isinstance(kind, str)
        else kind(omega_max, theta, M)
    )
    sensor = sensor_with(mirror, far, f_number=F)
    if kind == "waves":
        sensor = wavy_sensor(sensor, rng)
    bound = om.blur_bound(sensor, distance)
    best = om.best_focus(sensor, "worst_blur_deg", object_distance_mm=distance)
    assert best.value >= bound.blur_deg * (1 - 1e-9)
    focused = replace(sensor, lens=sensor.lens.focused_at(bound.focus_mm))
    assert worst(focused, distance) >= bound.blur_deg * (1 - 1e-9)


def wavy_sensor(sensor, rng):
    """Return the mirror that reaches the bound with slopes perturbed by a few 0.001 between axis
    and rim."""
    optimum = sensor_at_bound(om.blur_bound(sensor), sensor)
    slopes = np.array(optimum.mirror.slopes)
    u = np.linspace(0, 1, slopes.size)
    waves = np.cos(np.pi * np.outer(u, np.arange(1, 5))) @ rng.standard_normal(4)
    mirror = SlopeSpline(tuple(slopes * (1 + 2e-3 * waves * (1 - u**2))), M)
    rim = sensor.mirror_distance_mm + float(sensor.mirror.sag(M))
    return replace(optimum, mirror=mirror, mirror_distance_mm=rim - float(mirror.sag(M)))


def test_blur_bound_decreases_with_inner_field_limit():
    sensor = paper()
    blurs = [om.blur_bound(sensor, omega_min_deg=low).blur_deg for low in (0.0, 20.0, 60.0, 100.0)]
    assert np.all(np.diff(blurs) < 0)


def test_optimised_blur_approaches_bound_from_above():
    problem = DesignProblem(family="even-polynomial", terms=6, mode="paper", image_radius_px=500.0)
    result = optimise(problem, "worst_blur_deg", starts=1)
    assert 1 - 1e-9 < result.value / result.bound.blur_deg < 1.01


def test_blur_bound_of_narrow_field_is_zero():
    """Inwards from the rim, a tangentially sharp mirror reaches 120 deg before it reaches the axis."""
    bounds_deg = [
        om.blur_bound(paper(), omega_min_deg=omega).blur_deg for omega in (80.0, 100.0, 120.0)
    ]
    assert bounds_deg[0] > bounds_deg[1] > bounds_deg[2] == 0.0


def test_blur_bound_rejects_unsupported_sensors():
    assert om.blur_bound(paper(), 1e-6).blur_deg == 0.0  # no bound for objects on the mirror
    with pytest.raises(
        InvalidParameter, match="object_distance_mm must be at least 1e-09 mm, or inf; got 0"
    ):
        om.blur_bound(paper(), 0.0)
    with pytest.raises(
        InvalidParameter, match="omega_min_deg must be in the field, 0 to 135 deg; got 140"
    ):
        om.blur_bound(paper(), omega_min_deg=140.0)
    lens = Perspective(11.6, 4.0, 210.0, k1=-0.1)
    with pytest.raises(InvalidParameter, match="must be free of distortion"):
        om.blur_bound(replace(paper(), lens=lens))
    with pytest.raises(InvalidParameter, match="a sensor without secondary mirror"):
        om.blur_bound(om.load_sensor("folded-spherical"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode": "Paper"}, "mode must be one of exact, paper; got 'Paper'"),
        ({"image_radius_px": -5.0}, "image_radius_px must be greater than 0 px .*; got -5"),
        ({"image_radius_px": np.nan}, "image_radius_px must be a number or None; got nan"),
    ],
)
def test_blur_bound_rejects_unknown_modes_and_invalid_radii(options, message):
    with pytest.raises(InvalidParameter, match=message):
        om.blur_bound(paper(), **options)
