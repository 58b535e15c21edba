"""What would have to give where no mirror of free form keeps everything: each answer is an optimum of its own.

A limit that gives alone is pressed down while all others are kept. A number that is given (field, rim, lens) is
set free, and moves as little as will do. Jointly, the largest share by which any of them gives is made least. What
comes out is put into a requirement file, and is advice if a mirror near by meets everything in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...errors import OmnimirrorError
from ..criteria.ranges import ends
from ..criteria.requirements import Requirements
from ..optimise.objective import IMAGE, Concession, Key, Objective
from ..optimise.optimiser import CLOSE, KEPT, coarse_nodes, follow
from ..optimise.problem import DesignProblem
from ..optimise.variables import DesignSpace
from .freeform import Shaped, judged_sensor, problem_of
from .relaxation import RANGES, Conflict, Relaxation, asked_of, given_way, held, held_together, relaxed
from .verdict import Row, unit_of

Array = NDArray[np.float64]

NUMBERS = ("omega_max_deg", "theta_max_deg", "rim_radius_mm", "focal_length_mm", "f_number")
FARTHEST = 10.0  # times what was asked, or one over it
STILL = 1e-6  # a share below this is none


Place = dict[str, float]
"""A design by the names of its coordinates."""


def find_concessions(
    requirements: Requirements, shaped: Shaped, on_step: Callable[[str], None] | None = None
) -> Conflict | None:
    """Why not everything is kept, or None where it is; ``on_step`` is told the name of each before it gives."""
    missed = tuple(row.label for row in shaped.rows if not row.is_met)
    if not missed:
        return None
    say = on_step or (lambda name: None)

    def tried(found: tuple[Relaxation, Place]) -> Relaxation:
        return held(found[0], partial(_is_met, requirements, shaped.problem, found[1]))

    alone = []
    for i, row in enumerate(row for row in shaped.rows if row.is_limit):
        say(row.label)
        alone.append(tried(_pressed(shaped, i, row)))
    others = (row for row in shaped.rows if not (row.is_limit or row.is_met or row.name in NUMBERS))
    alone += [tried(_other(shaped, row)) for row in others]
    for name in NUMBERS:
        if getattr(shaped.problem, name) is not None and name not in shaped.problem.free:
            say(name)
            alone.append(tried(_number(shaped, name)))
    alone.sort(key=lambda r: (r.needed is None, r.share or 0.0))
    say("everything")
    given, share, place = _jointly(shaped, alone)
    joint, share = held_together(given, share, partial(_is_met, requirements, shaped.problem, place))
    return Conflict(missed, tuple(alone), joint, share)


def _is_met(requirements: Requirements, problem: DesignProblem, place: Place, given: Sequence[Relaxation]) -> bool:
    """Whether a mirror near a place meets everything, once some requirements have given."""
    try:
        wanted = relaxed(requirements, given)
        theirs = replace(problem_of(wanted), mode=problem.mode, image_radius_px=problem.image_radius_px)
        objective = Objective(DesignSpace(theirs), Concession(()), coarse_nodes(theirs))
        objective = replace(objective, goal=Concession(objective.asked))
        y = follow(objective, _point(theirs, place), tolerance=CLOSE).y
        _, _, rows = judged_sensor(wanted, DesignSpace(theirs).sensor(y))
    except OmnimirrorError:
        return False
    return all(row.is_met for row in rows)


def _place(problem: DesignProblem, y: Array) -> Place:
    return dict(zip(DesignSpace(problem).names, y.tolist(), strict=True))


def _followed(problem: DesignProblem, y: Array, goal: Concession) -> tuple[Array, float] | None:
    """Where a goal is reached best from a point, and the share conceded; None where something else is missed."""
    found = follow(Objective(DesignSpace(problem), goal, coarse_nodes(problem)), y, tolerance=CLOSE)
    return (found.y, found.value) if found.violation < KEPT else None


def _pressed(shaped: Shaped, key: Key, row: Row) -> tuple[Relaxation, Place]:
    """What is asked, as near as it can be had while all else is kept."""
    found = _followed(shaped.problem, shaped.y, Concession((key,)))
    needed = None if found is None else given_way(row, max(found[1], 0.0))
    told = Relaxation(row.label, row.unit, asked_of(row), needed, key if isinstance(key, int) else None)
    return told, _place(shaped.problem, shaped.y if found is None else found[0])


def _other(shaped: Shaped, row: Row) -> tuple[Relaxation, Place]:
    """What is neither a limit nor a given number: the rim's image, where the view begins to be clear."""
    if row.name == IMAGE and shaped.problem.has_image_to_fit:
        return _pressed(shaped, IMAGE, row)
    others_missed = any(not r.is_met for r in shaped.rows if r is not row)
    needed = None if others_missed else row.reached
    return Relaxation(row.label, row.unit, asked_of(row), needed), _place(shaped.problem, shaped.y)


def _number(shaped: Shaped, name: str) -> tuple[Relaxation, Place]:
    """The nearest value of a given number, either way, at which all can be kept."""
    asked = ends(getattr(shaped.problem, name))[0]
    found: list[tuple[float, Place]] = []
    for sign in (-1, 1):
        freed = _freed(shaped.problem, {name: (sign,)})
        if freed is None:
            continue
        goal = Concession((), ((name, asked, sign),))
        reached = _followed(freed, _point(freed, _known(shaped)), goal)
        if reached is not None:
            found.append((sign * max(reached[1], 0.0), _place(freed, reached[0])))
    if not found:
        return Relaxation(name, unit_of(name), asked, None), {}
    share, place = min(found, key=lambda f: abs(f[0]))
    return Relaxation(name, unit_of(name), asked, asked * (1 + share)), place


def _freed(problem: DesignProblem, ways: dict[str, tuple[int, ...]]) -> DesignProblem | None:
    """The problem with numbers free on one side of what was asked, or on both; None where there is no room."""
    spans = {}
    for name, signs in ways.items():
        asked = ends(getattr(problem, name))[0]
        low, high = RANGES.get(name, (1e-3, 1e6))
        span = (
            max(asked / FARTHEST, low) if -1 in signs else asked,
            min(asked * FARTHEST, high) if 1 in signs else asked,
        )
        if name in ("omega_max_deg", "theta_max_deg"):
            room = _room(problem)
            span = max(span[0], asked - room), min(span[1], asked + room)
        if name == "omega_max_deg" and span[0] < asked:  # no limit's part of the field may be left behind
            parts = [limit.omega_deg[1] for limit in problem.limits if limit.omega_deg]
            span = max([span[0], *parts]), span[1]
        if not span[0] < span[1]:
            return None
        spans[name] = span
    return replace(problem, **spans)  # type: ignore[arg-type]


def _room(problem: DesignProblem) -> float:
    """How far field and viewing angle can both move without the rim's being seen edge-on, or the field's vanishing."""
    omega = ends(problem.omega_max_deg)
    theta = ends(problem.theta_max_deg)[1] if problem.theta_max_deg is not None else 0.0
    return 0.45 * min(180 - omega[1] - theta, omega[0] - theta, omega[0] - problem.omega_min_deg)


def _known(shaped: Shaped) -> Place:
    """The design, and the numbers given that may be set free."""
    asked = {n: float(np.log(ends(v)[0])) for n in NUMBERS if (v := getattr(shaped.problem, n)) is not None}
    return asked | _place(shaped.problem, shaped.y)


def _point(problem: DesignProblem, place: Place) -> Array:
    """A place as a point of a problem's space, which may have other numbers free."""
    return np.array([place.get(name, 0.0) for name in DesignSpace(problem).names])


def _jointly(shaped: Shaped, alone: list[Relaxation]) -> tuple[tuple[Relaxation, ...], float | None, Place]:
    """The least share by which all limits give, and with them the given numbers.

    A number that would do alone gives its own way; one that would not may still help others, either way.
    """
    told_alone = {r.name: r.needed for r in alone if r.limit is None and r.name in NUMBERS}
    asked = {name: ends(getattr(shaped.problem, name))[0] for name in told_alone}
    ways: dict[str, tuple[int, ...]] = {
        name: (-1, 1) if needed is None else (int(np.sign(needed - asked[name])),)
        for name, needed in told_alone.items()
        if needed != asked[name]
    }
    problem = _freed(shaped.problem, ways)
    if problem is None:
        return (), None, {}
    limits = tuple(range(len(problem.limits)))
    numbers = tuple((name, asked[name], sign) for name, signs in ways.items() for sign in signs)
    if not limits and not numbers:
        return (), None, {}
    found = _followed(problem, _point(problem, _known(shaped)), Concession(limits, numbers))
    if found is None:
        return (), None, {}
    y, share = found
    names = DesignSpace(problem).names
    moved = {name: float(np.exp(y[names.index(name)])) for name in ways}
    missed = Objective(DesignSpace(problem), Concession(limits), coarse_nodes(problem)).missed(y)
    rows = [row for row in shaped.rows if row.is_limit]
    given = (
        Relaxation(row.label, row.unit, asked_of(row), given_way(row, missed[i]), i)
        for i, row in enumerate(rows)
        if missed[i] > STILL
    )
    changed = (Relaxation(n, unit_of(n), asked[n], v) for n, v in moved.items() if abs(v / asked[n] - 1) > STILL)
    told = (*given, *changed)
    return (told, share, _place(problem, y)) if len(told) > 1 else ((), None, {})
