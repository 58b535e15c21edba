"""Optimisation of the free parameters of a mapping or a family for the largest margin.

The cost of a candidate is its largest relative violation (negative if all requirements are met) or,
without limits, its worst floored blur area. Linear programmes start from points of a coarse grid
over the ranges until several of them agree. If some requirements are infeasible, the others are met
first (:mod:`.priorities`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...base.numerics.lazy import cached_property
from ...optics.lenses import GaussianLens
from ..criteria.field_angles import counted_field
from ..criteria.ranges import is_free
from ..criteria.requirements import Requirements
from ..optimise.objective import Key, Slack
from .candidates import Candidate, make, mapping_deviation_px
from .generated import AREA, SEARCHED, GeneratedSpace, free_of, ranges_of
from .priorities import is_more_met, meeting_the_others, told
from .space import BestDesign, Say
from .verdict import EDGE_PX, Verdict, evaluations, judge

GRID = {1: 9, 2: 4, 3: 3, 4: 2, 5: 2}  # grid points per free number, by their count
STARTS, RESTARTS = 12, 5  # searches from different starts, and restarts of a search at its end point
SAME, AGREEING = 1e-4, 3  # relative difference of equal costs; number of searches that have to agree
ENOUGH_IF_MET = 5  # searches after which a feasible candidate is accepted
NEAR_MISS = 0.05  # cost below which a derivative-free search follows
SIMPLEX, SIMPLEX_STEPS = 0.05, 60  # initial steps relative to the ranges; evaluations for each free number
GAIN, ROUGH_GAIN = 1e-4, 0.02  # smallest relative gains for a restart: of optima, of feasibility
INFEASIBLE = 1e6  # deg2, above any floored blur area; penalty for violated given values


class Ranked(NamedTuple):
    """Candidate with its requirement check; ``cost`` is the minimised quantity."""

    made: Candidate
    verdict: Verdict
    cost: float


@dataclass(frozen=True)
class RangeSearch:
    """Search over the free parameters of requirements."""

    requirements: Requirements

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float] | None]:
        """Return the ranges (low, high) of the candidate numbers; None if dependent."""
        return ranges_of(self.requirements)

    @cached_property
    def free(self) -> dict[str, tuple[float, float]]:
        """Return the ranges of the free numbers."""
        return free_of(self.ranges)

    def middle(self) -> Requirements:
        """Return the requirements settled at the centre of all ranges."""
        middles = {name: (s[0] + s[1]) / 2 for name, s in self.ranges.items() if s is not None}
        return self.requirements.changed(**middles)

    def judged(self, settled: Requirements) -> Ranked:
        """Return a checked candidate; raise OmnimirrorError if the sensor does not exist."""
        made = make(settled)
        verdict = judge(self.requirements, made.sensor, angles=SEARCHED)
        return Ranked(made, verdict, self._cost(verdict))

    def _cost(self, verdict: Verdict) -> float:
        missed = [row.shortfall for row in verdict.rows if not row.is_limit and not row.is_met]
        limits = [row.shortfall for row in verdict.limits]
        if missed or limits:
            return max(missed + limits) + (0.0 if limits else INFEASIBLE)
        low, high, _ = counted_field(self.requirements.field, verdict.sensor).part()
        results = evaluations(self.requirements, verdict.sensor, np.linspace(low, high, SEARCHED))
        return max(float(result.floored_area_deg2.max()) for result in results)

    def best(self, begin: Iterable[Requirements] = (), enough: float = -np.inf, starts: int | None = None) -> Ranked:
        """Return the best candidate of several searches from starts distributed over the ranges.

        Parameters
        ----------
        begin
            Settled requirements of earlier designs, the first starts.
        enough
            Cost at which the search may end.
        starts
            Maximum number of searches; by default the constants of this module.

        Raises
        ------
        OmnimirrorError
            No candidate exists; the message is that of the candidate at the centre.
        """
        middle = self.middle()
        if not self.free:
            return self.judged(middle)
        ends = list[Ranked]()
        for start in islice(self._starts(begin, middle), starts):
            found = self._followed(start, enough)
            ends.append(found)
            best = min(ends, key=lambda c: c.cost)
            agreeing = sum(c.cost - best.cost <= SAME * abs(best.cost) for c in ends)
            if best.cost <= enough or agreeing >= AGREEING or (best.cost <= 0 and len(ends) >= ENOUGH_IF_MET):
                break
        if not ends:
            return self.judged(middle)  # raises the reason
        return self._by_simplex(best) if starts is None and 0 < best.cost < NEAR_MISS else best

    def _starts(self, begin: Iterable[Requirements], middle: Requirements) -> Iterator[Ranked]:
        """Yield the starts of the searches: earlier designs, then alternately the best grid point
        and the one farthest from all previous starts.
        """
        yield from (found for settled in begin if (found := self._tried(settled)) is not None)
        rest = [found for settled in [middle, *self._grid(middle)] if (found := self._tried(settled)) is not None]
        rest.sort(key=lambda c: c.cost)
        places = [self._place(c) for c in rest]
        taken = list[NDArray[np.float64]]()
        for i in range(min(STARTS, len(rest))):
            at = 0
            if i % 2 and taken:
                at = int(np.argmax([min(float(np.abs(p - t).max()) for t in taken) for p in places]))
            taken.append(places.pop(at))
            yield rest.pop(at)

    def _place(self, candidate: Ranked) -> NDArray[np.float64]:
        """Return the position of a candidate within the free ranges, each scaled to 0 to 1."""
        entries = candidate.made.settled.tables()
        values = {**entries["field"], **entries["mirror"], **entries["lens"]}
        return np.array([(values[name] - low) / (high - low) for name, (low, high) in self.free.items()])

    def _by_simplex(self, start: Ranked) -> Ranked:
        """Refine a nearly feasible candidate by a derivative-free search until it is feasible.

        Linear programmes assume a constant effect of the fit between two fits; this search does
        not.
        """
        from scipy.optimize import minimize

        best, spans = start, np.array([*self.free.values()])
        settled = start.made.settled.changed(focus_mm=self.requirements.lens.focus_mm)

        def cost(place: NDArray[np.float64]) -> float:
            nonlocal best
            if best.cost <= 0:
                return INFEASIBLE
            numbers = spans[:, 0] + np.clip(place, 0.0, 1.0) * (spans[:, 1] - spans[:, 0])
            found = self._tried(settled.changed(**dict(zip(self.free, numbers.tolist(), strict=True))))
            if found is None:
                return INFEASIBLE
            best = min(best, found, key=lambda c: c.cost)
            return found.cost

        place = self._place(start)
        corners = [place, *(place + np.where(place < 0.5, SIMPLEX, -SIMPLEX) * unit for unit in np.eye(place.size))]
        options = {"initial_simplex": np.array(corners), "maxfev": SIMPLEX_STEPS * place.size, "xatol": 1e-6,
                   "fatol": 1e-7}  # fmt: skip
        minimize(cost, place, method="Nelder-Mead", bounds=[(0.0, 1.0)] * place.size, options=options)
        return best

    def _followed(self, start: Ranked, enough: float) -> Ranked:
        """Follow one start to its optimum, with restarts while the cost decreases."""
        least_gain = GAIN if np.isinf(enough) else ROUGH_GAIN
        for _ in range(RESTARTS):
            if start.cost <= enough:
                break
            found = self._polished(start)
            gain = start.cost - found.cost
            start = found
            if gain <= least_gain * abs(found.cost):
                break
        return start

    def space(self, found: Ranked) -> GeneratedSpace:
        """Return the design space around a candidate."""
        return GeneratedSpace(self.requirements, found.made.settled, self.free, found.made.sensor, found_from_scratch)

    def _polished(self, start: Ranked) -> Ranked:
        """Return the best candidate near a given one over the free parameters."""
        space = self.space(start)
        point = space.point(start.made.settled, start.made.sensor)
        limits: tuple[Key, ...] = tuple(range(len(self.requirements.limits))) or (AREA,)
        found = space.reach(point, Slack(limits))
        if found is None:  # a given value is violated: treat it as a limit
            found = space.reach(point, Slack(tuple(space.missed(point))))
        if found is None:
            return start
        # Refocusing can leave the optimum: the focus of the search is also evaluated.
        settled = (space.made_at(found.point), space.settled_at(found.point))
        tried = (self._tried(requirements) for requirements in settled)
        return min([start, *(t for t in tried if t is not None)], key=lambda t: t.cost)

    def _grid(self, base: Requirements) -> Iterator[Requirements]:
        """Yield settled requirements on a grid over the ranges, in equal ratios if possible."""
        values = [ratios(span, GRID[len(self.free)]) for span in self.free.values()]
        for numbers in product(*values):
            yield base.changed(**dict(zip(self.free, numbers, strict=True)))

    def _tried(self, settled: Requirements) -> Ranked | None:
        """Return a checked candidate, or None if the sensor does not exist."""
        try:
            return self.judged(settled)
        except OmnimirrorError:
            return None


def solve(requirements: Requirements, say: Say = lambda words: None) -> tuple[GeneratedSpace, BestDesign]:
    """Return the best candidate and its design space.

    Raises
    ------
    OmnimirrorError
        Mirror that does not exist.
    """
    search = RangeSearch(requirements)
    if search.free:
        say(f"choosing {', '.join(search.free)}")
    found = search.best()
    space = search.space(found)
    best = _design(search, space, found.made)
    for point in meeting_the_others(space, best.point, best.verdict, say):
        try:
            other = _design(search, space, make(space.settled_at(point)))
        except OmnimirrorError:
            continue
        if is_more_met(other.verdict, best.verdict):
            return space, replace(other, notes=(told(other.verdict, best.verdict), *other.notes))
    return space, best


def found_from_scratch(
    requirements: Requirements, begin: Iterable[Requirements] = (), starts: int | None = None
) -> Candidate | None:
    """Return the candidate of a search, if feasible; ``begin`` contains earlier designs.

    Raises
    ------
    OmnimirrorError
        Mirror that does not exist.
    """
    found = RangeSearch(requirements).best(begin, enough=0.0, starts=starts)
    return found.made if judge(requirements, found.made.sensor).is_met else None


def _design(search: RangeSearch, space: GeneratedSpace, made: Candidate) -> BestDesign:
    """Return a checked candidate with its point in the design space."""
    verdict = judge(search.requirements, made.sensor)
    return BestDesign(space.point(made.settled, made.sensor), made.sensor, verdict, _notes(search, made))


def _notes(search: RangeSearch, made: Candidate) -> tuple[str, ...]:
    """Return notes on the chosen parameters."""
    notes, sensor, requirements = [*made.notes], made.sensor, search.requirements
    tables = made.settled.tables()
    chosen = {**tables["field"], **tables["mirror"], **tables["lens"]}
    for name, (low, high) in search.free.items():
        notes.append(f"{name} = {chosen[name]:.6g}, chosen between {low:g} and {high:g}")
    if isinstance(sensor.lens, GaussianLens):
        fills = sensor.rim_radius_px > requirements.largest_image_px - EDGE_PX
        where = "where the rim fills the imager" if fills else "the end of its range, where the imager is not filled"
        if search.ranges["theta_max_deg"] is None:
            notes.append(f"theta_max_deg = {float(np.degrees(sensor.meridian.theta_max)):.6g}, {where}")
        elif search.ranges["focal_length_mm"] is None:
            notes.append(f"focal_length_mm = {sensor.lens.focal_length_mm:.6g}, {where}")
    if requirements.lens.focus_mm is None or is_free(requirements.lens.focus_mm):
        notes.append(f"focused at {sensor.lens.focus_distance_mm:.5g} mm, where {_why_there(requirements, made)}")
    deviation = mapping_deviation_px(made.settled, sensor)
    if deviation is not None:
        mirror = requirements.mirror
        who = "the mirror behind lens and cover" if mirror.mapping and not mirror.fit else "the fitted mirror"
        notes.append(f"{who} departs from its mapping by up to {deviation:.3g} px")
    return tuple(notes)


def _why_there(requirements: Requirements, made: Candidate) -> str:
    """Return the criterion of the focus."""
    if made.settled.lens.focus_mm != requirements.lens.focus_mm:
        return "the smallest margin is largest"
    is_sharpness = any(limit.of.is_sharpness for limit in requirements.limits)
    return "the limits of blur are kept best" if is_sharpness else "the worst floored blur area is least"


def ratios(span: tuple[float, float], count: int) -> list[float]:
    """Return numbers over a range in equal ratios, or in equal steps if the range includes 0.

    >>> [round(v, 6) for v in ratios((4.0, 16.0), 3)], ratios((-1.0, 1.0), 3)
    ([4.0, 8.0, 16.0], [-1.0, 0.0, 1.0])
    """
    spaced = np.geomspace if span[0] > 0 else np.linspace
    return [float(v) for v in spaced(*span, count)]
