"""A lattice map: places at every so many pixels of the view, and bicubic interpolation between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.native import backend
from ...base.numerics.lazy import cached_property
from ..contracts import Annulus, Averages, Interpolation, Map, RemapJob
from ..sampling.footprints import RULES, Footprints, squared_sides_of_nodes
from .halving import Offset, half, halved_pixels
from .pixels import PixelMap

FINEST_STEP = 4


@dataclass(frozen=True, eq=False)
class LatticeMap:
    """Places at every ``step``-th output pixel, between which they are interpolated by Lagrange's cubics.

    With 16 pixels between nodes, a perspective view is met to some thousandths of a pixel. See
    :class:`~omnimirror.dewarp.contracts.Map`.
    """

    nodes: NDArray[np.float32]
    """(2, rows, columns): u and v at output pixels (-step, -step), (0, -step), .. up to one beyond the cell of
    the last pixel."""
    size: tuple[int, int]
    """(width, height) of the view."""
    source_size: tuple[int, int]
    """(width, height) of the pictures."""
    step: int
    """4, 8, 16, 32 or 64."""
    cells: NDArray[np.int32]
    """(cell rows, cell columns): -1 where to interpolate, else the index of a patch."""
    patches: NDArray[np.float32]
    """(n, step, step, 2): the places of cells that must not be interpolated."""
    shift: tuple[float, float] = (0.0, 0.0)
    """How far right of and below the nodes' lattice the output's pixels lie, less than 1 px."""
    annulus: Annulus | None = None
    """Where in the pictures something is seen, for averages at the end of the field."""

    def pixels(self) -> NDArray[np.float32]:
        """All places (height, width, 2); NaN outside."""
        return self._pixels

    @cached_property
    def _pixels(self) -> NDArray[np.float32]:
        down, across = self.cells.shape
        outside = np.isnan(self.nodes).any(axis=0)
        nodes = np.where(outside, np.float32(0), self.nodes)  # or one would spoil its whole row and column
        (right, below), step = self._weights, self.step
        lines = sum(nodes[:, :, i : i + across, None] * w for i, w in enumerate(right)).reshape(2, -1, 1, across * step)
        full = sum(lines[:, i : i + down] * w[:, None] for i, w in enumerate(below))
        tiles = full.reshape(2, down, step, across, step).transpose(1, 3, 2, 4, 0)
        tiles[np.lib.stride_tricks.sliding_window_view(outside, (4, 4)).any(axis=(2, 3))] = np.nan
        exact = self.cells >= 0
        tiles[exact] = self.patches[self.cells[exact]]
        width, height = self.size
        whole = tiles.transpose(0, 2, 1, 3, 4).reshape(down * self.step, across * self.step, 2)[:height, :width]
        pixels: NDArray[np.float32] = whole
        return pixels

    def shows_something(self) -> bool:
        """Whether anything of the picture is seen."""
        return not ((self.cells >= 0).all() and np.isnan(self.patches).all())

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """What an interpolation averages; None where that is nothing."""
        return self._footprints.averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _footprints(self) -> Footprints:
        squares = squared_sides_of_nodes(self.nodes, self.step, self.cells, self.patches)
        return Footprints(squares, self.step, self.annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """From the nodes."""
        u, v = self.nodes
        lattice = u, v, *self._weights, self.cells, self.patches
        backend.kernels.remap_lattice(job.source, *lattice, job.target, *job.how)

    @cached_property
    def _weights(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Of the nodes, across and down."""
        return node_weights(self.step, self.shift[0]), node_weights(self.step, self.shift[1])

    # -- of half the size ----------------------------------------------------------------------------

    def halved(self, in_picture: Offset, in_view: Offset) -> Map:
        """The same lattice at half the step, read between its pixels; where the picture may end, pixel by pixel."""
        if self.step == FINEST_STEP:
            return PixelMap.of(self, self.annulus).halved(in_picture, in_view)
        nodes = (self.nodes - np.array(in_picture)[:, None, None]) / 2
        cells, patches = self._patched_at_ends()
        return LatticeMap(
            nodes.astype(np.float32),
            half(self.size),
            half(self.source_size),
            self.step // 2,
            cells,
            halved_pixels(patches, in_picture, in_view, self.source_size),
            ((self.shift[0] + in_view[0]) / 2, (self.shift[1] + in_view[1]) / 2),
            self.annulus and self.annulus.halved(in_picture),
        )

    def _patched_at_ends(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Cells and patches, with more of these where a node lies outside the picture."""
        (u, v), (width, height) = self.nodes, self.source_size
        beyond = (u < -0.5) | (u > width - 0.5) | (v < -0.5) | (v > height - 0.5)
        if not beyond.any():
            return self.cells, self.patches
        ends = np.lib.stride_tricks.sliding_window_view(beyond, (4, 4)).any(axis=(2, 3)) & (self.cells < 0)
        windows = np.lib.stride_tricks.sliding_window_view(self.nodes, (4, 4), axis=(1, 2))[:, ends]
        across, down = self._weights
        tiles = np.einsum("cnij,ik,jl->nklc", windows, down, across)
        cells = self.cells.copy()
        cells[ends] = len(self.patches) + np.arange(len(tiles))
        return cells, np.concatenate([self.patches, tiles]).astype(np.float32)


def node_weights(step: int, shift: float = 0.0) -> NDArray[np.float32]:
    """Lagrange's cubic weights (4, step) of the nodes at -1, 0, 1 and 2, at every 1/step from shift/step on."""
    t = (np.arange(step) + shift) / step
    outer = t * (t - 1) / 6
    inner = (t + 1) * (t - 2) / 2
    return np.stack([-outer * (t - 2), inner * (t - 1), -inner * t, outer * (t + 1)]).astype(np.float32)
