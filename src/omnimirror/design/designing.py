"""A sensor from requirements: the best that the ranges allow, judged, and what conflicts if it falls short."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..lenses import Perspective
from ..sensor import Sensor
from .assessment import Row, assess, mapping_deviation_px
from .conflicts import Conflict, find_conflict
from .making import Choice
from .requirements import Requirements
from .search import Search


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
    """

    requirements: Requirements
    sensor: Sensor
    rows: tuple[Row, ...]
    conflict: Conflict | None
    notes: tuple[str, ...]

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


def design_sensor(requirements: Requirements, on_step: Callable[[str], None] | None = None) -> Design:
    """Design a sensor: mirror, distance, lens and focus.

    What the requirements leave free (ranges; the conic constant of an ellipsoid) is chosen so that the limit
    kept worst is kept best, or without limits so that the worst floored blur area is least. The lens is focused
    where that is least, unless ``focus_mm`` is given.

    Parameters
    ----------
    on_step
        Called with a few words before each longer step.

    Raises
    ------
    OmnimirrorError
        There is no such mirror at all, whatever gives among the ranges.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.design.requirements import parse_requirements
    >>> design = om.design_sensor(parse_requirements('''
    ... field.omega_max_deg = 135
    ... [mirror]
    ... mapping = "equidistant"
    ... rim_radius_mm = 43.9
    ... [lens]
    ... theta_max_deg = 12
    ... '''))
    >>> design.is_met, round(design.sensor.mirror_distance_mm, 3), round(design.sensor.rim_radius_px, 3)
    (True, 172.275, 512.0)
    """
    say = on_step or (lambda words: None)
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
    said = "; ".join(notes)
    text = "\n".join(part for part in (requirements.notes.strip(), said and f"Designed: {said}.") if part)
    return Design(requirements, replace(best.made.sensor, notes=text), rows, conflict, notes)


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
    if search.requirements.lens.focus_mm is None:
        notes.append(f"focused at {sensor.lens.focus_distance_mm:.5g} mm, where the worst floored blur area is least")
    return tuple(notes)


def _plain(value: Any) -> Any:
    """The same data with tuples as lists, and numbers that JSON cannot hold as words."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
