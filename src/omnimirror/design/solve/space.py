"""Protocol of design spaces: designs as points, and searches for minimum slack.

The coordinates of mirrors of a mapping or a family are the numbers of their requirements, those of
freeform mirrors also include slopes; both include a focus. The solver and the relaxation are
independent of the kind of mirror.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from ...optics.sensor import Sensor
from ..criteria.requirements import Requirements
from ..optimise.objective import Key, Slack
from ..optimise.optimiser import Optimum
from .verdict import Verdict

Point = dict[str, float]
"""Design as values by coordinate name; a space ignores other names."""

Say = Callable[[str], None]
"""Callback for progress messages, called before each longer step."""


class Reached(NamedTuple):
    """Point of minimum slack, and the largest relative violation there."""

    point: Point
    share: float


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
        """Return the requirements common to all designs."""

    @property
    def numbers(self) -> dict[str, float]:
        """Return the fixed numbers of the requirements, which may be relaxed."""

    @property
    def keys(self) -> tuple[Key, ...]:
        """Return the other requirements that a design can violate: limits by index, or names."""

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

    def meeting(self, requirements: Requirements, point: Point, is_local: bool = False) -> Point | None:
        """Search for a design that meets other requirements, starting near a point.

        Parameters
        ----------
        is_local
            Restrict the search to the given start.

        Raises
        ------
        OmnimirrorError
            Mirror that does not exist.
        """
