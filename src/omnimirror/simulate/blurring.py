"""Blur as a matrix: from a sharp picture on a fine grid to the pixels of a sensor that is out of focus.

What a lens with a round aperture makes of a point is an elliptic disk, as long away from the optical axis as the
tangential blur and across as the sagittal one (Eqs. 34-36 of Ohte and Tsuzuki). So every pixel is the mean of the
sharp picture over such a disk about it, widened by its own square.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..analysis import evaluate
from ..sensor import Sensor

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

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


class BlurMatrix(NamedTuple):
    """``matrix @ sharp.reshape(-1, channels)`` are the blurred values of ``pixels``."""

    matrix: csr_matrix
    """(n, rows * columns * fineness^2), float32; every row adds up to 1."""
    pixels: Indices
    """(n,) of the pixels: row * width + column."""
    fineness: int
    """Pixels of the sharp picture along the side of a pixel."""


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
    sensor.check_one_mirror("restoring and merging pictures")
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


def blur_matrix(sensor: Sensor, fineness: int = 2, object_distance_mm: float = np.inf) -> BlurMatrix:
    """The blur of all pixels whose whole light comes off the mirror.

    Parameters
    ----------
    sensor
        With its mirror on the axis of the lens.
    fineness
        Pixels of the sharp picture along the side of a pixel.
    object_distance_mm
        From the mirror to what is seen.

    Raises
    ------
    InvalidParameter
        If the mirror is decentred or tilted.
    """
    from scipy.sparse import csr_matrix

    offsets = offsets_from_axis(sensor)
    height, width = offsets.shape[:2]
    radius = np.hypot(offsets[..., 0], offsets[..., 1]).ravel()
    pixels = np.flatnonzero(radius <= whole_radius_px(sensor))
    ring = (radius[pixels] / RING_PX).astype(int)
    turn = np.arctan2(offsets[..., 1], offsets[..., 0]).ravel()[pixels] / np.pi * TURNS
    sizes = blur_sizes(sensor, (np.arange(ring.max() + 1) + 0.5) * RING_PX, object_distance_mm)

    group = ring * TURNS + np.rint(turn).astype(int) % TURNS
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(group[order]) > 0, True])
    across = width * fineness
    lengths, targets, weights = np.zeros(len(pixels), np.int64), [], []
    for begin, end in pairwise(starts):
        members = order[begin:end]
        r, k = divmod(int(group[members[0]]), TURNS)
        down, right, weight = _kernel(sizes.tangential[r], sizes.sagittal[r], np.pi * k / TURNS, fineness)
        y, x = np.divmod(pixels[members], width)
        y = np.clip(fineness * y[:, None] + down, 0, height * fineness - 1)
        x = np.clip(fineness * x[:, None] + right, 0, across - 1)
        targets.append((y * across + x).astype(np.int32).ravel())
        weights.append(np.broadcast_to(weight, x.shape).ravel())
        lengths[begin:end] = len(weight)
    bounds = np.r_[0, np.cumsum(lengths)]
    shape = (len(pixels), across * height * fineness)
    matrix = csr_matrix((np.concatenate(weights), np.concatenate(targets), bounds), shape=shape)
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    return BlurMatrix(matrix[back], pixels, fineness)


def _kernel(
    tangential: float, sagittal: float, turn: float, fineness: int
) -> tuple[Indices, Indices, NDArray[np.float32]]:
    """Offsets (m,) down and right on the fine grid from a pixel's first, and weights (m,): a disk, times its square."""
    count = max(32, int(np.ceil(POINTS_PER_PX2 * tangential * sagittal)))
    along, across = (_sunflower(count) * [tangential / 2, sagittal / 2]).T * fineness
    c, s = np.cos(turn), np.sin(turn)
    reach = int(np.ceil(max(tangential, sagittal) / 2 * fineness)) + 1
    x, y = along * c - across * s + reach, along * s + across * c + reach
    side = 2 * reach + 2
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - left, y - top
    grid = np.zeros(side * side)
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            grid += np.bincount((top + dy) * side + left + dx, wy * wx, side * side)
    wide = np.zeros((side + fineness - 1,) * 2)
    for dy in range(fineness):
        for dx in range(fineness):
            wide[dy : dy + side, dx : dx + side] += grid.reshape(side, side)
    down, right = np.nonzero(wide > 1e-4 * wide.max())
    weight = wide[down, right]
    return down - reach, right - reach, (weight / weight.sum()).astype(np.float32)


def _sunflower(count: int) -> Array:
    """Points (count, 2) spread evenly over the unit disk (Vogel's spiral)."""
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
