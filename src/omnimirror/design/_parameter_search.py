"""Free parameters of a mapping or a family: design space and search for the largest margin."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
from ..base.errors import OmnimirrorError
from ..base.optimisation import LinearisedValues, MinimaxResult, ObjectiveValues, solve_minimax
from ..base.typing import Array
from ..optics.lenses import GaussianLens
from ..optics.sensor import Sensor
from ._candidates import Candidate, Focusing, focusing, make, mapping_deviation_px, vergences_of
from ._design_problem import OF_LENS
from ._design_space import (
    BestDesign,
    OnStep,
    Point,
    Reached,
    is_more_met,
    meet_other_requirements,
    priority_note,
)
from .optimiser import IMAGE, Key, Slack
from .requirement_check import (
    EDGE_PX,
    Verdict,
    check_requirements,
    evaluable_field,
    evaluations,
    given_rows,
)
from .requirements import OF_OPTICS, Requirements, ends, ends_or_none, is_free

# -- Design space of mirrors of a mapping or a family: the numbers of the requirements, and the focus
#
# The coordinates are the free numbers, the given numbers that may be relaxed, and the focus. A
# sequence of linear programmes (:mod:`omnimirror.base.optimisation`) minimises the objective.
# Lengths, angles and F-numbers are represented by their logarithms, which gives steps of 0.1 equal
# relative size. Mirrors are evaluated before fitting; the change due to the fit is taken as constant
# in the neighbourhood of a point.

Span = tuple[float, float]

NODES = 91  # mirror points in each evaluated part of the field
STEP = 1e-6  # finite-difference step
CLOSE = 1e-6  # relative violation, and step in a coordinate, at which a search ends
STEPS = 25  # maximum iterations of a search
VIOLATION_TOLERANCE = 1e-6  # tolerance of relative violations
RELAXED_STARTS = 2  # searches of relaxed requirements, the first from a nearly feasible design
FITS = 3  # searches with an updated effect of the fit
TRIED = (
    0.05,
    0.2,
    0.5,
    1.0,
    2.0,
    4.0,
)  # relative changes of a number, tried for the start of its search
SEARCHED = 181  # field angles of a requirement check within a search
LINEAR = ("conic", "omega_min_deg")  # entries that may be 0 or negative
FREE_CONIC = (-0.9, 4.0)  # range for an ellipsoid with a free conic constant
AREA = "floored_area"
"""Substitute for the limits if there are none: logarithm of the floored blur area."""


def ranges_of(requirements: Requirements) -> dict[str, Span | None]:
    """Return the permitted ranges (low, high) of the design numbers, or None if dependent."""
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    conic = ends_or_none(mirror.conic)
    if mirror.family == "ellipsoid" and conic is None:
        conic = FREE_CONIC
    theta, focal = ends_or_none(lens.theta_max_deg), ends_or_none(lens.focal_length_mm)
    if is_free(theta) and focal and not is_free(focal):
        theta = None  # follows from the focal length; its range is a requirement
    elif theta and is_free(focal):
        focal = None
    return {
        "omega_max_deg": ends(field.omega_max_deg),
        "omega_min_deg": ends(field.omega_min_deg),
        "rim_radius_mm": ends(mirror.rim_radius_mm),
        "theta_max_deg": theta,
        "focal_length_mm": focal,
        "f_number": ends(lens.f_number),
        "magnification": ends_or_none(lens.magnification),
        "conic": conic,
    }


def free_of(ranges: dict[str, Span | None]) -> dict[str, Span]:
    """Return the ranges with different ends."""
    return {name: span for name, span in ranges.items() if span is not None and is_free(span)}


@dataclass(frozen=True)
class ParameterSpace:
    """Design space around a design.

    Attributes
    ----------
    settled
        Requirements with a number for every range; numbers without a coordinate are constant.
    spans
        Ranges of the variable numbers.
    near
        Sensor of the design; its size is the unit of the focus coordinate.
    search_from_scratch
        Function that searches for a design that meets other requirements with a given number of
        searches and first starts; None if a requirement is missed.
    """

    requirements: Requirements
    settled: Requirements
    spans: dict[str, Span]
    near: Sensor
    search_from_scratch: Callable[[Requirements, Iterable[Requirements], int], Candidate | None]

    # -- points ------------------------------------------------------------------------------------

    @cached_property
    def names(self) -> list[str]:
        """Coordinate names: variable numbers, and the focus if limits depend on it.

        Otherwise the focus minimises the floored blur area, as in an initial design.
        """
        limits = self.requirements.limits
        hangs = (
            not limits
            or any(limit.of.is_sharpness for limit in limits)
            or not self.settled.lens.fills_imager
        )
        return [*self.spans, "focus"] if self._is_focus_free and hangs else [*self.spans]

    @property
    def _is_focus_free(self) -> bool:
        requested = self.requirements.lens.focus_mm
        return requested is None or is_free(requested)

    @cached_property
    def _unit(self) -> float:
        """Unit of the focus coordinate, 1/(lens to rim) or the rim radius."""
        sensor = self.near
        return (
            sensor.mirror.rim_radius_mm
            if sensor.lens.TELECENTRIC
            else 1 / sensor.mirror_distance_mm
        )

    def _place(self, focus_mm: float) -> float:
        return -focus_mm if self.near.lens.TELECENTRIC else 1 / focus_mm

    def point(self, settled: Requirements, sensor: Sensor) -> Point:
        """Return a design as a point, including fixed numbers."""
        numbers = {
            name: ends_or_none(_entry(settled, name)) for name in ranges_of(self.requirements)
        }
        point = {name: _inner(name, span[0]) for name, span in numbers.items() if span is not None}
        return point | {"focus": self._place(sensor.lens.focus_distance_mm) / self._unit}

    def value(self, point: Point, name: str) -> float:
        """Return a number at a point, clipped to its span."""
        return float(np.clip(_outer(name, point[name]), *self.spans[name]))

    def _y(self, point: Point) -> Array:
        return np.array([point[name] for name in self.names])

    def _settled(self, y: Array) -> tuple[Requirements, Requirements]:
        """Return the requirements settled at y, and those on its own field and focus."""
        point = dict(zip(self.names, y.tolist(), strict=True))
        numbers: dict[str, float] = {name: self.value(point, name) for name in self.spans}
        if "focus" in point:
            numbers["focus_mm"] = self._place(point["focus"] * self._unit)
        settled = self.settled.changed(**numbers)
        requested = {
            name: _entry(settled, name) for name in ("omega_min_deg", "omega_max_deg", "focus_mm")
        }
        return settled, self.requirements.changed(**requested)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the coordinates."""
        low, high = ([_inner(name, span[i]) for name, span in self.spans.items()] for i in (0, 1))
        if "focus" in self.names:
            ends_of = vergences_of(self.near.lens)
            if (requested := ends_or_none(self.requirements.lens.focus_mm)) is not None:
                positions = sorted(self._place(v) for v in requested)
                ends_of = (
                    float(np.clip(positions[0], *ends_of)),
                    float(np.clip(positions[1], *ends_of)),
                )
            low, high = [*low, ends_of[0] / self._unit], [*high, ends_of[1] / self._unit]
        return np.array(low), np.array(high)

    # -- numbers that may be relaxed ---------------------------------------------------------------

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Fixed numbers of the requirements."""
        spans = ranges_of(self.requirements)
        values = {
            n: span[0]
            for n, span in spans.items()
            if span is not None and not is_free(span) and span[0] != 0
        }
        if all(limit.omega_deg for limit in self.requirements.limits):
            values.pop("omega_min_deg", None)
        if self.requirements.lens.optics is not None:
            values = {name: value for name, value in values.items() if name not in OF_OPTICS}
        return values

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """Limits, and the other requirements that the numbers can violate."""
        lens, settled = self.requirements.lens, self.settled.lens
        keys: list[Key] = [*range(len(self.requirements.limits)), "omega_min_deg"]
        keys += [] if settled.fills_imager else [IMAGE]
        follow = (
            n
            for n in OF_LENS
            if getattr(lens, n) is not None and ranges_of(self.requirements)[n] is None
        )
        return (*keys, *follow)

    def freed(self, ranges: dict[str, Span]) -> ParameterSpace:
        """Return the space with additional free numbers."""
        return replace(self, spans=self.spans | ranges)

    def towards(self, point: Point, name: str, way: int, span: Span) -> Point:
        """Return a start for moving a number: a feasible point, or the nearest to it."""
        requested, best, smallest = self.numbers[name], point, np.inf
        for fraction in TRIED:
            value = requested + way * fraction * abs(requested)
            if not span[0] <= value <= span[1]:
                break
            try:
                moved = unfitted(self.requirements.changed(**{name: value}))
                candidate = make(unfitted(self.settled.changed(**{name: value})))
                verdict = check_requirements(moved, candidate.sensor, angles=SEARCHED)
            except OmnimirrorError:
                continue
            if verdict.worst < smallest:
                best, smallest = self.point(candidate.settled, candidate.sensor), verdict.worst
            if smallest <= 0:
                break
        return best

    def search_design(
        self, requirements: Requirements, point: Point, is_local: bool = False
    ) -> Point | None:
        """Return the design for other requirements, found by a local or a global search."""
        result = (
            self.settled_at(point) if all(name in point for name in self.names) else self.settled
        )
        spans = free_of(ranges_of(requirements))
        numbers = {
            name: float(np.clip(_number(result, name), *span)) for name, span in spans.items()
        }
        settled = {
            name: span[0] for name, span in ranges_of(requirements).items() if span is not None
        }
        starts = 1 if is_local else RELAXED_STARTS
        candidate = self.search_from_scratch(
            requirements, [requirements.changed(**(settled | numbers))], starts
        )
        return None if candidate is None else self.point(candidate.settled, candidate.sensor)

    # -- violations --------------------------------------------------------------------------------

    def missed(self, point: Point) -> dict[Key, float]:
        """Return the relative violation of each requirement at a point."""
        return {
            key: float(rows.max())
            for key, rows in self._missed(self._y(point), fitted=True).items()
        }

    def _missed(self, y: Array, fitted: bool = False) -> dict[Key, Array]:
        """Return the relative violation of each requirement at y, as smooth rows.

        Raises
        ------
        OmnimirrorError
            If the sensor does not exist.
        """
        settled, requested = self._settled(y)
        if self._is_focus_free and "focus" not in self.names:
            # No limit refers to sharpness, and the focus changes the image scale little: its value in the
            # neighbouring design replaces the iteration of mirror and best focus. Finished designs are refocused.
            settled = settled.changed(focus_mm=self.near.lens.focus_distance_mm)
        sensor = make(settled if fitted else unfitted(settled)).sensor
        focus_search: Focusing = focusing(settled, sensor, NODES)
        v = np.full((1, 1), focus_search.camera.vergence(sensor.lens.focus_distance_mm))
        violations: dict[Key, Array] = {}
        with np.errstate(all="ignore"):
            for i, limit in enumerate(self.requirements.limits):
                violations[i] = np.nan_to_num(
                    np.atleast_2d(limit.excess(focus_search.at(v, limit), focus_search.distances))[
                        0
                    ],
                    nan=-1.0,
                )
            if not self.requirements.limits:
                violations[AREA] = np.atleast_2d(focus_search.at(v).log_area)[0]
        for row in given_rows(requested, sensor):
            if row.name in self.keys:
                violations[row.name] = np.array([row.shortfall])
        return violations

    # -- searches ----------------------------------------------------------------------------------

    def reach(self, point: Point, slack: Slack) -> Reached | None:
        """Return the point of minimum slack near a point; None if infeasible."""
        y, added = self._y(point), dict[Key, float]()
        for _ in range(FITS if self.requirements.mirror.fit else 1):
            result = self._followed(y, slack, added)
            if result.violation > VIOLATION_TOLERANCE:
                return None
            y = result.y
            if self.requirements.mirror.fit:
                try:
                    added = self._added(y)
                except OmnimirrorError:
                    return None
        return Reached(point | dict(zip(self.names, y.tolist(), strict=True)), result.value)

    def made_at(self, point: Point) -> Requirements:
        """Return the requirements settled at a point, with the original focus requirement."""
        return self.settled_at(point).changed(focus_mm=self.settled.lens.focus_mm)

    def settled_at(self, point: Point) -> Requirements:
        """Return the requirements settled at a point, including the focus."""
        return self._settled(self._y(point))[0]

    def _added(self, y: Array) -> dict[Key, float]:
        """Return the change of each requirement's largest row due to the fit."""
        plain, fitted = self._missed(y), self._missed(y, fitted=True)
        return {key: float(fitted[key].max() - rows.max()) for key, rows in plain.items()}

    def _followed(self, y: Array, slack: Slack, added: dict[Key, float]) -> MinimaxResult:
        cache = dict[bytes, ObjectiveValues]()  # derivatives are computed at points of known values

        def values(y: Array) -> ObjectiveValues:
            if (key := y.tobytes()) not in cache:
                cache[key] = computed(y)
            return cache[key]

        def computed(y: Array) -> ObjectiveValues:
            try:
                missed = {key: rows + added.get(key, 0.0) for key, rows in self._missed(y).items()}
            except OmnimirrorError:
                return ObjectiveValues(np.array([np.nan]), np.array([np.nan]))
            relaxed_rows = [missed[key] for key in slack.keys]
            relaxed_rows += [np.array([self._moved(y, *number)]) for number in slack.numbers]
            other_rows = [
                rows + slack.margin for key, rows in missed.items() if key not in slack.keys
            ]
            return ObjectiveValues(
                np.concatenate(relaxed_rows), np.concatenate([*other_rows, np.array([-1.0])])
            )

        def rows(y: Array) -> LinearisedValues:
            here = values(y)
            objective, constraints = [], []
            for i in range(y.size):
                step = np.zeros(y.size)
                step[i] = STEP if y[i] + STEP <= self.bounds[1][i] else -STEP
                there = values(y + step)
                objective.append((there.objective - here.objective) / step[i])
                constraints.append((there.constraints - here.constraints) / step[i])
            return LinearisedValues(
                *here,
                np.nan_to_num(np.stack(objective, axis=1)),
                np.nan_to_num(np.stack(constraints, axis=1)),
            )

        return solve_minimax(
            values,
            rows,
            y,
            self.bounds,
            tolerance=CLOSE,
            max_steps=STEPS,
            final_trust=CLOSE,
            min_gain=CLOSE,
        )

    def _moved(self, y: Array, name: str, requested: float, way: int) -> float:
        """Return the relative change of a number."""
        return way * (_outer(name, y[self.names.index(name)]) - requested) / abs(requested)


def unfitted(requirements: Requirements) -> Requirements:
    """Return the requirements without a fit of the mirror."""
    return requirements if requirements.mirror.fit is None else requirements.changed(fit=None)


def _entry(requirements: Requirements, name: str) -> float | None:
    """Return an entry of the table that contains it."""
    tables = (requirements.field, requirements.mirror, requirements.lens)
    value: float | None = next(getattr(table, name) for table in tables if hasattr(table, name))
    return value


def _number(requirements: Requirements, name: str) -> float:
    """Return an entry, or the centre of its range."""
    value = _entry(requirements, name)
    assert value is not None
    return sum(ends(value)) / 2


def _inner(name: str, value: float) -> float:
    return float(value) if name in LINEAR else float(np.log(value))


def _outer(name: str, value: float) -> float:
    return float(value) if name in LINEAR else float(np.exp(value))


# -- Optimisation of the free parameters of a mapping or a family for the largest margin -----------
#
# The cost of a candidate is its largest relative violation (negative if all requirements are met) or,
# without limits, its worst floored blur area. Linear programmes start from points of a coarse grid
# over the ranges until several of them agree. If some requirements are infeasible, the others are met
# first (:mod:`.priorities`).

GRID = {1: 9, 2: 4, 3: 3, 4: 2, 5: 2}  # grid points per free number, by their count
STARTS, RESTARTS = (
    12,
    5,
)  # searches from different starts, and restarts of a search at its end point
SAME, AGREEING = (
    1e-4,
    3,
)  # relative difference of equal costs; number of searches that have to agree
AGREEING_IF_MET = 2  # the same for feasible candidates
SEARCHES_IF_FEASIBLE = 4  # searches after which a feasible candidate is accepted
NEAR_MISS = 0.05  # cost below which a derivative-free search follows
SIMPLEX, SIMPLEX_STEPS = (
    0.05,
    60,
)  # initial steps relative to the ranges; evaluations for each free number
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
        """Ranges (low, high) of the candidate numbers; None if dependent."""
        return ranges_of(self.requirements)

    @cached_property
    def free(self) -> dict[str, tuple[float, float]]:
        """Ranges of the free numbers."""
        return free_of(self.ranges)

    def middle(self) -> Requirements:
        """Return the requirements settled at the centre of all ranges."""
        middles = {name: (s[0] + s[1]) / 2 for name, s in self.ranges.items() if s is not None}
        return self.requirements.changed(**middles)

    def evaluated(self, settled: Requirements) -> Ranked:
        """Return a checked candidate; raise OmnimirrorError if the sensor does not exist."""
        candidate = make(settled)
        verdict = check_requirements(self.requirements, candidate.sensor, angles=SEARCHED)
        return Ranked(candidate, verdict, self._cost(verdict))

    def _cost(self, verdict: Verdict) -> float:
        missed = [row.shortfall for row in verdict.rows if not row.is_limit and not row.is_met]
        limits = [row.shortfall for row in verdict.limits]
        if missed or limits:
            return max(missed + limits) + (0.0 if limits else INFEASIBLE)
        low, high, _ = evaluable_field(self.requirements.field, verdict.sensor).part()
        results = evaluations(self.requirements, verdict.sensor, np.linspace(low, high, SEARCHED))
        return max(float(result.floored_area_deg2.max()) for result in results)

    def best(
        self, begin: Iterable[Requirements] = (), enough: float = -np.inf, starts: int | None = None
    ) -> Ranked:
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
            If no candidate exists; the message is that of the candidate at the centre.
        """
        middle = self.middle()
        if not self.free:
            return self.evaluated(middle)
        ends = list[Ranked]()
        for start in islice(self._starts(begin, middle), starts):
            result = self.followed(start, enough)
            ends.append(result)
            best = min(ends, key=lambda c: c.cost)
            agreeing = sum(c.cost - best.cost <= SAME * abs(best.cost) for c in ends)
            is_confirmed = agreeing >= (AGREEING_IF_MET if best.cost <= 0 else AGREEING)
            if (
                best.cost <= enough
                or is_confirmed
                or (best.cost <= 0 and len(ends) >= SEARCHES_IF_FEASIBLE)
            ):
                break
        if not ends:
            return self.evaluated(middle)  # raises the reason
        return self._by_simplex(best) if starts is None and 0 < best.cost < NEAR_MISS else best

    def screened(self, count: int) -> Ranked | None:
        """Return the best of a few candidates: the centre of the ranges and evenly chosen grid points.

        Candidates are compared without the fit; the best one is fitted. None if no sensor exists.
        """
        middle = self.middle()
        grid = [*self._grid(middle)] if self.free else []
        chosen = [
            middle,
            *(
                grid[i]
                for i in np.linspace(0, len(grid) - 1, min(count, len(grid))).round().astype(int)
            ),
        ]
        candidates = [
            candidate
            for settled in chosen
            if (candidate := self._tried(unfitted(settled))) is not None
        ]
        return next(
            (
                c
                for candidate in sorted(candidates, key=lambda c: c.cost)
                if (c := self._fitted(candidate)) is not None
            ),
            None,
        )

    def _fitted(self, unfitted: Ranked) -> Ranked | None:
        """Return a candidate with the requested fit, if any."""
        fit = self.requirements.mirror.fit
        return unfitted if fit is None else self._tried(unfitted.made.settled.changed(fit=fit))

    def _starts(self, begin: Iterable[Requirements], middle: Requirements) -> Iterator[Ranked]:
        """Yield the starts of the searches: earlier designs, then alternately the best grid point
        and the one farthest from all previous starts.
        """
        yield from (
            candidate for settled in begin if (candidate := self._tried(settled)) is not None
        )
        # Fits take several times longer than the mirrors themselves: only the starts are fitted.
        candidates = (unfitted(settled) for settled in [middle, *self._grid(middle)])
        rest = [
            candidate for settled in candidates if (candidate := self._tried(settled)) is not None
        ]
        rest.sort(key=lambda c: c.cost)
        remaining = [self._place(c) for c in rest]
        selected = list[NDArray[np.float64]]()
        for i in range(min(STARTS, len(rest))):
            at = 0
            if i % 2 and selected:
                at = int(
                    np.argmax(
                        [min(float(np.abs(p - t).max()) for t in selected) for p in remaining]
                    )
                )
            selected.append(remaining.pop(at))
            if (start := self._fitted(rest.pop(at))) is not None:
                yield start

    def _place(self, candidate: Ranked) -> NDArray[np.float64]:
        """Return the position of a candidate within the free ranges, each scaled to 0 to 1."""
        entries = candidate.made.settled.tables()
        values = {**entries["field"], **entries["mirror"], **entries["lens"]}
        return np.array(
            [(values[name] - low) / (high - low) for name, (low, high) in self.free.items()]
        )

    def _by_simplex(self, start: Ranked) -> Ranked:
        """Refine a nearly feasible candidate by a derivative-free search until it is feasible.

        Linear programmes assume a constant effect of the fit between two fits; this search does
        not.
        """
        from scipy.optimize import minimize

        best, spans = start, np.array([*self.free.values()])
        settled = start.made.settled.changed(focus_mm=self.requirements.lens.focus_mm)

        def cost(position: NDArray[np.float64]) -> float:
            nonlocal best
            if best.cost <= 0:
                return INFEASIBLE
            numbers = spans[:, 0] + np.clip(position, 0.0, 1.0) * (spans[:, 1] - spans[:, 0])
            candidate = self._tried(
                settled.changed(**dict(zip(self.free, numbers.tolist(), strict=True)))
            )
            if candidate is None:
                return INFEASIBLE
            best = min(best, candidate, key=lambda c: c.cost)
            return candidate.cost

        origin = self._place(start)
        corners = [
            origin,
            *(
                origin + np.where(origin < 0.5, SIMPLEX, -SIMPLEX) * unit
                for unit in np.eye(origin.size)
            ),
        ]
        options = {
            "initial_simplex": np.array(corners),
            "maxfev": SIMPLEX_STEPS * origin.size,
            "xatol": 1e-6,
            "fatol": 1e-7,
        }
        minimize(
            cost, origin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * origin.size, options=options
        )
        return best

    def followed(self, start: Ranked, enough: float) -> Ranked:
        """Follow one start to its optimum, with restarts while the cost decreases.

        Without free parameters, the start is the only candidate.
        """
        min_gain = GAIN if np.isinf(enough) else ROUGH_GAIN
        for _ in range(RESTARTS if self.free else 0):
            if start.cost <= enough:
                break
            result = self._polished(start)
            gain = start.cost - result.cost
            start = result
            if gain <= min_gain * abs(result.cost):
                break
        return start

    def space(self, ranked: Ranked) -> ParameterSpace:
        """Return the design space around a candidate."""
        return ParameterSpace(
            self.requirements,
            ranked.made.settled,
            self.free,
            ranked.made.sensor,
            search_from_scratch,
        )

    def _polished(self, start: Ranked) -> Ranked:
        """Return the best candidate near a given one over the free parameters."""
        space = self.space(start)
        point = space.point(start.made.settled, start.made.sensor)
        limits: tuple[Key, ...] = tuple(range(len(self.requirements.limits))) or (AREA,)
        result = space.reach(point, Slack(limits))
        if result is None:  # a given value is violated: treat it as a limit
            result = space.reach(point, Slack(tuple(space.missed(point))))
        if result is None:
            return start
        # Refocusing can leave the optimum: the focus of the search is also evaluated.
        settled = (space.made_at(result.point), space.settled_at(result.point))
        candidates = (self._tried(requirements) for requirements in settled)
        return min([start, *(t for t in candidates if t is not None)], key=lambda t: t.cost)

    def _grid(self, base: Requirements) -> Iterator[Requirements]:
        """Yield settled requirements on a grid over the ranges, in equal ratios if possible."""
        values = [ratios(span, GRID[len(self.free)]) for span in self.free.values()]
        for numbers in product(*values):
            yield base.changed(**dict(zip(self.free, numbers, strict=True)))

    def _tried(self, settled: Requirements) -> Ranked | None:
        """Return a checked candidate, or None if the sensor does not exist."""
        try:
            return self.evaluated(settled)
        except OmnimirrorError:
            return None


def solve(
    requirements: Requirements, on_step: OnStep = lambda message: None
) -> tuple[ParameterSpace, BestDesign]:
    """Return the best candidate and its design space.

    Raises
    ------
    OmnimirrorError
        If the mirror does not exist.
    """
    search = RangeSearch(requirements)
    if search.free:
        on_step(f"choosing {', '.join(search.free)}")
    result = search.best()
    space = search.space(result)
    best = _design(search, space, result.made)
    for point in meet_other_requirements(space, best.point, best.verdict, on_step):
        try:
            other = _design(search, space, make(space.settled_at(point)))
        except OmnimirrorError:
            continue
        if is_more_met(other.verdict, best.verdict):
            return space, replace(
                other, notes=(priority_note(other.verdict, best.verdict), *other.notes)
            )
    return space, best


def search_from_scratch(
    requirements: Requirements, begin: Iterable[Requirements] = (), starts: int | None = None
) -> Candidate | None:
    """Return the candidate of a search, if feasible; ``begin`` contains earlier designs.

    Raises
    ------
    OmnimirrorError
        If the mirror does not exist.
    """
    best = RangeSearch(requirements).best(begin, enough=0.0, starts=starts)
    return best.made if check_requirements(requirements, best.made.sensor).is_met else None


def _design(search: RangeSearch, space: ParameterSpace, candidate: Candidate) -> BestDesign:
    """Return a checked candidate with its point in the design space."""
    verdict = check_requirements(search.requirements, candidate.sensor)
    return BestDesign(
        space.point(candidate.settled, candidate.sensor),
        candidate.sensor,
        verdict,
        _notes(search, candidate),
    )


def _notes(search: RangeSearch, candidate: Candidate) -> tuple[str, ...]:
    """Return notes on the chosen parameters."""
    notes, sensor, requirements = [*candidate.notes], candidate.sensor, search.requirements
    tables = candidate.settled.tables()
    chosen = {**tables["field"], **tables["mirror"], **tables["lens"]}
    for name, (low, high) in search.free.items():
        notes.append(f"{name} = {chosen[name]:.6g}, chosen between {low:g} and {high:g}")
    if isinstance(sensor.lens, GaussianLens):
        fills = sensor.rim_radius_px > requirements.largest_image_px - EDGE_PX
        where = (
            "so that the rim fills the imager"
            if fills
            else "the end of its range; the rim does not fill the imager"
        )
        if search.ranges["theta_max_deg"] is None:
            notes.append(
                f"theta_max_deg = {float(np.degrees(sensor.meridian.theta_max)):.6g}, {where}"
            )
        elif search.ranges["focal_length_mm"] is None:
            notes.append(f"focal_length_mm = {sensor.lens.focal_length_mm:.6g}, {where}")
    if requirements.lens.focus_mm is None or is_free(requirements.lens.focus_mm):
        notes.append(
            f"focused at {sensor.lens.focus_distance_mm:.5g} mm, {_why_there(requirements, candidate)}"
        )
    deviation = mapping_deviation_px(candidate.settled, sensor)
    if deviation is not None:
        mirror = requirements.mirror
        mirror_text = (
            "the mirror behind lens and cover"
            if mirror.mapping and not mirror.fit
            else "the fitted mirror"
        )
        notes.append(f"maximum deviation of {mirror_text} from its mapping: {deviation:.3g} px")
    return tuple(notes)


def _why_there(requirements: Requirements, candidate: Candidate) -> str:
    """Return the criterion of the focus."""
    if candidate.settled.lens.focus_mm != requirements.lens.focus_mm:
        return "maximising the smallest margin"
    is_sharpness = any(limit.of.is_sharpness for limit in requirements.limits)
    return (
        "maximising the margins of blur limits"
        if is_sharpness
        else "minimising the worst floored blur area"
    )


def ratios(span: tuple[float, float], count: int) -> list[float]:
    """Return numbers over a range in equal ratios, or in equal steps if the range includes 0.

    >>> [round(v, 6) for v in ratios((4.0, 16.0), 3)], ratios((-1.0, 1.0), 3)
    ([4.0, 8.0, 16.0], [-1.0, 0.0, 1.0])
    """
    spaced = np.geomspace if span[0] > 0 else np.linspace
    return [float(v) for v in spaced(*span, count)]
