"""A sensor from requirements: the best that the ranges allow, judged, and what conflicts if it falls short."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...lenses import BlurMode, Perspective
from ...sensor import Sensor
from ..criteria.merits import merit_named
from ..criteria.ranges import ends, is_free
from ..criteria.requirements import Requirements
from ..optimise.optimiser import Optimum, Progress
from ..optimise.problem import DesignProblem
from .candidates import Choice
from .freeform import judged_sensor, problem_of, shape
from .freeform_relaxation import find_concessions
from .range_search import Search
from .relaxation import Conflict, find_conflict
from .verdict import Row, assess, mapping_deviation_px


@dataclass(frozen=True)
class Design:
    """What :func:`design_sensor` answers.

    Attributes
    ----------
    requirements
    sensor
        The best that was found, focused; an ordinary sensor.
    rows
        Requirement by requirement.
    conflict
        Why not all are met, and what would have to give; None where they are.
    notes
        What was chosen where the requirements left a choice.
    optimum
        How an optimised mirror was found; None for other mirrors, and where no design keeps everything.
    """

    requirements: Requirements
    sensor: Sensor
    rows: tuple[Row, ...]
    conflict: Conflict | None
    notes: tuple[str, ...]
    optimum: Optimum | None = None

    @property
    def is_met(self) -> bool:
        """Whether every requirement is met."""
        return all(row.is_met for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """The table and the conflict as plain data, for JSON."""
        rows = [{**asdict(row), "margin": row.margin, "is_met": row.is_met} for row in self.rows]
        conflict = None
        if self.conflict is not None:
            conflict = asdict(self.conflict)
            for group in ("alone", "joint"):
                for entry, relaxation in zip(conflict[group], getattr(self.conflict, group), strict=True):
                    entry["share"] = relaxation.share
        data = {"name": self.sensor.name, "is_met": self.is_met, "requirements": rows, "conflict": conflict}
        plain: dict[str, Any] = _plain({**data, "notes": self.notes})
        return plain


def design_sensor(
    requirements: Requirements, on_step: Callable[[str], None] | None = None, *, search: SearchOptions | None = None
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
    >>> wanted = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(theta_max_deg=12),
    ... )
    >>> design = om.design_sensor(wanted)
    >>> design.is_met, round(design.sensor.mirror_distance_mm, 3), round(design.sensor.rim_radius_px, 3)
    (True, 172.275, 512.0)
    """
    say = on_step or (lambda words: None)
    if requirements.mirror.optimise is not None:
        return _optimised(requirements, say, search or SearchOptions())
    return _chosen(requirements, say)


def _chosen(requirements: Requirements, say: Callable[[str], None]) -> Design:
    """With a mapping or a family."""
    search = Search(requirements)
    if search.free:
        say(f"choosing {', '.join(search.free)}")
    best = search.best()
    rows = tuple(assess(requirements, best.choice, best.made))
    best = best._replace(rows=list(rows))
    conflict = find_conflict(search, best, lambda name: say(f"what if {name} gives"))
    notes = _notes(search, best.choice, best.made.sensor, best.made.notes)
    deviation = mapping_deviation_px(requirements, best.choice, best.made)
    if deviation is not None:
        notes = (*notes, f"the fitted mirror departs from its mapping by up to {deviation:.3g} px")
    return Design(requirements, _noted(requirements, best.made.sensor, notes), rows, conflict, notes)


def _optimised(requirements: Requirements, say: Callable[[str], None], search: SearchOptions) -> Design:
    """With a mirror of free form."""
    problem = search.changed(problem_of(requirements))
    said = search.on_progress or (lambda p: say(f"start {p.run + 1} of {p.runs}, {p.value:.4g}"))
    shaped = shape(requirements, problem, search.starts, search.seed, search.resume, said)
    notes = free_form_notes(problem, shaped.made.sensor)
    conflict = find_concessions(requirements, shaped, lambda name: say(f"what if {name} gives"))
    if shaped.optimum is None:
        notes = (f"no mirror of {problem.terms} numbers was found that keeps everything: this one misses least", *notes)
    else:
        merit = merit_named(shaped.optimum.merit)
        notes = (f"{merit.quantity.title}: {shaped.optimum.value:.5g} {merit.quantity.unit}".rstrip(), *notes)
    sensor = replace(_noted(requirements, shaped.made.sensor, notes), name=requirements.name)
    return Design(requirements, sensor, tuple(shaped.rows), conflict, notes, shaped.optimum)


def assessed(requirements: Requirements, sensor: Sensor, notes: tuple[str, ...] = ()) -> Design:
    """A sensor from elsewhere, such as from a front, requirement by requirement."""
    _, made, rows = judged_sensor(requirements, sensor)
    return Design(requirements, _noted(requirements, made.sensor, notes), tuple(rows), None, notes)


@dataclass(frozen=True)
class SearchOptions:
    """How an optimised mirror is searched for, see :func:`~omnimirror.design.optimise.optimiser.optimise`.

    ``mode`` and ``image_radius_px`` are taken as :func:`omnimirror.evaluate` takes them; the merit, and limits of blur
    while they are kept, are computed so. The table is always that of the real image.
    """

    starts: int = 4
    seed: int = 0
    resume: str | Path | None = None
    on_progress: Callable[[Progress], None] | None = None
    mode: BlurMode = "exact"
    image_radius_px: float | None = None

    def changed(self, problem: DesignProblem) -> DesignProblem:
        """A problem computed as these options say."""
        return replace(problem, mode=self.mode, image_radius_px=self.image_radius_px)


def _noted(requirements: Requirements, sensor: Sensor, notes: tuple[str, ...]) -> Sensor:
    said = "; ".join(notes)
    text = "\n".join(part for part in (requirements.notes.strip(), said and f"Designed: {said}.") if part)
    return replace(sensor, notes=text)


def free_form_notes(problem: DesignProblem, sensor: Sensor) -> tuple[str, ...]:
    """What an optimiser chose besides the shape, in words."""
    lens, notes = sensor.lens, []
    reached = {
        "rim_radius_mm": sensor.mirror.rim_radius_mm,
        "f_number": getattr(lens, "f_number", None) or lens.image_f_number(),
    }
    if isinstance(lens, Perspective):
        reached |= {
            "focal_length_mm": lens.focal_length_mm,
            "theta_max_deg": float(np.degrees(sensor.meridian.theta_max)),
        }
    for name, value in reached.items():
        asked = getattr(problem, name)
        if asked is None:
            notes.append(f"{name} = {value:.6g}, where the rim fills the imager")
        elif name in problem.free:
            notes.append("{} = {:.6g}, chosen between {:g} and {:g}".format(name, value, *ends(asked)))
    if problem.is_telecentric:
        notes.append(f"the telecentric lens has to be as wide as the mirror, {2 * reached['rim_radius_mm']:g} mm")
    if not isinstance(problem.focus_mm, float):
        notes.append(f"focused at {lens.focus_distance_mm:.5g} mm")
    return tuple(notes)


def _notes(search: Search, choice: Choice, sensor: Sensor, made: tuple[str, ...]) -> tuple[str, ...]:
    """What was chosen, in words."""
    notes = [*made]
    for name in search.free:
        low, high = search.spans[name] or (0.0, 0.0)
        notes.append(f"{name} = {getattr(choice, name):.6g}, chosen between {low:g} and {high:g}")
    if search.spans["theta_max_deg"] is None:
        theta = float(np.degrees(sensor.meridian.theta_max))
        notes.append(f"theta_max_deg = {theta:.6g}, where the rim fills the imager")
    elif search.spans["focal_length_mm"] is None and isinstance(sensor.lens, Perspective):
        notes.append(f"focal_length_mm = {sensor.lens.focal_length_mm:.6g}, where the rim fills the imager")
    asked = search.requirements.lens.focus_mm
    if asked is None or is_free(asked):
        notes.append(f"focused at {sensor.lens.focus_distance_mm:.5g} mm, {_focus_by(search.requirements)}")
    return tuple(notes)


def _focus_by(requirements: Requirements) -> str:
    """What the focus was chosen for."""
    if any(limit.of.is_sharpness for limit in requirements.limits):
        return "where the limits of blur are kept best"
    return "where the worst floored blur area is least"


def _plain(value: Any) -> Any:
    """The same data with tuples as lists, and numbers that JSON cannot hold as words."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
