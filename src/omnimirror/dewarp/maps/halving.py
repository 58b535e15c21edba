"""Source coordinates of half-resolution planes (4:2:0 chroma) from those of the full image.

Such a plane has one sample per 2 x 2 pixels. Its column i is at column ``2 i + x`` and its row j at
row ``2 j + y`` of the full image, with the sample offset (x, y). The source coordinate of a sample
is therefore ``(source coordinate at the view position - image offset) / 2``. The map is
interpolated between its pixels, without further projections.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import inside_image

Floats = NDArray[Any]
Offset = tuple[float, float]

SEEN = 2  # minimum number of the 4 pixels inside the field for a valid sample


def half(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size of a half-resolution plane.

    >>> half((63, 48))
    (32, 24)
    """
    return (size[0] + 1) // 2, (size[1] + 1) // 2


def halved_pixels(
    pixels: Floats,
    in_picture: Offset,
    in_view: Offset,
    source_size: tuple[int, int],
    labels: NDArray[np.int32] | None = None,
) -> Floats:
    """Return coordinates (..., ceil h/2, ceil w/2, 2) in half-resolution planes from full
    coordinates (..., h, w, 2).

    Interpolation between pixels is linear, with an error of 1/8 of the second difference of the
    map. At the field boundary a sample is valid if at least two of its four pixels are.

    Parameters
    ----------
    in_picture, in_view
        Sample offsets (x, y), px; see :meth:`~omnimirror.dewarp.contracts.Map.halved`.
    source_size
        Size (width, height) of the full image.
    labels : (h, w), optional
        Region labels; no interpolation between pixels of different labels.

    Examples
    --------
    >>> u, v = np.meshgrid(np.arange(4.0), np.arange(2.0))
    >>> halved_pixels(np.stack([u, v], axis=-1), (0.0, 0.5), (0.0, 0.5), (4, 2))  # the same picture
    array([[[0., 0.],
            [1., 0.]]])
    """
    x, y = in_view
    blocks = _blocks(np.where(inside_image(pixels, source_size)[..., None], pixels, np.nan))
    rows = (1 - y) * blocks[..., 0, :, :] + y * blocks[..., 1, :, :]
    at = (1 - x) * rows[..., 0, :] + x * rows[..., 1, :]
    cut = np.isnan(at[..., 0]) & ((~np.isnan(blocks[..., 0])).sum(axis=(-2, -1)) >= SEEN)
    at[cut] = np.nanmean(blocks[cut], axis=(1, 2))
    if labels is not None:
        of_block = _blocks(labels[..., None])[..., 0]
        mixed = (of_block != of_block[..., :1, :1]).any(axis=(-2, -1))
        at[mixed] = blocks[mixed][:, 0, 0]
    # A point on the outermost half pixel of the full image may be outside the half-resolution
    # plane.
    halved: Floats = np.clip((at - np.array(in_picture)) / 2, -0.5, np.array(half(source_size)) - 0.5)
    return halved.astype(pixels.dtype, copy=False)


def _blocks(values: Floats) -> Floats:
    """Return blocks of 2 x 2 values (..., h/2, w/2, 2, 2, n) of (..., h, w, n); odd sides are
    extrapolated linearly.
    """
    for axis in (-3, -2):
        count = values.shape[axis]
        if count % 2:
            last = np.take(values, [-1], axis)
            before = np.take(values, [max(count - 2, 0)], axis)
            values = np.concatenate([values, 2 * last - before], axis)
    *more, height, width, n = values.shape
    return np.swapaxes(values.reshape(*more, height // 2, 2, width // 2, 2, n), -4, -3)


def pairs(values: Floats) -> Floats:
    """Return pairs (n/2, 2) of values (n,); an odd number is extrapolated linearly."""
    if len(values) % 2:
        values = np.append(values, 2 * values[-1] - values[max(len(values) - 2, 0)])
    return values.reshape(-1, 2)
