"""Blur as kernels: from a sharp picture on a fine grid to the pixels of a sensor that is out of focus.

What a lens with a round aperture makes of a point is an elliptic disk, as long away from the optical axis as the
tangential blur and across as the sagittal one (Eqs. 34-36 of Ohte and Tsuzuki). So every pixel is the mean of the
sharp picture over such a disk about it, widened by its own square.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...analysis.evaluation import evaluate
from ...sensor import Sensor

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]
Whole = NDArray[np.int32]

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
    """(n,) which kernel each of them has."""
    firsts: Whole
    """(kernels + 1,) the first weight of each kernel, and the number of all."""
    offsets: Whole
    """(m, 2) rows down and columns right on the fine grid, from the first value of a pixel."""
    weights: NDArray[np.float32]
    """(m,), adding up to 1 in every kernel."""

    @property
    def spans(self) -> Whole:
        """(fine rows, 2) columns of the fine grid that known pixels may depend on: the first, and the end."""
        width, height = self.size
        across, deep = width * self.fineness, height * self.fineness
        known = np.zeros((height, width), bool)
        known.ravel()[self.pixels] = True
        rows = np.flatnonzero(known.any(axis=1))
        first, last = known[rows].argmax(axis=1), width - 1 - known[rows, ::-1].argmax(axis=1)
        (up, left), (down, right) = self.offsets.min(axis=0), self.offsets.max(axis=0)
        begins, ends = np.full(deep, across), np.zeros(deep, int)
        for reached in range(up, down + 1):
            at = np.clip(self.fineness * rows + reached, 0, deep - 1)
            np.minimum.at(begins, at, np.clip(self.fineness * first + left, 0, across))
            np.maximum.at(ends, at, np.clip(self.fineness * last + right + 1, 0, across))
        return _whole(np.stack([np.minimum(begins, ends), ends], axis=-1))

    def matrix(self) -> csr_matrix:
        """``matrix @ sharp.reshape(-1, channels)`` are the blurred values of ``pixels``; beyond its edge the picture
        goes on as it ends."""
        from scipy.sparse import csr_matrix

        width, height = self.size
        across, deep = width * self.fineness, height * self.fineness
        counts = np.diff(self.firsts)[self.kernels]
        bounds = np.r_[0, np.cumsum(counts)]
        of_pixel = np.repeat(np.arange(len(counts)), counts)
        entry = np.arange(bounds[-1]) - np.repeat(bounds[:-1] - self.firsts[self.kernels], counts)
        rows, columns = np.divmod(self.pixels, width)
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
    radius = np.hypot(offsets[..., 0], offsets[..., 1]).ravel()
    pixels = np.flatnonzero(radius <= whole_radius_px)
    ring = (radius[pixels] / RING_PX).astype(int)
    turn = np.arctan2(offsets[..., 1], offsets[..., 0]).ravel()[pixels] / np.pi * TURNS
    of_ring = sizes((np.arange(ring.max(initial=0) + 1) + 0.5) * RING_PX)
    groups, kernels = np.unique(ring * TURNS + np.rint(turn).astype(int) % TURNS, return_inverse=True)
    rings, turns = np.divmod(groups, TURNS)
    found = [
        _kernels(of_ring.tangential[r], of_ring.sagittal[r], np.pi / TURNS * turns[rings == r], fineness)
        for r in np.unique(rings)
    ]
    counts, reached, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    firsts = np.r_[0, np.cumsum(counts)]
    size = (offsets.shape[1], offsets.shape[0])
    return Blur(size, fineness, _whole(pixels), _whole(kernels), _whole(firsts), _whole(reached), weights)


def _whole(numbers: NDArray[Any]) -> Whole:
    return np.ascontiguousarray(numbers, np.int32)


def _kernels(
    tangential: float, sagittal: float, turns: Array, fineness: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
    """Of a disk turned so far (n,), widened by the pixel: how many offsets each has, offsets (m, 2) down and right on
    the fine grid, row by row, and weights (m,)."""
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
    kernel, down, right = np.nonzero(wide)
    counts = np.bincount(kernel, minlength=len(turns))
    return counts, np.stack([down, right], axis=-1) - reach, wide[kernel, down, right].astype(np.float32)


def _sunflower(count: int) -> Array:
    """Points (count, 2) spread evenly over the unit disk (Vogel's spiral)."""
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
