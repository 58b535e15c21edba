"""Prioritisation of infeasible requirements: all feasible requirements are met first.

Minimising the largest violation is appropriate for conflicting requirements that are individually
feasible. If one requirement is infeasible for any values of the others, this would relax the others
without benefit.
"""

from __future__ import annotations

from ...base.errors import OmnimirrorError
from ..optimise.objective import Key, Slack
from .space import Point, Say, Space
from .verdict import Verdict

MARGINS = (0.0, 1e-4, 1e-3)  # relative tightening of the other requirements, until they are met at all field angles


def meeting_the_others(space: Space, point: Point, verdict: Verdict, say: Say = lambda words: None) -> list[Point]:
    """Return points that violate only infeasible requirements by minimal amounts, best first.

    Parameters
    ----------
    point, verdict
        Point of the smallest largest violation, and its requirement check.
    say
        Callback for progress messages, called before the search.

    Returns
    -------
    list of Point
        One point for each margin of the other requirements; empty without improvement: a single
        missed requirement, individually feasible requirements, or others that cannot be met
        together.
    """
    missed = _missed(space, verdict)
    if len(missed) < 2 or not set(missed) <= set(space.keys):
        return []
    say("what can be met")
    hopeless = tuple(key for key in missed if _reached(space, point, set(missed) - {key}) is None)
    if not 0 < len(hopeless) < len(missed):
        return []
    found = [_reached(space, point, set(hopeless), margin) for margin in MARGINS]
    return [there for there in found if there is not None]


def is_more_met(verdict: Verdict, than: Verdict) -> bool:
    """Return whether a design misses a proper subset of the requirements missed by another."""
    return set(verdict.missed) < set(than.missed)


def told(verdict: Verdict, before: Verdict) -> str:
    """Return a note on the missed and the met requirements."""
    met = "; ".join(name for name in before.missed if name not in verdict.missed)
    return f"cannot be met though all else gives: {'; '.join(verdict.missed)}; met beside that: {met}"


def _missed(space: Space, verdict: Verdict) -> list[Key]:
    """Return the keys of missed requirements: limits by index, others by name."""
    limits = [key for key, row in enumerate(verdict.limits) if not row.is_met]
    return [*limits, *(row.name for row in verdict.rows if not row.is_limit and not row.is_met)]


def _reached(space: Space, point: Point, giving: set[Key], margin: float = 0.0) -> Point | None:
    """Return the point of minimum slack of some requirements with all others met."""
    try:
        found = space.reach(point, Slack(tuple(key for key in space.keys if key in giving), margin=margin))
    except OmnimirrorError:
        return None
    return None if found is None else found.point
