"""DtypeConversion between arrays of other libraries and other data types and those of the samplers.

The samplers support uint8, uint16 and float32. The weights of an interpolation sum to 1; therefore
an offset or a scale of the values commutes with it, and int16 and bool are sampled exactly as
uint16 and uint8 values of the same order.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..base.arguments import InvalidType, format_value, instance
from ..base.errors import InvalidParameter
from .interfaces import Image

# -- Data types ------------------------------------------------------------------------------------

INT16_OFFSET = 1 << 15
"""Offset between int16 and uint16 values of the same order."""
TRUE_VALUE = 255
"""uint8 value of True; 0 is False."""


class DtypeConversion(NamedTuple):
    """DtypeConversion of a data type to one of the samplers and back."""

    encode: Callable[[Image], Image]
    decode: Callable[[Image], Image]
    scale: float = 1
    """Border values are multiplied by the scale; then the offset is added."""
    offset: float = 0


def _encode_int16(image: Image) -> Image:
    return image.astype(np.int16).view(np.uint16) ^ np.uint16(INT16_OFFSET)


def _decode_int16(image: Image) -> Image:
    return (image ^ np.uint16(INT16_OFFSET)).view(np.int16)


def _encode_bool(image: Image) -> Image:
    return image.view(np.uint8) * np.uint8(TRUE_VALUE)


def _decode_bool(image: Image) -> Image:
    return image > TRUE_VALUE // 2


def _encode_float64(image: Image) -> Image:
    with np.errstate(over="ignore"):
        rounded = image.astype(np.float32)
    is_infinite = np.isinf(rounded)
    if is_infinite.any() and np.isfinite(image[is_infinite]).any():
        limit = np.finfo(np.float32).max
        magnitude = np.abs(image[np.isfinite(image)]).max()
        raise InvalidParameter(
            f"values of the image must be at most {limit:.3g} or infinite; got {magnitude:.3g}"
        )
    return rounded


def _decode_float64(image: Image) -> Image:
    return image.astype(np.float64)


CONVERSIONS = {
    "int16": DtypeConversion(_encode_int16, _decode_int16, 1, INT16_OFFSET),
    "float64": DtypeConversion(_encode_float64, _decode_float64),
    "bool": DtypeConversion(_encode_bool, _decode_bool, TRUE_VALUE),
}
"""Conversions by name of the data type, for types that the samplers do not support."""

# -- Arrays and tensors of other libraries, and stacks of images -----------------------------------

CPU_DEVICES = (1, 3)
"""DLPack device types whose memory the CPU reads: kDLCPU and kDLCUDAHost (pinned)."""


class SupportsDLPack(Protocol):
    """Array or tensor that other libraries read through the DLPack protocol."""

    def __dlpack__(self, *arguments: Any, **keywords: Any) -> Any: ...

    def __dlpack_device__(self) -> tuple[Any, Any]: ...


class SupportsArray(Protocol):
    """Object that NumPy converts to an array."""

    def __array__(self, *arguments: Any, **keywords: Any) -> Any: ...


TensorT = TypeVar("TensorT", bound=SupportsDLPack)


def as_array(image: object) -> tuple[Image, Callable[[Image], Any]]:
    """Return an image as a NumPy array, and the function that converts results to its library.

    Tensors are read without a copy. Results stay NumPy arrays if the library of the image does not
    read DLPack.

    Raises
    ------
    InvalidParameter
        If the object is no array, or not in the memory of the CPU.

    Examples
    --------
    >>> array, convert = as_array(np.zeros((2, 3), np.uint8))
    >>> array.shape, convert(array) is array
    ((2, 3), True)
    """
    if isinstance(image, np.ndarray):
        return image, _unchanged
    if hasattr(image, "__dlpack__") and hasattr(image, "__dlpack_device__"):
        return _from_dlpack(image), _reader_of(image)
    if hasattr(image, "__array__") or hasattr(image, "__array_interface__"):
        return np.asarray(image), _unchanged
    raise InvalidType(f"the image must be an array of pixels; got {format_value(image)}")


def _unchanged(image: Image) -> Image:
    return image


def _from_dlpack(image: Any) -> Image:
    name = type(image).__name__
    try:
        device = int(image.__dlpack_device__()[0])
        if device in CPU_DEVICES:
            array: Image = np.from_dlpack(image)
            return array
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        reason = str(error).partition("\n")[0].rstrip(".")
        raise InvalidParameter(
            f"the image must be an array that DLPack can export; got a {name}: {reason}"
        ) from None
    raise InvalidParameter(
        f"the image must be in the memory of the CPU; got a {name} on a device of DLPack type "
        f"{device}: copy it to the CPU, or use om.torch for PyTorch tensors"
    )


def _reader_of(image: Any) -> Callable[[Image], Any]:
    """Return the DLPack reader of the library of a tensor."""
    if hasattr(image, "__array_namespace__"):
        library = image.__array_namespace__()
    else:
        library = sys.modules.get(type(image).__module__.partition(".")[0])
    return getattr(library, "from_dlpack", _unchanged)


def apply_to_images(
    image: object, out: Image | None, function: Callable[[Image, Image | None], Image]
) -> Any:
    """Apply a function of an image and its output array to an image or to a stack (n, h, w, c).

    Returns
    -------
    object
        The filled ``out`` if given, otherwise an array or tensor of the library of the image.
    """
    array, convert = as_array(image)
    if out is not None:
        instance("out", out, np.ndarray, "an array of pixels")
        convert = _unchanged
    if array.ndim != 4:
        return convert(function(array, out))
    if not len(array):
        raise InvalidParameter(
            f"the image must contain at least one image; got an array of shape {array.shape}"
        )
    if out is not None and (out.ndim != 4 or len(out) != len(array)):
        raise InvalidParameter(
            f"out must be a stack of {len(array)} images (n, h, w, c); got shape {out.shape}"
        )
    first = function(array[0], None if out is None else out[0])
    results = out
    if results is None:
        results = np.empty((len(array), *first.shape), first.dtype)
        results[0] = first
    for index in range(1, len(array)):
        function(array[index], results[index])
    return convert(results)
