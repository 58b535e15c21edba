"""Infeasible requirements: relaxations and discrete alternatives, verified by a design."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import OmnimirrorError
from ..base.results import Columns, Result, record_of, table_of
from ..optics.image_sensor import Imager
from ..optics.mirrors.mappings import MAPPINGS
from ._design_space import BestDesign, OnStep, Point, Space
from ._parameter_search import RangeSearch, Ranked
from .catalogue import ImagerComponent, read_catalogue
from .limits import Limit
from .mirror_construction import FAMILIES
from .optimiser import IMAGE, Key, Slack
from .requirement_check import RequirementCheck, Verdict, check_requirements, unit_of
from .requirements import OF_MAPPINGS, Requirements

# -- Discrete alternatives for infeasible requirements: apex, mirror, filled side, imager ----------
#
# Each alternative is screened by a few designs, without fits, and a search then improves the most
# promising ones. Both are shorter than the search of the main design; therefore the result of an
# alternative may be better than reported, but never worse.

SCREENED = 6  # designs for the screening of each alternative
SEARCHED = 3  # most promising alternatives, which are searched
IMAGERS = 3  # larger imagers of the catalogue, the smallest of them first
MIN_GAIN = (
    0.01  # relative decrease of the largest violation that makes an alternative worth reporting
)


@dataclass(frozen=True)
class Alternative:
    """Alternative value of a discrete choice, with its result.

    Attributes
    ----------
    entry
        Entry of the requirement file, for example ``"mirror.apex"``.
    requested, value
        Requested value and alternative.
    missed
        Requirements that the alternative misses; empty if it meets all.
    worst
        Largest relative violation; 0 if all requirements are met.
    """

    entry: str
    requested: str
    value: str
    missed: tuple[str, ...]
    worst: float

    @property
    def is_met(self) -> bool:
        """True if the alternative meets all requirements."""
        return not self.missed


def find_alternatives(
    requirements: Requirements, verdict: Verdict, on_step: OnStep
) -> Iterator[Alternative]:
    """Yield the alternatives that meet all requirements or violate them less than a design does.

    Parameters
    ----------
    verdict
        Design with the requested choices.
    on_step
        Callback for progress messages, called before each alternative.
    """
    screened = list[tuple[Choice, Ranked]]()
    for choice in _choices(requirements):
        on_step(f"alternative {choice.entry} = {choice.value}")
        if (result := RangeSearch(choice.requirements).screened(SCREENED)) is not None:
            screened.append((choice, result))
    screened.sort(
        key=lambda pair: max(pair[1].cost, 0.0)
    )  # those that meet all requirements in their order
    remaining = SEARCHED
    for choice, result in screened:
        if result.cost > 0 and remaining:
            remaining -= 1
            on_step(f"alternative {choice.entry} = {choice.value}: search")
            result = RangeSearch(choice.requirements).followed(result, enough=0.0)
        reached = check_requirements(choice.requirements, result.made.sensor)
        if reached.is_met or reached.worst < (1 - MIN_GAIN) * verdict.worst:
            yield Alternative(
                choice.entry, choice.requested, choice.value, reached.missed, reached.worst
            )


class Choice(NamedTuple):
    """Alternative of an entry of the requirement file, with the changed requirements."""

    entry: str
    requested: str
    value: str
    requirements: Requirements


def _choices(requirements: Requirements) -> Iterator[Choice]:
    """Yield the alternatives that fit the other entries."""
    mirror, lens, imager = requirements.mirror, requirements.lens, requirements.imager
    apex = "smooth" if mirror.is_pointed else "pointed"
    choices: list[tuple[str, str, str, dict[str, Any]]] = []
    if mirror.mapping not in (None, "cylinder"):
        choices.append(("mirror.apex", mirror.apex, apex, {"apex": apex}))
    if imager.width_px != imager.height_px:
        side = "long-side" if lens.fills == "short-side" else "short-side"
        choices.append(("lens.fills", lens.fills, side, {"fills": side}))
    kind = mirror.mapping or mirror.family or ""
    none = dict.fromkeys((*OF_MAPPINGS, "mapping", "family", "conic", "fit"))
    smooth = none | {"apex": "smooth"}
    choices += [
        ("mirror.family", kind, name, smooth | {"family": name})
        for name in FAMILIES
        if name != kind
    ]
    choices += [
        ("mirror.mapping", kind, name, smooth | {"mapping": name})
        for name in MAPPINGS
        if name not in (kind, "tabulated-mapping", "cylinder", "ground-plane")
    ]
    for entry, requested, value, entries in choices:
        try:
            yield Choice(entry, requested, value, requirements.changed(**entries))
        except OmnimirrorError:  # the choice does not fit the other entries
            continue
    for part in _larger_imagers(requirements):
        requested = f"{imager.width_px} x {imager.height_px} px of {imager.pixel_pitch_um:g} um"
        larger = Imager(part.width_px, part.height_px, part.pixel_pitch_um)
        yield Choice("imager", requested, part.name, replace(requirements, imager=larger))


def _larger_imagers(requirements: Requirements) -> list[ImagerComponent]:
    """Return the bundled imagers with a larger short side in pixels, smallest first."""

    def short_side(imager: Imager | ImagerComponent) -> int:
        return min(imager.width_px, imager.height_px)

    larger = [
        part
        for part in read_catalogue().imagers
        if short_side(part) > short_side(requirements.imager)
    ]
    return sorted(larger, key=short_side)[:IMAGERS]


# -- Relaxations of infeasible requirements: thresholds of feasibility, verified by a design -------
#
# Individually: the free parameters, including the focus, are optimised for the smallest violation of
# one limit with all other requirements met, or for the smallest change of a given number (field, rim,
# lens). Jointly: the largest relative relaxation is minimised, and unnecessary relaxations are
# withdrawn. The results are rounded outwards and verified by a design for the relaxed requirements;
# only relaxations with a feasible design are reported.

Span = tuple[float, float]

MAX_RELAXATION = 10.0  # maximum factor of relaxation
ROOM = 0.45  # share of the distance to edge-on view, for each of two varied angles
WIDENINGS = (0.0, 1e-4, 1e-3, 1e-2)  # relative widening until a relaxation is verified
DIGITS = 5  # significant digits of the results
NEGLIGIBLE_CHANGE = 1e-6  # relative changes below this are 0
THRESHOLD_ACCURACY = 4e-3  # relative accuracy of a threshold
IDLE = 0.01  # largest relative increase of the others for an unnecessary relaxation
RANGES = {
    "omega_max_deg": (1.0, 179.0),
    "theta_max_deg": (0.1, 60.0),
    "omega_min_deg": (0.0, 170.0),
    "f_number": (0.1, 1e3),
    "magnification": (1e-5, 1e3),
    "conic": (-1e3, 1e3),
}
LENGTHS = (1e-2, 1e5)  # mm
ANGLES = ("omega_max_deg", "theta_max_deg")  # both determine the slope at the rim


@dataclass(frozen=True)
class Relaxation:
    """Required value of one requirement with all others met.

    Attributes
    ----------
    name
        Name of the requirement; for a limit with its part of the field.
    unit
    requested
    needed
        Required value; None if no value is sufficient.
    limit
        Index of the limit; None for other requirements.
    """

    name: str
    unit: str
    requested: float
    needed: float | None
    limit: int | None = None

    @property
    def relative_change(self) -> float | None:
        """Relative change; None without a required value or for a request of 0."""
        if self.needed is None or self.requested == 0:
            return None
        return abs(self.needed - self.requested) / abs(self.requested)

    @property
    def is_changed(self) -> bool:
        """True if the required value differs from the requested one."""
        return self.needed is not None and self.needed != self.requested

    def scaled(self, factor: float) -> Relaxation:
        """Return the relaxation scaled by a factor, rounded outwards."""
        if self.needed is None:
            return self
        needed = self.requested + factor * (self.needed - self.requested)
        return replace(self, needed=outwards(needed, 1 if needed > self.requested else -1))

    def widened(self, relative_change: float) -> Relaxation:
        """Return the relaxation widened by a relative amount, rounded outwards."""
        if self.needed is None or self.needed == self.requested:
            return self
        way = 1 if self.needed > self.requested else -1
        return replace(
            self, needed=outwards(self.needed + way * relative_change * abs(self.needed), way)
        )


@dataclass(frozen=True)
class Conflict(Result):
    """Requirements that cannot all be met.

    Attributes
    ----------
    missed
        Names of the requirements missed by the best design.
    alone
        Individual relaxations, smallest relative change first.
    joint
        Joint relaxations of the smallest largest relative change; each of them is necessary.
    joint_change
        Largest relative change in ``joint``; None if that is empty.
    alternatives
        Discrete choices that meet all requirements, or violate them less; best first.
    is_complete
        False if a KeyboardInterrupt ended the search; earlier results are retained.
    """

    missed: tuple[str, ...]
    alone: tuple[Relaxation, ...]
    joint: tuple[Relaxation, ...]
    joint_change: float | None
    is_complete: bool = True
    alternatives: tuple[Alternative, ...] = ()

    def _table(self) -> Columns:
        return table_of(
            {"group": group, **record_of(row), "relative_change": row.relative_change}
            for group, rows in (("alone", self.alone), ("joint", self.joint))
            for row in rows
        )


Holds = Callable[[Sequence[Relaxation]], bool | None]
"""Function that checks the feasibility of relaxed requirements; None without a mirror."""


def find_conflict(
    space: Space,
    best: BestDesign,
    on_step: OnStep = lambda message: None,
    alternatives: Iterable[Alternative] = (),
) -> Conflict:
    """Analyse the conflict of infeasible requirements.

    Parameters
    ----------
    space
        Design space around the best design.
    best
        Design with the smallest violation.
    on_step
        Callback with the current step and the number of steps, called before each step.
    alternatives
        Discrete choices, evaluated during iteration.
    """
    alone, others = list[Relaxation](), list[Alternative]()
    joint: tuple[Relaxation, ...] = ()
    is_complete = True
    count = len(_names(space, best)) + 1
    try:
        for advice, point in _single_relaxations(
            space, best, lambda name: on_step(f"relaxation {len(alone) + 1} of {count}: {name}")
        ):
            holds = partial(_holds, space, point)
            alone.append(nearest(verified(advice, holds), holds))
        on_step(f"relaxation {count} of {count}: all requirements together")
        joint = _jointly(space, best, sorted(alone, key=_by_share))
        others.extend(alternatives)
    except KeyboardInterrupt:
        is_complete = False
    relative_change = max((r.relative_change or 0.0 for r in joint), default=None)
    others.sort(key=lambda a: a.worst)
    return Conflict(
        best.verdict.missed,
        tuple(sorted(alone, key=_by_share)),
        joint,
        relative_change,
        is_complete,
        tuple(others),
    )


def _by_share(r: Relaxation) -> tuple[bool, float]:
    """Return the sort key: smallest relative change first, missing thresholds last."""
    return r.needed is None, r.relative_change or 0.0


# -- verification of relaxations -------------------------------------------------------------------


def relaxed(requirements: Requirements, relaxations: Iterable[Relaxation]) -> Requirements:
    """Return the requirements with some of them relaxed.

    Raises
    ------
    SpecError
        If the requirements are inconsistent.
    """
    limits, entries, imager = list(requirements.limits), {}, requirements.imager
    for r in relaxations:
        if r.needed is None:
            continue
        if r.limit is not None:
            limits[r.limit] = _with_side(limits[r.limit], r.requested, r.needed)
        elif r.name == IMAGE:
            more = ceil(r.needed - requirements.largest_image_px)
            centre = imager.centre_px and (imager.centre_px[0] + more, imager.centre_px[1] + more)
            imager = replace(
                imager,
                width_px=imager.width_px + 2 * more,
                height_px=imager.height_px + 2 * more,
                centre_px=centre,
            )
        else:
            entries[r.name] = r.needed
    return replace(requirements.changed(**entries), limits=tuple(limits), imager=imager)


def _with_side(limit: Limit, requested: float, needed: float) -> Limit:
    """Return the limit with another value of the requested bound."""
    return (
        replace(limit, at_most=needed)
        if limit.at_most == requested
        else replace(limit, at_least=needed)
    )


def _holds(
    space: Space, point: Point, relaxations: Sequence[Relaxation], is_local: bool = False
) -> bool | None:
    """Return whether a design meets the relaxed requirements; None if the mirror does not exist."""
    try:
        return (
            space.search_design(relaxed(space.requirements, relaxations), point, is_local)
            is not None
        )
    except OmnimirrorError:
        return None


def _minimum_widening(
    variants: Sequence[Sequence[Relaxation]], holds: Holds
) -> Sequence[Relaxation]:
    """Return the first feasible relaxation of an increasing sequence; none if all fail."""
    first, *between, last = variants
    if holds(first):
        return first
    return (
        next((relaxations for relaxations in between if holds(relaxations)), last)
        if holds(last)
        else ()
    )


def verified(r: Relaxation, holds: Holds) -> Relaxation:
    """Return the relaxation rounded and widened if necessary, or without a value."""
    if not r.is_changed:
        return r
    result = _minimum_widening(
        [[r.widened(relative_change)] for relative_change in WIDENINGS], holds
    )
    return result[0] if result else replace(r, needed=None)


def nearest(r: Relaxation, holds: Holds) -> Relaxation:
    """Return a verified relaxation reduced to the threshold of feasibility.

    Steps towards the requested value double until one is infeasible; the last step is then
    bisected.
    """
    if not r.is_changed or r.needed is None:
        return r
    step = (
        THRESHOLD_ACCURACY * abs(r.needed) / abs(r.needed - r.requested)
    )  # relative to the relaxation
    far, trial = 1.0, 1.0 - step
    while trial > 0 and holds([r.scaled(trial)]):
        far, step = trial, 2 * step
        trial = far - step
    near = max(trial, 0.0)
    while far < 1 and (far - near) * abs(r.needed - r.requested) > THRESHOLD_ACCURACY * abs(
        r.needed
    ):
        middle = (near + far) / 2
        near, far = (near, middle) if holds([r.scaled(middle)]) else (middle, far)
    return r if far == 1 else r.scaled(far)


def verified_together(relaxations: Sequence[Relaxation], holds: Holds) -> tuple[Relaxation, ...]:
    """Return several simultaneous relaxations as :func:`verified`; none if infeasible."""
    rounded = tuple(r.widened(0.0) for r in relaxations)
    result = _minimum_widening(
        [tuple(r.widened(more) for r in relaxations) for more in WIDENINGS], holds
    )
    # a number may be at the end of its possible range; then only the limits can be widened
    limits_wider = [
        tuple(r if r.limit is None else r.widened(more) for r in rounded) for more in WIDENINGS[1:]
    ]
    return tuple(result or _minimum_widening(limits_wider, holds))


def without_idle(relaxations: tuple[Relaxation, ...], holds: Holds) -> tuple[Relaxation, ...]:
    """Return the necessary ones of simultaneous relaxations, testing the smallest first.

    A relaxation is unnecessary if the others are feasible without it after an increase of at most 1
    %; or the limits among them, if a number is at the end of its possible range.
    """
    for r in sorted(relaxations, key=lambda r: r.relative_change or 0.0):
        rest = tuple(other for other in relaxations if other.name != r.name)
        if not rest:
            break
        more = tuple(other.scaled(1 + IDLE) for other in rest)
        limits_more = tuple(o if o.limit is None else m for o, m in zip(rest, more, strict=True))
        held = holds(more)
        if held or (held is None and holds(limits_more)):
            relaxations = more if held else limits_more
    return relaxations


def outwards(value: float, way: int) -> float:
    """Return a number rounded to few digits, up (way 1) or down (-1).

    >>> outwards(6.123412, 1), outwards(6.123412, -1)
    (6.1235, 6.1234)
    """
    if value == 0:
        return value
    unit = 10.0 ** (int(np.floor(np.log10(abs(value)))) + 1 - DIGITS)
    steps = np.round(value / unit, 6)  # rounded values are unchanged
    return float(f"{(np.ceil(steps) if way > 0 else np.floor(steps)) * unit:.{DIGITS}g}")


# -- individual relaxations ------------------------------------------------------------------------


def _names(space: Space, best: BestDesign) -> list[str]:
    """List the requirements relaxed by :func:`_single_relaxations`, in its order."""
    others = [row.name for row in best.verdict.rows if _is_other(space, row)]
    return [*(row.label for row in best.verdict.limits), *others, *space.numbers]


def _is_other(space: Space, row: RequirementCheck) -> bool:
    """Return whether a row is a missed requirement other than limits and numbers."""
    return not (row.is_limit or row.is_met or row.name in space.numbers)


def _single_relaxations(
    space: Space, best: BestDesign, on_step: OnStep
) -> Iterator[tuple[Relaxation, Point]]:
    """Yield each individually relaxed requirement with a feasible design."""
    for i, row in enumerate(best.verdict.limits):
        on_step(row.label)
        yield _relaxed_limit(space, best, i, row)
    for row in best.verdict.rows:
        if _is_other(space, row):
            on_step(row.name)
            yield _relaxed_limit(space, best, row.name, row)
    for name in space.numbers:
        on_step(name)
        yield _relaxed_number(space, best, name)


def _relaxed_limit(
    space: Space, best: BestDesign, key: Key, row: RequirementCheck
) -> tuple[Relaxation, Point]:
    """Minimise the violation of one requirement with all others met."""
    advice = Relaxation(
        row.label, row.unit, _required_value(row), None, key if isinstance(key, int) else None
    )
    if best.verdict.missed == (
        row.label,
    ):  # the best design violates only this one, by the smallest amount
        return replace(advice, needed=row.reached), best.point
    result = space.reach(best.point, Slack((key,))) if key in space.keys else None
    if (
        result is None
        and isinstance(key, int)
        and (begin := _without(space, best, replace(advice, needed=_maximum_relaxation(row))))
    ):
        result = space.reach(begin, Slack((key,)))
    if result is None:
        return advice, best.point
    return replace(
        advice, needed=_relaxed_value(row, max(result.relative_change, 0.0))
    ), result.point


def _without(space: Space, best: BestDesign, r: Relaxation) -> Point | None:
    """Return a design found with one requirement relaxed to its maximum; None if there is none."""
    try:
        return space.search_design(relaxed(space.requirements, [r]), best.point)
    except OmnimirrorError:
        return None


def _maximum_relaxation(row: RequirementCheck) -> float:
    """Return the value of a limit at its maximum relaxation."""
    requested = _required_value(row)
    return (
        requested * MAX_RELAXATION
        if (requested == row.at_most) == (requested > 0)
        else requested / MAX_RELAXATION
    )


def _required_value(row: RequirementCheck) -> float:
    """Return the violated bound of the limit, or the nearer one."""
    sides = [v for v in (row.at_least, row.at_most) if v is not None]
    return min(sides, key=lambda v: abs(v - row.reached))


def _relaxed_value(row: RequirementCheck, relative_change: float) -> float:
    """Return the value of a requirement after a relative relaxation."""
    requested = _required_value(row)
    return requested + (1 if requested == row.at_most else -1) * relative_change * row.scale


def _relaxed_number(space: Space, best: BestDesign, name: str) -> tuple[Relaxation, Point]:
    """Return the nearest value of a given number with all other requirements met."""
    requested, results = space.numbers[name], []
    for way in (-1, 1):
        low, high = _span(space, name, way)
        if low < high:
            freed = space.freed({name: (low, high)})
            begin = space.towards(best.point, name, way, (low, high))
            if (there := freed.reach(begin, Slack((), ((name, requested, way),)))) is not None:
                results.append((freed.value(there.point, name), there.point))
    if not results:
        return Relaxation(name, unit_of(name), requested, None), best.point
    needed, point = min(results, key=lambda f: abs(f[0] - requested))
    return Relaxation(name, unit_of(name), requested, needed), point


def _span(space: Space, name: str, way: int) -> Span:
    """Return the range of a given number in one direction, without an edge-on rim and without
    exclusion of a part of the field that a limit refers to.
    """
    requested, field = space.numbers[name], space.requirements.field
    low, high = RANGES.get(name, LENGTHS)
    if name in ANGLES:
        omega, theta = field.omega_max_deg, space.numbers.get("theta_max_deg", 0.0)
        high = min(high, 179.0 - (theta if name == "omega_max_deg" else omega))
    if name == "omega_max_deg":
        parts = [limit.omega_deg[1] for limit in space.requirements.limits if limit.omega_deg]
        low = max([low, field.omega_min_deg + 1, theta + 1, *parts])
    if name == "theta_max_deg":
        high = min(high, omega - 1)
    if name == "omega_min_deg":
        high = field.omega_max_deg - 1
    reach = abs(requested) * MAX_RELAXATION
    low, high = (
        max(low, requested - reach if requested < 0 else requested / MAX_RELAXATION),
        min(high, requested + reach),
    )
    return (low, requested) if way < 0 else (requested, high)


# -- joint relaxations -----------------------------------------------------------------------------


class Joint(NamedTuple):
    """Joint relaxations: each change, the largest relative change, and a feasible design."""

    given: tuple[Relaxation, ...]
    relative_change: float
    point: Point


def _jointly(space: Space, best: BestDesign, alone: list[Relaxation]) -> tuple[Relaxation, ...]:
    """Return the joint relaxations of minimal largest change; empty unless two are needed."""
    spans, ways = _freedom(space, alone)
    result = _minimum_joint(space, best, spans, ways)
    if result is None:
        return ()
    holds = partial(_holds, space, result.point, is_local=True)
    advice = verified_together(result.given, holds)
    needed = without_idle(advice, holds)
    if len(needed) < len(
        advice
    ):  # repeat without the others: smaller relaxations may be sufficient
        names = {r.name for r in needed}
        again = _minimum_joint(
            space,
            best,
            {name: span for name, span in spans.items() if name in names},
            [(name, way) for name, way in ways if name in names],
            names,
        )
        if again and (
            verified := verified_together(
                again.given, partial(_holds, space, again.point, is_local=True)
            )
        ):
            needed = verified
    return needed if len(needed) > 1 else ()


def _minimum_joint(
    space: Space,
    best: BestDesign,
    spans: dict[str, Span],
    ways: list[tuple[str, int]],
    names: Container[str] | None = None,
) -> Joint | None:
    """Minimise the largest relative relaxation of numbers and limits; None if infeasible."""
    rows = [
        (i, row) for i, row in enumerate(best.verdict.limits) if names is None or row.label in names
    ]
    if not rows and not ways:
        return None
    freed = space.freed(spans)
    numbers = tuple((name, space.numbers[name], way) for name, way in ways)
    result = freed.reach(best.point, Slack(tuple(i for i, _ in rows), numbers))
    if result is None:
        return None
    missed = freed.missed(result.point)
    relaxations = [
        Relaxation(row.label, row.unit, _required_value(row), _relaxed_value(row, missed[i]), i)
        for i, row in rows
        if missed[i] > NEGLIGIBLE_CHANGE
    ]
    values = {name: freed.value(result.point, name) for name in spans}
    relaxations += [
        Relaxation(name, unit_of(name), space.numbers[name], value)
        for name, value in values.items()
        if abs(value / space.numbers[name] - 1) > NEGLIGIBLE_CHANGE
    ]
    return Joint(tuple(relaxations), result.relative_change, result.point)


def _freedom(
    space: Space, alone: list[Relaxation]
) -> tuple[dict[str, Span], list[tuple[str, int]]]:
    """Return the joint ranges and the directions of the given numbers.

    An individually sufficient number moves in its own direction; any other one may support the rest
    in both directions.
    """
    spans, ways = dict[str, Span](), list[tuple[str, int]]()
    for r in (r for r in alone if r.limit is None and r.name in space.numbers):
        signs = (-1, 1) if r.needed is None else (int(np.sign(r.needed - r.requested)),)
        room = {
            way: span for way in signs if way and (span := _span(space, r.name, way))[0] < span[1]
        }
        if room:
            ways += [(r.name, way) for way in room]
            spans[r.name] = (
                min(low for low, _ in room.values()),
                max(high for _, high in room.values()),
            )
    if all(name in spans for name in ANGLES):
        omega, theta = (space.numbers[name] for name in ANGLES)
        room_deg = ROOM * min(
            180 - omega - theta, omega - theta, omega - space.requirements.field.omega_min_deg
        )
        for name in ANGLES:
            requested, (low, high) = space.numbers[name], spans[name]
            spans[name] = max(low, requested - room_deg), min(high, requested + room_deg)
    return spans, ways
