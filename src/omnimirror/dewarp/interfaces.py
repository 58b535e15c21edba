"""Interfaces shared by the modules for dewarping: images, source coordinates and sampling.

A screen defines the target of each output pixel (:mod:`~omnimirror.dewarp.screens`) and a camera
projects the target to source coordinates. The result is a :class:`Map`, and a :class:`Sampler`
interpolates the image at its coordinates. Each map implements its own sampling; callers do not
depend on its type.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
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
