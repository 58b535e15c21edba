"""Requirements that are feasible by construction, and searches that end early or skip a part of the
ranges."""

from __future__ import annotations

import runpy
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.logs import forward_steps
from omnimirror.design import parse_requirements
from omnimirror.design._candidates import make
from omnimirror.design._parameter_search import RangeSearch
from omnimirror.design.designer import design_sensor
from omnimirror.design.relaxation import SEARCHED, find_alternatives, relaxed
from tests.commands import PROGRAM
from tests.design.answers import best, row
from tests.everyday import few

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "feasible_requirements.py"

FITTED = """
[field]
omega_min_deg = 12.0
omega_max_deg = {omega}
object_plane_distance_mm = 300.0
[mirror]
mapping = "ground-plane"
plane_distance_mm = 300.0
rim_radius_mm = 40.0
fit = "{fit}"
[lens]
focal_length_mm = 8.0
[imager]
width_px = 2048
height_px = 2048
pixel_pitch_um = 3.45
"""

PIPE = """
[field]
omega_min_deg = {low}
omega_max_deg = 110.0
[housing.tube]
material = "sapphire"
diameter_mm = {diameter}
wall_mm = 2.0
medium = "water"
[mirror]
{mirror}
rim_radius_mm = 22.0
[lens]
focal_length_mm = 6.0
[imager]
width_px = 1920
height_px = 1200
pixel_pitch_um = 3.0
"""

BLUR_AGAINST_HEIGHT = """
[mount]
camera_looks = "up"
[field]
elevation_deg = [-40, 35]
object_distance_mm = [500, 3000]
[mirror]
family = "hyperboloid"
rim_radius_mm = [20, 40]
[lens]
focal_length_mm = [4, 12]
f_number = [2.8, 8]
[imager]
width_px = 4056
height_px = 3040
pixel_pitch_um = 1.55
[[limit]]
quantity = "total_blur_px"
at_most = {blur}
elevation_deg = [0, 30]
[[limit]]
quantity = "overall_height_mm"
at_most = 220.0
"""

INFEASIBLE = """
[field]
omega_max_deg = 135
[mirror]
mapping = "equidistant"
rim_radius_mm = 43.9
[lens]
theta_max_deg = 12
[[limit]]
quantity = "total_blur_px"
at_most = 2.0
"""


@pytest.mark.parametrize("seed", few(range(40), 0, 3))
def test_requirements_of_random_sensor_are_met(seed):
    requirements = runpy.run_path(str(BENCHMARK))["feasible_requirements"](seed)
    verdict = best(requirements)
    assert verdict.is_met, verdict.missed
    assert om.check_requirements(requirements, verdict.sensor).is_met


@pytest.mark.parametrize(
    ("omega", "fit"),
    few(
        [
            (60.0, "polynomial:5"),
            (60.0, "asphere:3"),
            (50.0, "polynomial:4"),
            (65.0, "polynomial:6"),
        ],
        (60.0, "polynomial:5"),
    ),
)
def test_fitted_mirror_fills_imager_without_missed_rows(omega, fit):
    verdict = best(parse_requirements(FITTED.format(omega=omega, fit=fit)))
    assert verdict.is_met
    assert row(verdict, "image_radius_px").reached == pytest.approx(1024, abs=1e-3)
    assert all(r.margin >= 0 for r in verdict.rows)


CYLINDER, EQUIDISTANT = (
    'mapping = "cylinder"\ncylinder_radius_mm = 150.0',
    'mapping = "equidistant"\napex = "pointed"',
)


@pytest.mark.parametrize(
    ("mirror", "low", "diameter"),
    few(
        [
            (CYLINDER, 45.0, 60.0),
            (CYLINDER, 60.0, 90.0),
            (EQUIDISTANT, 50.0, 60.0),
            (EQUIDISTANT, 60.0, 90.0),
        ],
        (CYLINDER, 45.0, 60.0),
        (EQUIDISTANT, 60.0, 90.0),
    ),
)
def test_inner_field_limit_of_pointed_mirror_in_water_tube(mirror, low, diameter):
    sensor = make(parse_requirements(PIPE.format(mirror=mirror, low=low, diameter=diameter))).sensor
    assert sensor.field_deg == pytest.approx((low, 110.0), abs=1e-6)
    rays = sensor.meridian.trace(np.array([sensor.meridian.x_min, 22.0]))
    snell = np.degrees(
        np.arccos(1.333 * np.cos(np.radians([low, 110.0])))
    )  # water to air at parallel walls
    np.testing.assert_allclose(
        np.degrees(rays.reflected), snell, atol=0.05
    )  # index to three decimals


@pytest.mark.parametrize("seed", few(range(40), 0, 2, 3))
def test_reached_values_are_met_when_required(seed):
    requirements = runpy.run_path(str(BENCHMARK))["feasible_requirements"](seed)
    first = best(requirements)
    exactly = [
        replace(
            limit,
            at_least=limit.at_least and row.reached * 0.9998,
            at_most=limit.at_most and row.reached * 1.0002,
        )
        for limit, row in zip(requirements.limits, first.limits, strict=True)
    ]
    verdict = best(replace(requirements, limits=tuple(exactly)))
    assert verdict.is_met, verdict.missed


def test_reached_blur_is_met_when_required():
    """The best blur under a height limit, then that blur as a limit itself, 0.02 % above."""
    first = best(parse_requirements(BLUR_AGAINST_HEIGHT.format(blur=9.3)))
    assert first.is_met
    blur_px = first.limits[0].reached
    assert best(parse_requirements(BLUR_AGAINST_HEIGHT.format(blur=1.0002 * blur_px))).is_met


SPHERE, CONIC = 'family = "sphere"', 'family = "hyperboloid"'
CONFLICTS = {
    "one number and a blur": (SPHERE, "focal_length_mm = 11.6", "total_blur_px", "at_most = 4.0"),
    "a resolution": (SPHERE, "focal_length_mm = 11.6", "resolution_px_per_deg", "at_least = 3.3"),
    "a mapping": (
        'mapping = "equidistant"',
        "theta_max_deg = 12",
        "total_blur_px",
        "at_most = 6.0",
    ),
    "a conic": (CONIC, "focal_length_mm = 11.6", "area_ratio", "at_least = 0.5"),
    "a range": (SPHERE, "focal_length_mm = [8, 11.6]", "total_blur_deg", "at_most = 0.3"),
    "a spread": (SPHERE, "theta_max_deg = 12", "viewpoint_spread_mm", "at_most = 5.0"),
    "a height": (CONIC, "focal_length_mm = [8, 12]", "overall_height_mm", "at_most = 100.0"),
}
CONFLICT = """
[field]
omega_max_deg = 135
[mirror]
{}
rim_radius_mm = 43.9
[lens]
{}
[[limit]]
quantity = "{}"
{}
"""


@pytest.mark.parametrize("name", few(CONFLICTS, "one number and a blur", "a resolution"))
def test_relaxations_are_thresholds_within_one_percent(name):
    """Separate searches without the design succeed above each threshold and fail below it."""
    requirements = parse_requirements(CONFLICT.format(*CONFLICTS[name]))
    conflict = design_sensor(requirements).conflict
    relaxations = [r for r in conflict.alone if r.needed is not None]
    assert relaxations
    for r in relaxations:
        step = 0.01 * np.sign(r.needed - r.requested) * abs(r.needed)
        assert best(relaxed(requirements, [replace(r, needed=r.needed + step)])).is_met, r
        if abs(r.needed - r.requested) > abs(step):
            assert not best(relaxed(requirements, [replace(r, needed=r.needed - step)])).is_met, r


def test_interrupted_relaxation_search_keeps_design_and_results():
    designs, steps = [], []

    def interrupt(step):
        if designs:  # only the search for relaxations is interrupted
            steps.append(step)
        if len(steps) == 2:
            raise KeyboardInterrupt

    with forward_steps(interrupt, "omnimirror.design"):
        design = design_sensor(parse_requirements(INFEASIBLE), on_design=designs.append)
    assert steps[0].startswith("relaxation 1 of ")
    assert not design.conflict.is_complete
    assert len(design.conflict.alone) == 1
    assert replace(design, conflict=None) == designs[0]


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM")
def test_signal_during_relaxation_search_keeps_table_and_sensor(tmp_path):
    (tmp_path / "requirements.toml").write_text(INFEASIBLE)
    command = [PROGRAM, "design", "requirements.toml", "-o", "best.toml"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as run:
        table = list[str]()
        for line in iter(run.stdout.readline, ""):
            table.append(line)
            if line.startswith("total_blur_px"):
                break
        run.send_signal(signal.SIGTERM)
        run.communicate()
    assert run.returncode not in (0, 3)
    assert table[-1].rstrip().endswith("missed")
    assert om.load_sensor(tmp_path / "best.toml").mirror.rim_radius_mm == 43.9


def test_reported_alternatives_agree_with_their_designs(
    monkeypatch,
):
    searches = list[om.Requirements]()
    original = RangeSearch.followed

    def count_search(search, start, enough):
        searches.append(search.requirements)
        return original(search, start, enough)

    requirements = parse_requirements(
        CONFLICT.format(SPHERE, "focal_length_mm = 11.6", "total_blur_deg", "at_most = 0.3")
    )
    verdict = best(requirements)
    monkeypatch.setattr(RangeSearch, "followed", count_search)
    alternatives = [*find_alternatives(requirements, verdict, lambda message: None)]
    monkeypatch.undo()
    assert 0 < len(searches) <= SEARCHED
    assert alternatives
    assert all(a.worst < verdict.worst for a in alternatives)
    for a in (a for a in alternatives if a.entry == "mirror.family"):
        assert best(requirements.changed(family=a.value)).worst <= a.worst * (1 + 1e-9)


@pytest.mark.full
def test_maximum_resolution_in_water_pipe_agrees_with_scan():
    """The scan covers focus and F-number; the relaxation of the resolution ends at the same value."""
    text = PIPE.format(mirror=CYLINDER, low=45.0, diameter=60.0)
    text = text.replace("focal_length_mm = 6.0", "focal_length_mm = 6.0\nf_number = [4, 11]")
    text = text.replace(
        "omega_max_deg = 110.0", "omega_max_deg = 110.0\nobject_cylinder_radius_mm = 150.0"
    )
    requirements = parse_requirements(
        text
        + '[[limit]]\nquantity = "resolution_px_per_deg"\nat_least = 4.0\n'
        + '[[limit]]\nquantity = "total_blur_deg"\nat_most = 0.9\n'
    )
    resolutions = []
    for f_number in (4.0, 4.5, 5.5, 8.0):
        for focus in np.linspace(74.0, 92.0, 37):
            sensor = make(requirements.changed(f_number=f_number, focus_mm=float(focus))).sensor
            resolution, blur = om.check_requirements(requirements, sensor, angles=181).limits
            if blur.reached <= 0.9:
                resolutions.append(resolution.reached)
    design = design_sensor(requirements)
    needed = next(r.needed for r in design.conflict.alone if r.name == "resolution_px_per_deg")
    assert design.verdict.limits[0].reached >= max(resolutions) * (1 - 1e-4)
    assert needed == pytest.approx(max(resolutions), rel=0.01)
    assert design.conflict.is_complete
    assert design.conflict.alternatives


@pytest.mark.full
def test_sufficient_discrete_choice_is_recommended():
    """A smooth apex has at most 7 px/deg at its centre here, a pointed one almost none."""
    text = INFEASIBLE.replace("total_blur_px", "resolution_px_per_deg").replace(
        "at_most = 2.0", "at_least = 2.0"
    )
    text = text.replace('"equidistant"', '"equidistant"\napex = "pointed"').replace(
        "omega_max_deg = 135", "omega_max_deg = 135\nomega_min_deg = 40"
    )
    design = design_sensor(parse_requirements(text))
    assert not design.is_met
    smooth = next(a for a in design.conflict.alternatives if a.entry == "mirror.apex")
    assert smooth.value == "smooth"
    assert smooth.is_met == best(parse_requirements(text.replace('"pointed"', '"smooth"'))).is_met
