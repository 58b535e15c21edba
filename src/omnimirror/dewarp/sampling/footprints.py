"""What an output pixel covers in the picture, and of how many samples its average is made.

A pixel's footprint is the parallelogram that the map makes of it, or what four neighbours make of one: from half
way to the neighbour on the left to half way to the one on the right, and likewise above and below. Where the view
shrinks the picture it is larger than a source pixel, and one sample would alias; the mean of cubic samples spread
evenly over it does not. How many are needed follows from the length of its sides, cell by cell of the view; how
far apart they stand, from the footprint of each pixel, so that cells join without a seam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.native import backend
from ...base.numerics.lazy import cached_property
from ..contracts import Annulus, Averages, Interpolation

SquaredSides = NDArray[np.float32]
"""Squared length of the longest sides of footprints in each cell, (cell rows, cell columns, 2): across and down,
in square source pixels."""

CELL_PX = 16
EVERY_PX = 4  # footprints change so little that these pixels stand for all
MOST_TAPS = 128  # a side
JUMP2, JUMP2_PX = 16.0, 4.0
"""A squared side that exceeds the opposite one by this factor and so much leads to another view of a mosaic."""


@dataclass(frozen=True)
class Rule:
    """From the side of a footprint to samples."""

    single_px: float
    """Up to here one sample is enough."""
    spacing_px: float
    """At most so far apart are the others."""
    sharp_px: float
    """A side of s is shortened by 1 - (sharp / s)^8: to nothing up to here, and soon no longer."""

    def taps(self, squares: SquaredSides) -> NDArray[np.uint8]:
        """Samples across and down in each cell."""
        with np.errstate(divide="ignore", invalid="ignore"):
            shortened = np.sqrt(squares) * (1 - (self.sharp_px**2 / squares) ** 4)
            needed = np.ceil(shortened / self.spacing_px).clip(2, MOST_TAPS)
        return np.where(squares > self.single_px**2, needed, 1).astype(np.uint8)


# Measured on the simulated room (benchmarks/interpolation_quality.py), PSNR against the supersampled scene:
# - A source pixel is itself the mean over its own footprint. Averaging again over that of an output pixel that is
#   hardly larger blurs twice: at 1:1 the plain average loses .1 dB to plain cubic, and pays four samples for it.
#   Shortened, the average is as good as cubic up to sides of 1.2 px and as good as the full one from 2 px on.
# - Samples 1.75 px apart lose .05 dB to denser ones, 2 px .2 dB, and stripes of single pixels then alias.
# - Bilinear samples in the place of cubic ones lose .4 to 1.5 dB.
RULES: dict[Interpolation, Rule] = {"auto": Rule(1.2, 1.5, 1.2), "area": Rule(0.5, 1.0, 0.0)}


@dataclass(frozen=True, eq=False)
class Footprints:
    """How large the footprints of a view's pixels are, cell by cell."""

    squared_sides: SquaredSides
    step: int
    """Side of a cell, output px."""
    annulus: Annulus | None = None
    """Where in the pictures something is seen."""

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """What an interpolation averages; None where that is nothing, and single samples do."""
        return self._averages(interpolation)

    @cached_property
    def _averages(self) -> Callable[[Interpolation], Averages | None]:
        return cache(self._worked_out)

    def _worked_out(self, interpolation: Interpolation) -> Averages | None:
        rule = RULES.get(interpolation)
        if rule is None or not self.squared_sides.size or self.squared_sides.max() <= rule.single_px**2:
            return None
        return Averages(rule.taps(_filled(self.squared_sides)), self.step, rule.sharp_px, self.annulus)


def _filled(squares: SquaredSides) -> SquaredSides:
    """With the largest of their neighbours in cells of which hardly a pixel is seen, and none that was looked at."""
    unknown = squares == 0
    if not unknown.any():
        return squares
    around = np.lib.stride_tricks.sliding_window_view(np.pad(squares, ((1, 1), (1, 1), (0, 0))), (3, 3), axis=(0, 1))
    return np.where(unknown, around.max(axis=(-2, -1)), squares)


def squared_sides_of_pixels(pixels: NDArray[Any]) -> SquaredSides:
    """Of a map (rows, columns, 2), in cells of 16 x 16 pixels; pixels outside count as nothing.

    >>> half = 2.0 * np.moveaxis(np.mgrid[:40, :20], 0, -1)[..., ::-1]
    >>> squared_sides_of_pixels(half).shape, squared_sides_of_pixels(half)[0, 0]
    ((3, 2, 2), array([4., 4.], dtype=float32))
    """
    rows, columns = pixels.shape[:2]
    cells = -(-rows // CELL_PX), -(-columns // CELL_PX)
    squares = np.zeros((*cells, 2), np.float32)
    every = EVERY_PX
    some = pixels[::every, ::every]
    neighbours = (
        (pixels[::every, 1::every], pixels[::every, every - 1 :: every]),
        (pixels[1::every, ::every].swapaxes(0, 1), pixels[every - 1 :: every, ::every].swapaxes(0, 1)),
    )
    for axis, (behind, before) in enumerate(neighbours):
        sides = _sides(some.swapaxes(0, 1) if axis else some, behind, before)
        if sides.size:
            squares[..., axis] = _largest(sides.T if axis else sides, cells)
    return squares


def _sides(some: NDArray[Any], behind: NDArray[Any], before: NDArray[Any]) -> NDArray[np.float32]:
    """Squared sides along the second axis; the shorter one where two views of a mosaic meet."""
    sides = _squared(behind - some[:, : behind.shape[1]])
    count = sides.shape[1]
    sides[:, 1:] = np.fmin(sides[:, 1:], _squared(some[:, 1:count] - before[:, : max(count - 1, 0)]))
    return np.nan_to_num(sides, copy=False)


def squared_sides_of_circles(radii: NDArray[np.float64], angles: NDArray[np.float64]) -> SquaredSides:
    """Of rows (n,) that are circles of so many px, columns (m,) at angles in radians; in cells of 16 x 16 pixels.

    >>> squared_sides_of_circles(np.array([100.0, 102.0]), np.array([0.0, 0.1])).round(2)
    array([[[103.95,   4.  ]]], dtype=float32)
    """
    chords, steps = 2 * np.sin(_to_next(angles) / 2), _to_next(radii)
    across = _longest(radii)[:, None] * _longest(chords)
    return np.stack([across, np.broadcast_to(_longest(steps)[:, None], across.shape)], axis=-1).astype(np.float32)


def _to_next(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences (n,); the last one again, which has no next."""
    differences = np.diff(values)
    return np.append(differences, differences[-1:] if len(differences) else np.zeros(len(values)))


def _longest(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square of the largest of every 16; 0 for those that are no numbers."""
    squares = np.nan_to_num(lengths) ** 2
    longest: NDArray[np.float64] = np.maximum.reduceat(squares, np.arange(0, len(squares), CELL_PX))
    return longest


def squared_sides_of_nodes(
    nodes: NDArray[np.float32], step: int, cells: NDArray[np.int32], patches: NDArray[np.float32]
) -> SquaredSides:
    """Of a lattice, from its nodes; see :class:`~omnimirror.dewarp.maps.lattice.LatticeMap`."""
    if backend.is_compiled:
        squares = np.empty((*cells.shape, 2), np.float32)
        u, v = nodes
        backend.kernels.squared_sides_of_nodes(u, v, step, cells, patches, squares)
        return squares
    scale = np.float32(0.5 / step)
    across = _squared(np.moveaxis(nodes[:, 1:-1, 2:] - nodes[:, 1:-1, :-2], 0, -1) * scale)
    down = _squared(np.moveaxis(nodes[:, 2:, 1:-1] - nodes[:, :-2, 1:-1], 0, -1) * scale)
    corners = np.stack([across, down], axis=-1)
    rows = np.maximum(corners[:-1], corners[1:])
    squares = np.maximum(rows[:, :-1], rows[:, 1:])
    exact = cells >= 0
    squares[exact] = _squares_of_patches(patches)[cells[exact]]
    return squares


def _squares_of_patches(patches: NDArray[np.float32]) -> SquaredSides:
    some = patches[:, ::EVERY_PX, ::EVERY_PX]
    sides = (patches[:, ::EVERY_PX, 1::EVERY_PX] - some, patches[:, 1::EVERY_PX, ::EVERY_PX] - some)
    return np.stack([np.fmax.reduce(_squared(to_next), axis=(1, 2), initial=0) for to_next in sides], axis=-1)


def _squared(vectors: NDArray[Any]) -> NDArray[np.float32]:
    """Squared lengths of vectors (..., 2)."""
    x, y = vectors[..., 0], vectors[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        squares: NDArray[np.float32] = (x * x + y * y).astype(np.float32)
    return squares


def _largest(values: NDArray[np.float32], cells: tuple[int, int]) -> NDArray[np.float32]:
    """The largest value in each cell; one that has none, at the end, is like its neighbour."""
    each = CELL_PX // EVERY_PX
    missing = [(0, each * n - have) for n, have in zip(cells, values.shape, strict=True)]
    padded = np.pad(values, missing, mode="edge")
    largest: NDArray[np.float32] = padded.reshape(cells[0], each, cells[1], each).max(axis=(1, 3))
    return largest
