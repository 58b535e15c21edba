"""Conversion of images to the depths and channels of a file format: integers are sRGB, floats
linear light.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.colour import linear_from_srgb, srgb_from_linear
from ...io.pictures.images import FULL, PictureFormat

Image = NDArray[Any]


def depth_for(depth: str, kind: PictureFormat) -> str:
    """Return the nearest depth supported by a file format; for linear light stored as integers, the
    largest one.

    >>> from omnimirror.io.pictures.images import format_of
    >>> depth_for("uint16", format_of("a.jpg")), depth_for("float32", format_of("a.png"))
    ('uint8', 'uint16')
    """
    return depth if depth in kind.depths else kind.depths[-1]


def as_held(image: Image, kind: PictureFormat) -> Image:
    """Convert an image to a depth and channels supported by a file format.

    16 bits are rounded to 8; floating-point light is converted to sRGB, clipped at white, and vice
    versa. A grey image becomes RGB if the format supports no grey images. Alpha is linear.

    >>> from omnimirror.io.pictures.images import format_of
    >>> as_held(np.array([[0, 257, 65535]], np.uint16), format_of("a.jpg"))
    array([[  0,   1, 255]], dtype=uint8)
    >>> as_held(np.array([[0.0, 0.214, 7.0]], np.float32), format_of("a.jpg"))
    array([[  0, 127, 255]], dtype=uint8)
    """
    depth = depth_for(image.dtype.name, kind)
    if depth != image.dtype.name:
        image = _in_depth(image, depth)
    channels = image.shape[2] if image.ndim == 3 else 1
    if channels == 1 and 1 not in kind.channels:
        image = np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
    return image


def _in_depth(image: Image, depth: str) -> Image:
    values = image.astype(np.float64) / FULL[image.dtype.name]
    colours: Image = values[..., :3] if image.ndim == 3 else values
    if image.dtype == np.float32:
        colours = srgb_from_linear(np.nan_to_num(colours))
    elif depth == "float32":
        colours = linear_from_srgb(colours)
    values[..., : colours.shape[-1]] = colours
    if depth == "float32":
        return values.astype(np.float32)
    return np.rint(values.clip(0, 1) * FULL[depth]).astype(depth)
