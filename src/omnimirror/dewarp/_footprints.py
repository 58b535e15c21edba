"""Footprints of output pixels in the image, and the number of samples in their averages.

The footprint of a pixel is the parallelogram that the map makes of it, extended to four neighbours:
from the midpoint to the left neighbour to the midpoint to the right one, and likewise above and
below. For minified views it is larger than a source pixel, and a single sample would alias; the
mean of cubic samples distributed uniformly over it does not. The number of samples follows from the
length of the sides for each cell of the view, and their spacing from the footprint of each pixel;
cells therefore join without a seam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
from ..base.native import backend
from .interfaces import Annulus, Averages, Interpolation

SquaredSides = NDArray[np.float32]
"""Squared length of the longest footprint sides in each cell, (cell rows, cell columns, 2), across
and down, in square source pixels.
"""

CELL_PX = 16
SAMPLING_STEP_PX = 4  # footprints vary slowly; these pixels represent all
MAX_TAPS = 128  # per side
JUMP_RATIO2, JUMP_EXCESS_PX2 = 16.0, 4.0
"""Thresholds of the ratio of opposite squared sides, and of the excess, for a jump to another view
of a mosaic.
"""


@dataclass(frozen=True)
class Rule:
    """Conversion of the side of a footprint to a number of samples."""

    single_px: float
    """Maximum side with a single sample."""
    spacing_px: float
    """Maximum spacing of multiple samples."""
    sharp_px: float
    """A side of s is shortened by the factor 1 - (sharp / s)^8: to 0 at this side, and little for
    larger sides.
    """

    def taps(self, squares: SquaredSides) -> NDArray[np.uint8]:
        """Return the number of samples across and down in each cell."""
        with np.errstate(divide="ignore", invalid="ignore"):
            shortened = np.sqrt(squares) * (1 - (self.sharp_px**2 / squares) ** 4)
            needed = np.ceil(shortened / self.spacing_px).clip(2, MAX_TAPS)
        return np.where(squares > self.single_px**2, needed, 1).astype(np.uint8)


# Measured on the simulated room (benchmarks/interpolation_quality.py), PSNR relative to the
# supersampled scene:
# - A source pixel is itself the mean over its footprint. A second average over an output pixel of
#   similar size blurs twice: at 1:1 the plain average is 0.1 dB worse than cubic, with four times
#   the samples. Shortened, the average equals cubic up to sides of 1.2 px and the full average from
#   2 px on.
# - Samples 1.75 px apart are 0.05 dB worse than denser ones, 2 px 0.2 dB, and single-pixel stripes
#   alias.
# - Bilinear instead of cubic samples are 0.4 to 1.5 dB worse.
RULES: dict[Interpolation, Rule] = {"auto": Rule(1.2, 1.5, 1.2), "area": Rule(0.5, 1.0, 0.0)}


@dataclass(frozen=True, eq=False)
class Footprints:
    """Footprint sizes of the pixels of a view for each cell."""

    squared_sides: SquaredSides
    step: int
    """Side of a cell, output px."""
    annulus: Annulus | None = None
    """Image annulus that contains the field."""

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if single samples are
        sufficient.
        """
        return self._averages(interpolation)

    @cached_property
    def _averages(self) -> Callable[[Interpolation], Averages | None]:
        return cache(self._compute)

    def _compute(self, interpolation: Interpolation) -> Averages | None:
        rule = RULES.get(interpolation)
        if (
            rule is None
            or not self.squared_sides.size
            or self.squared_sides.max() <= rule.single_px**2
        ):
            return None
        return Averages(
            rule.taps(_filled(self.squared_sides)), self.step, rule.sharp_px, self.annulus
        )


def _filled(squares: SquaredSides) -> SquaredSides:
    """Fill cells without sampled visible pixels with the maximum of their neighbours."""
    unknown = squares == 0
    if not unknown.any():
        return squares
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(squares, ((1, 1), (1, 1), (0, 0))), (3, 3), axis=(0, 1)
    )
    return np.where(unknown, around.max(axis=(-2, -1)), squares)


def squared_sides_of_pixels(pixels: NDArray[Any]) -> SquaredSides:
    """Return the squared sides of a map (rows, columns, 2), in cells of 16 x 16 pixels; pixels
    outside are ignored.

    >>> half = 2.0 * np.moveaxis(np.mgrid[:40, :20], 0, -1)[..., ::-1]
    >>> squared_sides_of_pixels(half).shape, squared_sides_of_pixels(half)[0, 0]
    ((3, 2, 2), array([4., 4.], dtype=float32))
    """
    rows, columns = pixels.shape[:2]
    cells = -(-rows // CELL_PX), -(-columns // CELL_PX)
    squares = np.zeros((*cells, 2), np.float32)
    every = SAMPLING_STEP_PX
    sampled = pixels[::every, ::every]
    neighbours = (
        (pixels[::every, 1::every], pixels[::every, every - 1 :: every]),
        (
            pixels[1::every, ::every].swapaxes(0, 1),
            pixels[every - 1 :: every, ::every].swapaxes(0, 1),
        ),
    )
    for axis, (after, before) in enumerate(neighbours):
        sides = _sides(sampled.swapaxes(0, 1) if axis else sampled, after, before)
        if sides.size:
            squares[..., axis] = _largest(sides.T if axis else sides, cells)
    return squares


def _sides(sampled: NDArray[Any], after: NDArray[Any], before: NDArray[Any]) -> NDArray[np.float32]:
    """Return squared sides along the second axis; the shorter one at boundaries between views of a
    mosaic.
    """
    sides = _squared(after - sampled[:, : after.shape[1]])
    count = sides.shape[1]
    sides[:, 1:] = np.fmin(
        sides[:, 1:], _squared(sampled[:, 1:count] - before[:, : max(count - 1, 0)])
    )
    return np.nan_to_num(sides, copy=False)


def squared_sides_of_circles(
    radii: NDArray[np.float64], angles: NDArray[np.float64]
) -> SquaredSides:
    """Return the squared sides of a polar map with radii (n,) in px and angles (m,) in radians, in
    cells of 16 x 16 pixels.

    >>> squared_sides_of_circles(np.array([100.0, 102.0]), np.array([0.0, 0.1])).round(2)
    array([[[103.95,   4.  ]]], dtype=float32)
    """
    # Chord between adjacent columns: 2 r sin(dphi / 2); distance between adjacent rows: dr
    chords, steps = 2 * np.sin(_to_next(angles) / 2), _to_next(radii)
    across = _longest(radii)[:, None] * _longest(chords)
    return np.stack(
        [across, np.broadcast_to(_longest(steps)[:, None], across.shape)], axis=-1
    ).astype(np.float32)


def _to_next(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return forward differences (n,); the last one is repeated."""
    differences = np.diff(values)
    return np.append(differences, differences[-1:] if len(differences) else np.zeros(len(values)))


def _longest(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squared maximum of every 16 values; NaN counts as 0."""
    squares = np.nan_to_num(lengths) ** 2
    longest: NDArray[np.float64] = np.maximum.reduceat(squares, np.arange(0, len(squares), CELL_PX))
    return longest


def squared_sides_of_lattice(
    nodes: NDArray[np.float32], step: int, cells: NDArray[np.int32], patches: NDArray[np.float32]
) -> SquaredSides:
    """Return the squared sides of a lattice from its nodes; see
    :class:`~omnimirror.dewarp.maps.LatticeMap`.
    """
    if backend.is_compiled:
        squares = np.empty((*cells.shape, 2), np.float32)
        u, v = nodes
        backend.kernels.squared_sides_of_lattice(u, v, step, cells, patches, squares)
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
    sampled = patches[:, ::SAMPLING_STEP_PX, ::SAMPLING_STEP_PX]
    sides = (
        patches[:, ::SAMPLING_STEP_PX, 1::SAMPLING_STEP_PX] - sampled,
        patches[:, 1::SAMPLING_STEP_PX, ::SAMPLING_STEP_PX] - sampled,
    )
    return np.stack(
        [np.fmax.reduce(_squared(to_next), axis=(1, 2), initial=0) for to_next in sides], axis=-1
    )


def _squared(vectors: NDArray[Any]) -> NDArray[np.float32]:
    """Return squared lengths of vectors (..., 2)."""
    x, y = vectors[..., 0], vectors[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        squares: NDArray[np.float32] = (x * x + y * y).astype(np.float32)
    return squares


def _largest(values: NDArray[np.float32], cells: tuple[int, int]) -> NDArray[np.float32]:
    """Return the maximum in each cell; a last cell without values has the value of its neighbour."""
    each = CELL_PX // SAMPLING_STEP_PX
    missing = [(0, each * n - have) for n, have in zip(cells, values.shape, strict=True)]
    padded = np.pad(values, missing, mode="edge")
    largest: NDArray[np.float32] = padded.reshape(cells[0], each, cells[1], each).max(axis=(1, 3))
    return largest
