"""Entrance pupil of a lens: its axial position, which may depend on the viewing angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.typing import Array


class ChiefAim(NamedTuple):
    """Distance and motion of the entrance pupil for chief rays, (n,) each."""

    distance: Array
    """Axial distance w from the entrance pupil to the mirror point, mm."""
    drift: Array | float
    """Motion of the entrance pupil towards the mirror per radian of the viewing angle, mm."""


@dataclass(frozen=True)
class EntrancePupil:
    """Fixed entrance pupil, at a distance from the lens's reference point.

    >>> EntrancePupil(5.0).aim(np.array([10.0]), np.array([180.0])).distance
    array([175.])
    """

    at_mm: float = 0.0

    @property
    def moves(self) -> bool:
        """True if its position depends on the viewing angle."""
        return False

    def place(self, tangent: Array) -> Array:
        """Return the positions (n,), mm, at viewing angles given by their tangents."""
        return np.full_like(tangent, self.at_mm)

    def aim(self, x: Array, depth: Array) -> ChiefAim:
        """Return the chief rays of points at distances x (n,) from the axis and depths (n,), mm.

        Depths are measured from the reference point.
        """
        return ChiefAim(depth - self.at_mm, 0.0)


IN_REFERENCE_POINT = EntrancePupil()
