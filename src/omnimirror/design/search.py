"""What the requirements leave free, chosen so that the requirement kept worst is kept best.

Every candidate is judged by the largest share by which a requirement is missed (below 0: kept); without
limits, by its worst floored blur area. A coarse grid of the ranges finds the valley, the simplex of
Nelder and Mead its bottom.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import OmnimirrorError
from .assessment import SEARCHED, Row, assess, evaluated
from .making import Choice, Made, given, make
from .requirements import Requirements

Array = NDArray[np.float64]

GRID = {1: 9, 2: 5, 3: 4, 4: 3, 5: 3}  # points per free number, by how many are free
NOT_TO_BE_HAD = 1e6  # added where nothing but blur is to be made least, and what is given does not fit
POLISH = 30  # candidates of the simplex, per free number


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
        angles = np.linspace(made.field_from_deg, made.sensor.field_deg[1], SEARCHED)
        return max(float(r.floored_area_deg2.max()) for r in evaluated(self.requirements, made, angles))

    def best(self) -> Candidate:
        """The best candidate.

        Raises
        ------
        OmnimirrorError
            No candidate can be made; with the reason of the one in the middle.
        """
        base = self.middle()
        if not self.free:
            return self.judge(base)
        judged = _Memory(self, base)
        for point in product(np.linspace(0.0, 1.0, GRID[len(self.free)]), repeat=len(self.free)):
            judged(np.array(point))
        if judged.best is None:
            return self.judge(base)  # says why
        judged.polish(POLISH * len(self.free))
        return judged.best

    def keeping(self, start: Choice, most: int) -> Candidate:
        """A candidate near a choice that meets everything, or else the best of so many for each free number.

        Raises
        ------
        OmnimirrorError
            The choice itself cannot be made.
        """
        first = self.judge(start)
        if first.is_met or not self.free:
            return first
        judged = _Memory(self, start, first)
        with suppress(_Kept):
            judged.polish(most * len(self.free), stop=True)
        return judged.best or first


class _Kept(Exception):
    """A candidate meets everything; there is no need to look further."""


class _Memory:
    """Candidates by where they lie in the unit cube of the free numbers; keeps the best one."""

    def __init__(self, search: Search, base: Choice, best: Candidate | None = None) -> None:
        self.search, self.base, self.best, self.stop = search, base, best, False
        self.place = np.array([self._share(name) for name in search.free])

    def _share(self, name: str) -> float:
        span, value = self.search.spans[name], getattr(self.base, name)
        assert span is not None
        return float(np.clip((value - span[0]) / (span[1] - span[0]), 0.0, 1.0))

    def __call__(self, point: Array) -> float:
        point = np.clip(point, 0.0, 1.0)
        numbers = {}
        for name, share in zip(self.search.free, point, strict=True):
            low, high = self.search.spans[name] or (0.0, 0.0)
            numbers[name] = float(low + share * (high - low))
        try:
            found = self.search.judge(replace(self.base, **numbers))
        except OmnimirrorError:
            return np.inf
        if self.best is None or found.badness < self.best.badness:
            self.best, self.place = found, point
        if self.stop and found.is_met:
            self.best = found
            raise _Kept
        return found.badness

    def polish(self, most: int, stop: bool = False) -> None:
        """The simplex from the best place, up to so many candidates; ``stop`` at the first that meets everything."""
        from scipy.optimize import minimize

        self.stop = stop
        size = 0.5 / GRID[len(self.search.free)]
        steps = np.diag(np.where(self.place > 0.5, -size, size))
        corners = np.vstack([self.place, self.place + steps])
        options = {"initial_simplex": corners, "maxfev": most, "xatol": 1e-6, "fatol": 1e-9}
        minimize(self, self.place, method="Nelder-Mead", bounds=[(0, 1)] * self.place.size, options=options)
