"""Where not everything can be met: what can be is met, and what cannot is missed by as little as that leaves.

To make the worst miss least is a fair answer where requirements pull against each other and each could be had. It is
none where one cannot be met whatever the others give: those beside it are then given up for nothing.
"""

from __future__ import annotations

from ...base.errors import OmnimirrorError
from ..optimise.objective import Key, Slack
from .space import Point, Say, Space
from .verdict import Verdict

MARGINS = (0.0, 1e-4, 1e-3)  # shares by which the others are kept better than asked, until no angle misses them


def meeting_the_others(space: Space, point: Point, verdict: Verdict, say: Say = lambda words: None) -> list[Point]:
    """Points at which only what cannot be met is missed, and that by the least largest share; the best first.

    Parameters
    ----------
    point, verdict
        Where the worst miss is least, and what is missed there.
    say
        Told a few words before the search.

    Returns
    -------
    list of Point
        One for each margin of the others; empty where nothing is won: one requirement is missed, all of them could be
        met in turn, or the others cannot be met together.
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
    """Whether a design misses a part of what another does, and nothing else."""
    return set(verdict.missed) < set(than.missed)


def told(verdict: Verdict, before: Verdict) -> str:
    """What was given up for what, in words."""
    met = "; ".join(name for name in before.missed if name not in verdict.missed)
    return f"cannot be met though all else gives: {'; '.join(verdict.missed)}; met beside that: {met}"


def _missed(space: Space, verdict: Verdict) -> list[Key]:
    """What is missed, as a space calls it: limits by their index."""
    limits = [key for key, row in enumerate(verdict.limits) if not row.is_met]
    return [*limits, *(row.name for row in verdict.rows if not row.is_limit and not row.is_met)]


def _reached(space: Space, point: Point, giving: set[Key], margin: float = 0.0) -> Point | None:
    """Where requirements give least while all others are kept."""
    try:
        found = space.reach(point, Slack(tuple(key for key in space.keys if key in giving), margin=margin))
    except OmnimirrorError:
        return None
    return None if found is None else found.point
