"""A mirror's meridian as cubic pieces, of which every mirror can be made, on any device."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..calibrate.physical.names import NamedNumber
from ..calibrate.physical.shape_rates import profile_rates
from ..mirrors import Mirror
from ..tracing.reflection import continued_profile
from .library import Tensor, torch

Array = NDArray[np.float64]

CELLS = 1024  # from vertex to rim: cubic pieces of sag and slope are then right to 1e-9 mm and 1e-9
BEYOND = 256  # as wide, past the rim, to which an estimate may have to come nearer than the drawing says


def radii(mirror: Mirror) -> Array:
    """The nodes (n,) mm of its tables, one of them at the rim."""
    return np.linspace(0.0, (CELLS + BEYOND) / CELLS * mirror.rim_radius_mm, CELLS + BEYOND + 1)


def meridian_table(mirror: Mirror) -> Array:
    """Cubic pieces (n, 8) of sag and slope between the nodes, four coefficients each.

    >>> from omnimirror.mirrors import Sphere
    >>> table = meridian_table(Sphere(50.0, 40.0))
    >>> table.shape, table[768, [0, 4]]  # at 30 mm: sag 10 mm, slope .75
    ((1280, 8), array([10.  ,  0.75]))
    """
    sag, slope, curvature = continued_profile(mirror, radii(mirror))
    step = mirror.rim_radius_mm / CELLS
    return np.concatenate([cubic_pieces(sag, slope * step), cubic_pieces(slope, curvature * step)], axis=1)


def rate_table(mirror: Mirror, place: NamedNumber) -> Array:
    """The same (n, 8) of the derivatives of sag and slope by one of the mirror's parameters."""
    sag, slope, curvature = profile_rates(mirror, radii(mirror), (place,))[..., 0]
    step = mirror.rim_radius_mm / CELLS
    return np.concatenate([cubic_pieces(sag, slope * step), cubic_pieces(slope, curvature * step)], axis=1)


def cubic_pieces(values: Array, rates: Array) -> Array:
    """Coefficients (n, 4) of Hermite's cubics between n + 1 nodes, rates per cell.

    >>> cubic_pieces(np.array([0.0, 1.0, 8.0]), np.array([0.0, 3.0, 12.0]))[1]  # t^3 about 1
    array([1., 3., 3., 1.])
    """
    rise = np.diff(values)
    low, high = rates[:-1], rates[1:]
    return np.stack([values[:-1], low, 3 * rise - 2 * low - high, low + high - 2 * rise], axis=1)


class Pieces:
    """A table (n, 4 k) on a device: k functions of a place in cells; beyond its ends the last pieces go on."""

    def __init__(self, table: Array, dtype: object, device: object) -> None:
        self.rows = torch.as_tensor(table.T.copy(), dtype=dtype, device=device).unbind(0)
        self.last = len(table) - 1

    def place(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Which cells (n,), and how far in these."""
        cell = position.detach().clamp(0, self.last).to(torch.int64)
        return cell, position - cell

    def at(self, place: tuple[Tensor, Tensor], which: int = 0) -> Tensor:
        """A function (n,) there."""
        cell, t = place
        a, b, c, d = (row.index_select(0, cell) for row in self.rows[4 * which : 4 * which + 4])
        return a + t * (b + t * (c + t * d))

    def with_rate(self, place: tuple[Tensor, Tensor], which: int = 0) -> tuple[Tensor, Tensor]:
        """A function (n,) there, and how it grows by cell."""
        cell, t = place
        a, b, c, d = (row.index_select(0, cell) for row in self.rows[4 * which : 4 * which + 4])
        return a + t * (b + t * (c + t * d)), b + t * (2 * c + t * (3 * d))
