"""Pixel map: one source coordinate for each pixel of the view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.native import PackedMap, backend
from ...base.numerics.lazy import cached_property
from ..contracts import Annulus, Averages, Interpolation, Kernel, Map, Pixels, RemapJob
from ..sampling.checks import adjoining, check_pixels
from ..sampling.footprints import CELL_PX, RULES, Footprints, squared_sides_of_pixels
from .halving import Offset, half, halved_pixels


class Rectangle(NamedTuple):
    """Rectangle of a view in a mosaic, px."""

    left: int
    top: int
    width: int
    height: int


class PixelMap:
    """Map with coordinates of all pixels; see :class:`~omnimirror.dewarp.contracts.Map`.

    The compiled samplers use unpacked coordinates for the first image, because a moving view has no
    second one; then they pack them to 6 bytes per pixel (8 for 16-bit and float images), which is
    about twice as fast.

    Parameters
    ----------
    pixels : (rows, columns, 2), float32 or float64, px
        Coordinates (u, v), integers at pixel centres; NaN outside. The array is kept and must not
        be modified.
    source_size : (width, height)
        Size of the source images.
    annulus
        Image region inside the field, for averages at the field boundary.
    views
        Rectangles of the views of a mosaic; no interpolation between views.
    averages
        Number of samples per value; derived from the coordinates by default.

    Raises
    ------
    InvalidParameter
        If the coordinates have another shape or type.
    """

    def __init__(
        self,
        pixels: Pixels,
        source_size: tuple[int, int],
        annulus: Annulus | None = None,
        views: Sequence[Rectangle] = (),
        averages: Callable[[Interpolation], Averages | None] | None = None,
    ):
        check_pixels(pixels)
        self._pixels: Pixels = adjoining(pixels)
        self.source_size = source_size
        self._annulus = annulus
        self._views = tuple(views)
        self._averages = averages
        self._packed: dict[tuple[Kernel, int, bool], PackedMap] = {}
        self._is_used = False

    @classmethod
    def of(cls, other: Map, annulus: Annulus | None = None) -> PixelMap:
        """Return the pixel map of another map, faster from the third image on."""
        pixels = other.pixels().astype(np.float32, copy=False)
        return cls(pixels, other.source_size, annulus, averages=other.averages)

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) of the view."""
        return self._pixels.shape[1], self._pixels.shape[0]

    def pixels(self) -> Pixels:
        """Return source coordinates (height, width, 2)."""
        return self._pixels

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if it does not average."""
        if interpolation not in RULES:
            return None
        return self._averages(interpolation) if self._averages else self._footprints.averages(interpolation)

    @cached_property
    def _footprints(self) -> Footprints:
        return Footprints(squared_sides_of_pixels(self._pixels), CELL_PX, self._annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """Sample with unpacked or packed coordinates."""
        # If all values are averages, a packed map of single samples is not used.
        can_pack = job.averages is None or not job.averages.are_everywhere
        if not (self._is_used and can_pack):
            self._is_used = True
            backend.kernels.remap(job.source, self._pixels, job.target, *job.how)
            return
        packed = self._packed_for(job.kernel, job.source.shape[2], job.source.dtype != np.uint8)
        if job.averages is None:
            packed.sample(job.source, job.target, job.border)
        else:
            packed.sample(job.source, job.target, job.border, self._pixels, job.averages.compiled)

    def _packed_for(self, kernel: Kernel, channels: int, is_deep: bool) -> PackedMap:
        kind = kernel, channels, is_deep
        if kind not in self._packed:
            number = ("nearest", "linear", "cubic").index(kernel)
            self._packed[kind] = backend.kernels.PackedMap(self._pixels, *self.source_size, channels, is_deep, number)
        return self._packed[kind]

    def halved(self, in_picture: Offset, in_view: Offset) -> PixelMap:
        """Return the half-resolution map; see :meth:`~omnimirror.dewarp.contracts.Map.halved`."""
        pixels = halved_pixels(self._pixels, in_picture, in_view, self.source_size, self._labels())
        annulus = self._annulus and self._annulus.halved(in_picture)
        return PixelMap(pixels.astype(np.float32, copy=False), half(self.source_size), annulus)

    def _labels(self) -> NDArray[np.int32] | None:
        """Return the view index (h, w) of each pixel of a mosaic, 0 for none; None for a single
        view.
        """
        if not self._views:
            return None
        labels: NDArray[Any] = np.zeros(self._pixels.shape[:2], np.int32)
        for number, (left, top, width, height) in enumerate(self._views, start=1):
            labels[top : top + height, left : left + width] = number
        return labels
