"""Ray endpoints of paths over a mirror, and the reflection points between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....base.typing import Array, Mask


@dataclass(frozen=True)
class Ends:
    """Points (n, 3), mm, or unit vectors (n, 3) from the mirror if they are distant."""

    xyz: Array
    distant: bool = False

    @classmethod
    def of(cls, xyz: ArrayLike, distant: bool = False) -> Ends:
        """Create ends from any array-like; directions may have any non-zero length."""
        ends = np.atleast_2d(np.asarray(xyz, dtype=float))
        if distant:
            with np.errstate(invalid="ignore", divide="ignore"):
                ends = ends / np.linalg.norm(ends, axis=-1, keepdims=True)
        return cls(ends, distant)

    def __getitem__(self, which: slice | NDArray[np.integer]) -> Ends:
        return Ends(self.xyz[which], self.distant)

    def spread(self, count: int) -> Ends:
        """Return ``count`` ends, broadcast from one or as many."""
        return Ends(np.broadcast_to(self.xyz, (count, 3)), self.distant)


class Specular(NamedTuple):
    """Mirror points of n pairs of ends; NaN if invalid, except for ``points``."""

    points: Array
    """(n, 3), mm; beyond the rim, on the mirror's smooth continuation."""
    normals: Array
    """(n, 3) unit vectors towards the lens side."""
    to_pupils: Array
    """(n, 3) unit vectors from the mirror points."""
    to_targets: Array
    """(n, 3) unit vectors from the mirror points."""
    path: Array
    """(n,), mm: optical path length; for a distant end, from a plane through the vertex."""
    reflects: Mask
    """(n,) True for a reflection with both ends in front of the (continued) surface."""
    valid: Mask
    """(n,) True if the point is also within the rim and the path is unobstructed."""
    seen_at: Array
    """(n, 3), mm: points of the mirror facing the pupils; a second mirror, if present."""

    @property
    def chief_slopes(self) -> Array:
        """Slopes (n, 2), against the axis, of the rays to the pupils."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes: Array = self.to_pupils[:, :2] / self.to_pupils[:, 2:]
        return slopes
