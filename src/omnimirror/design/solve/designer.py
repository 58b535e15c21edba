"""A sensor from requirements: the best that the ranges allow, judged, and what conflicts if it falls short."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...base.arguments import check_fields, checked, instance, whole
from ...base.files import json_plain
from ...optics.lenses import BlurMode
from ...optics.sensor import Sensor
from ..criteria.requirements import Requirements
from ..optimise.optimiser import Optimum, Progress
from . import freeform, range_search
from .alternatives import find_alternatives
from .relaxation import Conflict, find_conflict
from .space import BestDesign, Say, Space
from .verdict import Judgement, Verdict


@dataclass(frozen=True)
class Design:
    """What :func:`design_sensor` answers.

    Attributes
    ----------
    sensor
        The best that was found, focused; an ordinary sensor.
    verdict
        Requirement by requirement.
    conflict
        Why not all are met, and what would have to give; None where they are.
    notes
        What was chosen where the requirements left a choice.
    optimum
        How an optimised mirror was found; None for other mirrors, and where no design keeps everything.
    """

    sensor: Sensor
    verdict: Verdict
    conflict: Conflict | None
    notes: tuple[str, ...]
    optimum: Optimum | None = None

    @property
    def requirements(self) -> Requirements:
        return self.verdict.requirements

    @property
    def rows(self) -> tuple[Judgement, ...]:
        """Requirement by requirement."""
        return self.verdict.rows

    @property
    def is_met(self) -> bool:
        """Whether every requirement is met."""
        return self.verdict.is_met

    def to_dict(self) -> dict[str, Any]:
        """The table and the conflict as plain data, for JSON."""
        conflict = None
        if self.conflict is not None:
            conflict = asdict(self.conflict)
            for entry, alternative in zip(conflict["alternatives"], self.conflict.alternatives, strict=True):
                entry["is_met"] = alternative.is_met
            for group in ("alone", "joint"):
                for entry, relaxation in zip(conflict[group], getattr(self.conflict, group), strict=True):
                    entry["share"] = relaxation.share
        data: dict[str, Any] = json_plain({**self.verdict.to_dict(), "conflict": conflict, "notes": self.notes})
        return data


@dataclass(frozen=True)
class SearchOptions:
    """How an optimised mirror is searched for by :func:`omnimirror.design_sensor`.

    Parameters
    ----------
    starts, seed
        From how many mirrors to start; the third and later ones are drawn with the seed.
    resume
        A file that keeps finished starts; a search that was stopped goes on where it was.
    on_progress
        Told of every step.
    mode, image_radius_px
        As :func:`omnimirror.evaluate` takes them: the merit, and limits of blur while they are kept, are computed so.
        The table is always that of the real image.

    Examples
    --------
    >>> import omnimirror as om
    >>> sphere = om.load_sensor("paper-spherical")
    >>> asked = om.requirements_like(sphere, optimise="worst_blur_deg", shape="polynomial:3")
    >>> design = om.design_sensor(asked, search=om.SearchOptions(starts=1))
    >>> design.sensor.mirror.KIND, round(design.optimum.value, 3)
    ('even-polynomial', 0.635)
    """

    starts: int = 4
    seed: int = 0
    resume: str | Path | None = None
    on_progress: Callable[[Progress], None] | None = None
    mode: BlurMode = "exact"
    image_radius_px: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        whole("starts", self.starts, 1)
        whole("seed", self.seed)


@checked
def design_sensor(
    requirements: Requirements,
    on_step: Callable[[str], None] | None = None,
    *,
    search: SearchOptions | None = None,
    on_design: Callable[[Design], None] | None = None,
) -> Design:
    """Design a sensor: mirror, distance, lens and focus.

    With ``optimise`` in the requirements the mirror is of free form and has the least of that merit; limits are
    constraints of the search, and ranges are left to it. With a mapping or a family, what the requirements leave
    free (ranges; the conic constant of an ellipsoid) is chosen so that the limit kept worst is kept best, or without
    limits so that the worst floored blur area is least. The lens is focused likewise, anywhere or within the range of
    ``focus_mm``, unless that is one number: where the limit of blur kept worst is kept best, without limits of blur
    where the worst floored blur area is least.

    Parameters
    ----------
    requirements
        From :func:`omnimirror.load_requirements`, or made in Python.
    on_step
        Called with a few words before each longer step.
    search
        How an optimised mirror is searched for.
    on_design
        Called with the design, still without relaxations, before the search for relaxations starts. This search takes
        place only if a requirement is missed. A KeyboardInterrupt ends it; the relaxations found until then are
        returned.

    Returns
    -------
    Design
        The sensor, a row for each requirement, and what conflicts.

    Raises
    ------
    OmnimirrorError
        There is no such mirror at all, whatever gives among the ranges.

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
    say = on_step or (lambda words: None)
    space, best = _solve(requirements, say, search or SearchOptions())
    design = design_of(best.verdict, best.notes, None, best.optimum)
    if on_design is not None:
        on_design(design)
    others = () if requirements.mirror.optimise else find_alternatives(requirements, best.verdict, say)
    return replace(design, conflict=find_conflict(space, best, say, others))


def _solve(requirements: Requirements, say: Say, search: SearchOptions) -> tuple[Space, BestDesign]:
    """The best design, and those around it, by the way in which its mirror is made."""
    if requirements.mirror.optimise is None:
        return range_search.solve(requirements, say)
    problem = freeform.problem_of(requirements, search.mode, search.image_radius_px)
    said = search.on_progress or (lambda p: say(f"start {p.run + 1} of {p.runs}, {p.value:.4g}"))
    return freeform.solve(
        requirements, problem, starts=search.starts, seed=search.seed, resume=search.resume, on_progress=said
    )


def design_of(
    verdict: Verdict, notes: tuple[str, ...], conflict: Conflict | None = None, optimum: Optimum | None = None
) -> Design:
    """A sensor that was judged, with notes of how it was made in its file."""
    said = "; ".join(notes)
    text = "\n".join(part for part in (verdict.requirements.notes.strip(), said and f"Designed: {said}.") if part)
    sensor = replace(verdict.sensor, notes=text)
    return Design(sensor, verdict, conflict, notes, optimum)
