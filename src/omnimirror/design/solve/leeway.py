"""What may move of a choice, and by what share each requirement is missed wherever it has moved to.

The free numbers, numbers that were given but may give, and the focus are the coordinates of a point; a sequence of
linear programmes (:mod:`.minimax`) then makes what it is asked to as small as can be. Numbers that are lengths, angles
and F-numbers count by their logarithms, so that steps of .1 are all of one size. Mirrors are taken as they are before
they are fitted; what a fit adds at some point is taken for the same at all others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import OmnimirrorError
from ...numerics.lazy import cached_property
from ...numerics.minimax import Minimum, Rows, Values, solve_minimax
from ..criteria.ranges import ends_or_none, is_free
from ..criteria.requirements import Requirements
from ..optimise.objective import IMAGE
from ..optimise.problem import OF_LENS
from .candidates import Choice, Made, focusing, make
from .focusing import Focusing, places_of
from .verdict import given_rows

Array = NDArray[np.float64]

POINTS = 91  # of the mirror, in each part of the field that is judged
STEP = 1e-6  # of derivatives
CLOSE = 1e-6
STEPS = 25  # at most, of a search
KEPT = 1e-6  # a share this little missed is none
LINEAR = ("conic", "omega_min_deg")  # what may be 0 or below

Key = int | str
"""A limit by its number, another requirement by its name."""

AREA = "floored_area"
"""What stands for the limits where there are none: the logarithm of the floored blur area."""


@dataclass(frozen=True)
class Goal:
    """What is to give as little as can be: requirements by their keys, and numbers with what was asked of them and the
    sign of the way in which they may go. Whatever is not named is kept."""

    keys: tuple[Key, ...]
    numbers: tuple[tuple[str, float, int], ...] = ()


@dataclass(frozen=True)
class Found:
    """Where a goal was reached: the choice with its focus, and the largest share that gives."""

    choice: Choice
    focus_mm: float
    share: float
    y: Array


@dataclass(frozen=True)
class Leeway:
    """The choices that can be reached from one of them.

    Attributes
    ----------
    base
        The numbers that stay.
    spans
        Between which values each of the others may move.
    near
        The sensor of the base, whose size is the unit of the focus.
    """

    requirements: Requirements
    base: Choice
    spans: dict[str, tuple[float, float]]
    near: Made

    # -- points ------------------------------------------------------------------------------------

    @cached_property
    def _unit(self) -> float:
        """Of places in focus: over the distance from the lens to the rim, or the rim radius of a telecentric one."""
        sensor = self.near.sensor
        m = sensor.mirror_distance_mm
        return sensor.mirror.rim_radius_mm if sensor.lens.TELECENTRIC else 1 / m

    @property
    def _has_focus(self) -> bool:
        asked = self.requirements.lens.focus_mm
        return asked is None or is_free(asked)

    def _place(self, focus_mm: float) -> float:
        return -focus_mm if self.near.sensor.lens.TELECENTRIC else 1 / focus_mm

    def point(self, choice: Choice, focus_mm: float) -> Array:
        """A choice as a point."""
        y = [_inner(name, getattr(choice, name)) for name in self.spans]
        return np.array([*y, self._place(focus_mm) / self._unit] if self._has_focus else y)

    def choice(self, y: Array) -> tuple[Choice, float | None]:
        """The numbers of a point, and its focus; None where that is given."""
        moved = zip(self.spans.items(), y, strict=False)
        numbers = {name: float(np.clip(_outer(name, v), *span)) for (name, span), v in moved}
        focus = self._place(y[-1] * self._unit) if self._has_focus else None
        return replace(self.base, **numbers), focus

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        low, high = ([_inner(name, span[i]) for name, span in self.spans.items()] for i in (0, 1))
        if self._has_focus:
            ends = places_of(self.near.sensor.lens)
            span = ends_or_none(self.requirements.lens.focus_mm)
            if span is not None:
                asked = sorted(self._place(v) for v in span)
                ends = float(np.clip(asked[0], *ends)), float(np.clip(asked[1], *ends))
            low, high = [*low, ends[0] / self._unit], [*high, ends[1] / self._unit]
        return np.array(low), np.array(high)

    # -- what is missed ----------------------------------------------------------------------------

    def missed(self, y: Array, fitted: bool = False) -> dict[Key, Array]:
        """By what share each requirement is missed at a point, as rows of which each is smooth.

        Raises
        ------
        OmnimirrorError
            There is no such sensor.
        """
        choice, focus = self.choice(y)
        asked = _as_chosen(self.requirements, choice, focus)
        made = make(asked if fitted else unfitted(asked), choice)
        looked: Focusing = focusing(asked, choice, made, POINTS)
        v = np.full((1, 1), self._place(made.sensor.lens.focus_distance_mm))
        found: dict[Key, Array] = {}
        with np.errstate(all="ignore"):
            for i, limit in enumerate(self.requirements.limits):
                found[i] = np.nan_to_num(np.atleast_2d(limit.excess(looked.field(v, limit)))[0], nan=-1.0)
            if not self.requirements.limits:
                found[AREA] = np.atleast_2d(looked.field(v).log_area)[0]
        for row in given_rows(asked, choice, made):
            if row.name in self._judged:
                found[row.name] = np.array([row.shortfall])
        return found

    @cached_property
    def _judged(self) -> set[str]:
        """Requirements besides the limits that a choice can miss."""
        lens = self.requirements.lens
        names = {"omega_min_deg"}
        if None not in (self.base.theta_max_deg, self.base.focal_length_mm):
            names.add(IMAGE)
        follow = {name for name in OF_LENS if getattr(self.base, name) is None and getattr(lens, name) is not None}
        return names | follow

    # -- searches ----------------------------------------------------------------------------------

    def reach(self, y: Array, goal: Goal) -> Found | None:
        """The point near y where a goal gives least; None where something else is missed there."""
        added: dict[Key, float] = {}
        for _ in range(3 if self.requirements.mirror.fit else 1):
            found = self._searched(y, goal, added)
            if found.violation > KEPT:
                return None
            y = found.y
            if self.requirements.mirror.fit:
                try:
                    added = self._added(y)
                except OmnimirrorError:
                    return None
        choice, focus = self.choice(y)
        return Found(choice, np.nan if focus is None else focus, found.value, y)

    def _added(self, y: Array) -> dict[Key, float]:
        """What the fit adds to each requirement's worst row."""
        plain, fitted = self.missed(y), self.missed(y, fitted=True)
        return {key: float(fitted[key].max() - rows.max()) for key, rows in plain.items()}

    def _searched(self, y: Array, goal: Goal, added: dict[Key, float]) -> Minimum:
        def values(y: Array) -> Values:
            try:
                missed = {key: rows + added.get(key, 0.0) for key, rows in self.missed(y).items()}
            except OmnimirrorError:
                return Values(np.array([np.nan]), np.array([np.nan]))
            given = [missed[key] for key in goal.keys]
            given += [np.array([self._moved(y, *number)]) for number in goal.numbers]
            kept = [rows for key, rows in missed.items() if key not in goal.keys]
            return Values(np.concatenate(given), np.concatenate([*kept, np.array([-1.0])]))

        def rows(y: Array) -> Rows:
            here = values(y)
            objective, constraints = [], []
            for i in range(y.size):
                step = np.zeros(y.size)
                step[i] = STEP if y[i] + STEP <= self.bounds[1][i] else -STEP
                there = values(y + step)
                objective.append((there.objective - here.objective) / step[i])
                constraints.append((there.constraints - here.constraints) / step[i])
            return Rows(*here, np.nan_to_num(np.stack(objective, axis=1)), np.nan_to_num(np.stack(constraints, axis=1)))

        return solve_minimax(values, rows, y, self.bounds, tolerance=CLOSE, most_steps=STEPS)

    def _moved(self, y: Array, name: str, asked: float, sign: int) -> float:
        """By what share a number has moved."""
        return sign * (_outer(name, y[list(self.spans).index(name)]) - asked) / abs(asked)


def _inner(name: str, value: float) -> float:
    return float(value) if name in LINEAR else float(np.log(value))


def _outer(name: str, value: float) -> float:
    return float(value) if name in LINEAR else float(np.exp(value))


def unfitted(requirements: Requirements) -> Requirements:
    if requirements.mirror.fit is None:
        return requirements
    return replace(requirements, mirror=replace(requirements.mirror, fit=None))


def _as_chosen(requirements: Requirements, choice: Choice, focus_mm: float | None) -> Requirements:
    """The requirements with the field and the focus of a choice, where they give them."""
    field = {"omega_min_deg": choice.omega_min_deg, "omega_max_deg": choice.omega_max_deg}
    lens = requirements.lens if focus_mm is None else replace(requirements.lens, focus_mm=focus_mm)
    return replace(requirements, field=replace(requirements.field, **field), lens=lens)
