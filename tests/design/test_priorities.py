"""Infeasible requirements: the feasible ones are met, and conflicts are balanced."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.design import _parameter_search, freeform, parse_requirements

SPHERE = """
field.omega_max_deg = 135
mirror = {{family = "sphere", rim_radius_mm = 43.9}}
lens = {{theta_max_deg = 12, focal_length_mm = 11.6}}
[[limit]]
quantity = "total_blur_px"
at_most = {rim}
omega_deg = [110, 130]
[[limit]]
quantity = "total_blur_px"
at_most = {middle}
omega_deg = [0, 30]
"""
FOCUS_MM = np.linspace(195.0, 260.0, 261)


def evaluated_blurs(sensor: om.Sensor) -> np.ndarray:
    """Return the larger blur at the rim and in the centre (focuses, 2), with the Airy disc, for all
    focus settings."""
    blurs = []
    for focus in FOCUS_MM:
        at = [
            om.evaluate(sensor, np.linspace(*part, 60), focus_mm=focus)
            for part in ((110, 130), (0, 30))
        ]
        blurs.append([np.hypot(np.abs([r.blur_t_px, r.blur_s_px]).max(), r.airy_px) for r in at])
    return np.array(blurs)


def test_feasible_limits_are_met_beside_infeasible_ones():
    """No focus leaves less than 4 px at the rim: 2 px are required there, and 2.5 px in the centre,
    which is feasible."""
    requirements = parse_requirements(SPHERE.format(rim=2.0, middle=2.5))
    design = _parameter_search.solve(requirements)[1]
    rim, middle = evaluated_blurs(design.sensor).T
    assert rim.min() > 2.0
    assert design.verdict.missed == ("total_blur_px, 110 to 130 deg",)
    assert design.verdict.limits[1].reached <= 2.5 * (1 + 1e-6)
    assert design.verdict.limits[0].reached == pytest.approx(rim[middle <= 2.5].min(), rel=0.02)
    assert design.notes[0] == (
        "infeasible even without the other requirements: total_blur_px, 110 to 130 deg; "
        "met instead: total_blur_px, 0 to 30 deg"
    )


@pytest.mark.full
def test_conflicting_limits_are_missed_by_equal_relative_margins():
    """Each of the two is feasible alone: the design balances them."""
    bare = _parameter_search.solve(parse_requirements(SPHERE.format(rim=90.0, middle=90.0)))[
        1
    ].sensor
    rim, middle = evaluated_blurs(bare).T
    limits = {"rim": rim.min() * 1.05, "middle": middle.min() * 1.5}
    assert not ((rim <= limits["rim"]) & (middle <= limits["middle"])).any()
    design = _parameter_search.solve(parse_requirements(SPHERE.format(**limits)))[1]
    at_rim, in_middle = (row.shortfall for row in design.verdict.limits)
    assert at_rim == pytest.approx(in_middle, rel=1e-3)
    assert at_rim == pytest.approx(
        np.maximum(rim / limits["rim"], middle / limits["middle"]).min() - 1, abs=0.02
    )


def test_freeform_mirror_meets_feasible_limits():
    """A single blur of 0.3 deg is less than the lower bound of any mirror: the length limit is
    still met."""
    text = """
field.omega_max_deg = 135
mirror = {optimise = "worst_blur_deg", shape = "polynomial:3", rim_radius_mm = 43.9}
lens = {theta_max_deg = 12, focal_length_mm = 11.6}
[[limit]]
quantity = "total_blur_deg"
at_most = 0.3
[[limit]]
quantity = "area_ratio"
at_least = 0.8
"""
    requirements = parse_requirements(text)
    verdict = freeform.solve(requirements, freeform.problem_of(requirements), starts=1)[1].verdict
    assert verdict.missed == ("total_blur_deg",)
