"""What the requirements leave free, chosen so that the requirement kept worst is kept best.

Every candidate is judged by the largest share by which a requirement is missed (below 0: kept); without
limits, by its worst floored blur area. A coarse grid of the ranges finds the valley, linear programmes its bottom.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from ...errors import OmnimirrorError
from ...numerics.lazy import cached_property
from ..criteria.requirements import Requirements
from .candidates import Choice, Made, given, make
from .leeway import AREA, Goal, Key, Leeway
from .verdict import SEARCHED, Row, assess, evaluated

GRID = {1: 9, 2: 4, 3: 3, 4: 2, 5: 2}  # points per free number, by how many are free
NOT_TO_BE_HAD = 1e6  # added where nothing but blur is to be made least, and what is given does not fit


class Candidate(NamedTuple):
    """A choice, made and judged; ``badness`` is what the search makes least."""

    choice: Choice
    made: Made
    rows: list[Row]
    badness: float

    @property
    def is_met(self) -> bool:
        """Whether every requirement is met."""
        return all(row.is_met for row in self.rows)

    @property
    def worst(self) -> float:
        """The largest share by which a requirement is missed; 0 or below where all are met."""
        return max((row.shortfall for row in self.rows if not row.is_met), default=0.0)


@dataclass(frozen=True)
class Search:
    """The candidates that requirements leave to choose from."""

    requirements: Requirements

    @cached_property
    def spans(self) -> dict[str, tuple[float, float] | None]:
        return given(self.requirements)

    @cached_property
    def free(self) -> list[str]:
        """Entries of a choice that have a range."""
        return [name for name, span in self.spans.items() if span is not None and span[0] < span[1]]

    def middle(self) -> Choice:
        """The choice in the middle of all ranges."""
        return Choice(**{name: None if s is None else (s[0] + s[1]) / 2 for name, s in self.spans.items()})  # type: ignore[arg-type]

    def judge(self, choice: Choice, angles: int = SEARCHED) -> Candidate:
        """Make a choice and judge it; raises OmnimirrorError where there is no such sensor."""
        made = make(self.requirements, choice)
        rows = assess(self.requirements, choice, made, angles)
        return Candidate(choice, made, rows, self._badness(made, rows))

    def _badness(self, made: Made, rows: list[Row]) -> float:
        missed = [row.shortfall for row in rows if not row.is_limit and not row.is_met]
        limits = [row.shortfall for row in rows if row.is_limit]
        if missed or limits:
            return max(missed + limits) + (0.0 if limits else NOT_TO_BE_HAD)
        angles = np.linspace(*made.counted.part()[:2], SEARCHED)
        return max(float(r.floored_area_deg2.max()) for r in evaluated(self.requirements, made, angles))

    def best(self) -> Candidate:
        """The best candidate.

        Raises
        ------
        OmnimirrorError
            No candidate can be made; with the reason of the one in the middle.
        """
        middle = self.middle()
        if not self.free:
            return self.judge(middle)
        tried = [found for choice in [middle, *self._grid(middle)] if (found := self.judged(choice)) is not None]
        if not tried:
            return self.judge(middle)  # says why
        return self.polished(min(tried, key=lambda c: c.badness))

    def polished(self, start: Candidate) -> Candidate:
        """The best candidate near one, by what the requirements leave free."""
        spans = {name: self.spans[name] or (0.0, 0.0) for name in self.free}
        leeway = Leeway(self.requirements, start.choice, spans, start.made)
        y = leeway.point(start.choice, start.made.sensor.lens.focus_distance_mm)
        keys: tuple[Key, ...] = tuple(range(len(self.requirements.limits))) or (AREA,)
        found = leeway.reach(y, Goal(keys))
        if found is None:  # something given is missed, and gives as little as a limit
            found = leeway.reach(y, Goal(tuple(leeway.missed(y))))
        better = None if found is None else self.judged(found.choice)
        return better if better is not None and better.badness < start.badness else start

    def _grid(self, base: Choice) -> Iterator[Choice]:
        """Choices all over the ranges, in equal ratios where that can be."""
        values = [ratios(self.spans[name] or (0.0, 0.0), GRID[len(self.free)]) for name in self.free]
        for numbers in product(*values):
            yield replace(base, **dict(zip(self.free, numbers, strict=True)))

    def judged(self, choice: Choice) -> Candidate | None:
        """A choice judged, or None where there is no such sensor."""
        try:
            return self.judge(choice)
        except OmnimirrorError:
            return None


def ratios(span: tuple[float, float], count: int) -> list[float]:
    """Numbers from one end of a range to the other, in equal ratios, or in equal steps past 0.

    >>> [round(v, 6) for v in ratios((4.0, 16.0), 3)], ratios((-1.0, 1.0), 3)
    ([4.0, 8.0, 16.0], [-1.0, 0.0, 1.0])
    """
    spaced = np.geomspace if span[0] > 0 else np.linspace
    return [float(v) for v in spaced(*span, count)]
