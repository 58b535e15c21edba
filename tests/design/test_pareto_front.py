"""Pareto fronts against individually optimised designs, and files that resume an interrupted
search."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.design.freeform import problem_of
from omnimirror.design.limits import Limit
from omnimirror.design.optimiser import optimise
from omnimirror.design.pareto_front import EPOCH, load_front, pareto
from omnimirror.design.reference_mirrors import merit_values
from tests.design.answers import evaluated_merits

REQUIREMENTS = om.Requirements(
    field=om.FieldRequirements(omega_max_deg=135),
    mirror=om.MirrorRequirements(
        optimise="worst_floored_area_deg2", shape="polynomial:5", rim_radius_mm=43.9
    ),
    lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12),
)
PROBLEM = problem_of(REQUIREMENTS)
MERITS = ("worst_floored_area_deg2", "inverse_area_ratio")
SMALL = {"population": 24, "generations": 2 * EPOCH, "seed": 3}


@pytest.fixture(scope="module")
def front():
    return pareto(REQUIREMENTS, MERITS, population=60, generations=40)


def test_no_design_of_front_is_dominated(front):
    assert len(front) > 20
    assert (np.diff(front.values[:, 0]) > 0).all()
    assert (np.diff(front.values[:, 1]) < 0).all()


@pytest.mark.full
def test_front_agrees_with_individually_optimised_designs(front):
    """The minimum blur area under a uniformity limit, by linear programming instead of evolution."""
    for i in np.linspace(2, len(front) - 3, 3).astype(int):
        area, uniformity = front.values[i]
        problem = replace(PROBLEM, limits=(Limit("area_ratio", at_least=1 / uniformity),))
        alone = optimise(problem, "worst_floored_area_deg2", starts=1)
        assert area <= alone.value * 1.03


def test_values_of_front_agree_with_designs(front):
    for i in (0, len(front) // 2, len(front) - 1):
        sensor = front.sensor(i)
        evaluated = evaluated_merits(sensor)
        np.testing.assert_allclose(
            [evaluated[merit] for merit in MERITS], front.values[i], rtol=2e-3
        )
        assert sensor.field_deg[1] == pytest.approx(135.0, abs=1e-9)
        np.testing.assert_allclose(
            merit_values(sensor, front.merits, PROBLEM), front.values[i], rtol=2e-3
        )
    with pytest.raises(InvalidParameter, match="the index must be from 0 to"):
        front.sensor(len(front))


@pytest.mark.parametrize("name", ["paper-spherical", "paper-equidistant", "paper-hyperboloidal"])
def test_front_dominates_mirrors_of_paper(front, name):
    marks = merit_values(om.load_sensor(name), front.merits, PROBLEM)
    assert (front.values < marks).all(axis=1).any()
    r = om.evaluate(om.load_sensor(name), np.linspace(0, 135, 2001), focus_mm="auto")
    assert marks[0] == pytest.approx(r.floored_area_deg2.max(), rel=1e-3)
    assert marks[1] == pytest.approx(r.area_px2.max() / r.area_px2.min(), rel=1e-3)


def test_interrupted_evolution_resumes_identically(tmp_path):
    merits, file = ("worst_blur_deg", "worst_aspect"), tmp_path / "front.parquet"
    straight = pareto(REQUIREMENTS, merits, **SMALL)
    pareto(REQUIREMENTS, merits, **{**SMALL, "generations": EPOCH}, resume=file)
    updates = []
    resumed = pareto(
        REQUIREMENTS, merits, **SMALL, resume=file, on_progress=lambda *done: updates.append(done)
    )
    np.testing.assert_array_equal(resumed.y, straight.y)
    np.testing.assert_array_equal(resumed.values, straight.values)
    assert updates == [(2 * EPOCH, 2 * EPOCH)]
    loaded = load_front(file)
    np.testing.assert_array_equal(loaded.values, straight.values)
    assert loaded.requirements == REQUIREMENTS
    assert loaded.space.problem == PROBLEM
    assert loaded.sensor(0) == straight.sensor(0)
    with pytest.raises(OmnimirrorError, match="seed differ"):
        pareto(REQUIREMENTS, merits, **{**SMALL, "seed": 4}, resume=file)


@pytest.mark.full
def test_front_of_three_merits_with_limit():
    limited = replace(REQUIREMENTS, limits=(Limit("viewpoint_spread_mm", at_most=45.0),))
    front = pareto(limited, (*MERITS, "worst_aspect"), population=40, generations=10)
    assert front.values.shape[1] == 3
    for i in range(0, len(front), 5):
        assert evaluated_merits(front.sensor(i))["viewpoint_spread_mm"] <= 45.0 * 1.001


def test_verdict_of_front_design_agrees_with_check(front):
    """Rows of the same requirements for the same sensor, with the names of the requirements."""
    design = front.design(1)
    assert design.rows == om.check_requirements(REQUIREMENTS, front.sensor(1)).rows
    assert design.is_met
    named = replace(
        front, space=replace(front.space, requirements=replace(REQUIREMENTS, name="mine"))
    )
    assert (named.design(1).sensor.name, design.sensor.name[:6]) == ("mine", "front-")
    with pytest.raises(InvalidParameter, match="the index must be from 0 to"):
        front.design(len(front))


def test_invalid_front_settings_are_rejected(tmp_path, monkeypatch):
    with pytest.raises(InvalidParameter, match=r"requires mirror\.optimise"):
        pareto(REQUIREMENTS.changed(optimise=None, shape=None, family="sphere"))
    with pytest.raises(InvalidParameter, match="focus_mm must be omitted"):
        pareto(REQUIREMENTS.changed(focus_mm=200.0))
    with pytest.raises(InvalidParameter, match="at least two different names"):
        pareto(REQUIREMENTS, ("worst_blur_deg", "worst_blur_deg"))
    with pytest.raises(InvalidParameter, match="must be one of worst_floored_area_deg2"):
        pareto(REQUIREMENTS, ("worst_blur_deg", "beauty"))
    with pytest.raises(InvalidParameter, match="population must be greater than 0; got 0"):
        pareto(REQUIREMENTS, population=0)
    (tmp_path / "no.parquet").write_text("no front")
    with pytest.raises(OmnimirrorError, match="must be a Pareto front written by omnimirror"):
        load_front(tmp_path / "no.parquet")
    monkeypatch.setitem(sys.modules, "pymoo", None)
    with pytest.raises(OmnimirrorError, match=r"\.\[design\]"):
        pareto(REQUIREMENTS)
