"""What the solver knows of a way to make mirrors: designs as points of a space, followed to where least has to give.

Mirrors of a mapping or a family have the numbers of their requirements for coordinates, those of free form their
slopes too; both have a focus. Everything above (the solver, what would have to give) is the same for all.
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
"""A design by the names of its coordinates; a space takes those that it has."""

Say = Callable[[str], None]
"""Told a few words before each longer step."""


class Reached(NamedTuple):
    """Where slack is least: the point, and the largest share that gives."""

    point: Point
    share: float


@dataclass(frozen=True)
class BestDesign:
    """The best design that was found, at its focus, and by its requirements.

    Attributes
    ----------
    point
        Where it stands in its space, given numbers included.
    notes
        What was chosen where the requirements left a choice.
    optimum
        How a mirror of free form was found; None for others, and where none keeps everything.
    """

    point: Point
    sensor: Sensor
    verdict: Verdict
    notes: tuple[str, ...] = ()
    optimum: Optimum | None = None


class Space(Protocol):
    """The designs around a solution that a way of making mirrors can reach."""

    @property
    def requirements(self) -> Requirements:
        """What is asked of all of them."""

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of the requirements that are no ranges, and may give."""

    @property
    def keys(self) -> tuple[Key, ...]:
        """Requirements besides those numbers that a design can miss: limits by their index, others by name."""

    def freed(self, ranges: dict[str, tuple[float, float]]) -> Space:
        """The space in which some of its numbers are free."""

    def value(self, point: Point, name: str) -> float:
        """A number at a point."""

    def towards(self, point: Point, name: str, way: int, span: tuple[float, float]) -> Point:
        """From where to follow a number that moves one way within a span, so that all can be met."""

    def reach(self, point: Point, slack: Slack) -> Reached | None:
        """The point near one where the least has to give; None where something else is missed there."""

    def missed(self, point: Point) -> dict[Key, float]:
        """By what share each requirement is missed at a point; below 0 by what share it is kept."""

    def meeting(self, requirements: Requirements, point: Point, is_local: bool = False) -> Point | None:
        """Search for a design that meets other requirements, starting near a point; None if none is found.

        Parameters
        ----------
        is_local
            Search from the point alone.

        Raises
        ------
        OmnimirrorError
            There is none at all.
        """
