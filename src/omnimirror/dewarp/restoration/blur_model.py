"""Blur kernels of defocused sensors, and radially symmetric blur specified for other cameras."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...analysis.evaluation import evaluate
from ...base.arguments import format_value, numbers
from ...base.errors import InvalidParameter, SpecError
from ...base.files import read_bytes
from ...base.typing import Array
from ...cameras.camera import Camera
from ...cameras.models import RadialModel
from ...optics.sensor import Sensor

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


# -- Blur kernels: from a sharp image on a fine grid to the pixels of a defocused sensor -----------
#
# A lens with a circular aperture images a defocused point to an elliptic disc whose radial axis is
# the tangential blur and whose other axis is the sagittal blur (Eqs. 34-36 of Ohte and Tsuzuki). Each
# pixel is therefore the mean of the sharp image over such a disc, convolved with the pixel area.

IndexArray = NDArray[np.int32]

GROUP_PX = 8  # adjacent pixels of a row, which are blurred with SIMD instructions
# Maximum variation of the blur along the pixels of one kernel, at 90 % of the distances from the
# axis
STEEP_PX = 0.65
TILE_PX = 152  # maximum side of independently solved tiles: a few megabytes, which fit into caches
RING_PX = 2.0  # width of rings with one kernel per direction
TURNS = 64  # directions over half a turn: the ends of a 10 px blur are within 0.25 px
POINTS_PER_PX2 = 16  # samples on the disc
ROUNDED = 1 - 1e-9


class BlurSize(NamedTuple):
    """Blur diameters (n,) in px, unsigned."""

    tangential: Array
    sagittal: Array

    @property
    def larger(self) -> Array:
        return np.maximum(self.tangential, self.sagittal)

    @property
    def widening(self) -> Array:
        """Widening of a pixel by the blur: side of the square of equal area, minus that of the
        pixel.
        """
        # Pixel (side 1) and blur add in quadrature in both directions; the side is the root of the area
        widened: Array = ((1 + self.tangential**2) * (1 + self.sagittal**2)) ** 0.25 - 1
        return widened


class Blur(NamedTuple):
    """Blur of pixels as kernels: weights of the values of a sharp image on a finer grid."""

    size: tuple[int, int]
    """Size (width, height) of the image in pixels."""
    fineness: int
    """Number of fine pixels along the side of a pixel."""
    pixels: IndexArray
    """Indices (n,) of the known pixels, ascending: row * width + column."""
    kernels: IndexArray
    """Kernel indices (h, blocks) of the pixel blocks of each row, in whole groups; -1 for unknown
    blocks.
    """
    firsts: IndexArray
    """Index (kernels + 1,) of the first weight of each kernel, and the total number."""
    offsets: IndexArray
    """Offsets (m, 2) in rows down and columns right on the fine grid, from the first value of a
    pixel.
    """
    weights: NDArray[np.float32]
    """Weights (m,), normalised to the sum 1 in every kernel."""
    block_px: int
    """Number of adjacent pixels in a row with one kernel: 1, 2, 4 or 8."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask (h, w) of known pixels."""
        is_known = np.zeros(self.size[::-1], bool)
        is_known.ravel()[self.pixels] = True
        return is_known

    @property
    def reach(self) -> int:
        """Maximum number of pixels that kernels extend beyond their own pixel."""
        minimum, maximum = (
            int(extreme) // self.fineness for extreme in (self.offsets.min(), self.offsets.max())
        )
        return max(-minimum, maximum, 1)

    @property
    def tiles(self) -> IndexArray:
        """Tiles (n, 2, 4) of the image that are solved independently.

        Each tile contains the row and column ranges of the pixels whose sharp values are kept, and
        of the known pixels that it explains, including some of adjacent tiles. Its values extend
        beyond these by the reach of the kernels, in whole groups of columns.
        """
        is_known, created = self.known, []
        beyond = whole_groups(self.reach)
        width, height = self.size
        for top, bottom in pairwise(_parts(height)):
            for left, right in pairwise(_parts(width)):
                first_row, first_column = max(top - beyond, 0), max(left - beyond, 0)
                near = is_known[first_row : bottom + beyond, first_column : right + beyond]
                if near.any():
                    rows = first_row + np.flatnonzero(near.any(axis=1))
                    columns = first_column + np.flatnonzero(near.any(axis=0))
                    begin = columns[0] // GROUP_PX * GROUP_PX
                    created.append(
                        [
                            (top, bottom, left, right),
                            (rows[0], rows[-1] + 1, begin, columns[-1] + 1),
                        ]
                    )
        return _whole(np.array(created).reshape(-1, 2, 4))

    @property
    def concentration(self) -> NDArray[np.float32]:
        """Root sum square (h, w) of the kernel weights of each pixel, divided by the fineness. It
        is a near-optimal preconditioner of the conjugate gradients, between the diagonal of the
        product of the weights with their transpose, which is smaller, and the row sums of this
        product. Unknown pixels have the value of the last kernel, at the rim.
        """
        of_kernel = np.sqrt(np.add.reduceat(self.weights**2, self.firsts[:-1])) / self.fineness
        # The last entry is for unknown blocks
        of_block = of_kernel.astype(np.float32)[self.kernels]
        return np.ascontiguousarray(np.repeat(of_block, self.block_px, axis=1)[:, : self.size[0]])

    def matrix(self) -> csr_matrix:
        """Return the sparse matrix of the blur.

        ``matrix @ sharp.reshape(-1, channels)`` are the blurred values of ``pixels``; the image is
        continued with its edge values.
        """
        from scipy.sparse import csr_matrix

        width, height = self.size
        across, deep = width * self.fineness, height * self.fineness
        rows, columns = np.divmod(self.pixels, width)
        kernels = self.kernels[rows, columns // self.block_px]
        counts = np.diff(self.firsts)[kernels]
        bounds = np.r_[0, np.cumsum(counts)]
        of_pixel = np.repeat(np.arange(len(counts)), counts)
        entry = np.arange(bounds[-1]) - np.repeat(bounds[:-1] - self.firsts[kernels], counts)
        down = np.clip(self.fineness * rows[of_pixel] + self.offsets[entry, 0], 0, deep - 1)
        right = np.clip(self.fineness * columns[of_pixel] + self.offsets[entry, 1], 0, across - 1)
        shape = (len(counts), across * deep)
        return csr_matrix(
            (self.weights[entry], (down * across + right).astype(np.int32), bounds), shape=shape
        )


def blur_sizes(
    sensor: Sensor, radius_px: ArrayLike, object_distance_mm: float = np.inf
) -> BlurSize:
    """Return the blur at distances (n,) px from the optical axis; beyond the rim, that of the rim.

    >>> import omnimirror as om
    >>> blur_sizes(om.load_sensor("paper-spherical"), [0.0, 490.0]).sagittal.round(1)
    array([1. , 7.3])
    """
    radius = np.minimum(np.asarray(radius_px, dtype=float), sensor.rim_radius_px * ROUNDED)
    result = evaluate(sensor, h_px=radius, object_distance_mm=object_distance_mm)
    return BlurSize(np.abs(result.blur_t_px), np.abs(result.blur_s_px))


def offsets_from_axis(sensor: Sensor) -> Array:
    """Return offsets (rows, columns, 2) px of the pixels from the optical axis, right and down.

    Raises
    ------
    InvalidParameter
        If the mirror is decentred or tilted, or there are two mirrors.
    """
    sensor.check("image restoration and focus bracketing", "single mirror")
    _ = sensor.meridian  # raises an error for misaligned mirrors
    assert sensor.symmetry is not None
    width, height = sensor.image_size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    offsets: Array = np.stack([columns, rows], axis=-1) - np.asarray(sensor.symmetry.centre_px)
    return offsets


def whole_radius_px(sensor: Sensor) -> float:
    """Return the distance from the optical axis within which the mirror fills the aperture; the rim
    is defocused, too.
    """
    mirror, lens = sensor.mirror, sensor.lens
    z = float(mirror.sag(np.array([mirror.rim_radius_mm]))[0]) + sensor.mirror_pose.displacement_mm
    L = z if lens.TELECENTRIC else sensor.mirror_distance_mm + z
    return sensor.rim_radius_px - 1.0 - float(np.abs(lens.blur(L))) / sensor.imager.pitch_mm / 2


def blur_kernels(
    offsets: Array, whole_radius_px: float, sizes: Callable[[Array], BlurSize], fineness: int = 2
) -> Blur:
    """Return the blur of all pixels that receive all of their light from the mirror.

    Parameters
    ----------
    offsets : (h, w, 2)
        Offsets of the pixels from the axis, px right and down.
    whole_radius_px
        Distance from the axis within which pixels are known.
    sizes
        Blur at distances (n,) px from the axis.
    fineness
        Number of fine pixels along the side of a pixel.
    """
    is_known = np.hypot(offsets[..., 0], offsets[..., 1]) <= whole_radius_px
    block = _block_px(sizes, whole_radius_px)
    firsts = np.arange(0, is_known.shape[1], block)
    lasts = np.minimum(firsts + block, is_known.shape[1]) - 1
    blocks = np.logical_or.reduceat(is_known, firsts, axis=1)
    right, down = ((offsets[:, firsts] + offsets[:, lasts]) / 2)[blocks].T
    ring = (np.minimum(np.hypot(right, down), whole_radius_px) / RING_PX).astype(int)
    turn = np.rint(np.arctan2(down, right) / np.pi * TURNS).astype(int) % TURNS
    of_ring = sizes((np.arange(ring.max(initial=0) + 1) + 0.5) * RING_PX)
    groups, of_block = np.unique(ring * TURNS + turn, return_inverse=True)
    kernels = np.full((len(is_known), whole_groups(is_known.shape[1]) // block), -1)
    kernels[:, : len(firsts)][blocks] = of_block
    rings, turns = np.divmod(groups, TURNS)
    spectra = [
        _kernels(
            of_ring.tangential[r], of_ring.sagittal[r], np.pi / TURNS * turns[rings == r], fineness
        )
        for r in np.unique(rings)
    ]
    counts, reached, weights = (np.concatenate(parts) for parts in zip(*spectra, strict=True))
    size, pixels, bounds = (
        is_known.shape[::-1],
        np.flatnonzero(is_known),
        np.r_[0, np.cumsum(counts)],
    )
    return Blur(
        size,
        fineness,
        _whole(pixels),
        _whole(kernels),
        _whole(bounds),
        _whole(reached),
        weights,
        block,
    )


def _block_px(sizes: Callable[[Array], BlurSize], whole_radius_px: float) -> int:
    """Return the number of adjacent pixels that can share one kernel."""
    radii = np.arange(max(whole_radius_px, 0) + 2)
    steep = max(float(np.quantile(np.abs(np.diff(size)), 0.9)) for size in sizes(radii))
    block = GROUP_PX
    while block > 1 and block * steep > STEEP_PX:
        block //= 2
    return block


def whole_groups(length: int) -> int:
    """Return the number of pixels rounded up to whole groups."""
    return -(-length // GROUP_PX) * GROUP_PX


def _parts(length: int) -> list[int]:
    """Return the starts of tiles of about equal size along a side, and the end of the last one."""
    tiles = -(-length // TILE_PX)
    return [*range(0, length, whole_groups(-(-length // tiles))), length]


def _whole(numbers: NDArray[Any]) -> IndexArray:
    return np.ascontiguousarray(numbers, np.int32)


def _kernels(
    tangential: float, sagittal: float, turns: Array, fineness: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
    """Return the kernels of a disc at angles (n,), convolved with the pixel: number of offsets per
    kernel, offsets (m, 2) down and right on the fine grid, column by column, and weights (m,).
    """
    count = max(32, int(np.ceil(POINTS_PER_PX2 * tangential * sagittal)))
    along, across = (_sunflower(count) * [tangential / 2, sagittal / 2]).T * fineness
    c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
    reach = int(np.ceil(max(tangential, sagittal) / 2 * fineness)) + 1
    x, y = along * c - across * s + reach, along * s + across * c + reach
    side = 2 * reach + 2
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - left, y - top
    index = (np.arange(len(turns))[:, None] * side + top) * side + left
    grid = np.zeros(len(turns) * side * side)
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            grid += np.bincount((index + dy * side + dx).ravel(), (wy * wx).ravel(), len(grid))
    wide = np.zeros((len(turns), side + fineness - 1, side + fineness - 1))
    for dy in range(fineness):
        for dx in range(fineness):
            wide[:, dy : dy + side, dx : dx + side] += grid.reshape(-1, side, side)
    wide[wide <= 1e-4 * wide.max(axis=(1, 2), keepdims=True)] = 0
    wide /= wide.sum(axis=(1, 2), keepdims=True)
    kernel, right, down = np.nonzero(wide.transpose(0, 2, 1))
    counts = np.bincount(kernel, minlength=len(turns))
    return (
        counts,
        np.stack([down, right], axis=-1) - reach,
        wide[kernel, down, right].astype(np.float32),
    )


def _sunflower(count: int) -> Array:
    """Return points (count, 2) distributed uniformly on the unit disc (Vogel's spiral)."""
    i = np.arange(count)
    radius, angle = np.sqrt((i + 0.5) / count), i * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


# -- Radially symmetric blur: from the optics of a sensor, or specified for other cameras ----------

BlurDiameters: TypeAlias = ArrayLike | Callable[[Array], Any]

MAX_BLUR_PX = 30.0
MAX_BLUR_FILE_BYTES = 10 << 20
BLUR_FILE_COLUMNS = ("radius_px", "omega_deg")


@dataclass(frozen=True, eq=False)
class RadialBlur:
    """Blur that is symmetric about the optical axis."""

    offsets: Array
    """Offsets (h, w, 2) px of the pixels from the axis, right and down."""
    whole_radius_px: float
    """Distance from the axis within which pixels receive all of their light from the mirror."""
    sizes: Callable[[Array], BlurSize]
    """Blur at distances (n,) px from the axis."""

    @property
    def radius(self) -> Array:
        """Distances (h, w) from the axis, px."""
        return np.asarray(np.hypot(self.offsets[..., 0], self.offsets[..., 1]))

    @property
    def by_pixel(self) -> BlurSize:
        """Blur of every pixel (h, w)."""
        radius = self.radius
        radii = np.arange(int(radius.max()) + 2, dtype=float)
        return BlurSize(*(np.interp(radius, radii, size) for size in self.sizes(radii)))

    def window(self, rows: slice, columns: slice) -> RadialBlur:
        """Return the blur of an image window."""
        return replace(self, offsets=self.offsets[rows, columns])

    def scaled(self, fraction: float) -> RadialBlur:
        """Return a fraction of the blur."""
        return replace(
            self, sizes=lambda radius: BlurSize(*(fraction * size for size in self.sizes(radius)))
        )


def radial_blur_of(
    camera: Camera,
    object_distance_mm: float = np.inf,
    specified: BlurDiameters | None = None,
    *,
    f_number: float | None = None,
    focus_mm: float | None = None,
) -> RadialBlur:
    """Return the blur of the images of a camera.

    Parameters
    ----------
    camera
        Sensor, whose blur follows from its optics, or any camera with a specified blur.
    object_distance_mm
        Object distance from the mirror of a sensor.
    specified
        Blur diameters in px: one number, a pair (tangential, sagittal), a table (n, 3) of radius,
        tangential and sagittal diameters, or a function of radii (n,) that returns both.
    f_number, focus_mm
        Exposure settings that differ from those of the sensor. They reduce its blur and never
        increase it.

    Raises
    ------
    InvalidParameter
        If the blur is unknown, the table is invalid, or the mirror of a sensor is decentred or
        tilted.
    """
    if isinstance(camera, Sensor):
        offsets = offsets_from_axis(camera)
        if specified is None:
            fraction = 1.0 if f_number is None else min(1.0, camera.lens.stop_number / f_number)

            def sizes(radius: Array) -> BlurSize:
                result = blur_sizes(camera, radius, object_distance_mm)
                if focus_mm is not None:
                    # Focusing changes the image scale: compared at equal fractions of the rim
                    # radius
                    focused = replace(camera, lens=camera.lens.focused_at(focus_mm))
                    scale = focused.rim_radius_px / camera.rim_radius_px
                    other = blur_sizes(focused, scale * radius, object_distance_mm)
                    result = BlurSize(
                        *(np.minimum(*pair) for pair in zip(result, other, strict=True))
                    )
                return BlurSize(*(fraction * size for size in result))

            return RadialBlur(offsets, whole_radius_px(camera), sizes)
        return _specified_blur(offsets, camera.rim_radius_px, specified)
    if specified is None:
        raise InvalidParameter(
            f"blur must be specified for a {type(camera).__name__}; alternatively use a sensor with lens and mirror"
        )
    if not isinstance(camera, RadialModel):
        raise InvalidParameter(
            f"the camera must be a Sensor or a camera model with an optical axis; got a {type(camera).__name__}"
        )
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    offsets = (pixels - np.asarray(camera.centre_px)) @ np.linalg.inv(camera.stretch).T
    return _specified_blur(offsets, camera.field_radius_px, specified)


def _specified_blur(offsets: Array, rim_px: float, specified: BlurDiameters) -> RadialBlur:
    sizes = _sizes_of(specified)
    blur = float(sizes(np.array([rim_px])).larger[0])
    return RadialBlur(offsets, rim_px - 1.0 - blur / 2, sizes)


def _sizes_of(specified: BlurDiameters) -> Callable[[Array], BlurSize]:
    """Return the blur as a function of the radius, after validation."""
    if callable(specified):
        function = specified

        def sizes(radius: Array) -> BlurSize:
            diameters = function(radius)
            if not isinstance(diameters, Sequence | np.ndarray) or len(diameters) != 2:
                raise InvalidParameter(
                    f"the blur function must return two diameters; got {format_value(diameters)}"
                )
            return _checked(
                BlurSize(
                    *(np.broadcast_to(numbers("blur", size), radius.shape) for size in diameters)
                )
            )

        return sizes
    table = numbers("blur", specified, "one number, two numbers or a table (n, 3)")
    if table.ndim < 2 and table.size in (1, 2):
        tangential, sagittal = np.broadcast_to(table.ravel(), 2)
        _checked(BlurSize(tangential, sagittal))
        return lambda radius: BlurSize(
            np.full(radius.shape, tangential), np.full(radius.shape, sagittal)
        )
    if table.ndim != 2 or table.shape[1] != 3:
        raise InvalidParameter(
            f"blur must be one number, two numbers or a table (n, 3); got shape {table.shape}"
        )
    if not (len(table) and np.isfinite(table).all() and (np.diff(table[:, 0]) > 0).all()):
        raise InvalidParameter("the radii of the blur table must be finite and increasing")
    _checked(BlurSize(table[:, 1], table[:, 2]))
    return lambda radius: BlurSize(
        *(np.interp(radius, table[:, 0], column) for column in table.T[1:])
    )


def _checked(sizes: BlurSize) -> BlurSize:
    for size in sizes:
        wrong = ~((size >= 0) & (size <= MAX_BLUR_PX))
        if wrong.any():
            raise InvalidParameter(
                f"blur must be between 0 and {MAX_BLUR_PX:g} px; got {np.asarray(size)[wrong][0]:g} px"
            )
    return sizes


def load_blur(path: str | Path, camera: Camera) -> Array:
    """Read a blur table from a CSV file with the columns ``radius_px`` or ``omega_deg``, ``t_px``
    and ``s_px``.

    Returns
    -------
    (n, 3) array
        Radius, tangential and sagittal diameters in px, sorted by radius.

    Raises
    ------
    SpecError
        If the file cannot be read or lacks columns, or a field angle is outside the field.
    """
    try:
        text = read_bytes(path, MAX_BLUR_FILE_BYTES).decode("utf-8-sig")
    except OSError as e:
        raise SpecError(f"cannot read the blur table {path}: {e.strerror or e}") from None
    except UnicodeDecodeError:
        raise SpecError(f"cannot read the blur table {path}: not a text file") from None
    lines = [
        line
        for line in csv.reader(text.splitlines())
        if line and not line[0].lstrip().startswith("#")
    ]
    names = [name.strip() for name in lines[0]] if lines else []
    where = next((name for name in BLUR_FILE_COLUMNS if name in names), None)
    if where is None or not {"t_px", "s_px"} <= set(names):
        raise SpecError(
            f"{path} must have the columns radius_px or omega_deg, t_px and s_px; got {names}"
        )
    try:
        rows = [
            [float(line[names.index(name)]) for name in (where, "t_px", "s_px")]
            for line in lines[1:]
        ]
    except (ValueError, IndexError):
        raise SpecError(
            f"each line of {path} must contain one number for each of {', '.join(names)}"
        ) from None
    table = np.array(rows).reshape(-1, 3)
    if where == "omega_deg":
        table[:, 0] = _radii_of(table[:, 0], camera, path)
    ordered: Array = table[np.argsort(table[:, 0])]
    return ordered


def _radii_of(omega_deg: Array, camera: Camera, path: str | Path) -> Array:
    symmetry = camera.symmetry
    if symmetry is None:
        raise SpecError(
            f"{path} must specify the blur by radius_px for a camera without axial symmetry; got omega_deg"
        )
    omega = np.radians(omega_deg)
    outside = ~((omega >= symmetry.omega_min - 1e-9) & (omega <= symmetry.omega_max + 1e-9))
    if outside.any():
        low, high = np.degrees([symmetry.omega_min, symmetry.omega_max])
        raise SpecError(
            f"{path}: omega_deg must be within the field, {low:.4g} to {high:.4g} deg; got "
            f"{omega_deg[outside][0]:g} deg"
        )
    return symmetry.radius_px(np.clip(omega, symmetry.omega_min, symmetry.omega_max))
