"""Interfaces shared by the modules for dewarping: images, array types, source coordinates, sampling.

A screen defines the target of each output pixel (:mod:`~omnimirror.dewarp.screens`) and a camera
projects the target to source coordinates. The result is a :class:`Map`, and a :class:`Sampler`
interpolates the image at its coordinates. Each map implements its own sampling; callers do not
depend on its type.

The samplers support uint8, uint16 and float32. The weights of an interpolation sum to 1; therefore
an offset or a scale of the values commutes with it, and int16 and bool are sampled exactly as
uint16 and uint8 values of the same order.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import InvalidType, format_value, instance
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..base.native import backend

Image: TypeAlias = NDArray[Any]
"""Array (h, w) or (h, w, c), c from 1 to 4, with any strides; samplers support uint8, uint16 and
float32. Colours are RGB or RGBA.
"""
Pixels: TypeAlias = NDArray[np.float32] | NDArray[np.float64]
"""Source coordinates (rows, columns, 2) as (u, v), px, with integers at pixel centres; NaN outside.
"""
Border: TypeAlias = float | Sequence[float]
"""Value outside the image, for all channels or for each channel."""
Interpolation: TypeAlias = Literal["auto", "nearest", "linear", "cubic", "area"]
Kernel: TypeAlias = Literal["nearest", "linear", "cubic"]

INTERPOLATIONS: tuple[Interpolation, ...] = ("auto", "nearest", "linear", "cubic", "area")
KERNELS: dict[Interpolation, Kernel] = {
    "auto": "cubic",
    "nearest": "nearest",
    "linear": "linear",
    "cubic": "cubic",
    "area": "cubic",
}
"""Kernel of the individual samples for each interpolation."""


class Annulus(NamedTuple):
    """Annulus of the image that contains the field, px."""

    u: float
    v: float
    inner: float
    outer: float

    def halved(self, offset: tuple[float, float]) -> Annulus:
        """Return the annulus in half-resolution planes; see :meth:`Map.halved`."""
        return Annulus(
            (self.u - offset[0]) / 2, (self.v - offset[1]) / 2, self.inner / 2, self.outer / 2
        )


@dataclass(frozen=True, eq=False)
class Averages:
    """Number of samples per pixel in each cell of a view; see :class:`.sampling.Footprints`."""

    taps: NDArray[np.uint8]
    """Samples (cell rows, cell columns, 2), across and down, 1 to 128."""
    step: int
    """Side of a cell, output px."""
    sharp_px: float
    """Sharpness parameter: a side of s px is shortened by the factor 1 - (sharp / s)^8, and to 0
    for s <= sharp.
    """
    annulus: Annulus | None = None
    """Annulus outside which samples are ignored. If None, pixels at the field boundary are not
    averaged across it, because the field may end within half a pixel.
    """

    @cached_property
    def are_everywhere(self) -> bool:
        """True if no pixel is a single sample."""
        return not (self.taps == 1).all(axis=-1).any()

    @cached_property
    def compiled(self) -> object:
        """Arguments for the compiled kernels."""
        return backend.kernels.Averages(self.taps, self.step, self.sharp_px, self.annulus)


@dataclass(frozen=True, eq=False)
class RemapJob:
    """Arguments of a sampler: validated input and output with a channel axis and contiguous pixels."""

    source: Image
    """Input image (h, w, c)."""
    target: Image
    """Output image (rows, columns, c) of the same data type."""
    kernel: Kernel
    border: tuple[float, ...]
    """One value per channel."""
    averages: Averages | None
    """Averaging parameters; None if each pixel is a single sample."""

    @property
    def arguments(self) -> tuple[int, tuple[float, ...], object]:
        """Trailing arguments of the compiled samplers."""
        averages = None if self.averages is None else self.averages.compiled
        return ("nearest", "linear", "cubic").index(self.kernel), self.border, averages


class Map(Protocol):
    """Map from the pixels of a view to the source coordinates of one camera."""

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) of the view, px."""
        ...

    @property
    def source_size(self) -> tuple[int, int]:
        """Size (width, height) of the source images, px."""
        ...

    def pixels(self) -> Pixels:
        """Return source coordinates (height, width, 2)."""
        ...

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if it does not average."""
        ...

    def sample_compiled(self, job: RemapJob) -> None:
        """Fill the output of the job with the compiled kernel of this map type."""
        ...

    def halved(self, image_offset: tuple[float, float], view_offset: tuple[float, float]) -> Map:
        """Return the map from a half-resolution view to a half-resolution image, sizes rounded up.

        Samples are offset from the first pixel of each 2 x 2 block by (x, y) from 0 to 1 px:
        ``image_offset`` in the image, ``view_offset`` in the view. At the field boundary a sample is
        valid if at least two of its four pixels are.
        """
        ...


class Sampler(Protocol):
    """Interface of the samplers, compiled or OpenCV, with a common definition; see
    :mod:`.sampling`.
    """

    @property
    def longest_side_px(self) -> int:
        """Maximum side of an image, px."""
        ...

    def sample(self, job: RemapJob, where: Map) -> None:
        """Fill the output of the job."""
        ...


# -- Data types ------------------------------------------------------------------------------------

INT16_OFFSET = 1 << 15
"""Offset between int16 and uint16 values of the same order."""
TRUE_VALUE = 255
"""uint8 value of True; 0 is False."""


class DtypeConversion(NamedTuple):
    """Conversion of a data type to one of the samplers and back."""

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
