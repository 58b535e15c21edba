"""Protocol of design spaces (designs as points, minimum slack), and priorities among requirements."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple, Protocol

from ..base.errors import OmnimirrorError
from ..base.logs import OnProgress
from ..optics.sensor import Sensor
from .optimiser import Key, Optimum, Slack
from .requirement_check import Verdict
from .requirements import Requirements

# -- Protocol of design spaces: designs as points, and searches for minimum slack ------------------
#
# The coordinates of mirrors of a mapping or a family are the numbers of their requirements, those of
# freeform mirrors also include slopes; both include a focus. The solver and the relaxation are
# independent of the kind of mirror.

Point = dict[str, float]
"""Design as values by coordinate name; a space ignores other names."""

LOGGER = logging.getLogger(__name__)
OnStep = Callable[[str], None]
"""Callback with a description of each step."""


def step_reporter(on_progress: OnProgress | None) -> OnStep:
    """Return a callback that logs descriptions of steps and counts the steps."""
    steps = count(1)

    def on_step(description: str) -> None:
        LOGGER.info("%s", description)
        if on_progress is not None:
            on_progress(next(steps), None)

    return on_step


"""Callback for progress messages, called before each longer step."""


class Reached(NamedTuple):
    """Point of minimum slack, and the largest relative violation there."""

    point: Point
    relative_change: float


@dataclass(frozen=True)
class BestDesign:
    """Best design at its focus, with its requirement check.

    Attributes
    ----------
    point
        Point in the design space, including fixed numbers.
    notes
        Values chosen by the design.
    optimum
        Result of the optimisation of a freeform mirror; None for others, and without a feasible
        design.
    """

    point: Point
    sensor: Sensor
    verdict: Verdict
    notes: tuple[str, ...] = ()
    optimum: Optimum | None = None


class Space(Protocol):
    """Design space around a solution, for one construction method."""

    @property
    def requirements(self) -> Requirements:
        """Requirements common to all designs."""

    @property
    def numbers(self) -> dict[str, float]:
        """Fixed numbers of the requirements, which may be relaxed."""

    @property
    def keys(self) -> tuple[Key, ...]:
        """Other requirements that a design can violate: limits by index, or names."""

    def freed(self, ranges: dict[str, tuple[float, float]]) -> Space:
        """Return the space with additional free numbers."""

    def value(self, point: Point, name: str) -> float:
        """Return a number at a point."""

    def towards(self, point: Point, name: str, way: int, span: tuple[float, float]) -> Point:
        """Return a start for moving a number in one direction within a span."""

    def reach(self, point: Point, slack: Slack) -> Reached | None:
        """Return the point of minimum slack near a point; None if infeasible."""

    def missed(self, point: Point) -> dict[Key, float]:
        """Return the relative violation of each requirement at a point; negative if it is met."""

    def search_design(
        self, requirements: Requirements, point: Point, is_local: bool = False
    ) -> Point | None:
        """Search for a design that meets other requirements, starting near a point.

        Parameters
        ----------
        is_local
            Restrict the search to the given start.

        Raises
        ------
        OmnimirrorError
            If the mirror does not exist.
        """


# -- Prioritisation of infeasible requirements: all feasible requirements are met first ------------
#
# Minimising the largest violation is appropriate for conflicting requirements that are individually
# feasible. If one requirement is infeasible for any values of the others, this would relax the others
# without benefit.

MARGINS = (
    0.0,
    1e-4,
    1e-3,
)  # relative tightening of the other requirements, until they are met at all field angles


def meet_other_requirements(
    space: Space, point: Point, verdict: Verdict, on_step: OnStep = lambda message: None
) -> list[Point]:
    """Return points that violate only infeasible requirements by minimal amounts, best first.

    Parameters
    ----------
    point, verdict
        Point of the smallest largest violation, and its requirement check.
    on_step
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
    on_step("feasible requirements")
    hopeless = tuple(key for key in missed if _reached(space, point, set(missed) - {key}) is None)
    if not 0 < len(hopeless) < len(missed):
        return []
    points = [_reached(space, point, set(hopeless), margin) for margin in MARGINS]
    return [there for there in points if there is not None]


def is_more_met(verdict: Verdict, than: Verdict) -> bool:
    """Return whether a design misses a proper subset of the requirements missed by another."""
    return set(verdict.missed) < set(than.missed)


def priority_note(verdict: Verdict, before: Verdict) -> str:
    """Return a note on the missed and the met requirements."""
    met = "; ".join(name for name in before.missed if name not in verdict.missed)
    return f"infeasible even without the other requirements: {'; '.join(verdict.missed)}; met instead: {met}"


def _missed(space: Space, verdict: Verdict) -> list[Key]:
    """Return the keys of missed requirements: limits by index, others by name."""
    limits = [key for key, row in enumerate(verdict.limits) if not row.is_met]
    return [*limits, *(row.name for row in verdict.rows if not row.is_limit and not row.is_met)]


def _reached(space: Space, point: Point, giving: set[Key], margin: float = 0.0) -> Point | None:
    """Return the point of minimum slack of some requirements with all others met."""
    try:
        result = space.reach(
            point, Slack(tuple(key for key in space.keys if key in giving), margin=margin)
        )
    except OmnimirrorError:
        return None
    return None if result is None else result.point
