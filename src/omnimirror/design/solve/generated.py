"""The designs with a mirror of a mapping or a family: the numbers of the requirements, and the focus.

Free numbers, numbers that were given but may give, and the focus are the coordinates; a sequence of linear programmes
(:mod:`omnimirror.base.numerics.minimax`) makes what it is asked to as small as can be. Lengths, angles and F-numbers
count
by their logarithms, so that steps of .1 are all of one size. Mirrors are taken as they are before they are fitted; what
a fit adds at some point is taken for the same at all others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...base.numerics.lazy import cached_property
from ...base.numerics.minimax import Minimum, ObjectiveValues, Rows, solve_minimax
from ...optics.sensor import Sensor
from ..criteria.ranges import ends, ends_or_none, is_free
from ..criteria.requirements import OF_OPTICS, Requirements
from ..optimise.objective import IMAGE, Key, Slack
from ..optimise.problem import OF_LENS
from .candidates import Candidate, focusing, make
from .focusing import Focusing, vergences_of
from .space import Point, Reached
from .verdict import given_rows, judge

Array = NDArray[np.float64]
Span = tuple[float, float]

NODES = 91  # mirror points in each part of the field that is judged
STEP = 1e-6  # of derivatives
CLOSE = 1e-6
STEPS = 25  # at most, of a search
KEPT = 1e-6  # a share this little missed is none
RELAXED_STARTS = 2  # searches of relaxed requirements, the first of them from a design that meets them nearly
FITS = 3  # searches with what the fit adds taken anew
TRIED = (0.05, 0.2, 0.5, 1.0, 2.0, 4.0)  # shares by which a number has moved, to see where its search should begin
SEARCHED = 181  # field angles of a verdict within a search
LINEAR = ("conic", "omega_min_deg")  # what may be 0 or below
FREE_CONIC = (-0.9, 4.0)  # of an ellipsoid whose constant is left to the design
AREA = "floored_area"
"""What stands for the limits where there are none: the logarithm of the floored blur area."""


def ranges_of(requirements: Requirements) -> dict[str, Span | None]:
    """The numbers of a design as requirements allow them: (low, high), or None where they follow or do not apply."""
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    conic = ends_or_none(mirror.conic)
    if mirror.family == "ellipsoid" and conic is None:
        conic = FREE_CONIC
    theta, focal = ends_or_none(lens.theta_max_deg), ends_or_none(lens.focal_length_mm)
    if is_free(theta) and focal and not is_free(focal):
        theta = None  # follows from the focal length; that it stays in its range is a requirement
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
    """Those of the ranges that leave a choice."""
    return {name: span for name, span in ranges.items() if span is not None and is_free(span)}


@dataclass(frozen=True)
class GeneratedSpace:
    """The designs around one of them.

    Attributes
    ----------
    settled
        Its requirements with a number for every range; the numbers that do not move stay.
    spans
        Between which values each of the others may move.
    near
        Its sensor, whose size is the unit of the focus.
    found_from_scratch
        Design that so many searches find for other requirements, None if it misses any; the first starts are given.
    """

    requirements: Requirements
    settled: Requirements
    spans: dict[str, Span]
    near: Sensor
    found_from_scratch: Callable[[Requirements, Iterable[Requirements], int], Candidate | None]

    # -- points ------------------------------------------------------------------------------------

    @cached_property
    def names(self) -> list[str]:
        """What each coordinate is: the numbers that move, and the focus where limits hang on it.

        Where none does, it is where designs from scratch have it: at the least floored blur area.
        """
        asked, limits = self.requirements.lens.focus_mm, self.requirements.limits
        if not (asked is None or is_free(asked)):
            return [*self.spans]
        hangs = not limits or any(limit.of.is_sharpness for limit in limits) or not self.settled.lens.fills_imager
        return [*self.spans, "focus"] if hangs else [*self.spans]

    @cached_property
    def _unit(self) -> float:
        """Of places in focus: over the distance from the lens to the rim, or the rim radius of a telecentric one."""
        sensor = self.near
        return sensor.mirror.rim_radius_mm if sensor.lens.TELECENTRIC else 1 / sensor.mirror_distance_mm

    def _place(self, focus_mm: float) -> float:
        return -focus_mm if self.near.lens.TELECENTRIC else 1 / focus_mm

    def point(self, settled: Requirements, sensor: Sensor) -> Point:
        """A design as a point, its given numbers included."""
        numbers = {name: ends_or_none(_entry(settled, name)) for name in ranges_of(self.requirements)}
        point = {name: _inner(name, span[0]) for name, span in numbers.items() if span is not None}
        return point | {"focus": self._place(sensor.lens.focus_distance_mm) / self._unit}

    def value(self, point: Point, name: str) -> float:
        """A number at a point, as near as its span allows."""
        return float(np.clip(_outer(name, point[name]), *self.spans[name]))

    def _y(self, point: Point) -> Array:
        return np.array([point[name] for name in self.names])

    def _settled(self, y: Array) -> tuple[Requirements, Requirements]:
        """The requirements settled at y, and what is asked of that design: its own field, and its focus."""
        point = dict(zip(self.names, y.tolist(), strict=True))
        numbers: dict[str, float] = {name: self.value(point, name) for name in self.spans}
        if "focus" in point:
            numbers["focus_mm"] = self._place(point["focus"] * self._unit)
        settled = self.settled.changed(**numbers)
        asked = {name: _entry(settled, name) for name in ("omega_min_deg", "omega_max_deg", "focus_mm")}
        return settled, self.requirements.changed(**asked)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest value of each coordinate."""
        low, high = ([_inner(name, span[i]) for name, span in self.spans.items()] for i in (0, 1))
        if "focus" in self.names:
            ends_of = vergences_of(self.near.lens)
            if (asked := ends_or_none(self.requirements.lens.focus_mm)) is not None:
                places = sorted(self._place(v) for v in asked)
                ends_of = float(np.clip(places[0], *ends_of)), float(np.clip(places[1], *ends_of))
            low, high = [*low, ends_of[0] / self._unit], [*high, ends_of[1] / self._unit]
        return np.array(low), np.array(high)

    # -- what may give -----------------------------------------------------------------------------

    @cached_property
    def numbers(self) -> dict[str, float]:
        """The numbers of the requirements that are no ranges."""
        spans = ranges_of(self.requirements)
        found = {n: span[0] for n, span in spans.items() if span is not None and not is_free(span) and span[0] != 0}
        if all(limit.omega_deg for limit in self.requirements.limits):
            found.pop("omega_min_deg", None)
        if self.requirements.lens.optics is not None:
            found = {name: value for name, value in found.items() if name not in OF_OPTICS}
        return found

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """The limits, and the requirements besides that the numbers can miss."""
        lens, settled = self.requirements.lens, self.settled.lens
        keys: list[Key] = [*range(len(self.requirements.limits)), "omega_min_deg"]
        keys += [] if settled.fills_imager else [IMAGE]
        follow = (n for n in OF_LENS if getattr(lens, n) is not None and ranges_of(self.requirements)[n] is None)
        return (*keys, *follow)

    def freed(self, ranges: dict[str, Span]) -> GeneratedSpace:
        """The space in which some of its numbers are free too."""
        return replace(self, spans=self.spans | ranges)

    def towards(self, point: Point, name: str, way: int, span: Span) -> Point:
        """From where a number that moves one way lets all be met already, or is nearest to it."""
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
        """Return the design that a search from a point, then from all over the ranges, finds for requirements."""
        found = self.settled_at(point) if all(name in point for name in self.names) else self.settled
        spans = free_of(ranges_of(requirements))
        numbers = {name: float(np.clip(_number(found, name), *span)) for name, span in spans.items()}
        settled = {name: span[0] for name, span in ranges_of(requirements).items() if span is not None}
        starts = 1 if is_local else RELAXED_STARTS
        made = self.found_from_scratch(requirements, [requirements.changed(**(settled | numbers))], starts)
        return None if made is None else self.point(made.settled, made.sensor)

    # -- what is missed ----------------------------------------------------------------------------

    def missed(self, point: Point) -> dict[Key, float]:
        """By what share each requirement is missed at a point."""
        return {key: float(rows.max()) for key, rows in self._missed(self._y(point), fitted=True).items()}

    def _missed(self, y: Array, fitted: bool = False) -> dict[Key, Array]:
        """By what share each requirement is missed at y, as rows of which each is smooth.

        Raises
        ------
        OmnimirrorError
            There is no such sensor.
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
        """The point near one where the least has to give; None where something else is missed there."""
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
        """The requirements settled at a point, their focus as they give it."""
        return self.settled_at(point).changed(focus_mm=self.settled.lens.focus_mm)

    def settled_at(self, point: Point) -> Requirements:
        """The requirements settled at a point, and focused there."""
        return self._settled(self._y(point))[0]

    def _added(self, y: Array) -> dict[Key, float]:
        """What the fit adds to each requirement's worst row."""
        plain, fitted = self._missed(y), self._missed(y, fitted=True)
        return {key: float(fitted[key].max() - rows.max()) for key, rows in plain.items()}

    def _followed(self, y: Array, slack: Slack, added: dict[Key, float]) -> Minimum:
        known = dict[bytes, ObjectiveValues]()  # derivatives are taken at points whose values are known

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
        """By what share a number has moved."""
        return way * (_outer(name, y[self.names.index(name)]) - asked) / abs(asked)


def unfitted(requirements: Requirements) -> Requirements:
    """The same without a fit of the mirror."""
    return requirements if requirements.mirror.fit is None else requirements.changed(fit=None)


def _entry(requirements: Requirements, name: str) -> float | None:
    """An entry of whichever table has it."""
    tables = (requirements.field, requirements.mirror, requirements.lens)
    value: float | None = next(getattr(table, name) for table in tables if hasattr(table, name))
    return value


def _number(requirements: Requirements, name: str) -> float:
    """An entry that is a number, or the middle of its range."""
    value = _entry(requirements, name)
    assert value is not None
    return sum(ends(value)) / 2


def _inner(name: str, value: float) -> float:
    return float(value) if name in LINEAR else float(np.log(value))


def _outer(name: str, value: float) -> float:
    return float(value) if name in LINEAR else float(np.exp(value))
