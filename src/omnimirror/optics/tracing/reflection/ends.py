"""Both ends of the ways of light by a mirror, and what is found between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Ends:
    """Points (n, 3) mm, or, if they are distant, unit vectors (n, 3) from the mirror towards them."""

    xyz: Array
    distant: bool = False

    @classmethod
    def of(cls, xyz: ArrayLike, distant: bool = False) -> Ends:
        """Ends of any array-like; directions may have any length but 0."""
        ends = np.atleast_2d(np.asarray(xyz, dtype=float))
        if distant:
            with np.errstate(invalid="ignore", divide="ignore"):
                ends = ends / np.linalg.norm(ends, axis=-1, keepdims=True)
        return cls(ends, distant)

    def __getitem__(self, which: slice | NDArray[np.integer]) -> Ends:
        return Ends(self.xyz[which], self.distant)

    def spread(self, count: int) -> Ends:
        """As many ends as asked for, from one or as many."""
        return Ends(np.broadcast_to(self.xyz, (count, 3)), self.distant)


class Specular(NamedTuple):
    """The mirror points of n pairs of ends; NaN where not valid, but for ``points``."""

    points: Array
    """(n, 3) mm; where the mirror ends too early, on its smooth continuation beyond the rim."""
    normals: Array
    """(n, 3) unit vectors towards the side of the lens."""
    to_pupils: Array
    """(n, 3) unit vectors from the mirror points."""
    to_targets: Array
    """(n, 3) unit vectors from the mirror points."""
    path: Array
    """(n,) mm: length of the path of light; of a distant end, from a plane through the vertex."""
    reflects: Mask
    """(n,) whether the law of reflection holds with both ends in front of the surface or its continuation."""
    valid: Mask
    """(n,) whether, besides, the point is within the rim and nothing stands in between."""
    seen_at: Array
    """(n, 3) mm: points that the pupils look at, on the mirror or, where that is seen in a second one, on that."""

    @property
    def chief_slopes(self) -> Array:
        """Slopes (n, 2) against the axis under which the pupils see them."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes: Array = self.to_pupils[:, :2] / self.to_pupils[:, 2:]
        return slopes
