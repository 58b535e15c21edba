"""Sensor design from requirements: optimisation, requirement check and conflict analysis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..base.arguments import check_fields, instance, integer, validate_arguments
from ..base.files import json_plain
from ..base.logs import OnProgress
from ..base.results import Columns, Result
from ..optics.lenses import BlurMode
from ..optics.sensor import Sensor
from . import _parameter_search, freeform
from ._design_space import BestDesign, OnStep, Space, step_reporter
from .optimiser import Optimum, Progress
from .relaxation import Conflict, find_alternatives, find_conflict
from .requirement_check import RequirementCheck, Verdict
from .requirements import Requirements


@dataclass(frozen=True)
class Design(Result):
    """Result of :func:`design_sensor`.

    Attributes
    ----------
    sensor
        Best design, focused.
    verdict
        Results of the requirement check.
    conflict
        Conflicting requirements and possible relaxations; None if all requirements are met.
    notes
        Values chosen by the design.
    optimum
        Result of the mirror optimisation; None for other mirrors, and without a feasible design.
    """

    sensor: Sensor
    verdict: Verdict
    conflict: Conflict | None
    notes: tuple[str, ...]
    optimum: Optimum | None = None

    def _table(self) -> Columns:
        return self.verdict._table()

    @property
    def requirements(self) -> Requirements:
        return self.verdict.requirements

    @property
    def rows(self) -> tuple[RequirementCheck, ...]:
        """Results of the requirement check."""
        return self.verdict.rows

    @property
    def is_met(self) -> bool:
        """True if all requirements are met."""
        return self.verdict.is_met

    def to_dict(self) -> dict[str, Any]:
        """Return requirement table and conflict as plain data for JSON."""
        conflict = None
        if self.conflict is not None:
            conflict = asdict(self.conflict)
            for entry, alternative in zip(
                conflict["alternatives"], self.conflict.alternatives, strict=True
            ):
                entry["is_met"] = alternative.is_met
            for group in ("alone", "joint"):
                for entry, relaxation in zip(
                    conflict[group], getattr(self.conflict, group), strict=True
                ):
                    entry["relative_change"] = relaxation.relative_change
        data: dict[str, Any] = json_plain(
            {**self.verdict.to_dict(), "conflict": conflict, "notes": self.notes}
        )
        return data


@dataclass(frozen=True)
class SearchOptions:
    """Search options for the mirror optimisation of :func:`omnimirror.design_sensor`.

    Parameters
    ----------
    starts, seed
        Number of initial mirrors; the seed determines the third and later ones.
    resume
        File of finished starts, from which an interrupted search is resumed.
    on_iteration
        Callback of start and merit, called after each step.
    mode, image_radius_px
        As in :func:`omnimirror.evaluate`, for the merit and for limits of blur as constraints. The
        requirement table always refers to the real image.

    Examples
    --------
    >>> import omnimirror as om
    >>> sphere = om.load_sensor("paper-spherical")
    >>> requirements = om.requirements_like(sphere, optimise="worst_blur_deg", shape="polynomial:3")
    >>> design = om.design_sensor(requirements, search=om.SearchOptions(starts=1))
    >>> design.sensor.mirror.KIND, round(design.optimum.value, 3)
    ('even-polynomial', 0.635)
    """

    starts: int = 4
    seed: int = 0
    resume: str | Path | None = None
    on_iteration: Callable[[Progress], None] | None = None
    mode: BlurMode = "exact"
    image_radius_px: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        integer("starts", self.starts, 1)
        integer("seed", self.seed)


@validate_arguments
def design_sensor(
    requirements: Requirements,
    *,
    search: SearchOptions | None = None,
    on_progress: OnProgress | None = None,
    on_design: Callable[[Design], None] | None = None,
) -> Design:
    """Design a sensor: mirror, distance, lens and focus.

    With ``optimise`` in the requirements, the freeform mirror minimises that merit; limits are
    constraints of the search, and ranges are free variables. With a mapping or a family, the free
    parameters (ranges; the conic constant of an ellipsoid) maximise the smallest margin of the
    limits or, without limits, minimise the worst floored blur area. The focus is chosen by the
    limits of blur in the same manner, freely or within the range of ``focus_mm``, unless that is a
    number; without limits of blur it minimises the worst floored blur area.

    Parameters
    ----------
    requirements
        Requirements from :func:`omnimirror.load_requirements` or created in Python.
    search
        Search options of an optimised mirror.
    on_progress
        Callback of the number of finished steps, and None. The logger ``omnimirror.design`` reports
        the steps.
    on_design
        Callback for the design without relaxations, called before the search for relaxations. This
        search is run only if a requirement is missed. A KeyboardInterrupt ends it; the relaxations
        found until then are returned.

    Returns
    -------
    Design
        Sensor, one row for each requirement, and conflict.

    Raises
    ------
    OmnimirrorError
        If there is no feasible mirror for any values within the ranges.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(theta_max_deg=12),
    ... )
    >>> design = om.design_sensor(requirements)
    >>> design.is_met, round(design.sensor.mirror_distance_mm, 3), round(design.sensor.rim_radius_px, 3)
    (True, 172.275, 512.0)
    """
    instance("requirements", requirements, Requirements, "requirements")
    on_step = step_reporter(on_progress)
    space, best = _solve(requirements, on_step, search or SearchOptions())
    design = design_of(best.verdict, best.notes, None, best.optimum)
    if on_design is not None:
        on_design(design)
    if best.verdict.is_met:
        return design
    others = (
        ()
        if requirements.mirror.optimise
        else find_alternatives(requirements, best.verdict, on_step)
    )
    return replace(design, conflict=find_conflict(space, best, on_step, others))


def _solve(
    requirements: Requirements, on_step: OnStep, search: SearchOptions
) -> tuple[Space, BestDesign]:
    """Return the design space and the best design, for the mirror type of the requirements."""
    if requirements.mirror.optimise is None:
        return _parameter_search.solve(requirements, on_step)
    problem = freeform.problem_of(requirements, search.mode, search.image_radius_px)

    def on_iteration(progress: Progress) -> None:
        on_step(f"start {progress.run + 1} of {progress.runs}, {progress.value:.4g}")
        if search.on_iteration is not None:
            search.on_iteration(progress)

    return freeform.solve(
        requirements,
        problem,
        starts=search.starts,
        seed=search.seed,
        resume=search.resume,
        on_iteration=on_iteration,
    )


def design_of(
    verdict: Verdict,
    notes: tuple[str, ...],
    conflict: Conflict | None = None,
    optimum: Optimum | None = None,
) -> Design:
    """Return a checked sensor as a design, with its notes added to the sensor file."""
    remarks = "; ".join(notes)
    text = "\n".join(
        part
        for part in (verdict.requirements.notes.strip(), remarks and f"Designed: {remarks}.")
        if part
    )
    sensor = replace(verdict.sensor, notes=text)
    return Design(sensor, verdict, conflict, notes, optimum)
