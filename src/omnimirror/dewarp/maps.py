"""Maps from the pixels of a view to source coordinates: pixel map, lattice map and polar map.

A pixel map has one coordinate for each pixel, a lattice map has coordinates on a regular lattice
with bicubic interpolation, and a polar map has the radii and azimuths of a panorama about the
camera axis. Each of them also provides the map of half-resolution planes (4:2:0 chroma).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
from ..base.native import PackedMap, backend
from ..base.typing import Array
from ..cameras.camera import inside_image
from .interfaces import Annulus, Averages, Interpolation, Kernel, Map, Pixels, RemapJob
from .sampling import (
    CELL_PX,
    RULES,
    Footprints,
    check_pixels,
    contiguous,
    squared_sides_of_circles,
    squared_sides_of_lattice,
    squared_sides_of_pixels,
)

# -- Half-resolution planes (4:2:0 chroma) ---------------------------------------------------------
#
# Such a plane has one sample per 2 x 2 pixels. Its column i is at column ``2 i + x`` and its row j at
# row ``2 j + y`` of the full image, with the sample offset (x, y). The source coordinate of a sample
# is therefore ``(source coordinate at the view position - image offset) / 2``. The map is
# interpolated between its pixels, without further projections.

Floats = NDArray[Any]
Offset = tuple[float, float]

MIN_VALID_PIXELS = 2  # minimum number of the 4 pixels inside the field for a valid sample


def half(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size of a half-resolution plane.

    >>> half((63, 48))
    (32, 24)
    """
    return (size[0] + 1) // 2, (size[1] + 1) // 2


def halved_pixels(
    pixels: Floats,
    image_offset: Offset,
    view_offset: Offset,
    source_size: tuple[int, int],
    labels: NDArray[np.int32] | None = None,
) -> Floats:
    """Return coordinates (..., ceil h/2, ceil w/2, 2) in half-resolution planes from full
    coordinates (..., h, w, 2).

    Interpolation between pixels is linear, with an error of 1/8 of the second difference of the
    map. At the field boundary a sample is valid if at least two of its four pixels are.

    Parameters
    ----------
    image_offset, view_offset
        Sample offsets (x, y), px; see :meth:`~omnimirror.dewarp.interfaces.Map.halved`.
    source_size
        Size (width, height) of the full image.
    labels : (h, w), optional
        Region labels; no interpolation between pixels of different labels.

    Examples
    --------
    >>> u, v = np.meshgrid(np.arange(4.0), np.arange(2.0))
    >>> halved_pixels(np.stack([u, v], axis=-1), (0.0, 0.5), (0.0, 0.5), (4, 2))  # the same picture
    array([[[0., 0.],
            [1., 0.]]])
    """
    x, y = view_offset
    blocks = _blocks(np.where(inside_image(pixels, source_size)[..., None], pixels, np.nan))
    rows = (1 - y) * blocks[..., 0, :, :] + y * blocks[..., 1, :, :]
    at = (1 - x) * rows[..., 0, :] + x * rows[..., 1, :]
    cut = np.isnan(at[..., 0]) & (
        (~np.isnan(blocks[..., 0])).sum(axis=(-2, -1)) >= MIN_VALID_PIXELS
    )
    at[cut] = np.nanmean(blocks[cut], axis=(1, 2))
    if labels is not None:
        block_labels = _blocks(labels[..., None])[..., 0]
        mixed = (block_labels != block_labels[..., :1, :1]).any(axis=(-2, -1))
        at[mixed] = blocks[mixed][:, 0, 0]
    # A point on the outermost half pixel of the full image may be outside the half-resolution
    # plane.
    halved: Floats = np.clip(
        (at - np.array(image_offset)) / 2, -0.5, np.array(half(source_size)) - 0.5
    )
    return halved.astype(pixels.dtype, copy=False)


def _blocks(values: Floats) -> Floats:
    """Return blocks of 2 x 2 values (..., h/2, w/2, 2, 2, n) of (..., h, w, n); odd sides are
    extrapolated linearly.
    """
    for axis in (-3, -2):
        count = values.shape[axis]
        if count % 2:
            last = np.take(values, [-1], axis)
            before = np.take(values, [count - 2], axis)  # the last itself if there is one only
            values = np.concatenate([values, 2 * last - before], axis)
    *more, height, width, n = values.shape
    return np.swapaxes(values.reshape(*more, height // 2, 2, width // 2, 2, n), -4, -3)


def pairs(values: Floats) -> Floats:
    """Return pairs (n/2, 2) of values (n,); an odd number is extrapolated linearly."""
    if len(values) % 2:
        values = np.append(values, 2 * values[-1] - values[len(values) - 2])
    return values.reshape(-1, 2)


# -- Pixel map: one source coordinate per pixel ----------------------------------------------------


class Rectangle(NamedTuple):
    """Rectangle of a view in a mosaic, px."""

    left: int
    top: int
    width: int
    height: int


class PixelMap:
    """Map with coordinates of all pixels; see :class:`~omnimirror.dewarp.interfaces.Map`.

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
        self._pixels: Pixels = contiguous(pixels)
        self.source_size = source_size
        self._annulus = annulus
        self._views = tuple(views)
        self._averages = averages
        self._packed: dict[tuple[Kernel, int, bool], PackedMap] = {}
        self._was_sampled = False

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
        return (
            self._averages(interpolation)
            if self._averages
            else self._footprints.averages(interpolation)
        )

    @cached_property
    def _footprints(self) -> Footprints:
        return Footprints(squared_sides_of_pixels(self._pixels), CELL_PX, self._annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """Sample with unpacked or packed coordinates."""
        # If all values are averages, a packed map of single samples is not used.
        can_pack = job.averages is None or not job.averages.are_everywhere
        if not (self._was_sampled and can_pack):
            self._was_sampled = True
            backend.kernels.remap(job.source, self._pixels, job.target, *job.arguments)
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
            self._packed[kind] = backend.kernels.PackedMap(
                self._pixels, *self.source_size, channels, is_deep, number
            )
        return self._packed[kind]

    def halved(self, image_offset: Offset, view_offset: Offset) -> PixelMap:
        """Return the half-resolution map; see :meth:`~omnimirror.dewarp.interfaces.Map.halved`."""
        pixels = halved_pixels(
            self._pixels, image_offset, view_offset, self.source_size, self._labels()
        )
        annulus = self._annulus and self._annulus.halved(image_offset)
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


# -- Lattice map: bicubic interpolation between lattice nodes --------------------------------------

MIN_STEP = 4


@dataclass(frozen=True, eq=False)
class LatticeMap:
    """Map with nodes at every ``step``-th output pixel and cubic Lagrange interpolation between
    them.

    With a node spacing of 16 pixels, the error in a perspective view is some 0.001 px. See
    :class:`~omnimirror.dewarp.interfaces.Map`.
    """

    nodes: NDArray[np.float32]
    """Coordinates u and v (2, rows, columns) at output pixels (-step, -step), (0, -step), ... up to
    one node beyond the cell of the last pixel.
    """
    size: tuple[int, int]
    """Size (width, height) of the view."""
    source_size: tuple[int, int]
    """Size (width, height) of the source images."""
    step: int
    """Node spacing: 4, 8, 16, 32 or 64."""
    cells: NDArray[np.int32]
    """Index (cell rows, cell columns) of the patch of a cell; -1 for interpolated cells."""
    patches: NDArray[np.float32]
    """Coordinates (n, step, step, 2) of cells that are not interpolated."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Offset of the output pixels from the node lattice, right and down, below 1 px."""
    annulus: Annulus | None = None
    """Image region inside the field, for averages at the field boundary."""

    def pixels(self) -> NDArray[np.float32]:
        """Return coordinates (height, width, 2); NaN outside."""
        return self._pixels

    @cached_property
    def _pixels(self) -> NDArray[np.float32]:
        down, across = self.cells.shape
        outside = np.isnan(self.nodes).any(axis=0)
        # NaN would spread over its whole row and column
        nodes = np.where(outside, np.float32(0), self.nodes)
        (right, below), step = self._weights, self.step
        lines = sum(nodes[:, :, i : i + across, None] * w for i, w in enumerate(right)).reshape(
            2, -1, 1, across * step
        )
        full = sum(lines[:, i : i + down] * w[:, None] for i, w in enumerate(below))
        tiles = full.reshape(2, down, step, across, step).transpose(1, 3, 2, 4, 0)
        tiles[np.lib.stride_tricks.sliding_window_view(outside, (4, 4)).any(axis=(2, 3))] = np.nan
        exact = self.cells >= 0
        tiles[exact] = self.patches[self.cells[exact]]
        width, height = self.size
        view = tiles.transpose(0, 2, 1, 3, 4).reshape(down * self.step, across * self.step, 2)[
            :height, :width
        ]
        pixels: NDArray[np.float32] = view
        return pixels

    def has_valid_pixels(self) -> bool:
        """Return True if part of the view is inside the field."""
        return not ((self.cells >= 0).all() and np.isnan(self.patches).all())

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if it does not average."""
        return self._footprints.averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _footprints(self) -> Footprints:
        squares = squared_sides_of_lattice(self.nodes, self.step, self.cells, self.patches)
        return Footprints(squares, self.step, self.annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """Sample with the lattice kernel."""
        u, v = self.nodes
        lattice = u, v, *self._weights, self.cells, self.patches
        backend.kernels.remap_lattice(job.source, *lattice, job.target, *job.arguments)

    @cached_property
    def _weights(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Node weights, across and down."""
        return node_weights(self.step, self.shift[0]), node_weights(self.step, self.shift[1])

    # -- Half resolution ---------------------------------------------------------------------------

    def halved(self, image_offset: Offset, view_offset: Offset) -> Map:
        """Return the same lattice at half the step, evaluated between its pixels; patched at the
        image boundary.
        """
        if self.step == MIN_STEP:
            return PixelMap.of(self, self.annulus).halved(image_offset, view_offset)
        nodes = (self.nodes - np.array(image_offset)[:, None, None]) / 2
        cells, patches = self._patched_at_border()
        return LatticeMap(
            nodes.astype(np.float32),
            half(self.size),
            half(self.source_size),
            self.step // 2,
            cells,
            halved_pixels(patches, image_offset, view_offset, self.source_size),
            ((self.shift[0] + view_offset[0]) / 2, (self.shift[1] + view_offset[1]) / 2),
            self.annulus and self.annulus.halved(image_offset),
        )

    def _patched_at_border(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return cells and patches, with additional patches for nodes outside the image."""
        (u, v), (width, height) = self.nodes, self.source_size
        outside = (u < -0.5) | (u > width - 0.5) | (v < -0.5) | (v > height - 0.5)
        ends = np.lib.stride_tricks.sliding_window_view(outside, (4, 4)).any(axis=(2, 3)) & (
            self.cells < 0
        )
        windows = np.lib.stride_tricks.sliding_window_view(self.nodes, (4, 4), axis=(1, 2))[:, ends]
        across, down = self._weights
        tiles = np.einsum("cnij,ik,jl->nklc", windows, down, across)
        cells = self.cells.copy()
        cells[ends] = len(self.patches) + np.arange(len(tiles))
        return cells, np.concatenate([self.patches, tiles]).astype(np.float32)


@lru_cache(maxsize=64)
def node_weights(step: int, shift: float = 0.0) -> NDArray[np.float32]:
    """Return cubic Lagrange weights (4, step) of the nodes at -1, 0, 1 and 2, every 1/step from
    shift/step.
    """
    t = (np.arange(step) + shift) / step
    outer = t * (t - 1) / 6
    inner = (t + 1) * (t - 2) / 2
    weights = np.stack([-outer * (t - 2), inner * (t - 1), -inner * t, outer * (t + 1)])
    result = weights.astype(np.float32)
    result.flags.writeable = False
    return result


# -- Polar map: panoramas about the camera axis ----------------------------------------------------

Float32Array = NDArray[np.float32]

CHECKED_COLUMN_STEP = 16  # column spacing of the visibility check


@dataclass(frozen=True, eq=False)
class PolarMap:
    """Map with coordinates ``centre + radii[row] (cos, sin)(angles[column])``; see
    :class:`~omnimirror.dewarp.interfaces.Map`.
    """

    centre: tuple[float, float]
    """Centre (u, v), px."""
    radii: Array
    """Radii (rows,), px; NaN outside the field."""
    angles: Array
    """Angles (columns,), radians from right towards down in the image, continuous between columns.
    """
    source_size: tuple[int, int]
    """Size (width, height) of the source images."""
    annulus: Annulus | None = None
    """Image region inside the field, for averages at the field boundary."""

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) of the view."""
        return len(self.angles), len(self.radii)

    def pixels(self) -> Array:
        """Return coordinates (rows, columns, 2); NaN outside the image."""
        return self._pixels

    @cached_property
    def _pixels(self) -> Array:
        return self._of_columns(self.angles)

    def _of_columns(self, angles: Array) -> Array:
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        pixels: Array = self.centre + self.radii[:, None, None] * directions
        if not self._is_within_image:
            pixels[~inside_image(pixels, self.source_size)] = np.nan
        return pixels

    @property
    def _is_within_image(self) -> bool:
        """True if all circles are inside the rectangle of the outermost pixel centres."""
        reach = np.nanmax(self.radii, initial=0.0)
        return all(
            reach <= c <= length - 1 - reach
            for c, length in zip(self.centre, self.source_size, strict=True)
        )

    def has_valid_pixels(self) -> bool:
        """Return True if part of the image is visible; False also for undecided cases."""
        if self._is_within_image:
            return bool(np.isfinite(self.radii).any())
        return bool(np.isfinite(self._of_columns(self.angles[::CHECKED_COLUMN_STEP])).any())

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if it does not average."""
        return self._footprints.averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _footprints(self) -> Footprints:
        return Footprints(squared_sides_of_circles(self.radii, self.angles), CELL_PX, self.annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """Sample with the polar kernel."""
        x, y = self.centre
        backend.kernels.remap_polar(job.source, *self._floats, x, y, job.target, *job.arguments)

    @cached_property
    def _floats(self) -> tuple[Float32Array, Float32Array, Float32Array]:
        """Radii, cosines and sines."""
        radii, cosines, sines = (
            a.astype(np.float32) for a in (self.radii, np.cos(self.angles), np.sin(self.angles))
        )
        return radii, cosines, sines

    def halved(self, image_offset: Offset, view_offset: Offset) -> Map:
        """Return the map with interpolated circles; at the field boundary one of two rows is
        sufficient.
        """
        annulus = self.annulus and self.annulus.halved(image_offset)
        if not self._is_within_image:
            return PixelMap(self._pixels, self.source_size, self.annulus).halved(
                image_offset, view_offset
            )
        (x, y), radii, angles = view_offset, pairs(self.radii), pairs(self.angles)
        at = (1 - y) * radii[:, 0] + y * radii[:, 1]
        at = np.where(np.isnan(at), np.where(np.isnan(radii[:, 0]), radii[:, 1], radii[:, 0]), at)
        centre = (self.centre[0] - image_offset[0]) / 2, (self.centre[1] - image_offset[1]) / 2
        between = (1 - x) * angles[:, 0] + x * angles[:, 1]
        return PolarMap(centre, at / 2, between, half(self.source_size), annulus)
