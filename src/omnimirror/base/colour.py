"""Colours: linear light in floats, images in sRGB bytes, both in RGB order."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidParameter

Light = NDArray[np.float32]
SrgbImage = NDArray[np.uint8]
BLOCK_VALUES = 1 << 16  # fits the cache, and avoids a second copy of images as floats


def linear_from_srgb(srgb: ArrayLike) -> Light:
    """Convert sRGB values to linear light, both with white at 1 (IEC 61966-2-1).

    >>> linear_from_srgb([0.0, 0.5, 1.0]).round(4)
    array([0.   , 0.214, 1.   ], dtype=float32)
    """
    s = np.asarray(srgb, dtype=np.float32)
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_rgb(image: NDArray[Any]) -> Light:
    """Return linear RGB (h, w, 3) of a grey, RGB or RGBA image: integers are sRGB, floats linear light.

    >>> linear_rgb(np.array([[0, 188, 255]], np.uint8))[0, :, 0].round(2)
    array([0. , 0.5, 1. ], dtype=float32)
    """
    image = np.asarray(image)  # masked arrays would keep masked integers unchanged
    rgb = image[..., :3] if image.ndim == 3 else image[..., None]
    if image.dtype.kind == "u":
        rgb = linear_from_srgb(rgb / np.float32(np.iinfo(image.dtype).max))
    return np.broadcast_to(rgb, (*image.shape[:2], 3)).astype(np.float32)


def srgb_bytes(linear: ArrayLike) -> SrgbImage:
    """Convert linear light to sRGB bytes; light above 1 saturates.

    >>> srgb_bytes([0.0, 0.214, 1.0, 7.0])
    array([  0, 127, 255, 255], dtype=uint8)
    """
    light = np.asarray(linear)
    image = np.empty(light.shape, np.uint8)
    values, codes = light.reshape(-1), image.reshape(-1)
    for block in value_blocks(light.size):
        codes[block] = np.rint(255 * srgb_from_linear(values[block]))
    return image


def value_blocks(count: int) -> Iterator[slice]:
    """Yield slices of at most ``BLOCK_VALUES`` values.

    >>> [block.stop for block in value_blocks(100_000)]
    [65536, 100000]
    """
    for start in range(0, count, BLOCK_VALUES):
        yield slice(start, min(start + BLOCK_VALUES, count))


def srgb_from_linear(linear: ArrayLike) -> Light:
    """Convert linear light to sRGB values, both with white at 1; light above 1 saturates.

    >>> srgb_from_linear([0.0, 0.214, 7.0]).round(3)
    array([0. , 0.5, 1. ], dtype=float32)
    """
    x = np.asarray(np.clip(np.asarray(linear, dtype=np.float32), 0, 1))
    # IEC 61966-2-1: C = 12.92 L up to L = 0.0031308, otherwise C = 1.055 L^(1/2.4) - 0.055.
    encoded = np.asarray(x ** (1 / 2.4))  # in place from here on: images are large
    encoded *= 1.055
    encoded -= 0.055
    return np.multiply(x, 12.92, out=encoded, where=x <= 0.0031308)


def hex_colour(text: str) -> Light:
    """Return the linear light (3,) of a hexadecimal colour such as ``#rrggbb``.

    Raises
    ------
    InvalidParameter
        If the text is not # and six hexadecimal digits.

    Examples
    --------
    >>> hex_colour("#ff8000").round(4)
    array([1.    , 0.2159, 0.    ], dtype=float32)
    """
    if not re.fullmatch("#[0-9a-fA-F]{6}", text):
        raise InvalidParameter(
            f"a colour must be # and six hexadecimal digits, such as '#ff8000'; got {text!r}"
        )
    return linear_from_srgb([int(text[i : i + 2], 16) / 255 for i in (1, 3, 5)])
