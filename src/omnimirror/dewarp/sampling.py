"""Taking a picture's values at fractional coordinates, with OpenCV."""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras import Mask
from ..errors import InvalidParameter
from ..media.images import FULL

Image = NDArray[Any]
Interpolation = Literal["nearest", "linear", "cubic"]

INTERPOLATIONS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
LONGEST_SIDE_PX = 32_766  # cv2.remap counts pixels in 16 bits


def check_picture(image: Image, size: tuple[int, int]) -> None:
    """Refuse what is not a picture of the given (width, height)."""
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or channels not in (1, 3, 4):
        raise InvalidParameter(f"an array of shape {image.shape} is not a picture of 1, 3 or 4 channels")
    if image.dtype.name not in FULL:
        raise InvalidParameter(f"the picture holds {image.dtype.name} values; valid are {', '.join(FULL)}")
    height, width = image.shape[:2]
    if (width, height) != tuple(size):
        same_shape = abs(width * size[1] - height * size[0]) <= max(width, height, *size) / 2
        advice = "; both have the same shape: scale the picture to that size first" if same_shape else ""
        raise InvalidParameter(
            f"the picture has {width} x {height} px and the camera's {size[0]} x {size[1]} px{advice}"
        )
    if max(size) > LONGEST_SIDE_PX:
        raise InvalidParameter(
            f"a picture of {width} x {height} px is too large; valid are {LONGEST_SIDE_PX} px a side"
        )


def sample(
    image: Image,
    columns: NDArray[np.float32],
    rows: NDArray[np.float32],
    valid: Mask,
    interpolation: Interpolation,
    transparent: bool,
) -> Image:
    """The picture's values at (columns, rows), each (h, w); 0 where not valid.

    The outermost pixels reach half a pixel beyond their centres, with their own value; nothing is
    repeated farther out. ``transparent`` adds an alpha channel to a picture that has none.
    """
    height, width = valid.shape
    channels = image.shape[2:]
    if transparent and channels != (4,):
        bgr = image if channels == (3,) else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        image = cv2.cvtColor(bgr, cv2.COLOR_BGR2BGRA)
        channels = (4,)
    if height <= LONGEST_SIDE_PX and width <= LONGEST_SIDE_PX:
        return _sample_tile(image, columns, rows, valid, interpolation).reshape(height, width, *channels)
    out = np.empty((height, width, *channels), image.dtype)
    for top in range(0, height, LONGEST_SIDE_PX):
        for left in range(0, width, LONGEST_SIDE_PX):
            tile = slice(top, top + LONGEST_SIDE_PX), slice(left, left + LONGEST_SIDE_PX)
            taken = _sample_tile(image, columns[tile], rows[tile], valid[tile], interpolation)
            out[tile] = taken.reshape(out[tile].shape)
    return out


def _sample_tile(
    image: Image,
    columns: NDArray[np.float32],
    rows: NDArray[np.float32],
    valid: Mask,
    interpolation: Interpolation,
) -> Image:
    """:func:`sample` of an output small enough for OpenCV; a last axis of length 1 is lost."""
    taken = cv2.remap(image, columns, rows, INTERPOLATIONS[interpolation], borderMode=cv2.BORDER_REPLICATE)
    return taken if valid.all() else cv2.copyTo(taken, valid.astype(np.uint8))
