"""What would have to give where requirements cannot all be kept: thresholds of the problem, tried before they are told.

Each requirement alone: what is free, the focus among it, is chosen anew so that a limit is missed least while all else
is kept, or so that a number that is given (field, rim, lens) moves as little as will do. Jointly: the largest share by
which any of them gives is made least. What comes out is rounded to the side of caution, put into a requirement file,
and that is designed: only if everything in it is met is it advice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil

import numpy as np

from ...errors import OmnimirrorError
from ..criteria.requirement_file import requirements_of
from ..criteria.requirements import Requirements
from ..optimise.objective import IMAGE
from ..optimise.problem import imager_radius_px
from .leeway import Found, Goal, Key, Leeway, unfitted
from .range_search import Candidate, Search
from .verdict import REPORTED, Row, unit_of

FARTHEST = 10.0  # times what was asked, or one over it
LOOKED_AT = (0.05, 0.2, 0.5, 1.0, 2.0, 4.0)  # shares by which a number has moved, to see where its search should begin
MORE = (0.0, 1e-4, 1e-3, 1e-2)  # shares by which advice is widened until it holds
DIGITS = 5  # of advice
STILL = 1e-6  # a share below this is none
RANGES = {
    "omega_max_deg": (1.0, 179.0),
    "theta_max_deg": (0.1, 60.0),
    "omega_min_deg": (0.0, 170.0),
    "f_number": (0.1, 1e3),
    "conic": (-1e3, 1e3),
}


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
        What each must become if all give by the same share, which is the least that will do.
    joint_share
        That share; None where none would do.
    """

    missed: tuple[str, ...]
    alone: tuple[Relaxation, ...]
    joint: tuple[Relaxation, ...]
    joint_share: float | None


Holds = Callable[[Sequence[Relaxation]], bool]
"""Whether everything is met once some requirements have given."""


def find_conflict(search: Search, best: Candidate, on_step: Callable[[str], None] | None = None) -> Conflict | None:
    """Why not everything is kept, or None where it is.

    Parameters
    ----------
    best
        The best candidate that keeps what can be kept.
    on_step
        Called with the name of each requirement before it is made to give.
    """
    missed = tuple(row.label for row in best.rows if not row.is_met)
    if not missed:
        return None
    say = on_step or (lambda name: None)
    holds = partial(_is_met, search.requirements)
    alone = []
    for i, row in enumerate(row for row in best.rows if row.is_limit):
        say(row.label)
        alone.append(held(_pressed(search, best, i, row), holds))
    others = (r for r in best.rows if not (r.is_limit or r.is_met or r.name in _numbers(search)))
    alone += [held(_pressed(search, best, row.name, row), holds) for row in others]
    for name in _numbers(search):
        say(name)
        alone.append(held(_moved(search, best, name), holds))
    alone.sort(key=lambda r: (r.needed is None, r.share or 0.0))
    say("everything")
    joint, share = held_together(*_jointly(search, best, alone), holds)
    return Conflict(missed, tuple(alone), joint, share)


# -- advice is tried -------------------------------------------------------------------------------


def relaxed(requirements: Requirements, given: Iterable[Relaxation]) -> Requirements:
    """The requirements after some have given, read as a file that says so.

    Raises
    ------
    SpecError
        There is no such file.
    """
    tables = requirements.tables()
    for r in given:
        if r.needed is None:
            continue
        if r.limit is not None:
            limit = tables["limit"][r.limit]
            limit["at_most" if limit.get("at_most") == r.asked else "at_least"] = r.needed
        elif r.name == IMAGE:
            more = ceil(r.needed - imager_radius_px(requirements.imager))
            tables["imager"] |= {name: tables["imager"][name] + 2 * more for name in ("width_px", "height_px")}
            if "centre_px" in tables["imager"]:
                tables["imager"]["centre_px"] = [c + more for c in tables["imager"]["centre_px"]]
        else:
            _change(tables, r)
    return requirements_of(tables)


def _change(tables: dict[str, dict[str, object]], r: Relaxation) -> None:
    """A given number that moves, or a range that reaches farther."""
    section = next(tables[name] for name in ("field", "mirror", "lens") if r.name in tables[name])
    now = section[r.name]
    low, high = now if isinstance(now, list) else (r.asked, r.asked)
    section[r.name] = r.needed if low == high else [min(low, r.needed), max(high, r.needed)]  # type: ignore[type-var]


def _is_met(requirements: Requirements, given: Sequence[Relaxation]) -> bool:
    """Whether a design made from scratch meets everything once some requirements have given."""
    try:
        search = Search(relaxed(requirements, given))
        return search.judge(search.best().choice, REPORTED).is_met
    except OmnimirrorError:
        return False


def held(r: Relaxation, holds: Holds) -> Relaxation:
    """The advice in few digits, as it was found or a little wider, once it holds; without a value if it never does."""
    if r.needed is None or r.needed == r.asked:
        return r
    wider = (r.widened(share) for share in MORE)
    return next((w for w in wider if holds([w])), replace(r, needed=None))


def held_together(
    given: tuple[Relaxation, ...], share: float | None, holds: Holds
) -> tuple[tuple[Relaxation, ...], float | None]:
    """As :func:`held`, of several that give at once."""
    if share is None or not given:
        return (), None
    rounded = tuple(r.widened(0.0) for r in given)  # a number may stand where it can go no farther
    for more in MORE:
        limits_wider = tuple(r if r.limit is None else r.widened(more) for r in rounded)
        for wider in dict.fromkeys((limits_wider, tuple(r.widened(more) for r in given))):
            if holds(wider):
                return wider, share
    return (), None


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


# -- a limit gives ---------------------------------------------------------------------------------


def asked_of(row: Row) -> float:
    """The side of the limit that is missed, or nearer to it."""
    sides = [v for v in (row.at_least, row.at_most) if v is not None]
    return min(sides, key=lambda v: abs(v - row.reached))


def given_way(row: Row, share: float) -> float:
    """What a requirement comes to that gives by a share of what was asked."""
    asked = asked_of(row)
    return asked + (1 if asked == row.at_most else -1) * share * row.scale


def _pressed(search: Search, best: Candidate, key: Key, row: Row) -> Relaxation:
    """What is asked, as near as it can be had while all else is kept."""
    missed = [other for other in best.rows if not other.is_met]
    asked, number = asked_of(row), key if isinstance(key, int) else None
    if missed == [row]:  # the best design misses this one alone, by as little as can be
        return Relaxation(row.label, row.unit, asked, row.reached, number)
    found = _near(search, best, {}).reach(_point(search, best, {}), Goal((key,)))
    needed = None if found is None else given_way(row, max(found.share, 0.0))
    return Relaxation(row.label, row.unit, asked, needed, number)


def _near(search: Search, best: Candidate, spans: dict[str, tuple[float, float]]) -> Leeway:
    """What may move: the free numbers, and some that were given."""
    free = {name: search.spans[name] or (0.0, 0.0) for name in search.free}
    return Leeway(search.requirements, best.choice, free | spans, best.made)


def _point(search: Search, best: Candidate, values: dict[str, float]) -> np.ndarray:
    """The best candidate as a point, with given numbers moved to other values."""
    leeway = _near(search, best, dict.fromkeys(values, (0.0, 0.0)))
    return leeway.point(replace(best.choice, **values), best.made.sensor.lens.focus_distance_mm)


# -- a given number gives --------------------------------------------------------------------------


def _numbers(search: Search) -> list[str]:
    """The numbers of the requirements that are no ranges."""
    names = [n for n, span in search.spans.items() if span is not None and span[0] == span[1] != 0]
    if all(limit.omega_deg for limit in search.requirements.limits):
        return [name for name in names if name != "omega_min_deg"]
    return names


def _span(search: Search, best: Candidate, name: str, sign: int) -> tuple[float, float]:
    """Where a given number may move to, one way."""
    asked, field = getattr(best.choice, name), search.requirements.field
    low, high = RANGES.get(name, (1e-2, 1e5))
    if name in ("omega_max_deg", "theta_max_deg"):  # the rim must not be seen edge-on, nor parts of the field vanish
        other = best.choice.theta_max_deg or 0.0 if name == "omega_max_deg" else best.choice.omega_max_deg
        high = min(high, 179.0 - other)
    if name == "omega_max_deg":
        parts = [limit.omega_deg[1] for limit in search.requirements.limits if limit.omega_deg]
        low = max([low, field.omega_min_deg + 1, *parts])
    if name == "omega_min_deg":
        high = field.omega_max_deg - 1
    reach = abs(asked) * FARTHEST
    low, high = max(low, asked - reach if asked < 0 else asked / FARTHEST), min(high, asked + reach)
    return (low, asked) if sign < 0 else (asked, high)


def _moved(search: Search, best: Candidate, name: str) -> Relaxation:
    """The nearest value of a given number, either way, at which all else is kept."""
    asked = getattr(best.choice, name)
    found = []
    for sign in (-1, 1):
        low, high = _span(search, best, name, sign)
        if low < high and (there := _reached(search, best, name, sign, (low, high))) is not None:
            found.append(getattr(there.choice, name))
    needed = min(found, key=lambda v: abs(v - asked)) if found else None
    return Relaxation(name, unit_of(name), asked, needed)


def _reached(search: Search, best: Candidate, name: str, sign: int, span: tuple[float, float]) -> Found | None:
    """Where a number that moves one way lets all be kept; from where it does already, or is nearest to it."""
    asked = getattr(best.choice, name)
    plain, near, least = Search(unfitted(search.requirements)), best, np.inf
    for share in LOOKED_AT:
        value = asked + sign * share * abs(asked)
        if not span[0] <= value <= span[1]:
            break
        there = with_given(plain, name, value).judged(replace(best.choice, **{name: value}))
        if there is not None and there.worst < least:
            near, least = there, there.worst
        if least <= 0:
            break
    leeway = _near(search, best, {name: span})
    start = leeway.point(near.choice, near.made.sensor.lens.focus_distance_mm)
    return leeway.reach(start, Goal((), ((name, asked, sign),)))


def with_given(search: Search, name: str, value: float) -> Search:
    """The same search with one given number changed."""
    r = search.requirements
    section = {"omega_max_deg": "field", "omega_min_deg": "field", "rim_radius_mm": "mirror", "conic": "mirror"}.get(
        name, "lens"
    )
    return Search(replace(r, **{section: replace(getattr(r, section), **{name: value})}))


# -- all give --------------------------------------------------------------------------------------


def _jointly(search: Search, best: Candidate, alone: list[Relaxation]) -> tuple[tuple[Relaxation, ...], float | None]:
    """The least share by which all limits give, and with them the given numbers.

    A number that would do alone gives its own way; one that would not may still help others, either way.
    """
    helpful = {r.name: int(np.sign(r.needed - r.asked)) for r in alone if r.needed is not None and r.limit is None}
    ways: dict[str, tuple[int, ...]] = {}
    spans: dict[str, tuple[float, float]] = {}
    for name in (r.name for r in alone if r.name in _numbers(search)):
        signs = (helpful[name],) if name in helpful else (-1, 1)
        room = {sign: span for sign in signs if sign and (span := _span(search, best, name, sign))[0] < span[1]}
        if room:
            ways[name] = tuple(room)
            spans[name] = min(low for low, _ in room.values()), max(high for _, high in room.values())
    keys = tuple(range(len(search.requirements.limits)))
    if not keys and not ways:
        return (), None
    asked = {name: float(getattr(best.choice, name)) for name in ways}
    numbers = tuple((name, asked[name], sign) for name, signs in ways.items() for sign in signs)
    leeway = _near(search, best, spans)
    found = leeway.reach(_point(search, best, asked), Goal(keys, numbers))
    if found is None:
        return (), None
    y, moved = _without_idle(leeway, found, keys, asked)
    missed = leeway.missed(y, fitted=True)
    shares = [float(missed[key].max()) for key in keys]
    rows = [row for row in best.rows if row.is_limit]
    limits = (
        Relaxation(row.label, row.unit, asked_of(row), given_way(row, share), i)
        for i, (row, share) in enumerate(zip(rows, shares, strict=True))
        if share > STILL
    )
    changed = (Relaxation(n, unit_of(n), asked[n], v) for n, v in moved.items())
    given = (*limits, *changed)
    return (given, found.share) if len(given) > 1 else ((), None)


def _without_idle(
    leeway: Leeway, found: Found, keys: Sequence[Key], asked: dict[str, float]
) -> tuple[np.ndarray, dict[str, float]]:
    """What was found with every number put back that need not have moved, and the others."""
    y, moved = found.y, {name: getattr(found.choice, name) for name in asked}
    for name in sorted(asked, key=lambda n: abs(moved[n] / asked[n] - 1)):
        back = leeway.point(replace(leeway.choice(y)[0], **{name: asked[name]}), found.focus_mm)
        try:
            missed = leeway.missed(back, fitted=True)
        except OmnimirrorError:
            continue
        if all(rows.max() <= (found.share if key in keys else 0.0) + STILL for key, rows in missed.items()):
            y = back
            del moved[name]
    return y, moved
