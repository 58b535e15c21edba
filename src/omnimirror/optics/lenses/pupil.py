"""Where a lens sees from: the place on its axis that chief rays aim at, which may move with their angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ChiefAim(NamedTuple):
    """What chief rays aim at, (n,) each."""

    distance: Array
    """From the entrance pupil to the mirror point along the axis, mm: w."""
    drift: Array | float
    """How far the entrance pupil moves towards the mirror per radian of the viewing angle, mm."""


@dataclass(frozen=True)
class EntrancePupil:
    """An entrance pupil that stays where it is: on the axis, so far towards the mirror from the lens's reference point.

    >>> EntrancePupil(5.0).aim(np.array([10.0]), np.array([180.0])).distance
    array([175.])
    """

    at_mm: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether its place depends on the viewing angle."""
        return False

    def place(self, tangent: Array) -> Array:
        """Places (n,) mm of viewing angles given by their tangents."""
        return np.full_like(tangent, self.at_mm)

    def aim(self, x: Array, depth: Array) -> ChiefAim:
        """The chief rays of points at distances x (n,) from the axis and depth (n,) from the reference point, mm."""
        return ChiefAim(depth - self.at_mm, 0.0)


IN_REFERENCE_POINT = EntrancePupil()
