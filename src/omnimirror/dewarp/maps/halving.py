"""Places in planes of half the size, as 4:2:0 codes colours, from those of the whole picture.

Such a plane has one sample for 2 x 2 pixels. Column i of it lies over column ``2 i + x``, row j over ``2 j + y``, where
(x, y) is the offset of its samples; so what a sample of the view shows is found at ``(place of the view there - offset
of the picture's samples) / 2``. The map is taken between its pixels: nothing is projected again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import inside_image

Floats = NDArray[Any]
Offset = tuple[float, float]

SEEN = 2  # of the 4 pixels must show the scene for their sample to count


def half(size: tuple[int, int]) -> tuple[int, int]:
    """Size of a plane of half the size.

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
    """Places (.., ceil h/2, ceil w/2, 2) in planes of half the size from those of the whole (.., h, w, 2).

    Linear between pixels, which is wrong by an eighth of what the map bends from one output pixel to the
    next. At the end of the field a sample counts if at least two of its four pixels do.

    Parameters
    ----------
    in_picture, in_view
        Offsets (x, y) of samples, px; see :meth:`~omnimirror.dewarp.contracts.Map.halved`.
    source_size
        (width, height) of the whole picture.
    labels : (h, w), optional
        Different numbers where one must not interpolate between.

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
    # A point on the first or last half pixel of the whole image may lie outside the plane of half the size.
    halved: Floats = np.clip((at - np.array(in_picture)) / 2, -0.5, np.array(half(source_size)) - 0.5)
    return halved.astype(pixels.dtype, copy=False)


def _blocks(values: Floats) -> Floats:
    """Squares of 2 x 2 values (.., h/2, w/2, 2, 2, n) of (.., h, w, n); odd sides go on as they end."""
    for axis in (-3, -2):
        count = values.shape[axis]
        if count % 2:
            last = np.take(values, [-1], axis)
            before = np.take(values, [max(count - 2, 0)], axis)
            values = np.concatenate([values, 2 * last - before], axis)
    *more, height, width, n = values.shape
    return np.swapaxes(values.reshape(*more, height // 2, 2, width // 2, 2, n), -4, -3)


def pairs(values: Floats) -> Floats:
    """Pairs (n/2, 2) of values (n,); an odd number goes on as it ends."""
    if len(values) % 2:
        values = np.append(values, 2 * values[-1] - values[max(len(values) - 2, 0)])
    return values.reshape(-1, 2)
