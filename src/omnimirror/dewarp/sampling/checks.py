"""Validation of sampling arguments, and conversion of arrays for the samplers."""

from __future__ import annotations

import numpy as np

from ...base.arguments import instance
from ...base.errors import InvalidParameter
from ...io.pictures.images import FULL
from ..contracts import INTERPOLATIONS, Image, Pixels

DEPTHS = frozenset(np.dtype(name) for name in FULL) | {np.dtype(name).newbyteorder() for name in FULL}
MOST_VALUES = 0x7FFF0000  # the compiled samplers index values with 31 bits


def check_picture(image: Image, size: tuple[int, int]) -> None:
    """Raise an error unless an array is an image of the given (width, height)."""
    check_kind(image)
    if image.shape[2:] == (2,):
        raise InvalidParameter(f"an array of shape {image.shape} is not a picture of 1, 3 or 4 channels")
    height, width = image.shape[:2]
    if (width, height) != tuple(size):
        same_shape = abs(width * size[1] - height * size[0]) <= max(width, height, *size) / 2
        advice = "; both have the same shape: scale the picture to that size first" if same_shape else ""
        raise InvalidParameter(
            f"the picture has {width} x {height} px and the camera's {size[0]} x {size[1]} px{advice}"
        )


def check_kind(image: Image) -> None:
    """Raise an error for arrays of an unsupported shape or data type."""
    instance("a picture", image, np.ndarray, "an array of pixels")
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or channels not in (1, 2, 3, 4) or image.size == 0:
        raise InvalidParameter(f"an array of shape {image.shape} is not a picture of 1 to 4 channels")
    if image.dtype not in DEPTHS:
        raise InvalidParameter(f"the picture holds {image.dtype.name} values; valid are {', '.join(FULL)}")


def check_largest(image: Image, longest_side_px: int) -> None:
    """Raise an error if an image has too many pixels for a sampler."""
    height, width = image.shape[:2]
    if max(width, height) > longest_side_px:
        raise InvalidParameter(
            f"a picture of {width} x {height} px is too large; valid are {longest_side_px} px a side, "
            "and more with the compiled samplers"
        )
    if image.size > MOST_VALUES:
        raise InvalidParameter(f"a picture of {width} x {height} px is too large; valid are {MOST_VALUES} values")


def check_interpolation(interpolation: str) -> None:
    """Raise an error for an unknown interpolation."""
    if interpolation not in INTERPOLATIONS:
        raise InvalidParameter(f"interpolation = {interpolation!r} is not one of {', '.join(INTERPOLATIONS)}")


def check_pixels(pixels: Pixels) -> None:
    """Raise an error unless an array is a pixel map."""
    if pixels.ndim != 3 or pixels.shape[2] != 2 or pixels.dtype not in (np.float32, np.float64):
        raise InvalidParameter(
            f"coordinates are (rows, columns, 2) of float32 or float64, not {pixels.shape} of {pixels.dtype}"
        )


def checked_out(out: Image | None, image: Image, size: tuple[int, int]) -> Image:
    """Return the output array, or a new one if None, of a (width, height) and otherwise like the
    image.
    """
    shape, kind = (size[1], size[0], *image.shape[2:]), image.dtype.newbyteorder("=")
    if out is None:
        return np.empty(shape, kind)
    if out.shape != shape or out.dtype != kind:
        raise InvalidParameter(f"out is {out.shape} of {out.dtype.name}, not {shape} of {image.dtype.name}")
    if not out.flags.writeable:
        raise InvalidParameter("out cannot be written")
    return out


# -- array layout for the samplers -----------------------------------------------------------------


def adjoining(array: Image) -> Image:
    """Return the array (rows, columns, c), or an aligned copy in native byte order if samplers
    require it.
    """
    return array if adjoins(array) else np.array(array, array.dtype.newbyteorder("="), order="C")


def adjoins(array: Image) -> bool:
    """Return True if channels and pixels are contiguous, and rows are ascending without overlap."""
    flags = array.flags
    if not (flags.aligned and array.dtype.isnative):
        return False
    if flags.c_contiguous:
        return True
    _, width, channels = array.shape
    down, across, deep = array.strides
    item = array.itemsize
    return bool(
        (channels == 1 or deep == item)
        and (width == 1 or across == channels * item)
        and (array.shape[0] == 1 or (down >= width * channels * item and down % item == 0))
        and (down % item, across % item, deep % item) == (0, 0, 0)
    )
