"""A mirror's meridian as cubic pieces, of which every mirror can be made, on any device."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...calibrate.physical.names import NamedNumber
from ...calibrate.physical.shape_rates import profile_rates
from ...mirrors import Mirror
from ...tracing.reflection import CELLS, cubic_pieces, radii
from .library import Tensor, torch

Array = NDArray[np.float64]


def rate_table(mirror: Mirror, place: NamedNumber) -> Array:
    """The same (n, 8) of the derivatives of sag and slope by one of the mirror's parameters."""
    sag, slope, curvature = profile_rates(mirror, radii(mirror), (place,))[..., 0]
    step = mirror.rim_radius_mm / CELLS
    return np.concatenate([cubic_pieces(sag, slope * step), cubic_pieces(slope, curvature * step)], axis=1)


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
