"""What would have to give where requirements cannot all be kept: thresholds of the problem, tried before they are told.

Each requirement alone: what is free, the focus among it, is chosen anew so that a limit is missed least while all else
is kept, or so that a number that is given (field, rim, lens) moves as little as will do. Jointly: the largest share by
which any of them gives is made least, and what need not give is taken back. What comes out is rounded to the side of
caution, put into requirements of their own, and these are designed for: only if everything in them is met is it advice.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import NamedTuple

import numpy as np

from ...base.errors import OmnimirrorError
from ..criteria.limits import Limit
from ..criteria.requirements import Requirements
from ..optimise.objective import IMAGE, Key, Slack
from .alternatives import Alternative
from .space import BestDesign, Point, Say, Space
from .verdict import Judgement, unit_of

Span = tuple[float, float]

FARTHEST = 10.0  # times what was asked, or one over it
ROOM = 0.45  # of the way to where the rim is seen edge-on, for each of two angles that move at once
MORE = (0.0, 1e-4, 1e-3, 1e-2)  # shares by which advice is widened until it holds
DIGITS = 5  # of advice
STILL = 1e-6  # a share below this is none
NEAR = 4e-3  # of a threshold: how near to it the reported value is
IDLE = 0.01  # a move that saves the others less than this share of theirs is none
RANGES = {
    "omega_max_deg": (1.0, 179.0),
    "theta_max_deg": (0.1, 60.0),
    "omega_min_deg": (0.0, 170.0),
    "f_number": (0.1, 1e3),
    "magnification": (1e-5, 1e3),
    "conic": (-1e3, 1e3),
}
LENGTHS = (1e-2, 1e5)  # mm
ANGLES = ("omega_max_deg", "theta_max_deg")  # which together decide how steep the rim is


@dataclass(frozen=True)
class Relaxation:
    """What one requirement must become, all others kept.

    Attributes
    ----------
    name
        The requirement; of a limit with its part of the field.
    unit
    asked
    needed
        None where no value of it lets the others be kept.
    limit
        Which of the limits it is; None of other requirements.
    """

    name: str
    unit: str
    asked: float
    needed: float | None
    limit: int | None = None

    @property
    def share(self) -> float | None:
        """By what share of what was asked it gives; None where that is nothing, or 0 was asked."""
        if self.needed is None or self.asked == 0:
            return None
        return abs(self.needed - self.asked) / abs(self.asked)

    @property
    def gives(self) -> bool:
        """Whether it says anything."""
        return self.needed is not None and self.needed != self.asked

    def giving(self, factor: float) -> Relaxation:
        """Giving so many times as much, in few digits."""
        if self.needed is None:
            return self
        needed = self.asked + factor * (self.needed - self.asked)
        return replace(self, needed=outwards(needed, 1 if needed > self.asked else -1))

    def widened(self, share: float) -> Relaxation:
        """Giving by a little more than needed, in few digits."""
        if self.needed is None or self.needed == self.asked:
            return self
        way = 1 if self.needed > self.asked else -1
        return replace(self, needed=outwards(self.needed + way * share * abs(self.needed), way))


@dataclass(frozen=True)
class Conflict:
    """Requirements that cannot all be kept.

    Attributes
    ----------
    missed
        Names of those that the best design misses.
    alone
        What each must become if it alone gives; the first gives least.
    joint
        What some must become if they give at once, by the least largest share that will do; without any of them it
        would not.
    joint_share
        Largest relative change in ``joint``; None if that is empty.
    alternatives
        Discrete choices that meet all requirements, or violate them less; the best first.
    is_complete
        False if a KeyboardInterrupt ended the search; the relaxations found until then are kept.
    """

    missed: tuple[str, ...]
    alone: tuple[Relaxation, ...]
    joint: tuple[Relaxation, ...]
    joint_share: float | None
    is_complete: bool = True
    alternatives: tuple[Alternative, ...] = ()


Holds = Callable[[Sequence[Relaxation]], bool | None]
"""Whether everything is met once some requirements are relaxed; None if there is no such mirror."""


def find_conflict(
    space: Space, best: BestDesign, say: Say = lambda words: None, alternatives: Iterable[Alternative] = ()
) -> Conflict | None:
    """Why not everything is kept, or None where it is.

    Parameters
    ----------
    space
        The designs around the best one.
    best
        The design that misses least.
    say
        Called with the step and the number of steps before each step.
    alternatives
        Discrete choices, evaluated while they are iterated over.
    """
    if best.verdict.is_met:
        return None
    alone, others = list[Relaxation](), list[Alternative]()
    joint: tuple[Relaxation, ...] = ()
    is_complete = True
    count = len(_names(space, best)) + 1
    try:
        for advice, point in _alone(space, best, lambda name: say(f"relaxation {len(alone) + 1} of {count}: {name}")):
            holds = partial(_holds, space, point)
            alone.append(nearest(verified(advice, holds), holds))
        say(f"relaxation {count} of {count}: all requirements together")
        joint = _jointly(space, best, sorted(alone, key=_by_share))
        others.extend(alternatives)
    except KeyboardInterrupt:
        is_complete = False
    share = max((r.share or 0.0 for r in joint), default=None)
    others.sort(key=lambda a: a.worst)
    return Conflict(best.verdict.missed, tuple(sorted(alone, key=_by_share)), joint, share, is_complete, tuple(others))


def _by_share(r: Relaxation) -> tuple[bool, float]:
    """Sort key: smallest relative change first, requirements without a threshold last."""
    return r.needed is None, r.share or 0.0


# -- advice is tried -------------------------------------------------------------------------------


def relaxed(requirements: Requirements, given: Iterable[Relaxation]) -> Requirements:
    """The requirements after some have given.

    Raises
    ------
    SpecError
        They do not fit each other.
    """
    limits, entries, imager = list(requirements.limits), {}, requirements.imager
    for r in given:
        if r.needed is None:
            continue
        if r.limit is not None:
            limits[r.limit] = _with_side(limits[r.limit], r.asked, r.needed)
        elif r.name == IMAGE:
            more = ceil(r.needed - requirements.largest_image_px)
            centre = imager.centre_px and (imager.centre_px[0] + more, imager.centre_px[1] + more)
            imager = replace(
                imager, width_px=imager.width_px + 2 * more, height_px=imager.height_px + 2 * more, centre_px=centre
            )
        else:
            entries[r.name] = r.needed
    return replace(requirements.changed(**entries), limits=tuple(limits), imager=imager)


def _with_side(limit: Limit, asked: float, needed: float) -> Limit:
    """The limit with another number on the side that was asked."""
    return replace(limit, at_most=needed) if limit.at_most == asked else replace(limit, at_least=needed)


def _holds(space: Space, point: Point, given: Sequence[Relaxation], is_local: bool = False) -> bool | None:
    """Return whether a design meets all requirements once some are relaxed; None if there is no such mirror."""
    try:
        return space.meeting(relaxed(space.requirements, given), point, is_local) is not None
    except OmnimirrorError:
        return None


def _least_wide(variants: Sequence[Sequence[Relaxation]], holds: Holds) -> Sequence[Relaxation]:
    """Return the first of several ever wider relaxations that holds, none if the widest does not."""
    first, *between, last = variants
    if holds(first):
        return first
    return next((given for given in between if holds(given)), last) if holds(last) else ()


def verified(r: Relaxation, holds: Holds) -> Relaxation:
    """Return the relaxation in a few digits, slightly wider where necessary; without a value if it never holds."""
    if not r.gives:
        return r
    found = _least_wide([[r.widened(share)] for share in MORE], holds)
    return found[0] if found else replace(r, needed=None)


def nearest(r: Relaxation, holds: Holds) -> Relaxation:
    """Return a verified relaxation reduced to the threshold: a search along a curved valley may end too early.

    Steps towards the requested value double until one does not hold; the last one is then bisected.
    """
    if not r.gives or r.needed is None:
        return r
    step = NEAR * abs(r.needed) / abs(r.needed - r.asked)  # as a share of the relaxation
    far, tried = 1.0, 1.0 - step
    while tried > 0 and holds([r.giving(tried)]):
        far, step = tried, 2 * step
        tried = far - step
    near = max(tried, 0.0)
    while far < 1 and (far - near) * abs(r.needed - r.asked) > NEAR * abs(r.needed):
        middle = (near + far) / 2
        near, far = (near, middle) if holds([r.giving(middle)]) else (middle, far)
    return r if far == 1 else r.giving(far)


def verified_together(given: Sequence[Relaxation], holds: Holds) -> tuple[Relaxation, ...]:
    """Return several simultaneous relaxations as :func:`verified`; none if they never hold."""
    rounded = tuple(r.widened(0.0) for r in given)
    found = _least_wide([tuple(r.widened(more) for r in given) for more in MORE], holds)
    # a number may be at the end of what is possible, and then only the limits can be wider
    limits_wider = [tuple(r if r.limit is None else r.widened(more) for r in rounded) for more in MORE[1:]]
    return tuple(found or _least_wide(limits_wider, holds))


def without_idle(given: tuple[Relaxation, ...], holds: Holds) -> tuple[Relaxation, ...]:
    """Return the necessary ones of simultaneous relaxations: each is tried at its requested value, the smallest first.

    A relaxation is idle if the others hold without it when they are larger by at most one hundredth; or the limits
    among them, where a number is at the end of what is possible.
    """
    for r in sorted(given, key=lambda r: r.share or 0.0):
        rest = tuple(other for other in given if other.name != r.name)
        if not rest:
            break
        more = tuple(other.giving(1 + IDLE) for other in rest)
        limits_more = tuple(o if o.limit is None else m for o, m in zip(rest, more, strict=True))
        held = holds(more)
        if held or (held is None and holds(limits_more)):
            given = more if held else limits_more
    return given


def outwards(value: float, way: int) -> float:
    """A number in few digits, rounded up (way 1) or down (-1).

    >>> outwards(6.123412, 1), outwards(6.123412, -1)
    (6.1235, 6.1234)
    """
    if value == 0:
        return value
    unit = 10.0 ** (int(np.floor(np.log10(abs(value)))) + 1 - DIGITS)
    steps = np.round(value / unit, 6)  # what is round already stays
    return float(f"{(np.ceil(steps) if way > 0 else np.floor(steps)) * unit:.{DIGITS}g}")


# -- one gives -------------------------------------------------------------------------------------


def _names(space: Space, best: BestDesign) -> list[str]:
    """List the requirements that :func:`_alone` relaxes, in its order."""
    others = [row.name for row in best.verdict.rows if _is_other(space, row)]
    return [*(row.label for row in best.verdict.limits), *others, *space.numbers]


def _is_other(space: Space, row: Judgement) -> bool:
    """Whether a row is a missed requirement that is neither a limit nor a number of the space."""
    return not (row.is_limit or row.is_met or row.name in space.numbers)


def _alone(space: Space, best: BestDesign, say: Say) -> Iterator[tuple[Relaxation, Point]]:
    """Yield each requirement that may be relaxed alone, and a design at which it suffices."""
    for i, row in enumerate(best.verdict.limits):
        say(row.label)
        yield _limit_gives(space, best, i, row)
    for row in best.verdict.rows:
        if _is_other(space, row):
            say(row.name)
            yield _limit_gives(space, best, row.name, row)
    for name in space.numbers:
        say(name)
        yield _number_gives(space, best, name)


def _limit_gives(space: Space, best: BestDesign, key: Key, row: Judgement) -> tuple[Relaxation, Point]:
    """What is asked, as near as it can be had while all else is kept."""
    advice = Relaxation(row.label, row.unit, _asked(row), None, key if isinstance(key, int) else None)
    if best.verdict.missed == (row.label,):  # the best design misses this one alone, by as little as can be
        return replace(advice, needed=row.reached), best.point
    found = space.reach(best.point, Slack((key,))) if key in space.keys else None
    if found is None and isinstance(key, int) and (begin := _without(space, best, replace(advice, needed=_far(row)))):
        found = space.reach(begin, Slack((key,)))
    if found is None:
        return advice, best.point
    return replace(advice, needed=_after_giving(row, max(found.share, 0.0))), found.point


def _without(space: Space, best: BestDesign, r: Relaxation) -> Point | None:
    """Return a design that a search finds with one requirement relaxed as far as sensible, None if there is none."""
    try:
        return space.meeting(relaxed(space.requirements, [r]), best.point)
    except OmnimirrorError:
        return None


def _far(row: Judgement) -> float:
    """Return the value of a limit that is relaxed as far as sensible."""
    asked = _asked(row)
    return asked * FARTHEST if (asked == row.at_most) == (asked > 0) else asked / FARTHEST


def _asked(row: Judgement) -> float:
    """The side of the limit that is missed, or nearer to it."""
    sides = [v for v in (row.at_least, row.at_most) if v is not None]
    return min(sides, key=lambda v: abs(v - row.reached))


def _after_giving(row: Judgement, share: float) -> float:
    """What a requirement comes to that gives by a share of what was asked."""
    asked = _asked(row)
    return asked + (1 if asked == row.at_most else -1) * share * row.scale


def _number_gives(space: Space, best: BestDesign, name: str) -> tuple[Relaxation, Point]:
    """The nearest value of a given number, either way, at which all else is kept."""
    asked, found = space.numbers[name], []
    for way in (-1, 1):
        low, high = _span(space, name, way)
        if low < high:
            freed = space.freed({name: (low, high)})
            begin = space.towards(best.point, name, way, (low, high))
            if (there := freed.reach(begin, Slack((), ((name, asked, way),)))) is not None:
                found.append((freed.value(there.point, name), there.point))
    if not found:
        return Relaxation(name, unit_of(name), asked, None), best.point
    needed, point = min(found, key=lambda f: abs(f[0] - asked))
    return Relaxation(name, unit_of(name), asked, needed), point


def _span(space: Space, name: str, way: int) -> Span:
    """Where a given number may move to, one way: no farther than makes sense, and so that the rim is not seen edge-on,
    nor a part of the field that is asked for left behind."""
    asked, field = space.numbers[name], space.requirements.field
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
    reach = abs(asked) * FARTHEST
    low, high = max(low, asked - reach if asked < 0 else asked / FARTHEST), min(high, asked + reach)
    return (low, asked) if way < 0 else (asked, high)


# -- all give --------------------------------------------------------------------------------------


class Joint(NamedTuple):
    """What gives at once: by how much each, the largest share, and a design at which it does."""

    given: tuple[Relaxation, ...]
    share: float
    point: Point


def _jointly(space: Space, best: BestDesign, alone: list[Relaxation]) -> tuple[Relaxation, ...]:
    """Return the relaxations that together need the smallest largest share; empty unless at least two are needed."""
    spans, ways = _freedom(space, alone)
    found = _least_joint(space, best, spans, ways)
    if found is None:
        return ()
    holds = partial(_holds, space, found.point, is_local=True)
    advice = verified_together(found.given, holds)
    needed = without_idle(advice, holds)
    if len(needed) < len(advice):  # anew, without the others: less has to give than by what they were tried with
        names = {r.name for r in needed}
        again = _least_joint(
            space,
            best,
            {name: span for name, span in spans.items() if name in names},
            [(name, way) for name, way in ways if name in names],
            names,
        )
        if again and (verified := verified_together(again.given, partial(_holds, space, again.point, is_local=True))):
            needed = verified
    return needed if len(needed) > 1 else ()


def _least_joint(
    space: Space,
    best: BestDesign,
    spans: dict[str, Span],
    ways: list[tuple[str, int]],
    names: Container[str] | None = None,
) -> Joint | None:
    """The least largest share of numbers and limits, of all or of those that are named; None where nothing will do."""
    rows = [(i, row) for i, row in enumerate(best.verdict.limits) if names is None or row.label in names]
    if not rows and not ways:
        return None
    freed = space.freed(spans)
    numbers = tuple((name, space.numbers[name], way) for name, way in ways)
    found = freed.reach(best.point, Slack(tuple(i for i, _ in rows), numbers))
    if found is None:
        return None
    missed = freed.missed(found.point)
    given = [
        Relaxation(row.label, row.unit, _asked(row), _after_giving(row, missed[i]), i)
        for i, row in rows
        if missed[i] > STILL
    ]
    values = {name: freed.value(found.point, name) for name in spans}
    given += [
        Relaxation(name, unit_of(name), space.numbers[name], value)
        for name, value in values.items()
        if abs(value / space.numbers[name] - 1) > STILL
    ]
    return Joint(tuple(given), found.share, found.point)


def _freedom(space: Space, alone: list[Relaxation]) -> tuple[dict[str, Span], list[tuple[str, int]]]:
    """Between which values given numbers may move at once, and which ways.

    A number that would do alone gives its own way; one that would not may still help others, either way.
    """
    spans, ways = dict[str, Span](), list[tuple[str, int]]()
    for r in (r for r in alone if r.limit is None and r.name in space.numbers):
        signs = (-1, 1) if r.needed is None else (int(np.sign(r.needed - r.asked)),)
        room = {way: span for way in signs if way and (span := _span(space, r.name, way))[0] < span[1]}
        if room:
            ways += [(r.name, way) for way in room]
            spans[r.name] = min(low for low, _ in room.values()), max(high for _, high in room.values())
    if all(name in spans for name in ANGLES):
        omega, theta = (space.numbers[name] for name in ANGLES)
        room_deg = ROOM * min(180 - omega - theta, omega - theta, omega - space.requirements.field.omega_min_deg)
        for name in ANGLES:
            asked, (low, high) = space.numbers[name], spans[name]
            spans[name] = max(low, asked - room_deg), min(high, asked + room_deg)
    return spans, ways
