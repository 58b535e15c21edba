"""What would have to give where no mirror of free form keeps everything: each answer is an optimum of its own.

A limit that gives alone is pressed down while all others are kept. A number that is given (field, rim, lens) is
set free, and moves as little as will do. Jointly, the largest share by which any of them gives is made least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .assessment import Row, unit_of
from .conflicts import RANGES, Conflict, Relaxation, asked_of, given_way
from .objective import IMAGE, Concession, Key, Objective
from .optimise import CLOSE, KEPT, coarse_nodes, follow
from .problem import DesignProblem, ends
from .shaping import Shaped
from .space import DesignSpace

Array = NDArray[np.float64]

NUMBERS = ("omega_max_deg", "theta_max_deg", "rim_radius_mm", "focal_length_mm", "f_number")
FARTHEST = 10.0  # times what was asked, or one over it
STILL = 1e-6  # a share below this is none


def find_concessions(shaped: Shaped, on_step: Callable[[str], None] | None = None) -> Conflict | None:
    """Why not everything is kept, or None where it is; ``on_step`` is told the name of each before it gives."""
    missed = tuple(row.label for row in shaped.rows if not row.is_met)
    if not missed:
        return None
    say = on_step or (lambda name: None)
    alone = []
    for i, row in enumerate(row for row in shaped.rows if row.is_limit):
        say(row.label)
        alone.append(_pressed(shaped, i, row))
    others = (row for row in shaped.rows if not (row.is_limit or row.is_met or row.name in NUMBERS))
    alone += [_other(shaped, row) for row in others]
    for name in NUMBERS:
        if getattr(shaped.problem, name) is not None and name not in shaped.problem.free:
            say(name)
            alone.append(_number(shaped, name))
    alone.sort(key=lambda r: (r.needed is None, r.share or 0.0))
    say("everything")
    joint, share = _jointly(shaped, [r for r in alone if r.needed is not None])
    return Conflict(missed, tuple(alone), joint, share)


def _followed(problem: DesignProblem, y: Array, goal: Concession) -> tuple[Array, float] | None:
    """Where a goal is reached best from a point, and the share conceded; None where something else is missed."""
    found = follow(Objective(DesignSpace(problem), goal, coarse_nodes(problem)), y, tolerance=CLOSE)
    return (found.y, found.value) if found.violation < KEPT else None


def _pressed(shaped: Shaped, key: Key, row: Row) -> Relaxation:
    """What is asked, as near as it can be had while all else is kept."""
    found = _followed(shaped.problem, shaped.y, Concession((key,)))
    needed = None if found is None else given_way(row, max(found[1], 0.0))
    return Relaxation(row.label, row.unit, asked_of(row), needed)


def _other(shaped: Shaped, row: Row) -> Relaxation:
    """What is neither a limit nor a given number: the rim's image, where the view begins to be clear."""
    if row.name == IMAGE and shaped.problem.has_image_to_fit:
        return _pressed(shaped, IMAGE, row)
    others_missed = any(not r.is_met for r in shaped.rows if r is not row)
    return Relaxation(row.label, row.unit, asked_of(row), None if others_missed else row.reached)


def _number(shaped: Shaped, name: str) -> Relaxation:
    """The nearest value of a given number, either way, at which all can be kept."""
    asked = ends(getattr(shaped.problem, name))[0]
    found = []
    for sign in (-1, 1):
        freed = _freed(shaped.problem, {name: sign})
        if freed is None:
            continue
        goal = Concession((), ((name, asked, sign),))
        reached = _followed(freed, _point(shaped, freed), goal)
        if reached is not None:
            found.append(sign * max(reached[1], 0.0))
    needed = asked * (1 + min(found, key=abs)) if found else None
    return Relaxation(name, unit_of(name), asked, needed)


def _freed(problem: DesignProblem, signs: dict[str, int]) -> DesignProblem | None:
    """The problem with numbers free on one side of what was asked; None where there is no room."""
    spans = {}
    for name, sign in signs.items():
        asked = ends(getattr(problem, name))[0]
        low, high = RANGES.get(name, (1e-3, 1e6))
        span = (max(asked / FARTHEST, low), asked) if sign < 0 else (asked, min(asked * FARTHEST, high))
        if name in ("omega_max_deg", "theta_max_deg"):
            room = _room(problem)
            span = max(span[0], asked - room), min(span[1], asked + room)
        if not span[0] < span[1]:
            return None
        spans[name] = span
    return replace(problem, **spans)  # type: ignore[arg-type]


def _room(problem: DesignProblem) -> float:
    """How far field and viewing angle can both move without the rim's being seen edge-on, or the field's vanishing."""
    omega = ends(problem.omega_max_deg)
    theta = ends(problem.theta_max_deg)[1] if problem.theta_max_deg is not None else 0.0
    return 0.45 * min(180 - omega[1] - theta, omega[0] - theta, omega[0] - problem.omega_min_deg)


def _point(shaped: Shaped, problem: DesignProblem) -> Array:
    """The design as a point of a space with more free numbers."""
    known = dict(zip(DesignSpace(shaped.problem).names, shaped.y, strict=True))
    asked = {n: np.log(ends(getattr(shaped.problem, n))[0]) for n in problem.free if n not in known}
    return np.array([(known | asked)[name] for name in DesignSpace(problem).names])


def _jointly(shaped: Shaped, helpful: list[Relaxation]) -> tuple[tuple[Relaxation, ...], float | None]:
    """The least share by which all limits give, and with them the given numbers that help, each its own way."""
    signs = {r.name: int(np.sign((r.needed or 0.0) - r.asked)) for r in helpful if r.name in NUMBERS}
    signs = {name: sign for name, sign in signs.items() if sign}
    problem = _freed(shaped.problem, signs)
    if problem is None:
        return (), None
    limits = tuple(range(len(problem.limits)))
    numbers = tuple((name, ends(getattr(shaped.problem, name))[0], sign) for name, sign in signs.items())
    if not limits and not numbers:
        return (), None
    found = _followed(problem, _point(shaped, problem), Concession(limits, numbers))
    if found is None:
        return (), None
    y, share = found
    names = DesignSpace(problem).names
    moved = [(n, asked, float(np.exp(y[names.index(n)]))) for n, asked, _ in numbers]
    missed = Objective(DesignSpace(problem), Concession(limits), coarse_nodes(problem)).missed(y)
    rows = [row for row in shaped.rows if row.is_limit]
    given = (
        Relaxation(row.label, row.unit, asked_of(row), given_way(row, missed[i]))
        for i, row in enumerate(rows)
        if missed[i] > STILL
    )
    changed = (Relaxation(n, unit_of(n), asked, v) for n, asked, v in moved if abs(v / asked - 1) > STILL)
    return (*given, *changed), share
