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
from .sampling import Grid

Array = NDArray[np.float64]
Exact = Callable[[Array, Array], Array]
"""Source pixels (n, 2) of view pixels u (n,), v (n,); NaN outside the field."""

STEPS = (16, 8)
TOLERANCE_PX = 0.001  # at the middle of a cell, where the error of the interpolation is largest
FEW = 0.1  # of the cells: so many may be computed pixel by pixel before a finer lattice is cheaper


def view_grid(exact: Exact, size: tuple[int, int], tolerance: float = TOLERANCE_PX) -> Grid:
    """The lattice of a view of ``size`` (width, height), ready to be sampled.

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
    >>> view_grid(bent, (60, 40)).coordinates()[30, [20, 49, 50]].round(3)
    array([[20.09, 30.  ],
           [49.09, 30.  ],
           [  nan,   nan]], dtype=float32)
    """
    for step in STEPS:
        lattice = _Lattice(exact, size, step)
        rough = lattice.rough(tolerance)
        if rough.mean() <= FEW:
            break
    return lattice.grid(rough | lattice.unsure)


class _Lattice:
    """Exact nodes every ``step`` pixels, one more than needed on each side.

    A cell is ``unsure`` where one of the 16 nodes that its interpolation uses, or its middle, is outside
    the field: the field may end in it.
    """

    def __init__(self, exact: Exact, size: tuple[int, int], step: int) -> None:
        self.exact, self.size, self.step = exact, size, step
        across, down = (-(-n // step) for n in size)
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
        taps = np.array([-1.0, 9.0, 9.0, -1.0]) / 16  # of Lagrange's cubic half way between the inner two
        windows = np.lib.stride_tricks.sliding_window_view(self.nodes, (4, 4), axis=(0, 1))
        miss = np.abs(windows @ taps @ taps - self.middles).max(axis=-1)
        rough: Mask = ~self.unsure & (miss > tolerance)
        return rough

    def grid(self, patched: Mask) -> Grid:
        """What the sampler takes, with the cells of a mask (down, across) computed pixel by pixel."""
        rows, columns = np.nonzero(patched)
        cells = np.full(patched.shape, -1, np.int32)
        cells[rows, columns] = np.arange(len(rows))
        steps = np.arange(self.step, dtype=np.float64)
        u = self.step * columns[:, None, None] + steps
        v = self.step * rows[:, None, None] + steps[:, None]
        u, v = (np.broadcast_to(a, (len(rows), self.step, self.step)).ravel() for a in (u, v))
        patches = self.exact(u, v).reshape(len(rows), self.step, self.step, 2)
        nodes = np.ascontiguousarray(np.moveaxis(self.nodes, -1, 0), np.float32)
        return Grid(nodes, self.size, self.step, cells, patches.astype(np.float32))
