"""Sampling of rays: positions on the pixel and on the lens aperture.

Rays are uniform in all four dimensions (an additive recurrence), with a different shift in each
pixel, which turns the remaining error into fine grain without pattern. Sharp images need two
dimensions only and use a regular grid.
"""

from __future__ import annotations

from math import isqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import numbers, shown
from ...base.errors import InvalidParameter
from ...base.typing import Array

MOST_SAMPLES = 1 << 16
PLASTIC = {2: 1.32471795724474602596, 4: 1.16730397826141868426}
"""Roots of g^(d+1) = g + 1, whose powers are the steps of the recurrence (Roberts, 2018)."""


class Samples(NamedTuple):
    """Samples of every pixel."""

    points: NDArray[np.float32]
    """Points (n, 4) in [0, 1): across and down the pixel, and on the aperture."""
    blur: bool
    """True if samples are distributed over the aperture; each pixel then has its own cyclic shift.
    """
    seed: int


def spread(samples: int, blur: bool, seed: int = 0) -> Samples:
    """Return samples for each pixel.

    Parameters
    ----------
    samples
        Rays per pixel.
    blur
        True to sample the aperture, too; otherwise all rays pass through its centre.
    seed
        Random seed of the shifts.

    Raises
    ------
    InvalidParameter
        If the number of samples is out of range, or the seed is not a 32-bit integer.

    Examples
    --------
    >>> spread(4, blur=False).points[:, :2].tolist()
    [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]
    """
    for name, value in (("samples", samples), ("seed", seed)):
        if numbers(name, value, "(it takes one)").ndim:
            raise InvalidParameter(f"{name} = {shown(value)} is not one whole number")
    if not (1 <= samples <= MOST_SAMPLES and int(samples) == samples):
        raise InvalidParameter(f"samples = {shown(samples)} is not a whole number from 1 to {MOST_SAMPLES}")
    if not (0 <= seed < 1 << 32 and int(seed) == seed):
        raise InvalidParameter(f"seed = {shown(seed)} is not a whole number from 0 to {2**32 - 1}")
    points = np.zeros((samples, 4))
    side = isqrt(samples)
    if blur:
        points[:] = _recurrence(samples, 4)
    elif side * side == samples:
        u = (np.arange(side) + 0.5) / side
        points[:, :2] = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    else:  # identical in every pixel: half of the points, and their reflections at its centre, to avoid a shift
        half = _recurrence(samples // 2 + 1, 2)[1:]  # without the centre itself
        points[:, :2] = np.concatenate([half, 1 - half, np.full((samples % 2, 2), 0.5)])
    return Samples(np.minimum(points, 1 - 2.0**-24).astype(np.float32), blur, int(seed))


def _recurrence(count: int, dimensions: int) -> Array:
    steps = PLASTIC[dimensions] ** -np.arange(1.0, dimensions + 1)
    points: Array = (0.5 + np.arange(count)[:, None] * steps) % 1.0
    return points


def places(samples: Samples, columns: ArrayLike, rows: ArrayLike) -> tuple[Array, Array]:
    """Return pixels (..., n, 2) and aperture points (..., n, 2) of the unit disk, for pixels given
    by column and row.

    Shifts are a hash of the pixel, as in the compiled kernels (Wellons, "lowbias32").
    """
    columns, rows = np.broadcast_arrays(np.asarray(columns, np.int64), np.asarray(rows, np.int64))
    p = samples.points.astype(float)
    if samples.blur:
        p = (p + _shifts(columns, rows, samples.seed)[..., None, :]) % 1.0
    else:
        p = np.broadcast_to(p, (*columns.shape, *p.shape))
    pixels = np.stack([columns, rows], axis=-1)[..., None, :] + p[..., :2] - 0.5
    radius, turn = np.sqrt(p[..., 2]), 2 * np.pi * (p[..., 3] - 0.5)
    aperture = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    return pixels, aperture


def _shifts(columns: NDArray[np.int64], rows: NDArray[np.int64], seed: int) -> Array:
    h = _mixed(np.uint32(seed) ^ _mixed(columns.astype(np.uint32) + _mixed(rows.astype(np.uint32))))
    shifts = []
    for _ in range(4):
        shifts.append((h >> np.uint32(8)) * 2.0**-24)
        h = _mixed(h + np.uint32(0x9E3779B9))
    return np.stack(shifts, axis=-1)


def _mixed(h: NDArray[np.uint32]) -> NDArray[np.uint32]:
    h = np.asarray(h, np.uint32)
    h = h ^ (h >> np.uint32(16))
    h = h * np.uint32(0x7FEB352D)
    h = h ^ (h >> np.uint32(15))
    h = h * np.uint32(0x846CA68B)
    mixed: NDArray[np.uint32] = h ^ (h >> np.uint32(16))
    return mixed
