"""Optimised mirrors for requirements: limits by the evaluation, and sufficient relaxations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.design import Limit, SearchOptions, parse_requirements
from omnimirror.design._design_problem import DesignProblem
from omnimirror.design.designer import design_sensor
from omnimirror.design.freeform import problem_of, solve
from omnimirror.design.limits import LIMITABLE
from omnimirror.design.merits import values_of_evaluation
from omnimirror.design.optimiser import optimise
from omnimirror.design.reference_mirrors import known_sensors, merit_values

ONE = SearchOptions(starts=1)
TEXT = """
[field]
omega_max_deg = 130
omega_min_deg = 20
object_distance_mm = [600, inf]
[housing.camera]
diameter_mm = 50.0

[mirror]
optimise = "worst_floored_area_deg2"
shape = "polynomial:5"
rim_radius_mm = [30, 42]
[lens]
focal_length_mm = 11.6
theta_max_deg = [9, 12]
f_number = 8
[[limit]]
quantity = "total_blur_px"
at_most = 4.0
omega_deg = [40, 130]
[[limit]]
quantity = "resolution_px_per_deg"
at_least = 2.5
omega_deg = [30, 120]
[[limit]]
quantity = "length_mm"
at_most = 190
[[limit]]
quantity = "sag_mm"
at_most = 26
"""


@pytest.fixture(scope="module")
def feasible_design():
    return design_sensor(parse_requirements(TEXT), search=ONE)


def test_freeform_limits_agree_with_evaluation(feasible_design):
    sensor = feasible_design.sensor
    assert feasible_design.is_met
    assert feasible_design.conflict is None
    for distance in (600.0, np.inf):
        part = om.evaluate(sensor, np.linspace(40, 130, 3001), object_distance_mm=distance)
        assert max(np.abs(part.blur_t_px).max(), np.abs(part.blur_s_px).max()) <= 4.0
        part = om.evaluate(sensor, np.linspace(30, 120, 3001), object_distance_mm=distance)
        assert min(part.dh_domega_px_per_deg.min(), part.width_px_per_deg.min()) >= 2.5
    sag = float(sensor.mirror.sag(sensor.mirror.rim_radius_mm))
    assert sag <= 26
    assert sag + sensor.mirror_distance_mm <= 190
    assert sensor.rim_radius_px <= 512
    assert sensor.clear_field_deg[0] <= 20 + 1e-8
    assert 30 <= sensor.mirror.rim_radius_mm <= 42
    assert 9 <= np.degrees(sensor.meridian.theta_max) <= 12 + 1e-9
    assert sensor.field_deg == pytest.approx((0.0, 130.0), abs=1e-9)


def test_merit_covers_unobscured_field_at_both_distances(feasible_design):
    areas = [
        om.evaluate(
            feasible_design.sensor, np.linspace(20, 130, 2001), object_distance_mm=d
        ).floored_area_deg2.max()
        for d in (600.0, np.inf)
    ]
    assert feasible_design.optimum.value == pytest.approx(max(areas), rel=2e-3)
    looser = design_sensor(
        parse_requirements(TEXT.replace("at_most = 4.0", "at_most = 40.0")), search=ONE
    )
    assert looser.optimum.value <= feasible_design.optimum.value * (1 + 1e-6)


CONFLICTING = """
[field]
omega_max_deg = 130
[mirror]
optimise = "worst_floored_area_deg2"
shape = "polynomial:3"
rim_radius_mm = 40
[lens]
theta_max_deg = 12
[[limit]]
quantity = "total_blur_px"
at_most = 4.0
[[limit]]
quantity = "area_ratio"
at_least = 0.8
"""


@pytest.fixture(scope="module")
def infeasible_design():
    return design_sensor(parse_requirements(CONFLICTING), search=ONE)


def with_value(requirements, name, value):
    """Return the requirements with a limit or number changed."""
    for i, limit in enumerate(requirements.limits):
        if limit.label == name:
            side = "at_most" if limit.at_most is not None else "at_least"
            limits = list(requirements.limits)
            limits[i] = replace(limit, **{side: value})
            return replace(requirements, limits=tuple(limits))
    return requirements.changed(**{name: value})


def is_feasible(requirements):
    """Check if an optimised mirror meets all requirements, without relaxations."""
    return solve(requirements, problem_of(requirements), starts=1)[1].verdict.is_met


@pytest.mark.full
def test_single_relaxation_is_sufficient_and_minimal(infeasible_design):
    """Each relaxation is inserted in the requirements: feasible with it, infeasible with slightly
    less."""
    assert not infeasible_design.is_met
    helpful = [r for r in infeasible_design.conflict.alone if r.needed not in (None, r.requested)]
    assert len(helpful) >= 3
    for r in helpful:
        for relative_change, feasible in ((1.01, True), (0.97, False)):
            requirements = with_value(
                infeasible_design.requirements,
                r.name,
                r.requested + relative_change * (r.needed - r.requested),
            )
            assert is_feasible(requirements) == feasible, (r, relative_change)


def test_joint_relaxation_is_sufficient(infeasible_design):
    conflict = infeasible_design.conflict
    assert (
        0
        < conflict.joint_change
        < min(r.relative_change for r in conflict.alone if r.needed is not None)
    )
    requirements = infeasible_design.requirements
    for r in conflict.joint:
        requirements = with_value(
            requirements, r.name, r.requested + 1.01 * (r.needed - r.requested)
        )
    assert is_feasible(requirements)


@pytest.mark.full  # mirrors without optimisation are tested in every run
def test_joint_relaxation_is_minimal(infeasible_design):
    """Each one reset to the original, with the others relaxed, violates a requirement."""
    joint = infeasible_design.conflict.joint
    assert len(joint) >= 2
    for r in joint:
        requirements = infeasible_design.requirements
        for other in (other for other in joint if other is not r):
            requirements = with_value(requirements, other.name, other.needed)
        assert not is_feasible(requirements), r


def test_infeasible_limits_are_missed_by_minimum(infeasible_design):
    """Relaxed by slightly more than its violation, it is feasible with all others; by slightly
    less, it is not."""
    rows = [row for row in infeasible_design.rows if row.label in infeasible_design.verdict.missed]
    assert 0 < len(rows) < len(infeasible_design.requirements.limits)
    for factor, feasible in ((1.01, True), (0.97, False)):
        requirements = infeasible_design.requirements
        for row in rows:
            sign = 1 if row.at_most is not None else -1
            requirements = with_value(
                requirements, row.label, row.scale * (1 + sign * factor * row.shortfall)
            )
        assert is_feasible(requirements) == feasible


def test_known_mirrors_are_reproduced_under_telecentric_lens():
    """The sphere is equal-area, the paraboloid has one viewpoint and aspect ratio 1, both exactly."""
    problem = DesignProblem(
        lens="orthographic", omega_max_deg=120, rim_radius_mm=20.0, family="conic-asphere", terms=1
    )
    R = 20.0 / np.tan(np.radians(60.0))
    cases = (
        ("inverse_area_ratio", 1.0, 0.0),
        ("worst_aspect", 1.0, -1.0),
        ("viewpoint_spread_mm", 0.0, -1.0),
    )
    for merit, value, conic in cases:
        best = optimise(problem, merit, starts=1)
        assert best.value == pytest.approx(value, abs=1e-6)
        mirror = best.sensor.mirror
        x = np.linspace(0, 20.0, 50)
        radius = 20.0 / np.sin(np.radians(60.0)) if conic == 0 else R
        cases = x**2 / (radius * (1 + np.sqrt(1 - (1 + conic) * (x / radius) ** 2)))
        np.testing.assert_allclose(mirror.sag(x), cases, atol=2e-4)


def test_telecentric_design_reports_required_lens_diameter():
    design = design_sensor(
        parse_requirements(
            "field.omega_max_deg = 110\n"
            'mirror = {optimise = "worst_blur_deg", shape = "polynomial:4", rim_radius_mm = [15, 20]}\n'
            'lens.kind = "orthographic"\n[[limit]]\nquantity = "sag_mm"\nat_most = 8'
        ),
        search=ONE,
    )
    assert design.is_met
    width = 2 * design.sensor.mirror.rim_radius_mm
    assert any(f"that of the mirror, {width:g} mm" in note for note in design.notes)
    assert design.sensor.rim_radius_px == pytest.approx(512.0)
    result = om.evaluate(design.sensor, np.linspace(0, 110, 2001))
    worst = max(np.abs(result.blur_t_deg).max(), np.abs(result.blur_s_deg).max())
    assert design.optimum.value == pytest.approx(worst, rel=1e-4)
    optimum = om.best_focus(design.sensor, "worst_blur_deg")
    assert optimum.value >= worst * (1 - 1e-5)
    ray_blur = om.check_blur(
        design.sensor, [4.0, 8.0], omega_deg=np.linspace(5, 105, 11)
    )  # through the full aperture
    for edge in ("edge_t_px", "edge_s_px"):
        wide, narrow = ray_blur.max_abs(edge)
        assert narrow < wide / 6 < 0.2 / 6  # the error of second-order optics is of third order


def test_given_focus_is_kept():
    text = CONFLICTING.replace("[lens]", "[lens]\nfocus_mm = 250.0").split("[[limit]]")[0]
    design = design_sensor(parse_requirements(text), search=ONE)
    assert design.sensor.lens.focus_distance_mm == 250.0
    assert design.sensor.rim_radius_px == pytest.approx(512.0)


@pytest.mark.parametrize("quantity", LIMITABLE)
def test_every_quantity_may_be_limited_on_either_side(quantity):
    """Rows are positive exactly when the value of the table violates the limit."""
    sensor = om.load_sensor("paper-equidistant")
    distance = 1000.0 if quantity.endswith("mm_per_px") else np.inf
    result = om.evaluate(
        sensor, np.linspace(1, 134, 200), focus_mm="auto", object_distance_mm=distance
    )
    field = values_of_evaluation(result)
    frequency = {"cycles_per_px": 0.1} if quantity.startswith("mtf") else {}
    for largest in (True, False):
        value, _ = Limit(quantity, at_most=1.0, **frequency).of.extreme(field, largest)
        side = "at_most" if largest else "at_least"
        for relative_change, is_missed in ((1.001, not largest), (0.999, largest)):
            if value == 0 or np.isinf(value) or (value < 1e-3 and not largest):
                continue
            excess = Limit(quantity, **{side: value * relative_change}, **frequency).excess(field)
            assert (excess.max() > 0) == is_missed
            assert excess.max() == pytest.approx(0.001 if is_missed else -0.001, rel=0.01)


def test_known_mirrors_agree_with_paper_and_scale():
    paper = known_sensors(DesignProblem())
    assert {"SPH", "E-DI", "SVP", "exactly equiareal"} <= set(paper)
    area, uniformity = merit_values(
        paper["SPH"], ("worst_floored_area_deg2", "inverse_area_ratio"), DesignProblem()
    )
    r = om.evaluate(om.load_sensor("paper-spherical"), np.linspace(0, 135, 2001), focus_mm="auto")
    assert area == pytest.approx(r.floored_area_deg2.max(), rel=1e-3)
    assert uniformity == pytest.approx(r.area_px2.max() / r.area_px2.min(), rel=1e-3)
    other = DesignProblem(omega_max_deg=100, rim_radius_mm=20.0)
    for sensor in known_sensors(other).values():
        assert sensor.field_deg[1] == pytest.approx(100.0, abs=1e-6)
    assert merit_values(
        known_sensors(other)["exactly equiareal"], ("inverse_area_ratio",), other
    ) == pytest.approx(1.0)
