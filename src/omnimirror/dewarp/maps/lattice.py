"""Lattice map: source coordinates on a regular lattice of view pixels with bicubic interpolation."""

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
    """Map with nodes at every ``step``-th output pixel and cubic Lagrange interpolation between
    them.

    With a node spacing of 16 pixels, the error in a perspective view is some 0.001 px. See
    :class:`~omnimirror.dewarp.contracts.Map`.
    """

    nodes: NDArray[np.float32]
    """Coordinates u and v (2, rows, columns) at output pixels (-step, -step), (0, -step), ... up to
    one node beyond the cell of the last pixel.
    """
    size: tuple[int, int]
    """Size (width, height) of the view."""
    source_size: tuple[int, int]
    """Size (width, height) of the source images."""
    step: int
    """Node spacing: 4, 8, 16, 32 or 64."""
    cells: NDArray[np.int32]
    """Index (cell rows, cell columns) of the patch of a cell; -1 for interpolated cells."""
    patches: NDArray[np.float32]
    """Coordinates (n, step, step, 2) of cells that are not interpolated."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Offset of the output pixels from the node lattice, right and down, below 1 px."""
    annulus: Annulus | None = None
    """Image region inside the field, for averages at the field boundary."""

    def pixels(self) -> NDArray[np.float32]:
        """Return coordinates (height, width, 2); NaN outside."""
        return self._pixels

    @cached_property
    def _pixels(self) -> NDArray[np.float32]:
        down, across = self.cells.shape
        outside = np.isnan(self.nodes).any(axis=0)
        # NaN would spread over its whole row and column
        nodes = np.where(outside, np.float32(0), self.nodes)
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
        """Return True if part of the view is inside the field."""
        return not ((self.cells >= 0).all() and np.isnan(self.patches).all())

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if it does not average."""
        return self._footprints.averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _footprints(self) -> Footprints:
        squares = squared_sides_of_nodes(self.nodes, self.step, self.cells, self.patches)
        return Footprints(squares, self.step, self.annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """Sample with the lattice kernel."""
        u, v = self.nodes
        lattice = u, v, *self._weights, self.cells, self.patches
        backend.kernels.remap_lattice(job.source, *lattice, job.target, *job.how)

    @cached_property
    def _weights(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Node weights, across and down."""
        return node_weights(self.step, self.shift[0]), node_weights(self.step, self.shift[1])

    # -- half resolution -----------------------------------------------------------------------------

    def halved(self, in_picture: Offset, in_view: Offset) -> Map:
        """Return the same lattice at half the step, evaluated between its pixels; patched at the
        image boundary.
        """
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
        """Return cells and patches, with additional patches for nodes outside the image."""
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
    """Return cubic Lagrange weights (4, step) of the nodes at -1, 0, 1 and 2, every 1/step from
    shift/step.
    """
    t = (np.arange(step) + shift) / step
    outer = t * (t - 1) / 6
    inner = (t + 1) * (t - 2) / 2
    return np.stack([-outer * (t - 2), inner * (t - 1), -inner * t, outer * (t + 1)]).astype(np.float32)
