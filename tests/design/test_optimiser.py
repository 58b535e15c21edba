"""Optimised mirrors against published targets, verified independently of the optimiser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.design._design_problem import DesignProblem, DesignSpace
from omnimirror.design.limits import Limit
from omnimirror.design.merits import DESIGN_MERITS, merit_named
from omnimirror.design.optimiser import Objective, optimise, start
from omnimirror.optics.housing import CameraBody, Housing
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from tests.design.answers import evaluated_merits
from tests.everyday import few

PAPER = DesignProblem(mode="paper", image_radius_px=500.0)
SPHERE = om.load_sensor("paper-spherical")
AREAS = ("worst_floored_area_deg2", "mean_floored_area_deg2")


@pytest.mark.parametrize(
    ("merit", "target", "sphere"),
    [
        pytest.param("worst_floored_area_deg2", 0.286, 0.704, marks=pytest.mark.full),
        ("worst_blur_deg", 0.5772, 0.596),
        pytest.param("worst_blur_rss_deg", 0.6105, 0.660, marks=pytest.mark.full),
    ],
)
def test_optimised_mirror_improves_on_sphere(merit, target, sphere):
    best = optimise(replace(PAPER, terms=16), merit, starts=1)
    as_paper = {"mode": "paper", "image_radius_px": 500.0}
    evaluated = evaluated_merits(best.sensor, **as_paper)[merit]
    assert evaluated <= target
    assert evaluated == pytest.approx(best.value, rel=2e-5)
    focus = om.best_focus(SPHERE, merit, omega_deg=np.linspace(0, 135, 1001), **as_paper)
    assert focus.value == pytest.approx(sphere, abs=1e-3)
    assert om.best_focus(best.sensor, merit, **as_paper).value >= evaluated * (
        1 - 1e-5
    )  # no other focus is better


@pytest.mark.parametrize(
    ("family", "terms", "merit"),
    few(
        [("slope-spline", 8, merit) for merit in DESIGN_MERITS],
        *(
            ("slope-spline", 8, merit)
            for merit in (AREAS[0], "worst_blur_deg", "inverse_area_ratio")
        ),
    )
    + [("even-polynomial", 5, "mean_floored_area_deg2")]
    + [
        pytest.param(*case, marks=pytest.mark.full)
        for case in [
            ("even-polynomial", 5, merit)
            for merit in (AREAS[0], "worst_blur_rss_deg", "total_track_mm")
        ]
        + [
            ("conic-asphere", 3, merit)
            for merit in (AREAS[0], "worst_blur_rss_deg", "worst_aspect")
        ]
    ],
)
def test_merits_agree_with_evaluation_and_improve(family, terms, merit):
    problem = DesignProblem(family=family, terms=terms)
    best = optimise(problem, merit, starts=1)
    assert evaluated_merits(best.sensor)[merit] == pytest.approx(best.value, rel=1e-3, abs=1e-5)
    space = DesignSpace(problem)
    sphere = space.sensor(start(space, 0, 0)[1])
    assert best.value <= evaluated_merits(sphere)[merit] * (1 + 1e-6)
    assert best.runs[0].start == "sphere"


@pytest.mark.parametrize(
    ("family", "terms"),
    [
        pytest.param("slope-spline", 12, marks=pytest.mark.full),
        pytest.param("even-polynomial", 8, marks=pytest.mark.full),
        ("conic-asphere", 3),
    ],
)
def test_field_rim_and_view_angle_are_met_exactly(family, terms):
    sensor = optimise(DesignProblem(family=family, terms=terms), starts=1).sensor
    assert sensor.field_deg == pytest.approx((0.0, 135.0), abs=1e-9)
    assert np.degrees(sensor.meridian.theta_max) == pytest.approx(12.0, abs=1e-9)
    assert sensor.mirror.rim_radius_mm == 43.9
    assert parse_sensor(format_sensor(sensor)) == sensor  # an ordinary sensor file


LIMITS = (
    Limit("aspect", 0.3, None, (20.0, 100.0)),
    Limit("length_mm", 400.0),
    Limit("total_blur_px", 2.0),
    Limit("resolution_px_per_deg", None, 2.0),
    Limit("area_ratio", None, 0.7),
    Limit("viewpoint_spread_mm", 30.0),
)
PROBLEMS = {
    "ranges": DesignProblem(
        theta_max_deg=(10.0, 14.0),
        f_number=(2.0, 8.0),
        family="conic-asphere",
        terms=4,
        limits=LIMITS,
    ),
    "lens follows": DesignProblem(
        focal_length_mm=None,
        rim_radius_mm=(30.0, 50.0),
        terms=5,
        object_distance_mm=(400.0, np.inf),
        housing=Housing(CameraBody(40.0)),
        omega_min_deg=15.0,
        limits=LIMITS,
    ),
    "theta follows": DesignProblem(
        theta_max_deg=None,
        omega_max_deg=(120.0, 140.0),
        family="conic-asphere",
        terms=0,
        limits=LIMITS,
    ),
    "telecentric": DesignProblem(
        lens="orthographic", omega_max_deg=120.0, rim_radius_mm=(30.0, 50.0), terms=5, limits=LIMITS
    ),
}


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=list(PROBLEMS))
@pytest.mark.parametrize(
    "merit",
    few(
        [*AREAS, "worst_blur_rss_deg", "viewpoint_spread_mm", "inverse_area_ratio"],
        AREAS[0],
        "viewpoint_spread_mm",
    ),
)
def test_derivatives_agree_with_finite_differences(merit, problem):
    space = DesignSpace(problem)
    objective = Objective(space, merit_named(merit), np.linspace(0, 1, 41))
    _, y = start(space, 2, 5)
    rows, h = objective.rows(y), 1e-4
    for i in range(space.dim):
        at = [objective.values(y + k * h * np.eye(space.dim)[i]) for k in (-2, -1, 1, 2)]
        for part in ("objective", "constraints"):
            a, b, c, d = (getattr(v, part) for v in at)
            exact = getattr(rows, f"{part.rstrip('s')}_jacobian")[:, i]
            scale = max(np.abs(exact).max(), 1.0)
            numeric = (a - 8 * b + 8 * c - d) / (12 * h)
            np.testing.assert_allclose(exact, numeric, atol=1e-8 * scale, err_msg=space.names[i])


@pytest.mark.parametrize(
    "merit",
    [
        "worst_blur_deg",
        *(pytest.param(m, marks=pytest.mark.full) for m in (AREAS[0], "worst_blur_rss_deg")),
    ],
)
def test_optimum_is_local_minimum(merit):
    """Random steps of many sizes in all coordinates, each evaluated separately."""
    problem = replace(PAPER, family="even-polynomial", terms=6)
    best = optimise(problem, merit, starts=2)
    space = DesignSpace(problem)
    objective = Objective(space, merit_named(merit), np.linspace(0, 1, 1201))
    rng = np.random.default_rng(1)
    for size in 10.0 ** rng.uniform(-6, -1, 400):
        y = best.y + size * rng.standard_normal(space.dim)
        values = objective.values(y)
        if (values.constraints <= 0).all():
            assert objective.shown(float(values.objective.max())) >= best.value * (1 - 1e-6)


@pytest.mark.full
def test_distance_and_f_number_stay_within_ranges():
    """Stopping down reduces blur until diffraction dominates; the length decreases to the limit of
    theta."""
    narrow = optimise(DesignProblem(terms=8), starts=1)
    free = optimise(
        DesignProblem(terms=8, f_number=(2.0, 22.0), theta_max_deg=(10.0, 14.0)), starts=1
    )
    assert free.value < narrow.value
    assert 4.0 < free.sensor.lens.f_number < 22.0
    assert 10.0 - 1e-9 <= np.degrees(free.sensor.meridian.theta_max) <= 14.0 + 1e-9
    assert free.sensor.field_deg[1] == pytest.approx(135.0, abs=1e-9)
    short = optimise(DesignProblem(terms=8, theta_max_deg=(10.0, 14.0)), "total_track_mm", starts=1)
    assert short.sensor.rim_radius_px == pytest.approx(512.0, rel=2e-4)  # limited by the imager
    large = DesignProblem(terms=8, theta_max_deg=(10.0, 14.0), imager=Imager(2048, 2048, 5.2))
    short = optimise(large, "total_track_mm", starts=1)
    assert np.degrees(short.sensor.meridian.theta_max) == pytest.approx(14.0, abs=1e-6)


def test_limits_are_met_and_reduce_merit():
    free = optimise(DesignProblem(terms=8), "worst_floored_area_deg2", starts=1)
    sharp, even, flat = ("total_blur_t_deg", 0.6), ("area_ratio", None, 1 / 1.3), ("sag_mm", 28.5)
    limits = tuple(Limit(*limit) for limit in (sharp, even, flat))
    limited = optimise(DesignProblem(terms=8, limits=limits), "worst_floored_area_deg2", starts=1)
    evaluated = evaluated_merits(limited.sensor)
    assert evaluated["inverse_area_ratio"] <= 1.3 * (1 + 1e-6)
    r = om.evaluate(limited.sensor, np.linspace(0.0, 135.0, 2001))
    assert (np.hypot(r.blur_t_px, r.airy_px) / r.dh_domega_px_per_deg).max() <= 0.6 * (1 + 1e-6)
    assert float(limited.sensor.mirror.sag(43.9)) <= 28.5
    assert limited.value > free.value
    assert evaluated_merits(free.sensor)["inverse_area_ratio"] > 1.3


def test_obscured_centre_does_not_affect_merit():
    problems = [DesignProblem(terms=8, omega_min_deg=low) for low in (0.0, 30.0)]
    whole, ring = (optimise(problem, "worst_blur_deg", starts=1) for problem in problems)
    r = om.evaluate(ring.sensor, np.linspace(30.0, ring.sensor.field_deg[1], 2001))
    assert max(np.abs(r.blur_t_deg).max(), np.abs(r.blur_s_deg).max()) == pytest.approx(
        ring.value, rel=5e-3
    )
    assert ring.value < whole.value


def test_stopped_search_resumes(tmp_path):
    problem, file = DesignProblem(family="even-polynomial", terms=4), tmp_path / "search.json"
    straight = optimise(problem, starts=2, seed=7)
    optimise(problem, starts=1, seed=7, resume=file)
    updates = []
    resumed = optimise(problem, starts=2, seed=7, resume=file, on_iteration=updates.append)
    assert resumed.runs == straight.runs
    assert resumed.sensor == straight.sensor
    assert {p.run for p in updates} == {1}  # the first start was not repeated
    with pytest.raises(OmnimirrorError, match="the same search; seed differ"):
        optimise(problem, starts=2, seed=8, resume=file)
    file.write_text("{}")
    with pytest.raises(OmnimirrorError, match="must be the state of a search"):
        optimise(problem, starts=1, resume=file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"omega_max_deg": 175.0}, "between 12 and 168 deg .* got 175"),
        ({"theta_max_deg": (14.0, 12.0)}, "theta_max_deg must be .* got 14 to 12"),
        ({"rim_radius_mm": -1.0}, "rim_radius_mm must be .* got -1"),
        ({"omega_min_deg": 140.0}, "omega_min_deg must be .* got 140"),
        (
            {"family": "cone"},
            "must be one of even-polynomial, conic-asphere, slope-spline; got 'cone'",
        ),
        ({"terms": 99}, "terms must be .*; got 99"),
    ],
)
def test_infeasible_problems_are_rejected(change, message):
    with pytest.raises(InvalidParameter, match=message):
        DesignProblem(**change)


def test_invalid_search_settings_are_rejected():
    problem = DesignProblem(family="even-polynomial", terms=3)
    for options, message in [
        ({"merit": "sharpness"}, "must be one of worst_floored_area_deg2"),
        ({"starts": 0}, "starts must be at least 1; got 0"),
    ]:
        with pytest.raises(InvalidParameter, match=message):
            optimise(problem, **options)
    with pytest.raises(OmnimirrorError, match="meets all limits"):
        optimise(replace(problem, limits=(Limit("total_blur_deg", at_most=0.1),)), starts=1)


# -- real rays
# ---------------------------------------------------------------------------------------


def landing(sensor: om.Sensor, omega: float, aperture: np.ndarray, guess: float) -> np.ndarray:
    """Return imager intercepts (n, 2) px of rays of a distant object through aperture points (n,
    2).

    Each ray is aimed by Newton's method: the mirror point whose reflected ray passes through the
    aperture point.
    """
    mirror, m, lens = sensor.mirror, sensor.mirror_distance_mm, sensor.lens
    travel = -np.array([np.sin(omega), 0.0, -np.cos(omega)])

    def at_lens(p):
        x, y = p
        r = np.hypot(x, y)
        slope = float(mirror.slope(min(r, mirror.rim_radius_mm)))
        z = float(mirror.sag(min(r, mirror.rim_radius_mm))) + slope * max(
            r - mirror.rim_radius_mm, 0.0
        )
        n = np.array([slope * x / r, slope * y / r, -1.0])
        n /= np.linalg.norm(n)
        d = travel - 2 * (travel @ n) * n
        s = (-m - z) / d[2]
        return np.array([x + s * d[0], y + s * d[1]]), d

    out = []
    for target in aperture:
        p = np.array([guess, 1e-9])
        for _ in range(20):
            point_mm, _d = at_lens(p)
            J = np.column_stack(
                [(at_lens(p + e)[0] - at_lens(p - e)[0]) / 2e-5 for e in np.eye(2) * 1e-5]
            )
            p = p - np.linalg.solve(J, point_mm - target)
        point_mm, d = at_lens(p)
        assert np.abs(point_mm - target).max() < 1e-7
        b0 = lens.image_distance  # a thin lens deflects a ray at s by -s/f
        out.append(point_mm * (1 - b0 / lens.focal_length_mm) + b0 * d[:2] / -d[2])
    return np.array(out) / sensor.imager.pitch_mm


@pytest.mark.parametrize(
    "merit", [pytest.param(AREAS[0], marks=pytest.mark.full), "worst_blur_deg"]
)
def test_blur_agrees_with_real_rays_through_aperture(merit):
    """The whole aperture, edge to edge along and across the meridian, over the real mirror in 3-D."""
    sensor = optimise(DesignProblem(terms=10), merit, starts=1).sensor
    radius = sensor.lens.focal_length_mm / sensor.lens.f_number / 2
    angles = np.array([12.0, 40.0, 75.0, 100.0, 125.0])
    result = om.evaluate(sensor, angles)
    edge = radius * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    for i, omega in enumerate(np.radians(angles)):
        spot = landing(sensor, omega, edge, result.x_mm[i])
        tangential, sagittal = np.abs(spot[0] - spot[1])[0], np.abs(spot[2] - spot[3])[1]
        assert tangential == pytest.approx(abs(result.blur_t_px[i]), abs=0.05)
        assert sagittal == pytest.approx(abs(result.blur_s_px[i]), abs=0.05)


@pytest.mark.full
def test_spline_mirrors_converge_with_knots():
    """The residual decreases as 1/N^2, to 0.2830 deg2 and to the proven bound of the single blur."""
    counts = np.array([24, 36, 48, 60])
    problem = DesignProblem(family="slope-spline", mode="paper", image_radius_px=500.0)
    area = [
        optimise(replace(problem, terms=int(n)), "worst_floored_area_deg2", starts=1).value
        for n in counts
    ]
    limit, slope = np.polynomial.polynomial.polyfit(1 / counts**2.0, area, 1)
    assert slope > 0
    assert limit == pytest.approx(0.2830, abs=2e-4)
    np.testing.assert_allclose(area, limit + slope / counts**2.0, atol=1e-4)
    single = optimise(replace(problem, terms=48), "worst_blur_deg", starts=1)
    assert single.value == pytest.approx(single.bound.blur_deg, rel=1e-5)
