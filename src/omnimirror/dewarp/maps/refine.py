"""Source coordinates of a whole view from exact ones on a coarse lattice, refined where it must be.

Source coordinates vary slowly over a view, so most pixels can be interpolated between exact nodes some
16 pixels apart (four-point Lagrange, whose error falls with the fourth power of the step). A node in the
middle of each cell tells whether that is good enough, together with the fourth differences of the nodes in
each direction, since two errors of opposite sign cancel in the middle; cells where it is not, and cells next
to the end of the field, are computed pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Mask
from .lattice import LatticeMap

Array = NDArray[np.float64]
Exact = Callable[[Array, Array], Array]
"""Source pixels (..., 2) of view pixels u and v, which are broadcast; NaN outside the field."""
WithExcess = Callable[[Array, Array], tuple[Array, Array]]
"""The same, and about how far (...) px the view pixels look outside the field: not above 0 within, NaN if unknown."""

STEPS = (16, 8)
TOLERANCE_PX = 0.001  # at the middle of a cell, where the error of the interpolation is largest
CELLS = 6  # across and down at least: of fewer, neighbouring nodes of a wide view may lie on opposite sides of it
FEW = 0.1  # of the cells: so many may be computed pixel by pixel before a finer lattice is cheaper


def lattice_map(
    exact: Exact,
    size: tuple[int, int],
    source_size: tuple[int, int],
    tolerance: float = TOLERANCE_PX,
    with_excess: WithExcess | None = None,
) -> LatticeMap:
    """The lattice map of a view, ready to be sampled.

    Parameters
    ----------
    exact
        The projection of single pixels of the view; also asked a little beyond its edges.
    size, source_size : (width, height), px
        Of the view, and of the pictures.
    tolerance : px
        Largest error allowed at the middle of a cell.
    with_excess
        Spares the computing of cells that lie wholly outside the field.

    Examples
    --------
    >>> def bent(u, v):
    ...     u, v = np.broadcast_arrays(u, v)
    ...     return np.stack([np.where(u < 50, u + 1e-4 * v**2, np.nan), np.where(u < 50, v, np.nan)], axis=-1)
    >>> lattice_map(bent, (60, 40), (100, 100)).pixels()[30, [20, 49, 50]].round(3)
    array([[20.09, 30.  ],
           [49.09, 30.  ],
           [  nan,   nan]], dtype=float32)
    """
    ask = with_excess or (lambda u, v: _without_excess(exact(u, v)))
    lattice = None
    for step in (step for step in STEPS if min(size) >= CELLS * step):
        lattice = _Lattice(ask, size, step)
        rough = lattice.rough(tolerance)
        if rough.sum() <= FEW * rough.size:
            break
    if lattice is None:
        return _pixel_by_pixel(exact, size, source_size, STEPS[-1])
    cells, patches = lattice.patched(exact, rough)
    return LatticeMap(lattice.nodes_of_kernels(), size, source_size, lattice.step, cells, patches)


def _pixel_by_pixel(exact: Exact, size: tuple[int, int], source_size: tuple[int, int], step: int) -> LatticeMap:
    across, down = (-(-n // step) for n in size)
    cells = np.arange(across * down, dtype=np.int32).reshape(down, across)
    nodes, patches = np.zeros((2, down + 3, across + 3), np.float32), _patches(exact, cells >= 0, step)
    return LatticeMap(nodes, size, source_size, step, cells, patches)


def _patches(exact: Exact, where: Mask, step: int) -> NDArray[np.float32]:
    """Source pixels (n, step, step, 2) of the cells in a mask (down, across), row after row."""
    rows, columns = np.nonzero(where)
    steps = np.arange(step, dtype=np.float64)
    pixels = exact(step * columns[:, None, None] + steps, step * rows[:, None, None] + steps[:, None])
    return pixels.astype(np.float32)


def _without_excess(pixels: Array) -> tuple[Array, Array]:
    return pixels, np.where(np.isnan(pixels[..., 0]), np.nan, 0.0)


class _Lattice:
    """Nodes every ``step`` pixels, one more than needed on each side, and the middles of the cells between them.

    A cell is ``unsure`` where one of the 16 nodes that its interpolation uses, or its middle, is outside
    the field: the field may end in it. It is ``empty`` where its corners and its middle are so far outside, compared
    with how much the nodes around differ, that the field cannot reach into it.
    """

    def __init__(self, ask: WithExcess, size: tuple[int, int], step: int) -> None:
        self.step = step
        across, down = (-(-n // step) for n in size)
        columns, rows = (step * np.arange(-1.0, cells + 2) for cells in (across, down))
        self.nodes, excess = ask(columns, rows[:, None])
        self.middles, excess_within = ask(columns[1:-2] + step / 2, rows[1:-2, None] + step / 2)
        outside, outside_within = ~(excess <= 0), ~(excess_within <= 0)
        self.outside: Mask = outside
        self.unsure: Mask = outside_within
        self.empty: Mask = np.zeros_like(outside_within)
        if outside.any():
            self.nodes[outside] = 0.0  # NaN would spread in the sampler
            self.unsure = outside_within | _in_windows(np.logical_or, outside)
            change = _in_windows(np.maximum, excess) - _in_windows(np.minimum, excess)  # over three cells
            nearest = np.minimum(_in_windows(np.minimum, excess[1:-1, 1:-1], 2), excess_within)
            self.empty = nearest > change / 2

    def rough(self, tolerance: float) -> Mask:
        """Cells (down, across) that the interpolation misses: their middle, or somewhere between two nodes."""
        miss = np.abs(_half_way(_half_way(self.nodes).swapaxes(0, 1)).swapaxes(0, 1) - self.middles)
        down, across = (_bend(self.nodes, self.outside), _bend(self.nodes.swapaxes(0, 1), self.outside.T).T)
        rough: Mask = ~self.unsure & ((miss[..., 0] > tolerance) | (miss[..., 1] > tolerance))
        rough |= ~self.unsure & ~((down <= tolerance) & (across <= tolerance))
        return rough

    def patched(self, exact: Exact, rough: Mask) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Which cells must not be interpolated, and their places, worked out pixel by pixel; as a map takes them."""
        patched = (rough | self.unsure) & ~self.empty
        cells = np.full(rough.shape, -1, np.int32)
        patches = np.empty((0, self.step, self.step, 2), np.float32)
        if patched.any():
            patches = _patches(exact, patched, self.step)
            cells[patched] = np.arange(len(patches))
        if self.empty.any():  # one patch for all of them
            cells[self.empty] = len(patches)
            patches = np.concatenate([patches, np.full_like(patches, np.nan, shape=(1, *patches.shape[1:]))])
        return cells, patches

    def nodes_of_kernels(self) -> NDArray[np.float32]:
        """(2, rows, columns): u and v."""
        return np.ascontiguousarray(np.moveaxis(self.nodes, -1, 0), np.float32)


def _half_way(nodes: Array) -> Array:
    """Lagrange's cubic half way between the inner two of every 4 rows: (n, ...) to (n - 3, ...)."""
    middle: Array = (9 * (nodes[1:-2] + nodes[2:-1]) - nodes[:-3] - nodes[3:]) / 16
    return middle


def _bend(nodes: Array, outside: Mask) -> Array:
    """About the error (px) of the interpolation down the columns (n, m), in the cells (n - 3, m - 3) between them.

    Half way between two of four nodes it is 3/128 of their fourth difference, of those next to the cell the larger;
    NaN where all of these reach outside.
    """
    if len(nodes) < 5:
        return np.zeros((len(nodes) - 3, nodes.shape[1] - 3))
    differences = np.abs(nodes[:-4] - 4 * nodes[1:-3] + 6 * nodes[2:-2] - 4 * nodes[3:-1] + nodes[4:])
    fourth = 3 / 128 * np.maximum(differences[..., 0], differences[..., 1])  # a maximum over an axis of 2 is slow
    if outside.any():
        fourth[np.logical_or.reduce([outside[i : len(outside) - 4 + i] for i in range(5)])] = np.nan
    padded = np.concatenate([fourth[:1], fourth, fourth[-1:]])
    at_rows = np.fmax(padded[:-1], padded[1:])
    bend: Array = np.maximum(at_rows[:, 1:-2], at_rows[:, 2:-1])  # the two columns that bound the cell
    return bend


def _in_windows(combine: np.ufunc, values: NDArray[Any], side: int = 4) -> NDArray[Any]:
    """Every ``side`` x ``side`` values (n, m) combined to one, (n - side + 1, m - side + 1)."""
    for _ in range(2):
        values = combine.reduce([values[i : len(values) - side + 1 + i] for i in range(side)]).T
    return values
