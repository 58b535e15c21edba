"""Source coordinates of a whole view from exact ones on a coarse lattice, refined where it must be.

Source coordinates vary slowly over a view, so most pixels can be interpolated between exact nodes some
16 pixels apart (four-point Lagrange, whose error falls with the fourth power of the step). A node in the
middle of each cell tells whether that is good enough; cells where it is not, and cells next to the end
of the field, are computed pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..cameras import Mask

Array = NDArray[np.float64]
Exact = Callable[[Array, Array], Array]
"""Source pixels (n, 2) of view pixels u (n,), v (n,); NaN outside the field."""

STEPS = (16, 8, 4)
TOLERANCE_PX = 0.001  # at the middle of a cell, where the error of the interpolation is largest
FEW = 0.1  # of the cells: so many may be computed pixel by pixel before a finer lattice is cheaper


def gridded_coordinates(exact: Exact, size: tuple[int, int], tolerance: float = TOLERANCE_PX) -> Array:
    """Source pixels (height, width, 2) of a view of ``size`` (width, height).

    Parameters
    ----------
    exact
        The projection of single pixels of the view; also asked a little beyond its edges.
    tolerance : px
        Largest error allowed at the middle of a cell.

    Examples
    --------
    >>> def bent(u, v):
    ...     return np.where(u < 50, [u + 1e-4 * v**2, v], np.nan).T
    >>> gridded_coordinates(bent, (60, 40))[30, [20, 49, 50]].round(3)
    array([[20.09, 30.  ],
           [49.09, 30.  ],
           [  nan,   nan]])
    """
    for step in STEPS:
        lattice = _Lattice(exact, size, step)
        rough = lattice.rough(tolerance)
        if rough.mean() <= FEW:
            break
    pixels = lattice.interpolated()
    v, u = np.nonzero(lattice.pixels_of(rough | lattice.unsure))
    pixels[v, u] = exact(u.astype(float), v.astype(float))
    return pixels


class _Lattice:
    """Exact nodes every ``step`` pixels, one more than needed on each side.

    A cell is ``unsure`` where one of the 16 nodes that its interpolation uses, or its middle, is outside
    the field: the field may end in it.
    """

    def __init__(self, exact: Exact, size: tuple[int, int], step: int) -> None:
        self.exact, self.size, self.step = exact, size, step
        across, down = (max(1, -(-(n - 1) // step)) for n in size)
        self.cells = across, down
        columns, rows = (step * np.arange(-1.0, cells + 2) for cells in self.cells)
        nodes = self._at(columns, rows)
        outside = np.isnan(nodes[..., 0])
        near = np.lib.stride_tricks.sliding_window_view(outside, (4, 4)).any(axis=(2, 3))
        self.nodes = np.where(outside[..., None], 0.0, nodes)
        self.middles = self._at(*(step * (np.arange(n, dtype=np.float64) + 0.5) for n in self.cells))
        self.unsure: Mask = near | np.isnan(self.middles[..., 0])

    def _at(self, columns: Array, rows: Array) -> Array:
        u, v = np.meshgrid(columns, rows)
        return self.exact(u.ravel(), v.ravel()).reshape(len(rows), len(columns), 2)

    def rough(self, tolerance: float) -> Mask:
        """Cells (down, across) whose middle the interpolation misses."""
        across, down = (_weights(np.arange(n, dtype=np.float64) + 0.5, n) for n in self.cells)
        miss = np.abs(_spread(self.nodes, across, down) - self.middles).max(axis=-1)
        rough: Mask = ~self.unsure & (miss > tolerance)
        return rough

    def interpolated(self) -> Array:
        """Source pixels (height, width, 2) by interpolation everywhere."""
        across, down = (
            _weights(np.arange(n) / self.step, cells) for n, cells in zip(self.size, self.cells, strict=True)
        )
        return _spread(self.nodes, across, down)

    def pixels_of(self, cells: Mask) -> Mask:
        """Pixels (height, width) of cells (down, across)."""
        width, height = self.size
        mask = np.repeat(np.repeat(cells, self.step, axis=0), self.step, axis=1)
        # the last node may be the last pixel, which then belongs to the last cell
        short = max(0, height - mask.shape[0]), max(0, width - mask.shape[1])
        return np.pad(mask, ((0, short[0]), (0, short[1])), mode="edge")[:height, :width]


def _weights(x: Array, cells: int) -> Array:
    """Four-point Lagrange weights (n, cells + 3) of positions x (n,) in cells, for nodes at -1, 0, .. cells + 1."""
    cell = np.clip(np.floor(x), 0, cells - 1).astype(int)
    t = x - cell
    taps = [
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    ]
    weights = np.zeros((len(x), cells + 3))
    for i, tap in enumerate(taps):
        weights[np.arange(len(x)), cell + i] = tap
    return weights


def _spread(nodes: Array, across: Array, down: Array) -> Array:
    """Interpolate nodes (rows, columns, 2) to (len(down), len(across), 2); banded, but BLAS makes little of it."""
    by_column = np.einsum("rck,wc->rwk", nodes, across, optimize=True)
    spread: Array = (down @ by_column.reshape(len(by_column), -1)).reshape(len(down), len(across), 2)
    return spread
