"""An optimised mirror for requirements: the best that keeps them all, or the one that misses them least."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...batch.bases import FreeForm
from ...numerics.minimax import Minimum
from ...sensor import Sensor
from ..construct.rim import MountedMirror
from ..criteria.requirements import Requirements
from ..optimise.objective import Concession, Objective
from ..optimise.optimiser import (
    CLOSE,
    FINE,
    KEPT,
    POLISH_TRUST,
    Optimum,
    Progress,
    coarse_nodes,
    follow,
    optimised,
    start,
)
from ..optimise.problem import DesignProblem
from ..optimise.variables import DesignSpace
from .candidates import Choice, Made, judged
from .verdict import Row, assess

Array = NDArray[np.float64]

SHAPE = "spline"  # where none is asked for


@dataclass(frozen=True)
class Shaped:
    """An optimised sensor, judged.

    Attributes
    ----------
    y
        Its point of the problem's design space.
    optimum
        How it was found; None where no design keeps everything, and this one misses least.
    """

    problem: DesignProblem
    y: Array
    optimum: Optimum | None
    choice: Choice
    made: Made
    rows: list[Row]


def problem_of(requirements: Requirements) -> DesignProblem:
    """What an optimiser has to know of requirements; what they give as ranges is free."""
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    shape = FreeForm.parse(mirror.shape or SHAPE)
    return DesignProblem(
        omega_max_deg=field.omega_max_deg,
        theta_max_deg=lens.theta_max_deg,
        rim_radius_mm=mirror.rim_radius_mm,
        focal_length_mm=lens.focal_length_mm,
        f_number=lens.f_number,
        imager=requirements.imager,
        lens=lens.kind,
        omega_min_deg=field.omega_min_deg,
        camera_radius_mm=field.camera_radius_mm,
        object_distance_mm=field.object_distance_mm,
        focus_mm=lens.focus_mm,
        family=shape.name,
        terms=shape.terms,
        limits=requirements.limits,
    )


def shape(
    requirements: Requirements,
    problem: DesignProblem,
    starts: int = 4,
    seed: int = 0,
    resume: str | Path | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Shaped:
    """Optimise for requirements; ``problem`` is theirs, or that with another mode of blur.

    Where none of the starts leads to a mirror that keeps everything, what is missed most is made least; should all
    be kept then, the merit is pressed down from there.
    """
    merit = requirements.mirror.optimise
    assert merit is not None
    found = optimised(problem, merit, starts, seed, resume, on_progress)
    if isinstance(found, Optimum):
        return _shaped(requirements, problem, found.y, found)
    return _shaped(requirements, problem, _least_bad(problem, found), None)


def _shaped(requirements: Requirements, problem: DesignProblem, y: Array, optimum: Optimum | None) -> Shaped:
    """A point of the design space as a sensor, requirement by requirement."""
    sensor = optimum.sensor if optimum else DesignSpace(problem).sensor(y)
    choice, made, rows = judged_sensor(requirements, sensor)
    return Shaped(problem, y, optimum, choice, made, rows)


def judged_sensor(requirements: Requirements, sensor: Sensor) -> tuple[Choice, Made, list[Row]]:
    """Any sensor, requirement by requirement."""
    lens = sensor.lens
    theta = None if lens.TELECENTRIC else float(np.degrees(sensor.meridian.theta_max))
    choice = Choice(
        requirements.field.omega_max_deg, requirements.field.omega_min_deg, sensor.mirror.rim_radius_mm, theta,
        getattr(lens, "focal_length_mm", None), getattr(lens, "f_number", None) or lens.image_f_number(), None,
    )  # fmt: skip
    made = judged(requirements, sensor, MountedMirror(sensor.mirror, sensor.mirror_distance_mm))
    return choice, made, assess(requirements, choice, made)


def _least_bad(problem: DesignProblem, ends: list[Array]) -> Array:
    """The point where what is missed most is missed least, from the ends of some searches; polished."""
    space = DesignSpace(problem)
    coarse = Objective(space, Concession(()), coarse_nodes(problem))
    coarse = replace(coarse, goal=Concession(coarse.asked))
    found = [follow(coarse, y, tolerance=CLOSE) for y in [start(space, 0, 0)[1], *ends]]
    best = min(found, key=_cost)
    fine = replace(coarse, u=np.linspace(0.0, 1.0, FINE))
    return follow(fine, best.y, tolerance=CLOSE, first_trust=POLISH_TRUST).y


def _cost(found: Minimum) -> float:
    return found.value if found.violation < KEPT else np.inf
