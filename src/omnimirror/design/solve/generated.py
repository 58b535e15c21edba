"""Design space of mirrors of a mapping or a family: the numbers of the requirements, and the focus.

The coordinates are the free numbers, the given numbers that may be relaxed, and the focus. A
sequence of linear programmes (:mod:`omnimirror.base.numerics.minimax`) minimises the objective.
Lengths, angles and F-numbers are represented by their logarithms, which gives steps of 0.1 equal
relative size. Mirrors are evaluated before fitting; the change due to the fit is taken as constant
in the neighbourhood of a point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import OmnimirrorError
from ...base.numerics.lazy import cached_property
from ...base.numerics.minimax import Minimum, ObjectiveValues, Rows, solve_minimax
from ...base.typing import Array
from ...optics.sensor import Sensor
from ..criteria.ranges import ends, ends_or_none, is_free
from ..criteria.requirements import OF_OPTICS, Requirements
from ..optimise.objective import IMAGE, Key, Slack
from ..optimise.problem import OF_LENS
from .candidates import Candidate, focusing, make
from .focusing import Focusing, vergences_of
from .space import Point, Reached
from .verdict import given_rows, judge

Span = tuple[float, float]

NODES = 91  # mirror points in each evaluated part of the field
STEP = 1e-6  # finite-difference step
CLOSE = 1e-6
STEPS = 25  # maximum iterations of a search
KEPT = 1e-6  # tolerance of relative violations
RELAXED_STARTS = 2  # searches of relaxed requirements, the first from a nearly feasible design
FITS = 3  # searches with an updated effect of the fit
TRIED = (0.05, 0.2, 0.5, 1.0, 2.0, 4.0)  # relative changes of a number, tried for the start of its search
SEARCHED = 181  # field angles of a requirement check within a search
LINEAR = ("conic", "omega_min_deg")  # entries that may be 0 or negative
FREE_CONIC = (-0.9, 4.0)  # of an ellipsoid with a free conic constant
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
class GeneratedSpace:
    """Design space around a design.

    Attributes
    ----------
    settled
        Requirements with a number for every range; numbers without a coordinate are constant.
    spans
        Ranges of the variable numbers.
    near
        Sensor of the design; its size is the unit of the focus coordinate.
    found_from_scratch
        Function that searches a design for other requirements with a given number of searches and
        first starts; None if a requirement is missed.
    """

    requirements: Requirements
    settled: Requirements
    spans: dict[str, Span]
    near: Sensor
    found_from_scratch: Callable[[Requirements, Iterable[Requirements], int], Candidate | None]

    # -- points ------------------------------------------------------------------------------------

    @cached_property
    def names(self) -> list[str]:
        """Return the coordinate names: variable numbers, and the focus if limits depend on it.

        Otherwise the focus minimises the floored blur area, as in an initial design.
        """
        asked, limits = self.requirements.lens.focus_mm, self.requirements.limits
        if not (asked is None or is_free(asked)):
            return [*self.spans]
        hangs = not limits or any(limit.of.is_sharpness for limit in limits) or not self.settled.lens.fills_imager
        return [*self.spans, "focus"] if hangs else [*self.spans]

    @cached_property
    def _unit(self) -> float:
        """Return the unit of the focus coordinate, 1/(lens to rim) or the rim radius."""
        sensor = self.near
        return sensor.mirror.rim_radius_mm if sensor.lens.TELECENTRIC else 1 / sensor.mirror_distance_mm

    def _place(self, focus_mm: float) -> float:
        return -focus_mm if self.near.lens.TELECENTRIC else 1 / focus_mm

    def point(self, settled: Requirements, sensor: Sensor) -> Point:
        """Return a design as a point, including fixed numbers."""
        numbers = {name: ends_or_none(_entry(settled, name)) for name in ranges_of(self.requirements)}
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
        asked = {name: _entry(settled, name) for name in ("omega_min_deg", "omega_max_deg", "focus_mm")}
        return settled, self.requirements.changed(**asked)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of the coordinates."""
        low, high = ([_inner(name, span[i]) for name, span in self.spans.items()] for i in (0, 1))
        if "focus" in self.names:
            ends_of = vergences_of(self.near.lens)
            if (asked := ends_or_none(self.requirements.lens.focus_mm)) is not None:
                places = sorted(self._place(v) for v in asked)
                ends_of = float(np.clip(places[0], *ends_of)), float(np.clip(places[1], *ends_of))
            low, high = [*low, ends_of[0] / self._unit], [*high, ends_of[1] / self._unit]
        return np.array(low), np.array(high)

    # -- numbers that may be relaxed ---------------------------------------------------------------

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Return the fixed numbers of the requirements."""
        spans = ranges_of(self.requirements)
        found = {n: span[0] for n, span in spans.items() if span is not None and not is_free(span) and span[0] != 0}
        if all(limit.omega_deg for limit in self.requirements.limits):
            found.pop("omega_min_deg", None)
        if self.requirements.lens.optics is not None:
            found = {name: value for name, value in found.items() if name not in OF_OPTICS}
        return found

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """Return the limits, and the other requirements that the numbers can violate."""
        lens, settled = self.requirements.lens, self.settled.lens
        keys: list[Key] = [*range(len(self.requirements.limits)), "omega_min_deg"]
        keys += [] if settled.fills_imager else [IMAGE]
        follow = (n for n in OF_LENS if getattr(lens, n) is not None and ranges_of(self.requirements)[n] is None)
        return (*keys, *follow)

    def freed(self, ranges: dict[str, Span]) -> GeneratedSpace:
        """Return the space with additional free numbers."""
        return replace(self, spans=self.spans | ranges)

    def towards(self, point: Point, name: str, way: int, span: Span) -> Point:
        """Return a start for moving a number: a feasible point, or the nearest to it."""
        asked, best, least = self.numbers[name], point, np.inf
        for share in TRIED:
            value = asked + way * share * abs(asked)
            if not span[0] <= value <= span[1]:
                break
            try:
                moved = unfitted(self.requirements.changed(**{name: value}))
                made = make(unfitted(self.settled.changed(**{name: value})))
                verdict = judge(moved, made.sensor, angles=SEARCHED)
            except OmnimirrorError:
                continue
            if verdict.worst < least:
                best, least = self.point(made.settled, made.sensor), verdict.worst
            if least <= 0:
                break
        return best

    def meeting(self, requirements: Requirements, point: Point, is_local: bool = False) -> Point | None:
        """Return the design for other requirements, found by a local or a global search."""
        found = self.settled_at(point) if all(name in point for name in self.names) else self.settled
        spans = free_of(ranges_of(requirements))
        numbers = {name: float(np.clip(_number(found, name), *span)) for name, span in spans.items()}
        settled = {name: span[0] for name, span in ranges_of(requirements).items() if span is not None}
        starts = 1 if is_local else RELAXED_STARTS
        made = self.found_from_scratch(requirements, [requirements.changed(**(settled | numbers))], starts)
        return None if made is None else self.point(made.settled, made.sensor)

    # -- violations --------------------------------------------------------------------------------

    def missed(self, point: Point) -> dict[Key, float]:
        """Return the relative violation of each requirement at a point."""
        return {key: float(rows.max()) for key, rows in self._missed(self._y(point), fitted=True).items()}

    def _missed(self, y: Array, fitted: bool = False) -> dict[Key, Array]:
        """Return the relative violation of each requirement at y, as smooth rows.

        Raises
        ------
        OmnimirrorError
            Sensor that does not exist.
        """
        settled, asked = self._settled(y)
        sensor = make(settled if fitted else unfitted(settled)).sensor
        looked: Focusing = focusing(settled, sensor, NODES)
        v = np.full((1, 1), looked.camera.vergence(sensor.lens.focus_distance_mm))
        found: dict[Key, Array] = {}
        with np.errstate(all="ignore"):
            for i, limit in enumerate(self.requirements.limits):
                found[i] = np.nan_to_num(
                    np.atleast_2d(limit.excess(looked.at(v, limit), looked.distances))[0], nan=-1.0
                )
            if not self.requirements.limits:
                found[AREA] = np.atleast_2d(looked.at(v).log_area)[0]
        for row in given_rows(asked, sensor):
            if row.name in self.keys:
                found[row.name] = np.array([row.shortfall])
        return found

    # -- searches ----------------------------------------------------------------------------------

    def reach(self, point: Point, slack: Slack) -> Reached | None:
        """Return the point of minimum slack near a point; None if infeasible."""
        y, added = self._y(point), dict[Key, float]()
        for _ in range(FITS if self.requirements.mirror.fit else 1):
            found = self._followed(y, slack, added)
            if found.violation > KEPT:
                return None
            y = found.y
            if self.requirements.mirror.fit:
                try:
                    added = self._added(y)
                except OmnimirrorError:
                    return None
        return Reached(point | dict(zip(self.names, y.tolist(), strict=True)), found.value)

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

    def _followed(self, y: Array, slack: Slack, added: dict[Key, float]) -> Minimum:
        known = dict[bytes, ObjectiveValues]()  # derivatives are computed at points of known values

        def values(y: Array) -> ObjectiveValues:
            if (key := y.tobytes()) not in known:
                known[key] = computed(y)
            return known[key]

        def computed(y: Array) -> ObjectiveValues:
            try:
                missed = {key: rows + added.get(key, 0.0) for key, rows in self._missed(y).items()}
            except OmnimirrorError:
                return ObjectiveValues(np.array([np.nan]), np.array([np.nan]))
            gives = [missed[key] for key in slack.keys]
            gives += [np.array([self._moved(y, *number)]) for number in slack.numbers]
            kept = [rows + slack.margin for key, rows in missed.items() if key not in slack.keys]
            return ObjectiveValues(np.concatenate(gives), np.concatenate([*kept, np.array([-1.0])]))

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

    def _moved(self, y: Array, name: str, asked: float, way: int) -> float:
        """Return the relative change of a number."""
        return way * (_outer(name, y[self.names.index(name)]) - asked) / abs(asked)


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
