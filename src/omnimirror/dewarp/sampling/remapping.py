"""Taking a picture's values at fractional coordinates: compiled, or with OpenCV where nothing was compiled.

Both follow one rule. A coordinate from half a pixel before the first pixel's centre to half a pixel behind the
last one's lies on the picture; on that outermost half pixel the picture has the value of its edge. NaN and all
other coordinates lie outside and give the border value: nothing is smeared. Cubic is the kernel of Keys with
a = -0.75, as in OpenCV; its taps beyond the picture repeat the edge. Area is the mean of cubic samples over what an
output pixel covers in the picture, of those that are inside; auto is the same where the picture is minified, and
cubic elsewhere (see :mod:`omnimirror.dewarp.sampling.footprints`).

Values agree to one grey level. Coordinates are kept as float32; the compiled samplers take fractions of a pixel
to 1/255 in uint8 pictures and to 1/65535 in others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import instance, shown
from ...errors import InvalidParameter
from ...media.pictures.images import FULL
from ...native import backend
from ...numerics.lazy import cached_property
from .footprints import (
    CELL_PX,
    RULES,
    Averages,
    Ring,
    averages_of,
    squares_of_coordinates,
    squares_of_nodes,
    squares_of_rings,
)
from .opencv import LONGEST_SIDE_PX, remap_opencv

Image = NDArray[Any]
Coordinates = NDArray[np.float32] | NDArray[np.float64]
Array = NDArray[np.float64]
Interpolation = Literal["auto", "nearest", "linear", "cubic", "area"]
Border = float | Sequence[float]

INTERPOLATIONS: tuple[Interpolation, ...] = ("auto", "nearest", "linear", "cubic", "area")
KINDS = {"nearest": "nearest", "linear": "linear", "cubic": "cubic", "area": "cubic", "auto": "cubic"}
"""The single samples that each is made of."""
NUMBERS = {"nearest": 0, "linear": 1, "cubic": 2}
DEPTHS = frozenset(np.dtype(name) for name in FULL) | {np.dtype(name).newbyteorder() for name in FULL}
MOST_VALUES = 0x7FFF0000  # the compiled samplers count values in 31 bits


def check_picture(image: Image, size: tuple[int, int]) -> None:
    """Refuse what is not a picture of the given (width, height)."""
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
    check_largest(image)


def check_kind(image: Image) -> None:
    """Refuse what no picture looks like."""
    instance("a picture", image, np.ndarray, "an array of pixels")
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.ndim not in (2, 3) or channels not in (1, 2, 3, 4) or image.size == 0:
        raise InvalidParameter(f"an array of shape {image.shape} is not a picture of 1 to 4 channels")
    if image.dtype not in DEPTHS:
        raise InvalidParameter(f"the picture holds {image.dtype.name} values; valid are {', '.join(FULL)}")


def check_largest(image: Image) -> None:
    """Refuse a picture with more pixels than can be counted."""
    height, width = image.shape[:2]
    if not backend.is_compiled and max(width, height) > LONGEST_SIDE_PX:
        raise InvalidParameter(
            f"a picture of {width} x {height} px is too large; valid are {LONGEST_SIDE_PX} px a side, "
            "and more with the compiled samplers"
        )
    if image.size > MOST_VALUES:
        raise InvalidParameter(f"a picture of {width} x {height} px is too large; valid are {MOST_VALUES} values")


LARGEST_VALUE = 1e30  # of a colour


def check_border(border: Border) -> None:
    """Refuse what is neither a number nor some numbers."""
    try:
        values = np.array(border, object)
    except ValueError:
        values = np.empty((0, 0), object)
    if values.ndim > 1 or not all(_is_value(value) for value in values.flat):
        raise InvalidParameter(f"border = {shown(border)} is no colour; valid are a number, or one for every channel")


def _is_value(value: Any) -> bool:
    if not isinstance(value, int | float | np.integer | np.floating):
        return False
    size: Any = abs(value)
    return not size > LARGEST_VALUE  # NaN is one, in pictures of floats


def border_values(border: Border, image: Image) -> tuple[float, ...]:
    """The border's value in each of a picture's channels; refuses what is none."""
    check_border(border)
    channels = image.shape[2] if image.ndim == 3 else 1
    values = np.array(border, float)
    if values.ndim and len(values) != channels:
        raise InvalidParameter(
            f"border = {border} has {len(values)} values, and the picture {channels} channels; "
            "a single number stands for all of them"
        )
    full = FULL[image.dtype.name]
    if image.dtype.kind == "u" and not ((values >= 0) & (values <= full) & (values % 1 == 0)).all():
        raise InvalidParameter(
            f"border = {border} is no value of a picture of {image.dtype.name}; "
            f"valid are whole numbers from 0 to {full}"
        )
    return tuple(np.broadcast_to(values, channels).tolist())


def clear_border(border: Border, image: Image) -> tuple[float, ...]:
    """The border of a picture that gets an alpha: a colour for those who look at it without, and 0."""
    values = border_values(border, image)
    colours = values[:3] if len(values) > 1 else values * 3
    return (*colours, 0.0)


def with_alpha(image: Image) -> Image:
    """The picture in four channels, opaque unless it has an alpha."""
    channels = image.shape[2:]
    if channels == (4,):
        return image
    rgb = image if channels == (3,) else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA))


# -- what can be asked -----------------------------------------------------------------------------


def remap(
    image: Image,
    coordinates: Coordinates,
    interpolation: Interpolation = "linear",
    out: Image | None = None,
    border: Border = 0,
) -> Image:
    """The picture's values at coordinates that are used once.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array, uint8, uint16 or float32, c from 1 to 4
        With any strides.
    coordinates : (rows, columns, 2), float32 or float64, px
        (u, v), integers at pixel centres; NaN is outside.
    interpolation
        ``"auto"``, ``"nearest"``, ``"linear"``, ``"cubic"`` or ``"area"``.
    out : (rows, columns) or (rows, columns, c) array of the same depth, optional
        Filled and returned; with any strides.
    border
        Value outside the picture, of all channels or of each.

    Raises
    ------
    InvalidParameter
        For arrays that do not fit each other.

    Examples
    --------
    >>> picture = np.array([[0, 100], [0, 100]], np.uint8)
    >>> remap(picture, np.array([[[0.25, 0.5], [1.5, 0.0], [1.6, 0.0]]]), border=7)
    array([[ 25, 100,   7]], dtype=uint8)
    """
    coordinates = _checked(coordinates)
    call = _Call(image, coordinates.shape[:2], interpolation, out, border)
    averages = _averages_of_map(coordinates, interpolation)
    if not backend.is_compiled:
        return call.done(remap_opencv(call.source, coordinates, call.kind, call.border, averages))
    backend.kernels.remap(call.source, _adjoining(coordinates), call.target, *call.how(averages))
    return call.done()


class FixedMap:
    """Coordinates that are used for many pictures of one size; see :func:`remap`.

    The compiled samplers take the first picture with the coordinates as they are, since a moving view has no
    second one; then they pack them into 6 bytes a pixel (8 for deep pictures) and are about twice as fast.

    Parameters
    ----------
    coordinates : (rows, columns, 2), px
        Kept as float32.
    size : (width, height)
        Of the pictures.
    interpolation
        As in :func:`remap`.
    ring
        Where in the pictures something is seen, for averages at the end of the field.
    averages
        Of how many samples values are made; found from the coordinates where not given.
    """

    def __init__(
        self,
        coordinates: Coordinates,
        size: tuple[int, int],
        interpolation: Interpolation = "linear",
        ring: Ring | None = None,
        averages: Averages | None = None,
    ):
        _check_interpolation(interpolation)
        self.coordinates = np.array(_checked(coordinates), np.float32, order="C")
        self.size = size
        self.interpolation: Interpolation = interpolation
        self.ring = ring
        self._averages = averages or _averages_of_map(self.coordinates, interpolation, ring)
        # Where all values are averages, a packed map of single samples is of no use.
        self._can_pack = self._averages is None or bool((self._averages.taps == 1).all(axis=-1).any())
        self._packed: dict[tuple[int, bool], Any] = {}
        self._is_used = False

    @classmethod
    def of_grid(cls, grid: Grid, size: tuple[int, int], interpolation: Interpolation = "linear") -> Self:
        """For the same pictures as :func:`remap_grid`'s."""
        return cls(grid.coordinates(), size, interpolation, grid.ring, grid.averages(interpolation))

    def __call__(self, image: Image, out: Image | None = None, border: Border = 0) -> Image:
        """The picture's values; ``out`` and ``border`` as in :func:`remap`."""
        check_kind(image)
        if image.shape[1::-1] != tuple(self.size):
            raise InvalidParameter(f"the picture has another size than the map: {image.shape[1::-1]}, not {self.size}")
        call = _Call(image, self.coordinates.shape[:2], self.interpolation, out, border)
        if not backend.is_compiled:
            return call.done(remap_opencv(call.source, self.coordinates, call.kind, call.border, self._averages))
        if not (self._is_used and self._can_pack):
            self._is_used = True
            backend.kernels.remap(call.source, self.coordinates, call.target, *call.how(self._averages))
            return call.done()
        kind = (call.source.shape[2], call.source.dtype != np.uint8)
        if kind not in self._packed:
            self._packed[kind] = backend.kernels.PackedMap(self.coordinates, *self.size, *kind, NUMBERS[call.kind])
        averages = (self.coordinates, self._averages.for_compiled) if self._averages else ()
        self._packed[kind].sample(call.source, call.target, call.border, *averages)
        return call.done()


def remap_polar(
    image: Image,
    radii: ArrayLike,
    angles: ArrayLike,
    centre: tuple[float, float],
    interpolation: Interpolation = "linear",
    out: Image | None = None,
    border: Border = 0,
    averages: Averages | None = None,
) -> Image:
    """The picture's values at ``centre + radii[row] (cos, sin)(angles[column])``, without a map.

    Parameters
    ----------
    radii : (rows,) px
        NaN is outside.
    angles : (columns,) radians
        From right towards down in the picture.
    centre : (u, v) px
    averages
        Of how many samples values are made; found from radii and angles where not given.

    The others are those of :func:`remap`.
    """
    rows, columns = np.asarray(radii, np.float64), np.asarray(angles, np.float64)
    directions = np.cos(columns), np.sin(columns)
    call = _Call(image, (len(rows), len(columns)), interpolation, out, border)
    if averages is None and interpolation in RULES:
        averages = averages_of(squares_of_rings(rows, columns), CELL_PX, interpolation)
    if not backend.is_compiled:
        pixels = np.stack([c + rows[:, None] * d for c, d in zip(centre, directions, strict=True)], axis=-1)
        return call.done(remap_opencv(call.source, pixels, call.kind, call.border, averages))
    cosines, sines = (d.astype(np.float32) for d in directions)
    backend.kernels.remap_polar(
        call.source, rows.astype(np.float32), cosines, sines, *centre, call.target, *call.how(averages)
    )
    return call.done()


@dataclass(frozen=True)
class Grid:
    """Coordinates at every ``step``-th output pixel, to be interpolated bicubically between.

    With 16 pixels between nodes, a perspective view is met to some thousandths of a pixel.
    """

    nodes: NDArray[np.float32]
    """(2, rows, columns): u and v at output pixels (-step, -step), (0, -step), .. up to one beyond the cell of
    the last pixel."""
    size: tuple[int, int]
    """(width, height) of the output."""
    step: int
    """4, 8, 16, 32 or 64."""
    cells: NDArray[np.int32]
    """(cell rows, cell columns): -1 where to interpolate, else the index of a patch."""
    patches: NDArray[np.float32]
    """(n, step, step, 2): the coordinates of cells that must not be interpolated."""
    shift: tuple[float, float] = (0.0, 0.0)
    """How far right of and below the nodes' lattice the output's pixels lie, less than 1 px."""
    ring: Ring | None = None
    """Where in the pictures something is seen, for averages at the end of the field."""

    def coordinates(self) -> NDArray[np.float32]:
        """All coordinates (height, width, 2); NaN outside."""
        down, across = self.cells.shape
        outside = np.isnan(self.nodes).any(axis=0)
        nodes = np.where(outside, np.float32(0), self.nodes)  # or one would spoil its whole row and column
        (right, below), step = (node_weights(self.step, shift) for shift in self.shift), self.step
        lines = sum(nodes[:, :, i : i + across, None] * w for i, w in enumerate(right)).reshape(2, -1, 1, across * step)
        full = sum(lines[:, i : i + down] * w[:, None] for i, w in enumerate(below))
        tiles = full.reshape(2, down, step, across, step).transpose(1, 3, 2, 4, 0)
        tiles[np.lib.stride_tricks.sliding_window_view(outside, (4, 4)).any(axis=(2, 3))] = np.nan
        exact = self.cells >= 0
        tiles[exact] = self.patches[self.cells[exact]]
        width, height = self.size
        whole = tiles.transpose(0, 2, 1, 3, 4).reshape(down * self.step, across * self.step, 2)[:height, :width]
        pixels: NDArray[np.float32] = whole
        return pixels

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """What an interpolation averages; None where that is nothing."""
        return self._averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _averages(self) -> Callable[[Interpolation], Averages | None]:
        squares = squares_of_nodes(self.nodes, self.step, self.cells, self.patches)
        return cache(lambda interpolation: averages_of(squares, self.step, interpolation, self.ring))


def node_weights(step: int, shift: float = 0.0) -> NDArray[np.float32]:
    """Lagrange's cubic weights (4, step) of the nodes at -1, 0, 1 and 2, at every 1/step from shift/step on."""
    t = (np.arange(step) + shift) / step
    outer = t * (t - 1) / 6
    inner = (t + 1) * (t - 2) / 2
    return np.stack([-outer * (t - 2), inner * (t - 1), -inner * t, outer * (t + 1)]).astype(np.float32)


def remap_grid(
    image: Image, grid: Grid, interpolation: Interpolation = "linear", out: Image | None = None, border: Border = 0
) -> Image:
    """The picture's values at a grid's coordinates; the others are as in :func:`remap`."""
    call = _Call(image, grid.size[::-1], interpolation, out, border)
    averages = grid.averages(interpolation)
    if not backend.is_compiled:
        return call.done(remap_opencv(call.source, grid.coordinates(), call.kind, call.border, averages))
    u, v = grid.nodes
    across, down = (node_weights(grid.step, shift) for shift in grid.shift)
    where = u, v, across, down, grid.cells, grid.patches
    backend.kernels.remap_grid(call.source, *where, call.target, *call.how(averages))
    return call.done()


def _averages_of_map(
    coordinates: Coordinates, interpolation: Interpolation, ring: Ring | None = None
) -> Averages | None:
    if interpolation not in RULES:
        return None
    return averages_of(squares_of_coordinates(coordinates), CELL_PX, interpolation, ring)


# -- arrays as the samplers need them --------------------------------------------------------------


class _Call:
    """One picture in, one out: three axes, pixels that adjoin, checked against each other."""

    def __init__(
        self, image: Image, shape: tuple[int, ...], interpolation: str, out: Image | None, border: Border
    ) -> None:
        check_kind(image)
        check_largest(image)
        _check_interpolation(interpolation)
        self.kind = KINDS[interpolation]
        self.border = border_values(border, image)
        whole, kind = (*shape, *image.shape[2:]), image.dtype.newbyteorder("=")
        if out is None:
            out = np.empty(whole, kind)
        elif out.shape != whole or out.dtype != kind:
            raise InvalidParameter(f"out is {out.shape} of {out.dtype.name}, not {whole} of {image.dtype.name}")
        elif not out.flags.writeable:
            raise InvalidParameter("out cannot be written")
        self.out = out
        self.source = image if image.ndim == 3 else image[..., None]
        if not _is_direct(self.source):
            self.source = np.array(self.source, kind, order="C")  # a copy, aligned too
        self.target = out if out.ndim == 3 else out[..., None]
        if not _is_direct(self.target) or np.may_share_memory(image, out):
            self.target = np.empty(self.target.shape, kind)

    def how(self, averages: Averages | None) -> tuple[Any, ...]:
        """The last arguments of the compiled samplers."""
        return NUMBERS[self.kind], self.border, averages and averages.for_compiled

    def done(self, taken: Image | None = None) -> Image:
        """What the caller asked for, from what was sampled."""
        target = self.target if taken is None else taken
        if target is not self.out and target.base is not self.out:
            self.out[...] = target.reshape(self.out.shape)
        return self.out


def _is_direct(array: Image) -> bool:
    """Whether channels and pixels adjoin, and rows follow downwards without overlap."""
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


def _adjoining(coordinates: Coordinates) -> Image:
    direct = coordinates.strides[1:] == (2 * coordinates.itemsize, coordinates.itemsize)
    return (
        coordinates
        if direct and _is_direct(coordinates)
        else np.array(coordinates, coordinates.dtype.newbyteorder("="), order="C")
    )


def _checked(coordinates: Coordinates) -> Coordinates:
    if coordinates.ndim != 3 or coordinates.shape[2] != 2 or coordinates.dtype not in (np.float32, np.float64):
        raise InvalidParameter(
            f"coordinates are (rows, columns, 2) of float32 or float64, not {coordinates.shape} of {coordinates.dtype}"
        )
    return coordinates


def _check_interpolation(interpolation: str) -> None:
    if interpolation not in INTERPOLATIONS:
        raise InvalidParameter(f"interpolation = {interpolation!r} is not one of {', '.join(INTERPOLATIONS)}")
