"""Blur as kernels: from a sharp picture on a fine grid to the pixels of a sensor that is out of focus.

What a lens with a round aperture makes of a point is an elliptic disk, as long away from the optical axis as the
tangential blur and across as the sagittal one (Eqs. 34-36 of Ohte and Tsuzuki). So every pixel is the mean of the
sharp picture over such a disk about it, widened by its own square.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...analysis.evaluation import evaluate
from ...optics.sensor import Sensor

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]
Whole = NDArray[np.int32]

GROUP_PX = 8  # adjoining pixels of a row, which processors blur beside each other
STEEP_PX = 0.65  # by as much the blur may change along pixels of one kernel, at nine of ten distances from the axis
TILE_PX = 152  # sides of the parts that are looked for by themselves, at most: a few megabytes, which stay in caches
RING_PX = 2.0  # the width of rings with one kernel for each direction
TURNS = 64  # directions, over half a turn: at 10 px of blur its ends are .25 px off at most
POINTS_PER_PX2 = 16  # on the disk
ROUNDED = 1 - 1e-9


class BlurSize(NamedTuple):
    """Blur diameters (n,) in px, without sign."""

    tangential: Array
    sagittal: Array

    @property
    def larger(self) -> Array:
        return np.maximum(self.tangential, self.sagittal)

    @property
    def widening(self) -> Array:
        """By how much a pixel grows with the blur: side of the square of its area, less the pixel's own."""
        widened: Array = ((1 + self.tangential**2) * (1 + self.sagittal**2)) ** 0.25 - 1
        return widened


class Blur(NamedTuple):
    """The blur of pixels as kernels: the weights with which values of a sharp picture on a finer grid count in each."""

    size: tuple[int, int]
    """Width and height of the picture in pixels."""
    fineness: int
    """Pixels of the sharp picture along the side of a pixel."""
    pixels: Whole
    """(n,) that are known, ascending: row * width + column."""
    kernels: Whole
    """(h, blocks) which kernel the pixels of a block in a row have, in whole groups; -1 where none is known."""
    firsts: Whole
    """(kernels + 1,) the first weight of each kernel, and the number of all."""
    offsets: Whole
    """(m, 2) rows down and columns right on the fine grid, from the first value of a pixel."""
    weights: NDArray[np.float32]
    """(m,), adding up to 1 in every kernel."""
    block_px: int
    """Adjoining pixels of a row that have one kernel: 1, 2, 4 or 8."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """(h, w) whether a pixel is known."""
        known = np.zeros(self.size[::-1], bool)
        known.ravel()[self.pixels] = True
        return known

    @property
    def reach(self) -> int:
        """By how many pixels kernels go beyond their own, at most."""
        least, most = (int(extreme) // self.fineness for extreme in (self.offsets.min(), self.offsets.max()))
        return max(-least, most, 1)

    @property
    def tiles(self) -> Whole:
        """(n, 2, 4) parts of the picture that are looked for each as a picture of its own.

        The pixels whose sharp values are kept of it, and the known ones that it explains, some of its neighbours' among
        them: their rows and columns, each from the first to the end. Its values lie as far beyond as kernels reach, in
        whole groups of columns.
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
        """(h, w) root of the sum of squares of the weights in each pixel's kernel, over the fineness: about what makes
        conjugate gradients quickest, between the diagonal of the weights' product with their transpose, which is less,
        and what that comes to for even pictures. Where no pixel is known, that of the last kernel, which is at the rim.
        """
        of_kernel = np.sqrt(np.add.reduceat(self.weights**2, self.firsts[:-1])) / self.fineness
        of_block = of_kernel.astype(np.float32)[self.kernels]  # none is the last
        return np.ascontiguousarray(np.repeat(of_block, self.block_px, axis=1)[:, : self.size[0]])

    def matrix(self) -> csr_matrix:
        """``matrix @ sharp.reshape(-1, channels)`` are the blurred values of ``pixels``; beyond its edge the picture
        goes on as it ends."""
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
    """Blur at distances (n,) px from the optical axis; beyond the rim that of the rim.

    >>> import omnimirror as om
    >>> blur_sizes(om.load_sensor("paper-spherical"), [0.0, 490.0]).sagittal.round(1)
    array([1. , 7.3])
    """
    radius = np.minimum(np.asarray(radius_px, dtype=float), sensor.rim_radius_px * ROUNDED)
    found = evaluate(sensor, h_px=radius, object_distance_mm=object_distance_mm)
    return BlurSize(np.abs(found.blur_t_px), np.abs(found.blur_s_px))


def offsets_from_axis(sensor: Sensor) -> Array:
    """Offsets (rows, columns, 2) px of the pixels from the optical axis, right and down.

    Raises
    ------
    InvalidParameter
        If the mirror is decentred or tilted, or there are two.
    """
    sensor.check("restoring and merging pictures", "one mirror")
    _ = sensor.meridian  # refuses mirrors out of place
    assert sensor.symmetry is not None
    width, height = sensor.image_size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    offsets: Array = np.stack([columns, rows], axis=-1) - np.asarray(sensor.symmetry.centre_px)
    return offsets


def whole_radius_px(sensor: Sensor) -> float:
    """Distance from the optical axis up to which the mirror fills the aperture: the rim is out of focus, too."""
    mirror, lens = sensor.mirror, sensor.lens
    z = float(mirror.sag(np.array([mirror.rim_radius_mm]))[0]) + sensor.mirror_pose.displacement_mm
    L = z if lens.TELECENTRIC else sensor.mirror_distance_mm + z
    return sensor.rim_radius_px - 1.0 - float(np.abs(lens.blur(L))) / sensor.imager.pitch_mm / 2


def blur_kernels(offsets: Array, whole_radius_px: float, sizes: Callable[[Array], BlurSize], fineness: int = 2) -> Blur:
    """The blur of all pixels whose whole light comes off the mirror.

    Parameters
    ----------
    offsets : (h, w, 2)
        Of the pixels from the axis, px right and down.
    whole_radius_px
        Distance from the axis up to which pixels are known.
    sizes
        Blur at distances (n,) px from the axis.
    fineness
        Pixels of the sharp picture along the side of a pixel.
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
    """As many pixels as can have one kernel."""
    radii = np.arange(max(whole_radius_px, 0) + 2)
    steep = max(float(np.quantile(np.abs(np.diff(size)), 0.9)) for size in sizes(radii))
    block = GROUP_PX
    while block > 1 and block * steep > STEEP_PX:
        block //= 2
    return block


def whole_groups(length: int) -> int:
    """As many pixels as groups have that are no shorter together."""
    return -(-length // GROUP_PX) * GROUP_PX


def _parts(length: int) -> list[int]:
    """Where tiles of about one size begin along a side, and the end."""
    tiles = -(-length // TILE_PX)
    return [*range(0, length, whole_groups(-(-length // tiles))), length]


def _whole(numbers: NDArray[Any]) -> Whole:
    return np.ascontiguousarray(numbers, np.int32)


def _kernels(
    tangential: float, sagittal: float, turns: Array, fineness: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
    """Of a disk turned so far (n,), widened by the pixel: how many offsets each has, offsets (m, 2) down and right on
    the fine grid, column by column, and weights (m,)."""
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
    """Points (count, 2) spread evenly over the unit disk (Vogel's spiral)."""
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
