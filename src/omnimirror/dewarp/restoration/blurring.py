"""Blur kernels: from a sharp image on a fine grid to the pixels of a defocused sensor.

A lens with a circular aperture images a defocused point to an elliptic disk whose radial axis is
the tangential blur and whose other axis is the sagittal blur (Eqs. 34-36 of Ohte and Tsuzuki). Each
pixel is therefore the mean of the sharp image over such a disk, convolved with the pixel area.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...analysis.evaluation import evaluate
from ...base.typing import Array
from ...optics.sensor import Sensor

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Whole = NDArray[np.int32]

GROUP_PX = 8  # adjacent pixels of a row, which are blurred with SIMD instructions
# Maximum variation of the blur along the pixels of one kernel, at 90 % of the distances from the
# axis
STEEP_PX = 0.65
TILE_PX = 152  # maximum side of independently solved tiles: a few megabytes, which fit into caches
RING_PX = 2.0  # width of rings with one kernel per direction
TURNS = 64  # directions over half a turn: the ends of a 10 px blur are within 0.25 px
POINTS_PER_PX2 = 16  # samples on the disk
ROUNDED = 1 - 1e-9


class BlurSize(NamedTuple):
    """Blur diameters (n,) in px, unsigned."""

    tangential: Array
    sagittal: Array

    @property
    def larger(self) -> Array:
        return np.maximum(self.tangential, self.sagittal)

    @property
    def widening(self) -> Array:
        """Widening of a pixel by the blur: side of the square of equal area, minus that of the
        pixel.
        """
        # Pixel (side 1) and blur add in quadrature in both directions; the side is the root of the area
        widened: Array = ((1 + self.tangential**2) * (1 + self.sagittal**2)) ** 0.25 - 1
        return widened


class Blur(NamedTuple):
    """Blur of pixels as kernels: weights of the values of a sharp image on a finer grid."""

    size: tuple[int, int]
    """Size (width, height) of the image in pixels."""
    fineness: int
    """Number of fine pixels along the side of a pixel."""
    pixels: Whole
    """Indices (n,) of the known pixels, ascending: row * width + column."""
    kernels: Whole
    """Kernel indices (h, blocks) of the pixel blocks of each row, in whole groups; -1 for unknown
    blocks.
    """
    firsts: Whole
    """Index (kernels + 1,) of the first weight of each kernel, and the total number."""
    offsets: Whole
    """Offsets (m, 2) in rows down and columns right on the fine grid, from the first value of a
    pixel.
    """
    weights: NDArray[np.float32]
    """Weights (m,), with sum 1 in every kernel."""
    block_px: int
    """Number of adjacent pixels in a row with one kernel: 1, 2, 4 or 8."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask (h, w) of known pixels."""
        known = np.zeros(self.size[::-1], bool)
        known.ravel()[self.pixels] = True
        return known

    @property
    def reach(self) -> int:
        """Maximum number of pixels that kernels extend beyond their own pixel."""
        least, most = (int(extreme) // self.fineness for extreme in (self.offsets.min(), self.offsets.max()))
        return max(-least, most, 1)

    @property
    def tiles(self) -> Whole:
        """Tiles (n, 2, 4) of the image that are solved independently.

        Each tile contains the row and column ranges of the pixels whose sharp values are kept, and
        of the known pixels that it explains, including some of adjacent tiles. Its values extend
        beyond these by the reach of the kernels, in whole groups of columns.
        """
        known, found = self.known, []
        beyond = whole_groups(self.reach)
        width, height = self.size
        for top, bottom in pairwise(_parts(height)):
            for left, right in pairwise(_parts(width)):
                first_row, first_column = max(top - beyond, 0), max(left - beyond, 0)
                near = known[first_row : bottom + beyond, first_column : right + beyond]
                if near.any():
                    rows = first_row + np.flatnonzero(near.any(axis=1))
                    columns = first_column + np.flatnonzero(near.any(axis=0))
                    begin = columns[0] // GROUP_PX * GROUP_PX
                    found.append([(top, bottom, left, right), (rows[0], rows[-1] + 1, begin, columns[-1] + 1)])
        return _whole(np.array(found).reshape(-1, 2, 4))

    @property
    def concentration(self) -> NDArray[np.float32]:
        """Root sum square (h, w) of the kernel weights of each pixel, divided by the fineness. It
        is a near-optimal preconditioner of the conjugate gradients, between the diagonal of the
        product of the weights with their transpose, which is smaller, and the row sums of this
        product. Unknown pixels have the value of the last kernel, at the rim.
        """
        of_kernel = np.sqrt(np.add.reduceat(self.weights**2, self.firsts[:-1])) / self.fineness
        # The last entry is for unknown blocks
        of_block = of_kernel.astype(np.float32)[self.kernels]
        return np.ascontiguousarray(np.repeat(of_block, self.block_px, axis=1)[:, : self.size[0]])

    def matrix(self) -> csr_matrix:
        """Return the sparse matrix of the blur.

        ``matrix @ sharp.reshape(-1, channels)`` are the blurred values of ``pixels``; the image is
        continued with its edge values.
        """
        from scipy.sparse import csr_matrix

        width, height = self.size
        across, deep = width * self.fineness, height * self.fineness
        rows, columns = np.divmod(self.pixels, width)
        kernels = self.kernels[rows, columns // self.block_px]
        counts = np.diff(self.firsts)[kernels]
        bounds = np.r_[0, np.cumsum(counts)]
        of_pixel = np.repeat(np.arange(len(counts)), counts)
        entry = np.arange(bounds[-1]) - np.repeat(bounds[:-1] - self.firsts[kernels], counts)
        down = np.clip(self.fineness * rows[of_pixel] + self.offsets[entry, 0], 0, deep - 1)
        right = np.clip(self.fineness * columns[of_pixel] + self.offsets[entry, 1], 0, across - 1)
        shape = (len(counts), across * deep)
        return csr_matrix((self.weights[entry], (down * across + right).astype(np.int32), bounds), shape=shape)


def blur_sizes(sensor: Sensor, radius_px: ArrayLike, object_distance_mm: float = np.inf) -> BlurSize:
    """Return the blur at distances (n,) px from the optical axis; beyond the rim, that of the rim.

    >>> import omnimirror as om
    >>> blur_sizes(om.load_sensor("paper-spherical"), [0.0, 490.0]).sagittal.round(1)
    array([1. , 7.3])
    """
    radius = np.minimum(np.asarray(radius_px, dtype=float), sensor.rim_radius_px * ROUNDED)
    found = evaluate(sensor, h_px=radius, object_distance_mm=object_distance_mm)
    return BlurSize(np.abs(found.blur_t_px), np.abs(found.blur_s_px))


def offsets_from_axis(sensor: Sensor) -> Array:
    """Return offsets (rows, columns, 2) px of the pixels from the optical axis, right and down.

    Raises
    ------
    InvalidParameter
        If the mirror is decentred or tilted, or there are two mirrors.
    """
    sensor.check("restoring and merging pictures", "one mirror")
    _ = sensor.meridian  # raises an error for misaligned mirrors
    assert sensor.symmetry is not None
    width, height = sensor.image_size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    offsets: Array = np.stack([columns, rows], axis=-1) - np.asarray(sensor.symmetry.centre_px)
    return offsets


def whole_radius_px(sensor: Sensor) -> float:
    """Return the distance from the optical axis within which the mirror fills the aperture; the rim
    is defocused, too.
    """
    mirror, lens = sensor.mirror, sensor.lens
    z = float(mirror.sag(np.array([mirror.rim_radius_mm]))[0]) + sensor.mirror_pose.displacement_mm
    L = z if lens.TELECENTRIC else sensor.mirror_distance_mm + z
    return sensor.rim_radius_px - 1.0 - float(np.abs(lens.blur(L))) / sensor.imager.pitch_mm / 2


def blur_kernels(offsets: Array, whole_radius_px: float, sizes: Callable[[Array], BlurSize], fineness: int = 2) -> Blur:
    """Return the blur of all pixels that receive all of their light from the mirror.

    Parameters
    ----------
    offsets : (h, w, 2)
        Offsets of the pixels from the axis, px right and down.
    whole_radius_px
        Distance from the axis within which pixels are known.
    sizes
        Blur at distances (n,) px from the axis.
    fineness
        Number of fine pixels along the side of a pixel.
    """
    known = np.hypot(offsets[..., 0], offsets[..., 1]) <= whole_radius_px
    block = _block_px(sizes, whole_radius_px)
    firsts = np.arange(0, known.shape[1], block)
    lasts = np.minimum(firsts + block, known.shape[1]) - 1
    blocks = np.logical_or.reduceat(known, firsts, axis=1)
    right, down = ((offsets[:, firsts] + offsets[:, lasts]) / 2)[blocks].T
    ring = (np.minimum(np.hypot(right, down), whole_radius_px) / RING_PX).astype(int)
    turn = np.rint(np.arctan2(down, right) / np.pi * TURNS).astype(int) % TURNS
    of_ring = sizes((np.arange(ring.max(initial=0) + 1) + 0.5) * RING_PX)
    groups, of_block = np.unique(ring * TURNS + turn, return_inverse=True)
    kernels = np.full((len(known), whole_groups(known.shape[1]) // block), -1)
    kernels[:, : len(firsts)][blocks] = of_block
    rings, turns = np.divmod(groups, TURNS)
    found = [
        _kernels(of_ring.tangential[r], of_ring.sagittal[r], np.pi / TURNS * turns[rings == r], fineness)
        for r in np.unique(rings)
    ]
    counts, reached, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    size, pixels, bounds = known.shape[::-1], np.flatnonzero(known), np.r_[0, np.cumsum(counts)]
    return Blur(size, fineness, _whole(pixels), _whole(kernels), _whole(bounds), _whole(reached), weights, block)


def _block_px(sizes: Callable[[Array], BlurSize], whole_radius_px: float) -> int:
    """Return the number of adjacent pixels that can share one kernel."""
    radii = np.arange(max(whole_radius_px, 0) + 2)
    steep = max(float(np.quantile(np.abs(np.diff(size)), 0.9)) for size in sizes(radii))
    block = GROUP_PX
    while block > 1 and block * steep > STEEP_PX:
        block //= 2
    return block


def whole_groups(length: int) -> int:
    """Return the number of pixels rounded up to whole groups."""
    return -(-length // GROUP_PX) * GROUP_PX


def _parts(length: int) -> list[int]:
    """Return the start of tiles of about equal size along a side, and the end."""
    tiles = -(-length // TILE_PX)
    return [*range(0, length, whole_groups(-(-length // tiles))), length]


def _whole(numbers: NDArray[Any]) -> Whole:
    return np.ascontiguousarray(numbers, np.int32)


def _kernels(
    tangential: float, sagittal: float, turns: Array, fineness: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
    """Return the kernels of a disk at angles (n,), convolved with the pixel: number of offsets per
    kernel, offsets (m, 2) down and right on the fine grid, column by column, and weights (m,).
    """
    count = max(32, int(np.ceil(POINTS_PER_PX2 * tangential * sagittal)))
    along, across = (_sunflower(count) * [tangential / 2, sagittal / 2]).T * fineness
    c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
    reach = int(np.ceil(max(tangential, sagittal) / 2 * fineness)) + 1
    x, y = along * c - across * s + reach, along * s + across * c + reach
    side = 2 * reach + 2
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - left, y - top
    place = (np.arange(len(turns))[:, None] * side + top) * side + left
    grid = np.zeros(len(turns) * side * side)
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            grid += np.bincount((place + dy * side + dx).ravel(), (wy * wx).ravel(), len(grid))
    wide = np.zeros((len(turns), side + fineness - 1, side + fineness - 1))
    for dy in range(fineness):
        for dx in range(fineness):
            wide[:, dy : dy + side, dx : dx + side] += grid.reshape(-1, side, side)
    wide[wide <= 1e-4 * wide.max(axis=(1, 2), keepdims=True)] = 0
    wide /= wide.sum(axis=(1, 2), keepdims=True)
    kernel, right, down = np.nonzero(wide.transpose(0, 2, 1))
    counts = np.bincount(kernel, minlength=len(turns))
    return counts, np.stack([down, right], axis=-1) - reach, wide[kernel, down, right].astype(np.float32)


def _sunflower(count: int) -> Array:
    """Return points (count, 2) distributed uniformly on the unit disk (Vogel's spiral)."""
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
