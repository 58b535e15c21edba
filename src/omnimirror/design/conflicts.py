"""What would have to give where requirements cannot all be kept: found by giving, not by guessing.

Each requirement alone: a limit is left out and the others kept as well as can be, and what it then comes
to is what it must be. A number that is given (field, rim, lens) is moved, either way, to the nearest value
at which everything else is kept. Jointly: the least share by which all give at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..errors import OmnimirrorError
from .assessment import Row, unit_of
from .making import Choice
from .quantities import Limit
from .search import Candidate, Search

STEPS = (0.05, 0.15, 0.35, 0.75)  # shares by which a requirement is tried to give
FURTHER = (1.5, 3.0, 10.0, 100.0)  # for what may give by more than all of it
ROUNDS = 9  # of bisection
QUICK = 8  # candidates for each free number, where numbers are free while others give
RANGES = {"omega_max_deg": (1.0, 179.0), "theta_max_deg": (0.1, 60.0), "omega_min_deg": (0.0, 170.0)}


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
    """

    name: str
    unit: str
    asked: float
    needed: float | None

    @property
    def share(self) -> float | None:
        """By what share of what was asked it gives; None where that is nothing, or 0 was asked."""
        if self.needed is None or self.asked == 0:
            return None
        return abs(self.needed - self.asked) / abs(self.asked)


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
        That share; None where even giving half is not enough.
    """

    missed: tuple[str, ...]
    alone: tuple[Relaxation, ...]
    joint: tuple[Relaxation, ...]
    joint_share: float | None


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
    alone = []
    for name, relax in [*_limits(search, best), *_givens(search, best), *_others(search, best)]:
        if on_step:
            on_step(name)
        alone.append(relax())
    alone.sort(key=lambda r: (r.needed is None, r.share or 0.0))
    joint, share = _jointly(search, best, [r for r in alone if r.needed is not None])
    return Conflict(missed, tuple(alone), joint, share)


Entry = tuple[str, Callable[[], Relaxation]]


# -- a limit gives ---------------------------------------------------------------------------------


def _limits(search: Search, best: Candidate) -> Iterator[Entry]:
    rows = [row for row in best.rows if row.is_limit]
    for i, row in enumerate(rows):
        yield row.label, partial(_without, search, best, i, row)


def _without(search: Search, best: Candidate, index: int, row: Row) -> Relaxation:
    """The limit's value where the others are kept and it is missed least."""
    asked = asked_of(row)
    others_missed = [r for r in best.rows if r is not row and not r.is_met]
    if others_missed and not search.free:
        return Relaxation(row.label, row.unit, asked, None)
    if not others_missed:
        # the best design misses this one alone, by as little as can be
        return Relaxation(row.label, row.unit, asked, asked if row.is_met else row.reached)
    low, high = 0.0, None
    for share in (*STEPS, *FURTHER):
        if _keeps(_eased(search, {index: share}), best.choice):
            high = share
            break
        low = share
    if high is None:
        return Relaxation(row.label, row.unit, asked, None)
    share = _bisected(low, high, lambda s: _keeps(_eased(search, {index: s}), best.choice))
    return Relaxation(row.label, row.unit, asked, given_way(row, share))


def asked_of(row: Row) -> float:
    """The side of the limit that is missed, or nearer to it."""
    sides = [v for v in (row.at_least, row.at_most) if v is not None]
    return min(sides, key=lambda v: abs(v - row.reached))


def given_way(row: Row, share: float) -> float:
    asked = asked_of(row)
    return asked + (1 if asked == row.at_most else -1) * share * row.scale


def _eased(search: Search, shares: dict[int, float]) -> Search:
    """The same search with limits that give by shares of what they ask."""
    limits = list(search.requirements.limits)
    for i, share in shares.items():
        limits[i] = _ease(limits[i], share)
    return Search(replace(search.requirements, limits=tuple(limits)))


def _ease(limit: Limit, share: float) -> Limit:
    give = share * limit.scale
    return replace(
        limit,
        at_most=None if limit.at_most is None else limit.at_most + give,
        at_least=None if limit.at_least is None else limit.at_least - give,
    )


def _keeping(search: Search, start: Choice) -> Candidate | None:
    """A design near a choice that keeps everything, or None."""
    try:
        found = search.keeping(start, QUICK)
    except OmnimirrorError:
        return None
    return found if found.is_met else None


def _keeps(search: Search, start: Choice) -> bool:
    return _keeping(search, start) is not None


def _bisected(low: float, high: float, holds: Callable[[float], bool]) -> float:
    """The least number between low and high at which something holds that holds at high."""
    for _ in range(ROUNDS):
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


# -- a given number gives --------------------------------------------------------------------------


def _givens(search: Search, best: Candidate) -> Iterator[Entry]:
    """The numbers of the requirements that are no ranges."""
    requirements = search.requirements
    for name, span in search.spans.items():
        if span is None or span[0] < span[1] or span[0] == 0:
            continue
        if name == "omega_min_deg" and all(limit.omega_deg for limit in requirements.limits):
            continue
        yield name, partial(_moved, search, best, name)


def _others(search: Search, best: Candidate) -> Iterator[Entry]:
    """What is missed and is neither a limit nor a number to move: it must be what is reached, if all else is kept."""
    missed = [row for row in best.rows if not row.is_met]
    moved = {name for name, _ in _givens(search, best)}
    for row in missed:
        if not row.is_limit and row.name not in moved:
            needed = row.reached if len(missed) == 1 else None
            yield row.label, partial(Relaxation, row.label, row.unit, asked_of(row), needed)


def with_given(search: Search, name: str, value: float) -> Search:
    """The same search with one given number changed."""
    r = search.requirements
    section = {"omega_max_deg": "field", "omega_min_deg": "field", "rim_radius_mm": "mirror", "conic": "mirror"}.get(
        name, "lens"
    )
    new = value if section == "field" else (value, value)
    return Search(replace(r, **{section: getattr(r, section).model_copy(update={name: new})}))


def _moved(search: Search, best: Candidate, name: str) -> Relaxation:
    """The nearest value of a given number at which all else is kept."""
    asked = getattr(best.choice, name)

    def keeps(share: float) -> bool:
        value = asked * (1 + share)
        low, high = RANGES.get(name, (1e-3, 1e6))
        if not low <= value <= high:
            return False
        return _keeps(with_given(search, name, value), replace(best.choice, **{name: value}))

    found = []
    for sign in (-1, 1):
        low = 0.0
        for share in STEPS if sign < 0 else (*STEPS, *FURTHER[:2]):
            if keeps(sign * share):
                found.append(sign * _bisected(low, share, partial(_signed, keeps, sign)))
                break
            low = share
    needed = asked * (1 + min(found, key=abs)) if found else None
    return Relaxation(name, unit_of(name), asked, needed)


def _signed(keeps: Callable[[float], bool], sign: int, share: float) -> bool:
    return keeps(sign * share)


# -- all give --------------------------------------------------------------------------------------


def _jointly(search: Search, best: Candidate, helpful: list[Relaxation]) -> tuple[tuple[Relaxation, ...], float | None]:
    """The least share by which all limits give, and with them the given numbers that help, each its own way."""
    signs = {r.name: float(np.sign(r.needed - r.asked)) for r in helpful if r.needed is not None}
    givens = {name: sign for name, sign in signs.items() if name in search.spans and sign}
    count = len(search.requirements.limits)

    def eased(share: float) -> tuple[Search, Choice]:
        eased, choice = _eased(search, dict.fromkeys(range(count), share)), best.choice
        for name, sign in givens.items():
            value = getattr(best.choice, name) * (1 + sign * share)
            eased, choice = with_given(eased, name, value), replace(choice, **{name: value})
        return eased, choice

    low = 0.0
    for share in STEPS:
        if _keeps(*eased(share)):
            break
        low = share
    else:
        return (), None
    share = _bisected(low, share, lambda s: _keeps(*eased(s)))
    found = _keeping(*eased(share))
    assert found is not None  # the bisection ends where it was
    asked = [row for row in best.rows if row.is_limit]
    reached = [row.reached for row in found.rows if row.is_limit]
    now = [(row, replace(row, reached=value)) for row, value in zip(asked, reached, strict=True)]
    limits = (Relaxation(row.label, row.unit, asked_of(new), new.reached) for row, new in now if not new.is_met)
    moved = (replace(r, needed=r.asked * (1 + givens[r.name] * share)) for r in helpful if r.name in givens)
    return (*limits, *moved), share
