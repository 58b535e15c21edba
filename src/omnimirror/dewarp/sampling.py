"""Image interpolation at fractional coordinates: compiled, or OpenCV without the compiled module.

Both implementations have a common definition. Coordinates from half a pixel before the first pixel
centre to half a pixel after the last one are inside the image; on the outermost half pixel the
image has its edge value. NaN and all other coordinates are outside and yield the border value,
without smearing. Cubic is the kernel of Keys [1]_ with a = -0.75, as in OpenCV; its taps outside
the image repeat the edge. Area is the mean of cubic samples over the footprint of an output pixel,
restricted to samples inside the image; auto equals area for minified pixels, and cubic otherwise
(see "Footprints of output pixels" below).

Results agree within one grey level; integers are rounded to the nearest and limited to their range.
Coordinates are rounded to float32 before sampling; the compiled samplers quantise fractions of a
pixel to 1/255 in uint8 images and to 1/65535 in others. OpenCV 4 quantises them to
1/32, with deviations of several grey levels at sharp edges.

.. [1] R. G. Keys, Cubic convolution interpolation for digital image processing, IEEE Trans. ASSP 29 (1981).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..base.arguments import format_value, instance
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..base.native import backend
from ..base.typing import Mask
from ..cameras.camera import inside_image
from ..io.images import OPAQUE
from .interfaces import (
    CONVERSIONS,
    INTERPOLATIONS,
    KERNELS,
    Annulus,
    Averages,
    Border,
    DtypeConversion,
    Image,
    Interpolation,
    Map,
    Pixels,
    RemapJob,
    Sampler,
)

# -- Footprints of output pixels, and the number of samples in their averages ----------------------
#
# The footprint of a pixel is the parallelogram that the map makes of it, extended to four
# neighbours: from the midpoint to the left neighbour to the midpoint to the right one, and likewise
# above and below. For minified views it is larger than a source pixel, and a single sample would
# alias; the mean of cubic samples distributed uniformly over it does not. The number of samples
# follows from the length of the sides for each cell of the view, and their spacing from the
# footprint of each pixel; cells therefore join without a seam.

SquaredSides = NDArray[np.float32]
"""Squared length of the longest footprint sides in each cell, (cell rows, cell columns, 2), across
and down, in square source pixels.
"""

CELL_PX = 16
SAMPLING_STEP_PX = 4  # footprints vary slowly; these pixels represent all
MAX_TAPS = 128  # per side
JUMP_RATIO2, JUMP_EXCESS_PX2 = 16.0, 4.0
"""Thresholds of the ratio of opposite squared sides, and of the excess, for a jump to another view
of a mosaic.
"""


@dataclass(frozen=True)
class Rule:
    """Conversion of the side of a footprint to a number of samples."""

    single_px: float
    """Maximum side with a single sample."""
    spacing_px: float
    """Maximum spacing of multiple samples."""
    sharp_px: float
    """A side of s is shortened by the factor 1 - (sharp / s)^8: to 0 at this side, and little for
    larger sides.
    """

    def taps(self, squares: SquaredSides) -> NDArray[np.uint8]:
        """Return the number of samples across and down in each cell."""
        with np.errstate(divide="ignore", invalid="ignore"):
            shortened = np.sqrt(squares) * (1 - (self.sharp_px**2 / squares) ** 4)
            needed = np.ceil(shortened / self.spacing_px).clip(2, MAX_TAPS)
        return np.where(squares > self.single_px**2, needed, 1).astype(np.uint8)


# Measured on the simulated room (benchmarks/interpolation_quality.py), PSNR relative to the
# supersampled scene:
# - A source pixel is itself the mean over its footprint. A second average over an output pixel of
#   similar size blurs twice: at 1:1 the plain average is 0.1 dB worse than cubic, with four times
#   the samples. Shortened, the average equals cubic up to sides of 1.2 px and the full average from
#   2 px on.
# - Samples 1.75 px apart are 0.05 dB worse than denser ones, 2 px 0.2 dB, and single-pixel stripes
#   alias.
# - Bilinear instead of cubic samples are 0.4 to 1.5 dB worse.
RULES: dict[Interpolation, Rule] = {"auto": Rule(1.2, 1.5, 1.2), "area": Rule(0.5, 1.0, 0.0)}


@dataclass(frozen=True, eq=False)
class Footprints:
    """Footprint sizes of the pixels of a view for each cell."""

    squared_sides: SquaredSides
    step: int
    """Side of a cell, output px."""
    annulus: Annulus | None = None
    """Image annulus that contains the field."""

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if single samples are
        sufficient.
        """
        return self._averages(interpolation)

    @cached_property
    def _averages(self) -> Callable[[Interpolation], Averages | None]:
        return cache(self._compute)

    def _compute(self, interpolation: Interpolation) -> Averages | None:
        rule = RULES.get(interpolation)
        if (
            rule is None
            or not self.squared_sides.size
            or self.squared_sides.max() <= rule.single_px**2
        ):
            return None
        return Averages(
            rule.taps(_filled(self.squared_sides)), self.step, rule.sharp_px, self.annulus
        )


def _filled(squares: SquaredSides) -> SquaredSides:
    """Fill cells without sampled visible pixels with the maximum of their neighbours."""
    unknown = squares == 0
    if not unknown.any():
        return squares
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(squares, ((1, 1), (1, 1), (0, 0))), (3, 3), axis=(0, 1)
    )
    return np.where(unknown, around.max(axis=(-2, -1)), squares)


def squared_sides_of_pixels(pixels: NDArray[Any]) -> SquaredSides:
    """Return the squared sides of a map (rows, columns, 2), in cells of 16 x 16 pixels; pixels
    outside are ignored.

    >>> half = 2.0 * np.moveaxis(np.mgrid[:40, :20], 0, -1)[..., ::-1]
    >>> squared_sides_of_pixels(half).shape, squared_sides_of_pixels(half)[0, 0]
    ((3, 2, 2), array([4., 4.], dtype=float32))
    """
    rows, columns = pixels.shape[:2]
    cells = -(-rows // CELL_PX), -(-columns // CELL_PX)
    squares = np.zeros((*cells, 2), np.float32)
    every = SAMPLING_STEP_PX
    sampled = pixels[::every, ::every]
    neighbours = (
        (pixels[::every, 1::every], pixels[::every, every - 1 :: every]),
        (
            pixels[1::every, ::every].swapaxes(0, 1),
            pixels[every - 1 :: every, ::every].swapaxes(0, 1),
        ),
    )
    for axis, (after, before) in enumerate(neighbours):
        sides = _squared_sides(sampled.swapaxes(0, 1) if axis else sampled, after, before)
        if sides.size:
            squares[..., axis] = _largest(sides.T if axis else sides, cells)
    return squares


def _squared_sides(
    sampled: NDArray[Any], after: NDArray[Any], before: NDArray[Any]
) -> NDArray[np.float32]:
    """Return squared sides along the second axis; the shorter one at boundaries between views of a
    mosaic.
    """
    sides = _squared(after - sampled[:, : after.shape[1]])
    count = sides.shape[1]
    sides[:, 1:] = np.fmin(
        sides[:, 1:], _squared(sampled[:, 1:count] - before[:, : max(count - 1, 0)])
    )
    return np.nan_to_num(sides, copy=False)


def squared_sides_of_circles(
    radii: NDArray[np.float64], angles: NDArray[np.float64]
) -> SquaredSides:
    """Return the squared sides of a polar map with radii (n,) in px and angles (m,) in radians, in
    cells of 16 x 16 pixels.

    >>> squared_sides_of_circles(np.array([100.0, 102.0]), np.array([0.0, 0.1])).round(2)
    array([[[103.95,   4.  ]]], dtype=float32)
    """
    # Chord between adjacent columns: 2 r sin(dphi / 2); distance between adjacent rows: dr
    chords, steps = 2 * np.sin(_to_next(angles) / 2), _to_next(radii)
    across = _longest(radii)[:, None] * _longest(chords)
    return np.stack(
        [across, np.broadcast_to(_longest(steps)[:, None], across.shape)], axis=-1
    ).astype(np.float32)


def _to_next(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return forward differences (n,); the last one is repeated."""
    differences = np.diff(values)
    return np.append(differences, differences[-1:] if len(differences) else np.zeros(len(values)))


def _longest(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squared maximum of every 16 values; NaN counts as 0."""
    squares = np.nan_to_num(lengths) ** 2
    longest: NDArray[np.float64] = np.maximum.reduceat(squares, np.arange(0, len(squares), CELL_PX))
    return longest


def squared_sides_of_lattice(
    nodes: NDArray[np.float32], step: int, cells: NDArray[np.int32], patches: NDArray[np.float32]
) -> SquaredSides:
    """Return the squared sides of a lattice from its nodes; see
    :class:`~omnimirror.dewarp.maps.LatticeMap`.
    """
    if backend.is_compiled:
        squares = np.empty((*cells.shape, 2), np.float32)
        u, v = nodes
        backend.kernels.squared_sides_of_lattice(u, v, step, cells, patches, squares)
        return squares
    scale = np.float32(0.5 / step)
    across = _squared(np.moveaxis(nodes[:, 1:-1, 2:] - nodes[:, 1:-1, :-2], 0, -1) * scale)
    down = _squared(np.moveaxis(nodes[:, 2:, 1:-1] - nodes[:, :-2, 1:-1], 0, -1) * scale)
    corners = np.stack([across, down], axis=-1)
    rows = np.maximum(corners[:-1], corners[1:])
    squares = np.maximum(rows[:, :-1], rows[:, 1:])
    exact = cells >= 0
    squares[exact] = _squares_of_patches(patches)[cells[exact]]
    return squares


def _squares_of_patches(patches: NDArray[np.float32]) -> SquaredSides:
    sampled = patches[:, ::SAMPLING_STEP_PX, ::SAMPLING_STEP_PX]
    sides = (
        patches[:, ::SAMPLING_STEP_PX, 1::SAMPLING_STEP_PX] - sampled,
        patches[:, 1::SAMPLING_STEP_PX, ::SAMPLING_STEP_PX] - sampled,
    )
    return np.stack(
        [np.fmax.reduce(_squared(to_next), axis=(1, 2), initial=0) for to_next in sides], axis=-1
    )


def _squared(vectors: NDArray[Any]) -> NDArray[np.float32]:
    """Return squared lengths of vectors (..., 2)."""
    x, y = vectors[..., 0], vectors[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        squares: NDArray[np.float32] = (x * x + y * y).astype(np.float32)
    return squares


def _largest(values: NDArray[np.float32], cells: tuple[int, int]) -> NDArray[np.float32]:
    """Return the maximum in each cell; a last cell without values has the value of its neighbour."""
    each = CELL_PX // SAMPLING_STEP_PX
    missing = [(0, each * n - have) for n, have in zip(cells, values.shape, strict=True)]
    padded = np.pad(values, missing, mode="edge")
    largest: NDArray[np.float32] = padded.reshape(cells[0], each, cells[1], each).max(axis=(1, 3))
    return largest


# -- Validation of sampling arguments --------------------------------------------------------------

FULL_VALUES = {**OPAQUE, "int16": 32767, "float64": 1.0, "bool": 1}
"""Value of an opaque alpha channel, by data type of arrays."""
DTYPES = ("uint8", "uint16", "int16", "float32", "float64", "bool")
MAX_VALUES = 0x7FFF0000  # the compiled samplers index values with 31 bits


def check_image(image: Image, size: tuple[int, int]) -> None:
    """Raise an error unless an array is an image of the given (width, height)."""
    check_colours(image)
    height, width = image.shape[:2]
    check_size((width, height), size)


def check_size(actual: tuple[int, int], expected: tuple[int, int], noun: str = "image") -> None:
    """Raise an error unless images or a video have the (width, height) of a camera."""
    (width, height), (across, down) = actual, expected
    if (width, height) != (across, down):
        same_shape = abs(width * down - height * across) <= max(width, height, across, down) / 2
        advice = (
            f"; the aspect ratios are equal: scale the {noun} to that size first"
            if same_shape
            else ""
        )
        raise InvalidParameter(
            f"the {noun} must have the {across} x {down} px of the camera; got {width} x {height} px{advice}"
        )


def check_colours(image: Image) -> None:
    """Raise an error unless an array is a grey, RGB or RGBA image."""
    check_kind(image)
    if image.shape[2:] == (2,):
        raise InvalidParameter(
            f"the image must have 1, 3 or 4 channels; got an array of shape {image.shape}"
        )


def check_kind(image: Image) -> None:
    """Raise an error for arrays of an unsupported shape or data type."""
    instance("the image", image, np.ndarray, "an array of pixels")
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or channels not in (1, 2, 3, 4) or image.size == 0:
        raise InvalidParameter(
            "the image must have 1 to 4 channels and at least one pixel; got an array of shape "
            f"{image.shape}"
        )
    if image.dtype.name not in DTYPES:
        raise InvalidParameter(
            f"the type of the image must be one of {', '.join(DTYPES)}; got {image.dtype.name}"
        )


def check_largest(image: Image, longest_side_px: int) -> None:
    """Raise an error if an image has too many pixels for a sampler."""
    height, width = image.shape[:2]
    if max(width, height) > longest_side_px:
        raise InvalidParameter(
            f"the sides of the image must be at most {longest_side_px} px without the "
            f"compiled samplers; got {width} x {height} px"
        )
    if image.size > MAX_VALUES:
        raise InvalidParameter(
            f"the image must have at most {MAX_VALUES} values; got {image.size} in {width} x {height} px"
        )


def check_interpolation(interpolation: str) -> None:
    """Raise an error for an unknown interpolation."""
    if interpolation not in INTERPOLATIONS:
        raise InvalidParameter(
            f"interpolation must be one of {', '.join(INTERPOLATIONS)}; got {interpolation!r}"
        )


def check_pixels(pixels: Pixels) -> None:
    """Raise an error unless an array is a pixel map."""
    if pixels.ndim != 3 or pixels.shape[2] != 2 or pixels.dtype not in (np.float32, np.float64):
        raise InvalidParameter(
            f"coordinates must be (rows, columns, 2) of float32 or float64; got {pixels.shape} of {pixels.dtype}"
        )


def output_array(out: Image | None, image: Image, size: tuple[int, int]) -> Image:
    """Return the validated output array of a (width, height), or a new one with channels and data
    type of the image.
    """
    shape, kind = (size[1], size[0], *image.shape[2:]), image.dtype.newbyteorder("=")
    if out is None:
        return np.empty(shape, kind)
    if out.shape != shape or out.dtype != kind:
        raise InvalidParameter(
            f"out must be {shape} of {image.dtype.name}; got {out.shape} of {out.dtype.name}"
        )
    if not out.flags.writeable:
        raise InvalidParameter("out must be writeable")
    return out


# -- Array layout for the samplers -----------------------------------------------------------------


def contiguous(array: Image) -> Image:
    """Return the array (rows, columns, c), or an aligned copy in native byte order if samplers
    require it.
    """
    return (
        array if is_contiguous(array) else np.array(array, array.dtype.newbyteorder("="), order="C")
    )


def is_contiguous(array: Image) -> bool:
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


# -- Border of a view: colour or transparency ------------------------------------------------------

MAX_BORDER_VALUE = 1e30  # maximum magnitude of a colour


def check_border(border: Border) -> None:
    """Raise an error unless the border is a number or a sequence of numbers."""
    try:
        values = np.array(border, object)
    except ValueError:
        values = np.empty((0, 0), object)
    if values.ndim > 1 or not all(_is_value(value) for value in values.flat):
        raise InvalidParameter(
            f"border must be one number or one number per channel; got {format_value(border)}"
        )


def _is_value(value: Any) -> bool:
    if not isinstance(value, int | float | np.integer | np.floating):
        return False
    size: Any = abs(value)
    return not size > MAX_BORDER_VALUE  # NaN is valid in floating-point images


def border_values(border: Border, image: Image) -> tuple[float, ...]:
    """Return the border value of each image channel; raise an error for invalid values."""
    check_border(border)
    channels = image.shape[2] if image.ndim == 3 else 1
    is_scalar = np.ndim(border) == 0
    values = np.array(border, float).reshape(-1).tolist()
    if not is_scalar and len(values) != channels:
        raise InvalidParameter(
            f"border must have one value, or one for each of the {channels} channels of the image; got {border}"
        )
    high = FULL_VALUES[image.dtype.name]
    low = -high - 1 if image.dtype.kind == "i" else 0
    is_integer = image.dtype.kind != "f"
    if is_integer and not all(low <= value <= high and value % 1 == 0 for value in values):
        raise InvalidParameter(
            f"border must contain integers from {low} to {high} for {image.dtype.name} images; got {border}"
        )
    return tuple(values * channels if is_scalar else values)


def transparent_border(border: Border, image: Image) -> tuple[float, ...]:
    """Return the border of an image with an alpha channel: a colour for programs that ignore alpha,
    and 0.
    """
    values = border_values(border, image)
    colours = values[:3] if len(values) > 1 else values * 3
    return (*colours, 0.0)


def with_alpha(image: Image) -> Image:
    """Return the image with four channels, opaque unless it has an alpha channel."""
    channels = image.shape[2:]
    if channels == (4,):
        return image
    if image.dtype.name not in OPAQUE:  # OpenCV has no conversion of this type
        rgba = np.empty((*image.shape[:2], 4), image.dtype)
        rgba[..., :3] = image if channels else image[..., None]
        rgba[..., 3] = FULL_VALUES[image.dtype.name]
        return rgba
    rgb = image if channels == (3,) else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA))


# -- OpenCV sampler --------------------------------------------------------------------------------

Values = NDArray[Any]

FLAGS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}
MAX_SIDE_PX = 32_766  # cv2.remap indexes pixels with 16 bits
BAND_PX = 1 << 17  # output pixels averaged per band
LIST_WIDTH_PX = 1024  # row width of scattered samples arranged for OpenCV


def remap_opencv(job: RemapJob, where: Pixels) -> None:
    """Fill the output of a job with the values at coordinates (rows, columns, 2)."""
    if job.averages is not None:
        _average(job, where, job.averages)
        return
    rows, columns = where.shape[:2]
    for top in range(0, rows, MAX_SIDE_PX):
        for left in range(0, columns, MAX_SIDE_PX):
            tile = slice(top, top + MAX_SIDE_PX), slice(left, left + MAX_SIDE_PX)
            pixels: Values = where[tile].astype(np.float32)
            inside: Mask = inside_image(pixels, (job.source.shape[1], job.source.shape[0]))
            pixels[~inside] = 0
            samples = _values(job.source, pixels, job.kernel)
            samples[~inside] = job.border
            job.target[tile] = samples


def _values(image: Image, pixels: Values, kernel: str) -> Image:
    """Return the values at pixels (rows, columns, 2) inside the image."""
    height, width, channels = image.shape
    if channels == 2:  # OpenCV quantises their fractions to 1/32
        return np.concatenate(
            [_values(part, pixels, kernel) for part in np.split(image, 2, axis=2)], axis=2
        )
    x, y = pixels[..., 0].clip(0, width - 1), pixels[..., 1].clip(0, height - 1)
    if kernel == "nearest":  # OpenCV versions round halves differently
        x, y = np.floor(x + 0.5), np.floor(y + 0.5)
    samples = cv2.remap(image, x, y, FLAGS[kernel], borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(samples).reshape(*x.shape, channels)


# -- Averages over footprints ----------------------------------------------------------------------


def _average(job: RemapJob, where: Pixels, averages: Averages) -> None:
    """Compute means over footprints in bands of rows, identical to
    native/src/sampling/footprint.hpp.
    """
    image, dtype = job.source.astype(np.float32), job.target.dtype
    size = image.shape[1], image.shape[0]
    for rows, around, taps in _bands(where, size, averages):
        out = np.empty((*taps.shape[:2], image.shape[2]), np.float32)
        out[:] = job.border
        for chosen, centres, positions in _footprint_groups(around, taps, averages):
            out[chosen] = _means(image, centres, positions)
        if dtype != np.float32:
            out = np.floor(out + np.float32(0.5)).clip(0, np.iinfo(dtype).max)
        job.target[rows] = out.astype(dtype, copy=False)


def sample_positions(where: Map, interpolation: Interpolation) -> tuple[Values, NDArray[np.int64]]:
    """Return the positions of all samples of a view, for samplers of other libraries.

    Parameters
    ----------
    where
        Map of the view.
    interpolation
        An output pixel is the mean of its samples; for ``"nearest"``, ``"linear"`` and ``"cubic"``
        it has one sample. Pixels outside the field have none.

    Returns
    -------
    positions : (n, 2) float32
        Source pixels (u, v).
    indices : (n,)
        Index of the output pixel of each sample, in rows; ascending.

    Examples
    --------
    >>> from omnimirror.dewarp.maps import PixelMap
    >>> view = PixelMap(np.array([[[0.25, 0.5], [1.6, 0.0], [1.0, 0.0]]]), (2, 2))
    >>> positions, indices = sample_positions(view, "linear")
    >>> positions.tolist(), indices.tolist()
    ([[0.25, 0.5], [1.0, 0.0]], [0, 2])
    """
    check_interpolation(interpolation)
    averages, pixels, size = where.averages(interpolation), where.pixels(), where.source_size
    if averages is None:
        inside: Mask = inside_image(pixels.astype(np.float32), size)
        return pixels[inside].astype(np.float32), np.flatnonzero(inside)
    columns = where.size[0]
    samples: list[tuple[Values, NDArray[np.int64]]] = []
    for rows, around, taps in _bands(pixels, size, averages):
        for chosen, centres, positions in _footprint_groups(around, taps, averages):
            indices = np.flatnonzero(chosen) + rows.start * columns
            is_empty = np.ones(len(indices), np.bool_)
            for position in positions:
                visible = inside_image(position, size)
                is_empty &= ~visible
                samples.append((position[visible], indices[visible]))
            samples.append((centres[is_empty], indices[is_empty]))
    if not samples:
        return np.zeros((0, 2), np.float32), np.zeros(0, np.int64)
    all_positions, all_indices = (np.concatenate(part) for part in zip(*samples, strict=True))
    order = np.argsort(all_indices, kind="stable")
    return all_positions[order], all_indices[order]


def _bands(
    where: Pixels, size: tuple[int, int], averages: Averages
) -> Iterator[tuple[slice, Values, NDArray[np.uint8]]]:
    """Yield bands of rows with their coordinates and a margin of one pixel, and their numbers of
    samples.
    """
    rows, columns = where.shape[:2]
    step = averages.step
    band = max(step, BAND_PX // columns // step * step)
    for top in range(0, rows, band):
        bottom = min(top + band, rows)
        cells = averages.taps[top // step : -(-bottom // step)]
        taps = cells.repeat(step, axis=0).repeat(step, axis=1)[: bottom - top, :columns]
        yield slice(top, bottom), _neighbourhood(where, size, top, bottom), taps


def _neighbourhood(where: Pixels, size: tuple[int, int], top: int, bottom: int) -> Values:
    """Return coordinates of some rows with a margin of one pixel; NaN outside the image."""
    first, last = max(top - 1, 0), min(bottom + 1, len(where))
    pixels: Values = where[first:last].astype(np.float32)
    pixels[~inside_image(pixels, size)] = np.nan
    return _extrapolated(_with_neighbours(pixels), 0, first == top, last == bottom)


def _with_neighbours(pixels: Values) -> Values:
    """Extrapolate rows by one pixel at both ends, by a parabola through three pixels if they are
    inside: columns at the seam of a full panorama have neighbours on a circle.
    """
    extended = _extrapolated(pixels, 1, True, True)
    if pixels.shape[1] > 2:
        for end, (one, two, three) in ((0, (0, 1, 2)), (-1, (-1, -2, -3))):
            parabola = 3 * (pixels[:, one] - pixels[:, two]) + pixels[:, three]
            extended[:, end] = np.where(np.isnan(parabola), extended[:, end], parabola)
    return extended


def _extrapolated(pixels: Values, axis: int, before: bool, after: bool) -> Values:
    """Extrapolate linearly by one pixel at the ends of an axis."""
    ends = []
    for end, next_one, is_extended in ((0, 1, before), (-1, -2, after)):
        last = pixels.take([end], axis)
        ends.append(
            [2 * last - pixels.take([next_one], axis) if pixels.shape[axis] > 1 else last]
            * is_extended
        )
    return np.concatenate([*ends[0], pixels, *ends[1]], axis)


def _footprint_groups(
    around: Values, taps: NDArray[np.uint8], averages: Averages
) -> Iterator[tuple[Mask, Values, Iterator[Values]]]:
    """Yield pixels with a common number of samples: their mask, their coordinates (n, 2), and the
    coordinates of each of their samples, NaN outside the field.
    """
    middle = around[1:-1, 1:-1]
    aside = _sides(middle, around[1:-1, :-2], around[1:-1, 2:], averages)
    upright = _sides(middle, around[:-2, 1:-1], around[2:, 1:-1], averages)
    inside = np.isfinite(middle[..., 0])
    for across, down in np.unique(taps[inside], axis=0):
        chosen = inside & (taps == (across, down)).all(axis=-1)
        centres = middle[chosen]
        sides = [side[chosen] for side in aside], [side[chosen] for side in upright]
        yield chosen, centres, _footprint_positions(centres, sides, (across, down), averages)


def _footprint_positions(
    centres: Values,
    sides: tuple[list[Values], list[Values]],
    taps: tuple[int, int],
    averages: Averages,
) -> Iterator[Values]:
    """Yield the coordinates (n, 2) of each sample of some pixels; NaN outside the annulus."""
    annulus = averages.annulus
    for i in range(taps[0]):
        for j in range(taps[1]):
            pixels = centres + _part(i, taps[0], sides[0]) + _part(j, taps[1], sides[1])
            if annulus is not None:
                square = ((pixels - np.array(annulus[:2], np.float32)) ** 2).sum(axis=-1)
                pixels[~((square >= annulus.inner**2) & (square <= annulus.outer**2))] = np.nan
            yield pixels


def _sides(middle: Values, before: Values, after: Values, averages: Averages) -> list[Values]:
    """Return vectors (..., 2) to the neighbours on one axis, shortened as in
    :class:`~.footprints.Rule`.
    """
    offsets = before - middle, after - middle
    squares = [(offset**2).sum(axis=-1) for offset in offsets]
    with np.errstate(invalid="ignore"):
        missing = [
            np.isnan(s) | (s > JUMP_RATIO2 * o + JUMP_EXCESS_PX2)
            for s, o in (squares, squares[::-1])
        ]
    none = missing[0] & missing[1]
    if averages.annulus is None:
        none |= np.isnan(squares[0]) | np.isnan(squares[1])
    sides = []
    for is_missing, offset, opposite in zip(missing, offsets, offsets[::-1], strict=True):
        side = np.where(is_missing[..., None], -opposite, offset)
        side[none] = 0
        sides.append(side * _share((side**2).sum(axis=-1), averages.sharp_px)[..., None])
    return sides


def _share(square: Values, sharp_px: float) -> Values:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(square > sharp_px**2, 1 - (sharp_px**2 / square) ** 4, 0).astype(np.float32)


def _part(i: int, count: int, sides: list[Values]) -> Values:
    """Return the offset of sample i as a fraction of the vector to the previous or next neighbour."""
    t = np.float32((i + 0.5) / count - 0.5)
    return abs(t) * sides[0 if t < 0 else 1]


def _means(image: Image, middle: Values, positions: Iterable[Values]) -> Image:
    """Return means (n, channels) of the samples inside; without any, the value at the centre
    (n, 2).
    """
    sums, counts = (
        np.zeros((len(middle), image.shape[2]), np.float32),
        np.zeros(len(middle), np.float32),
    )
    for pixels in positions:
        values, visible = _sampled_list(image, pixels)
        sums += values
        counts += visible
    without_samples = counts == 0
    sums[without_samples] = _sampled_list(image, middle[without_samples])[0]
    means: Image = sums / np.maximum(counts, 1)[:, None]
    return means


def _sampled_list(image: Image, pixels: Values) -> tuple[Image, Mask]:
    """Return cubic samples (n, channels) at scattered pixels (n, 2), 0 outside, and the mask of
    those inside.
    """
    inside: Mask = inside_image(pixels, (image.shape[1], image.shape[0]))
    rows = -(-len(pixels) // LIST_WIDTH_PX)
    arranged = np.zeros((rows * LIST_WIDTH_PX, 2), np.float32)
    arranged[: len(pixels)][inside] = pixels[inside]
    if not rows:
        return np.zeros((0, image.shape[2]), np.float32), inside
    values = _values(image, arranged.reshape(rows, LIST_WIDTH_PX, 2), "cubic")
    values = values.reshape(-1, image.shape[2])[: len(pixels)]
    values[~inside] = 0
    return values, inside


# -- Selection of the sampler ----------------------------------------------------------------------


@dataclass(frozen=True)
class CompiledSampler:
    """Sampler with the kernels in native/src/sampling, one per map type."""

    longest_side_px: int = MAX_VALUES

    def sample(self, job: RemapJob, where: Map) -> None:
        where.sample_compiled(job)


@dataclass(frozen=True)
class OpenCVSampler:
    """Sampler with OpenCV, which requires coordinates of all pixels."""

    longest_side_px: int = MAX_SIDE_PX

    def sample(self, job: RemapJob, where: Map) -> None:
        remap_opencv(job, where.pixels())


def sampler() -> Sampler:
    """Return the active sampler."""
    return CompiledSampler() if backend.is_compiled else OpenCVSampler()


MIN_WEIGHT = 1e-6
"""Weight of infinite values above which a mean is infinite, above rounding errors."""


def _sample_infinite(selected: Sampler, job: RemapJob, where: Map) -> None:
    """Sample an image with infinite values: means with a positive weight of them are infinite.

    A weight of 0 would make the product with infinity undefined, and so would the negative weights
    of adjacent cubic samples. The means of finite values are therefore divided by their weight.
    """
    finite = np.where(np.isinf(job.source), np.float32(0), job.source)
    selected.sample(replace(job, source=finite), where)
    result = job.target
    for value in (np.float32(np.inf), np.float32(-np.inf)):
        weight = np.empty_like(result)
        is_value = (job.source == value).astype(np.float32)
        selected.sample(
            replace(job, source=is_value, target=weight, border=(0.0,) * weight.shape[2]), where
        )
        with np.errstate(invalid="ignore"):
            result /= np.where(weight < MIN_WEIGHT, 1 - weight, 1)
        result[weight >= MIN_WEIGHT] = value


def remap(
    image: Image,
    where: Map,
    interpolation: Interpolation = "linear",
    out: Image | None = None,
    border: Border = 0,
) -> Image:
    """Interpolate an image at the coordinates of a map.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array, c from 1 to 4
        Image of the map's ``source_size``, with any strides: uint8, uint16, int16, float32, float64
        or bool. Types other than uint8, uint16 and float32 are copied.
    where
        A :class:`~omnimirror.dewarp.maps.PixelMap`,
        :class:`~omnimirror.dewarp.maps.LatticeMap` or :class:`~omnimirror.dewarp.maps.PolarMap`.
    interpolation
        ``"auto"``, ``"nearest"``, ``"linear"``, ``"cubic"`` or ``"area"``.
    out : (rows, columns) or (rows, columns, c) array of the same depth, optional
        Output array that is filled and returned; with any strides.
    border
        Value outside the image, for all channels or for each channel.

    Raises
    ------
    InvalidParameter
        If the arrays are inconsistent, or the border is not a valid image value.

    Examples
    --------
    >>> from omnimirror.dewarp.maps import PixelMap
    >>> picture = np.array([[0, 100], [0, 100]], np.uint8)
    >>> remap(picture, PixelMap(np.array([[[0.25, 0.5], [1.5, 0.0], [1.6, 0.0]]]), (2, 2)), border=7)
    array([[ 25, 100,   7]], dtype=uint8)
    """
    selected = sampler()
    check_kind(image)
    check_interpolation(interpolation)
    check_largest(image, selected.longest_side_px)
    if image.shape[1::-1] != tuple(where.source_size):
        raise InvalidParameter(
            f"the image must have the size {where.source_size} of the map; got {image.shape[1::-1]}"
        )
    out = output_array(out, image, where.size)
    if image.dtype.name in CONVERSIONS:
        conversion = CONVERSIONS[image.dtype.name]
        return _remap_converted(image, where, interpolation, out, border, conversion)
    target_view = out if out.ndim == 3 else out[..., None]
    is_direct = is_contiguous(target_view) and not np.may_share_memory(image, out)
    target = target_view if is_direct else np.empty(target_view.shape, target_view.dtype)
    source = contiguous(image if image.ndim == 3 else image[..., None])
    averages = where.averages(interpolation)
    job = RemapJob(source, target, KERNELS[interpolation], border_values(border, image), averages)
    if source.dtype == np.float32 and np.isinf(source).any():
        _sample_infinite(selected, job, where)
    else:
        selected.sample(job, where)
    if not is_direct:
        target_view[...] = target
    return out


def _remap_converted(
    image: Image,
    where: Map,
    interpolation: Interpolation,
    out: Image,
    border: Border,
    conversion: DtypeConversion,
) -> Image:
    """Interpolate an image of a type that the samplers do not support."""
    values = np.array(border_values(border, image)) * conversion.scale + conversion.offset
    samples = remap(conversion.encode(image), where, interpolation, border=values.tolist())
    out[...] = conversion.decode(samples)
    return out
