"""What the rooms of this floor tell each other: pictures, where to look in them, how to sample there.

A screen says what each pixel of a view looks at (:mod:`~omnimirror.dewarp.screens`), a camera where in its picture
that is. The answer is a :class:`Map`; a :class:`Sampler` takes the picture's values there. A map says itself how it is
sampled: nobody asks what kind it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.native import backend
from ..base.numerics.lazy import cached_property

Image: TypeAlias = NDArray[Any]
"""(h, w) or (h, w, c), c from 1 to 4, of uint8, uint16 or float32, with any strides. Colours are RGB or RGBA."""
Pixels: TypeAlias = NDArray[np.float32] | NDArray[np.float64]
"""(rows, columns, 2): places (u, v) in a picture, px, whole numbers at pixel centres; NaN is outside."""
Border: TypeAlias = float | Sequence[float]
"""The value outside the picture: of all channels, or of each."""
Interpolation: TypeAlias = Literal["auto", "nearest", "linear", "cubic", "area"]
Kernel: TypeAlias = Literal["nearest", "linear", "cubic"]

INTERPOLATIONS: tuple[Interpolation, ...] = ("auto", "nearest", "linear", "cubic", "area")
KERNELS: dict[Interpolation, Kernel] = {
    "auto": "cubic", "nearest": "nearest", "linear": "linear", "cubic": "cubic", "area": "cubic",
}  # fmt: skip
"""The interpolation kernel of the single samples that each is made of."""


class Annulus(NamedTuple):
    """What is seen of a picture lies between two distances from a point of it, px."""

    u: float
    v: float
    inner: float
    outer: float

    def halved(self, offset: tuple[float, float]) -> Annulus:
        """The same in planes of half the size; see :meth:`Map.halved`."""
        return Annulus((self.u - offset[0]) / 2, (self.v - offset[1]) / 2, self.inner / 2, self.outer / 2)


@dataclass(frozen=True, eq=False)
class Averages:
    """How many samples the pixels of each cell of a view are made of; see :mod:`.sampling.footprints`."""

    taps: NDArray[np.uint8]
    """(cell rows, cell columns, 2): across and down, 1 to 128."""
    step: int
    """Side of a cell, output px."""
    sharp_px: float
    """A side of s px is shortened by the factor 1 - (sharp / s)^8, and to nothing up to sharp."""
    annulus: Annulus | None = None
    """Samples outside it do not count. Where it is None, a pixel at the end of the field is not averaged towards
    it: half a pixel farther there may be nothing."""

    @cached_property
    def are_everywhere(self) -> bool:
        """Whether no pixel is a single sample."""
        return not (self.taps == 1).all(axis=-1).any()

    @cached_property
    def compiled(self) -> object:
        """The same as the compiled kernels take it."""
        return backend.kernels.Averages(self.taps, self.step, self.sharp_px, self.annulus)


@dataclass(frozen=True, eq=False)
class RemapJob:
    """One picture in, one out, as samplers need them: checked, channels on an axis, pixels that adjoin."""

    source: Image
    """(h, w, c)."""
    target: Image
    """(rows, columns, c) of the same depth, to be filled."""
    kernel: Kernel
    border: tuple[float, ...]
    """One value for each channel."""
    averages: Averages | None
    """What is averaged; None where each pixel is one sample."""

    @property
    def how(self) -> tuple[int, tuple[float, ...], object]:
        """The last arguments of the compiled samplers."""
        averages = None if self.averages is None else self.averages.compiled
        return ("nearest", "linear", "cubic").index(self.kernel), self.border, averages


class Map(Protocol):
    """Where each pixel of a view lies in the pictures of one camera."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the view, px."""
        ...

    @property
    def source_size(self) -> tuple[int, int]:
        """(width, height) of the pictures, px."""
        ...

    def pixels(self) -> Pixels:
        """All places (height, width, 2)."""
        ...

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """What an interpolation averages; None where that is nothing."""
        ...

    def sample_compiled(self, job: RemapJob) -> None:
        """Fill the job's target by the kernel made for such maps; only where kernels are compiled."""
        ...

    def halved(self, in_picture: tuple[float, float], in_view: tuple[float, float]) -> Map:
        """The map from a view of half the size to a picture of half the size, halves rounded up.

        Their samples lie right of and below the first of each 2 x 2 pixels, by offsets (x, y) from 0 to 1 px: those
        of the picture ``in_picture``, those of the view ``in_view``. At the end of the field a sample counts if at
        least two of its four pixels do.
        """
        ...


class Sampler(Protocol):
    """Takes a picture's values where a map says: compiled, or by OpenCV; to the same rule, see :mod:`.sampling`."""

    @property
    def longest_side_px(self) -> int:
        """Of the largest picture that it takes."""
        ...

    def sample(self, job: RemapJob, where: Map) -> None:
        """Fill the job's target."""
        ...
