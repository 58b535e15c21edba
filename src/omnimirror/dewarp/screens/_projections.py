"""Screens of one projection: planes, panoramas and circular views about a pole.

The common parts are interfaces, placement and validation.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import (
    Literal,
    NamedTuple,
    Protocol,
    Self,
    TypeAlias,
    TypeGuard,
    get_args,
    runtime_checkable,
)

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import format_value, number, numbers, positions, validate_arguments
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import pan_tilt_direction, view_axes

# -- Interfaces, placement and validation ----------------------------------------------------------

Offset = tuple[float, float, float]

MAX_SIDE_PX = 100_000
NO_OFFSET: Offset = (0.0, 0.0, 0.0)


@runtime_checkable
class Screen(Protocol):
    """Target of each output pixel: a direction, or a point at a finite distance."""

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) in pixels."""
        ...

    @property
    def is_distant(self) -> bool:
        """True if the targets are directions to infinitely distant points, rather than points in
        mm.
        """
        ...

    def targets_at(self, u: Array, v: Array) -> Array:
        """Return the targets (..., 3) of columns u and rows v in the world frame, also fractional
        or outside.

        NaN marks pixels without a target.
        """
        ...

    def __str__(self) -> str:
        """Return a short description for messages, in degrees or mm."""
        ...


@runtime_checkable
class Composite(Protocol):
    """Several views in one image; the pixels between them have no target."""

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) in pixels."""
        ...

    @property
    def parts(self) -> tuple[ScreenPart, ...]:
        """Views and their positions; overlapping pixels belong to the last view."""
        ...


View: TypeAlias = Screen | Composite


def is_screen(view: View) -> TypeGuard[Screen]:
    """Return True for a single screen, much faster than ``isinstance`` with a protocol."""
    return hasattr(view, "targets_at")


class ScreenPart(NamedTuple):
    """View and its position in a larger image."""

    left: int
    """Column of its first pixel."""
    top: int
    """Row of its first pixel."""
    view: View


class PlacedScreen(NamedTuple):
    """Single screen and its position in the whole image."""

    left: int
    top: int
    screen: Screen


def parts_of(view: View, left: int = 0, top: int = 0) -> tuple[PlacedScreen, ...]:
    """Return the screens of a view at their positions; a single screen is its only part.

    Parameters
    ----------
    view
        Screen of :mod:`omnimirror.screens`, or several screens in one image.
    left, top
        Position of the view itself, px.

    Returns
    -------
    tuple of PlacedScreen
        Each screen with the pixel of its upper left corner in the image.

    Examples
    --------
    >>> from omnimirror.dewarp.screens import CubeMap
    >>> [(part.left, part.top) for part in parts_of(CubeMap((12, 8), layout="3x2"))]
    [(0, 0), (4, 0), (8, 0), (0, 4), (4, 4), (8, 4)]
    """
    if isinstance(view, Composite):
        return tuple(
            s for part in view.parts for s in parts_of(part.view, left + part.left, top + part.top)
        )
    return (PlacedScreen(left, top, view),)


class CentredScreen(ABC):
    """Screen around or in front of a centre, at a finite or infinite distance.

    The centre is the world origin, moved by ``offset_mm``: the projector is not moved.
    """

    size: tuple[int, int]
    distance_mm: float
    offset_mm: Offset

    @abstractmethod
    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return vectors (..., 3) from the centre to the screen at pixels (u, v), in units of the
        distance.
        """

    @property
    def is_distant(self) -> bool:
        """True if the distance is infinite."""
        return math.isinf(self.distance_mm)  # NumPy rejects integers above 2^64

    @validate_arguments
    def targets(self, first_row: int, last_row: int) -> Array:
        """Return points (rows, width, 3) in mm, or directions for an infinite distance."""
        return self.targets_at(*pixels_of_rows(self.size, first_row, last_row))

    def targets_at(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return points (..., 3) in mm, or directions, at columns u and rows v, which may be
        fractional.
        """
        vectors = self.from_centre(u, v)
        if self.is_distant:
            return vectors
        vectors *= self.distance_mm
        vectors += self.offset_mm
        return vectors

    @property
    def _placement(self) -> str:
        """Placement for messages; empty for an infinite distance."""
        if self.is_distant:
            return ""
        return f", at {self.distance_mm:g} mm{offset_text(self.offset_mm)}"

    def _check_placement(self) -> None:
        check_size(self.size)
        if numbers("distance_mm", self.distance_mm, "a number").ndim or not self.distance_mm > 0:
            raise InvalidParameter(
                f"distance_mm must be above 0 mm or infinite; got {format_value(self.distance_mm)}"
            )
        check_offset(self.offset_mm)
        if self.is_distant and any(self.offset_mm):
            raise InvalidParameter(
                "offset_mm must be (0, 0, 0) for a screen at infinity; got "
                f"{self.offset_mm}; specify a finite distance_mm"
            )


def pixels_of_rows(size: tuple[int, int], first_row: int, last_row: int) -> tuple[Array, Array]:
    """Return columns (width,) and rows (rows, 1) of the pixels in some rows, for broadcasting."""
    return np.arange(size[0], dtype=float), np.arange(first_row, last_row, dtype=float)[:, None]


def on_plane(origin: Array, x: Array, right: Array, y: Array, down: Array) -> Array:
    """Return points (..., 3) at broadcast coordinates x and y along two vectors from an origin,
    each (3,).
    """
    points = np.empty((*np.broadcast_shapes(np.shape(x), np.shape(y)), 3))
    for axis in range(3):  # several times faster than operations on rows of 3
        np.add(origin[axis] + x * right[axis], y * down[axis], out=points[..., axis])
    return points


def offset_text(offset_mm: Offset) -> str:
    """Return ``, moved by (x, y, z) mm``, or an empty string."""
    return ", offset by ({:g}, {:g}, {:g}) mm".format(*offset_mm) if any(offset_mm) else ""


def check_size(size: tuple[int, int]) -> None:
    """Raise an error unless the size is a width and height in whole pixels."""
    if numbers("size", size, "two numbers (width, height)").shape != (2,) or not all(
        1 <= n <= MAX_SIDE_PX and int(n) == n for n in size
    ):
        raise InvalidParameter(
            f"size must be (width, height) from 1 to {MAX_SIDE_PX} px; got {format_value(size)}"
        )


def check_offset(offset_mm: Offset) -> None:
    """Raise an error unless the offset is a point in the world."""
    offset = numbers("offset_mm", offset_mm, "three numbers (x, y, z)")
    if offset.shape != (3,) or not np.isfinite(offset).all():
        raise InvalidParameter(
            f"offset_mm must be finite numbers (x, y, z); got {format_value(offset_mm)}"
        )


def check_angle(name: str, angle_deg: float) -> None:
    """Raise an error for non-finite angles."""
    number(name, angle_deg, unit="deg")


MIN_ANGLE_DEG = 1e-9


def check_range(name: str, value: float, low: float, high: float, upper_included: bool) -> None:
    """Raise an error unless an angle (deg) is above ``low`` and below ``high``."""
    value = number(name, value)
    if not (low + MIN_ANGLE_DEG < value < high or (upper_included and value == high)):
        bound = f"up to {high:g}" if upper_included else f"below {high:g}"
        raise InvalidParameter(f"{name} must be above {low:g} and {bound} deg; got {value:g}")


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise an error for an unknown choice."""
    if not isinstance(value, str) or value not in choices:
        raise InvalidParameter(
            f"{name} must be one of {', '.join(choices)}; got {format_value(value)}"
        )


def check_zoom(factor: float) -> None:
    """Raise an error unless the zoom is a positive finite factor."""
    number("zoom", factor, above=0.0)


def check_no_tilt(screen: object, tilt_deg: float) -> None:
    """Raise an error for tilting a screen without an up direction."""
    if tilt_deg:
        raise InvalidParameter(
            f"tilt_deg must be 0 for the {screen}, which can only be panned; got {tilt_deg:g} deg"
        )


# -- Plane screens ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plane(CentredScreen):
    """Perspective view: the image of an ideal camera without distortion.

    Parameters
    ----------
    size : (width, height)
    pan_deg, tilt_deg : deg
        Direction of the image centre, right of forward and above the horizon.
    roll_deg : deg
        Clockwise rotation of the view about its centre.
    hfov_deg : deg
        Angle from the left edge to the right edge, between 0 and 180.
    distance_mm : mm
        Distance of the plane from its viewpoint, along the viewing direction.
    offset_mm : (x, y, z) mm
        Position of the viewpoint relative to the mirror vertex, in the world frame; for a finite
        plane only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a view.

    Examples
    --------
    >>> view = Plane((3, 3), hfov_deg=90.0)
    >>> view.targets(1, 2)[0, 1] + 0.0  # the centre looks forward
    array([1., 0., 0.])

    A wall at 2 m, with 3 m across 300 pixels:

    >>> wall = Plane((300, 200), hfov_deg=np.degrees(2 * np.arctan(1.5 / 2)), distance_mm=2000.0)
    >>> wall.targets(0, 1)[0, 0]
    array([2000., 1495.,  995.])
    """

    size: tuple[int, int]
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 90.0
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        self._check_placement()
        for name in ("pan_deg", "tilt_deg", "roll_deg"):
            check_angle(name, getattr(self, name))
        check_range("hfov_deg", self.hfov_deg, 0, 180, upper_included=False)

    @property
    def focal_px(self) -> float:
        """Distance of the plane from the viewpoint in pixels."""
        return float(self.size[0] / 2 / np.tan(np.radians(self.hfov_deg / 2)))

    @cached_property
    def _axes(self) -> tuple[Array, Array, Array]:
        return view_axes(self.pan_deg, self.tilt_deg, self.roll_deg)

    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return vectors (..., 3), of length 1 at the centre."""
        width, height = self.size
        forward, right, down = self._axes
        x = (positions("u", u) - (width - 1) / 2) / self.focal_px
        y = (positions("v", v) - (height - 1) / 2) / self.focal_px
        return on_plane(forward, x, right, y, down)

    def zoomed(self, factor: float) -> Self:
        """Return the view with its focal length multiplied by a factor."""
        check_zoom(factor)
        return replace(
            self,
            hfov_deg=float(
                2 * np.degrees(np.arctan(np.tan(np.radians(self.hfov_deg / 2)) / factor))
            ),
        )

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the view rotated to the right and up."""
        return replace(self, pan_deg=self.pan_deg + pan_deg, tilt_deg=self.tilt_deg + tilt_deg)

    def __str__(self) -> str:
        roll = f", roll {self.roll_deg:g}" if self.roll_deg else ""
        text = f"pan {self.pan_deg:g}, tilt {self.tilt_deg:g}{roll}, hfov {self.hfov_deg:.6g} deg"
        return f"perspective view ({text}{self._placement})"


@dataclass(frozen=True)
class Ground:
    """Horizontal plane drawn to scale from above: a floor plan.

    A plane over the mirror, such as a ceiling, is also drawn from above, as if through the roof,
    aligned with the plan of the floor.

    Parameters
    ----------
    size : (width, height)
    height_mm : mm
        Height of the mirror vertex over the plane; negative for a plane over the mirror.
    mm_per_px : mm
        Scale of the plan.
    pan_deg : deg
        Direction at the top, right of forward.
    offset_mm : (x, y, z) mm
        Offset of the centre of the plan from the point below the mirror, in the world frame.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a plane.

    Examples
    --------
    >>> Ground((3, 3), height_mm=1200.0, mm_per_px=100.0).targets(0, 1)[0] + 0.0  # forward, from left to right
    array([[  100.,   100., -1200.],
           [  100.,     0., -1200.],
           [  100.,  -100., -1200.]])
    """

    size: tuple[int, int]
    height_mm: float
    mm_per_px: float
    pan_deg: float = 0.0
    offset_mm: Offset = NO_OFFSET
    is_distant = False

    def __post_init__(self) -> None:
        check_size(self.size)
        check_offset(self.offset_mm)
        check_angle("pan_deg", self.pan_deg)
        if not np.isfinite(self.height_mm):
            raise InvalidParameter(f"height_mm must be finite; got {self.height_mm:g}")
        if not (np.isfinite(self.mm_per_px) and self.mm_per_px > 0):
            raise InvalidParameter(f"mm_per_px must be finite and above 0; got {self.mm_per_px:g}")

    @validate_arguments
    def targets(self, first_row: int, last_row: int) -> Array:
        """Return points (rows, width, 3) in mm."""
        return self.targets_at(*pixels_of_rows(self.size, first_row, last_row))

    def targets_at(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return points (..., 3) in mm at columns u and rows v, which may be fractional."""
        width, height = self.size
        _, right, down = view_axes(self.pan_deg, -90.0)
        x = (positions("u", u) - (width - 1) / 2) * self.mm_per_px
        y = (positions("v", v) - (height - 1) / 2) * self.mm_per_px
        centre = np.add(self.offset_mm, (0.0, 0.0, -self.height_mm))
        return on_plane(centre, x, right, y, down)

    def zoomed(self, factor: float) -> Self:
        """Return the plan with its scale divided by a factor."""
        check_zoom(factor)
        return replace(self, mm_per_px=self.mm_per_px / factor)

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the screen rotated with a direction farther to the right at the top."""
        check_no_tilt(self, tilt_deg)
        return replace(self, pan_deg=self.pan_deg + pan_deg)

    def __str__(self) -> str:
        turned = f", pan {self.pan_deg:g} deg" if self.pan_deg else ""
        side = "below" if self.height_mm >= 0 else "above"
        return (
            f"plan of the ground ({abs(self.height_mm):g} mm {side} the mirror, "
            f"{self.mm_per_px:.4g} mm per pixel{turned}{offset_text(self.offset_mm)})"
        )


# -- Panoramas -------------------------------------------------------------------------------------

Rows = Literal["tilt", "height"]
MIN_SPAN_DEG = 1e-6


class Panorama(CentredScreen):
    """Screen of revolution about a vertical axis: each column has one pan and each row one tilt,
    from the centre.
    """

    tilt_min_deg: float
    tilt_max_deg: float
    pan_deg: float
    span_deg: float

    def pans(self) -> Array:
        """Return the pan of every column (width,), radians."""
        return self.pans_at(np.arange(self.size[0], dtype=float))

    def tilts(self) -> Array:
        """Return the tilt of every row (height,), radians."""
        return self.tilts_at(np.arange(self.size[1], dtype=float))

    def pans_at(self, u: ArrayLike) -> Array:
        """Return the pan of columns (...), radians."""
        return np.radians(
            self.pan_deg + ((positions("u", u) + 0.5) / self.size[0] - 0.5) * self.span_deg
        )

    @abstractmethod
    def tilts_at(self, v: ArrayLike) -> Array:
        """Return the tilt of rows (...), radians."""

    def _linear(self, v: ArrayLike, lowest: float, highest: float) -> Array:
        """Return values at rows (...) that decrease linearly from the upper to the lower image
        edge.
        """
        return highest - (positions("v", v) + 0.5) / self.size[1] * (highest - lowest)

    def _description(self, name: str) -> str:
        around = (
            "" if self.span_deg == 360 else f"{self.span_deg:g} deg around pan {self.pan_deg:g}, "
        )
        elevations = f"elevation {self.tilt_min_deg:.6g} to {self.tilt_max_deg:.6g} deg"
        return f"{name} ({around}{elevations}{self._placement})"

    def _check(self) -> None:
        self._check_placement()
        for name in ("tilt_min_deg", "tilt_max_deg"):
            number(name, getattr(self, name), unit="deg")
        if not -90 <= self.tilt_min_deg < self.tilt_max_deg <= 90:
            raise InvalidParameter(
                "tilt_min_deg and tilt_max_deg must increase within -90 to 90 deg; got "
                f"{self.tilt_min_deg:g} and {self.tilt_max_deg:g} deg"
            )
        if self.tilt_max_deg - self.tilt_min_deg < MIN_SPAN_DEG:
            raise InvalidParameter(
                f"tilt_max_deg must be at least {MIN_SPAN_DEG:g} deg above tilt_min_deg; "
                f"got {self.tilt_min_deg:g} and {self.tilt_max_deg:g} deg"
            )
        check_range("span_deg", self.span_deg, MIN_SPAN_DEG, 360, upper_included=True)
        check_angle("pan_deg", self.pan_deg)


@dataclass(frozen=True)
class Cylinder(Panorama):
    """Panorama on an upright cylinder: columns linear in pan, rows linear in tilt or in height on
    the wall.

    Parameters
    ----------
    size : (width, height)
    tilt_min_deg, tilt_max_deg : deg
        Elevation of the lower and upper edge from the centre of the cylinder, -90 to 90.
    pan_deg : deg
        Direction of the image centre, right of forward.
    span_deg : deg
        Angle from the left edge to the right edge, up to 360.
    rows
        ``"tilt"``, or ``"height"``: the unrolled cylindrical screen of the paper. It preserves
        upright planes and cannot reach the zenith or the nadir.
    distance_mm : mm
        Radius of the cylinder.
    offset_mm : (x, y, z) mm
        Position of its centre relative to the mirror vertex, in the world frame; for a finite
        cylinder only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a cylinder.

    Examples
    --------
    >>> Cylinder((4, 2), -90.0, 90.0).targets(0, 1)[0, 1].round(3)  # 45 deg left, 45 deg up
    array([0.5  , 0.5  , 0.707])

    The wall of a room 4 m wide, from 1.2 m below the mirror to 1.8 m above:

    >>> wall = Cylinder.wall((400, 300), (-1200.0, 1800.0), distance_mm=2000.0)
    >>> wall.targets(0, 300)[[0, 299], 199].round(0)
    array([[ 2000.,    16.,  1795.],
           [ 2000.,    16., -1195.]])
    """

    size: tuple[int, int]
    tilt_min_deg: float
    tilt_max_deg: float
    pan_deg: float = 0.0
    span_deg: float = 360.0
    rows: Rows = "tilt"
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        self._check()
        check_choice("rows", self.rows, get_args(Rows))
        if self.rows == "height" and 90 in (-self.tilt_min_deg, self.tilt_max_deg):
            raise InvalidParameter(
                "tilt_min_deg and tilt_max_deg must be above -90 and below 90 deg with "
                f"rows = 'height'; got {self.tilt_min_deg:g} and {self.tilt_max_deg:g} deg"
            )

    @classmethod
    @validate_arguments
    def wall(
        cls,
        size: tuple[int, int],
        height_mm: tuple[float, float],
        distance_mm: float,
        pan_deg: float = 0.0,
        span_deg: float = 360.0,
        offset_mm: Offset = NO_OFFSET,
    ) -> Self:
        """Return the section of a cylinder wall between two heights (mm) over its centre, in
        ascending order.
        """
        low, high = height_mm
        number("distance_mm", distance_mm, above=0.0)
        if not low < high:
            raise InvalidParameter(
                f"height_mm must be the lower and the upper edge of the wall; got {low:g} and {high:g} mm"
            )
        low, high = (float(np.degrees(np.arctan2(z, distance_mm))) for z in (low, high))
        return cls(size, low, high, pan_deg, span_deg, "height", distance_mm, offset_mm)

    def tilts_at(self, v: ArrayLike) -> Array:
        """Return the tilt of rows (...), radians."""
        if self.rows == "height":
            # Height on the wall at unit distance: tan(tilt)
            lowest, highest = np.tan(np.radians([self.tilt_min_deg, self.tilt_max_deg]))
            return np.arctan(self._linear(v, lowest, highest))
        return np.radians(self._linear(v, self.tilt_min_deg, self.tilt_max_deg))

    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return vectors (..., 3) to the wall; unit vectors for an infinite distance."""
        tilts = self.tilts_at(v)
        directions = pan_tilt_direction(self.pans_at(u), tilts)
        return directions if self.is_distant else directions / np.cos(tilts)[..., None]

    def zoomed(self, factor: float) -> Self:
        """Return the screen with a smaller or larger extent about the same centre."""
        check_zoom(factor)
        low, high = self._rows_changed(1 / factor, 0.0)
        return replace(
            self, tilt_min_deg=low, tilt_max_deg=high, span_deg=min(360.0, self.span_deg / factor)
        )

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the screen rotated to the right with its rows moved up by an angle, or by the
        height at this angle.
        """
        low, high = self._rows_changed(1.0, tilt_deg)
        return replace(self, tilt_min_deg=low, tilt_max_deg=high, pan_deg=self.pan_deg + pan_deg)

    def _rows_changed(self, stretch: float, tilt_deg: float) -> tuple[float, float]:
        """Return elevations (deg) of the edges for rows scaled about their middle and moved up."""
        if self.rows == "tilt":
            return _stretched(self.tilt_min_deg, self.tilt_max_deg, stretch, tilt_deg)
        check_range("tilt_deg", tilt_deg, -90, 90, upper_included=False)
        low, high, shift = (
            float(np.tan(np.radians(a))) for a in (self.tilt_min_deg, self.tilt_max_deg, tilt_deg)
        )
        low, high = _stretched(low, high, stretch, shift, limit=np.inf)
        return float(np.degrees(np.arctan(low))), float(np.degrees(np.arctan(high)))

    def __str__(self) -> str:
        return self._description("panorama")


@dataclass(frozen=True)
class Equirectangular(Panorama):
    """Equirectangular image of a sphere: columns linear in pan, rows linear in tilt.

    Parameters
    ----------
    size : (width, height)
    tilt_min_deg, tilt_max_deg : deg
        Elevation of the lower and upper edge from the centre of the sphere, -90 to 90.
    pan_deg : deg
        Direction of the image centre, right of forward.
    span_deg : deg
        Angle from the left edge to the right edge, up to 360.
    distance_mm : mm
        Radius of the sphere.
    offset_mm : (x, y, z) mm
        Position of its centre relative to the mirror vertex, in the world frame; for a finite
        sphere only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a sphere.

    Examples
    --------
    >>> Equirectangular((4, 2), distance_mm=1000.0).targets(0, 1)[0, 1].round(1)  # 45 deg left, 45 deg up
    array([500. , 500. , 707.1])
    """

    size: tuple[int, int]
    tilt_min_deg: float = -90.0
    tilt_max_deg: float = 90.0
    pan_deg: float = 0.0
    span_deg: float = 360.0
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        self._check()

    def tilts_at(self, v: ArrayLike) -> Array:
        """Return the tilt of rows (...), radians."""
        return np.radians(self._linear(v, self.tilt_min_deg, self.tilt_max_deg))

    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return unit vectors (..., 3)."""
        return pan_tilt_direction(self.pans_at(u), self.tilts_at(v))

    def zoomed(self, factor: float) -> Self:
        """Return the screen with a smaller or larger extent about the same centre."""
        check_zoom(factor)
        low, high = _stretched(self.tilt_min_deg, self.tilt_max_deg, 1 / factor)
        return replace(
            self, tilt_min_deg=low, tilt_max_deg=high, span_deg=min(360.0, self.span_deg / factor)
        )

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the screen rotated to the right with its rows moved up."""
        low, high = _stretched(self.tilt_min_deg, self.tilt_max_deg, 1.0, tilt_deg)
        return replace(self, tilt_min_deg=low, tilt_max_deg=high, pan_deg=self.pan_deg + pan_deg)

    def __str__(self) -> str:
        return self._description("sphere")


def _stretched(
    low: float, high: float, stretch: float, shift: float = 0.0, limit: float = 90.0
) -> tuple[float, float]:
    """Return a range scaled about its middle, clipped to the limits, and shifted."""
    middle, half = (low + high) / 2, (high - low) / 2 * stretch
    return max(middle - half, -limit) + shift, min(middle + half, limit) + shift


# -- Circular screens about a pole -----------------------------------------------------------------

Pole = Literal["nadir", "zenith"]


class PolarScreen(CentredScreen):
    """Screen with polar coordinates about a pole, drawn as seen by a viewer facing the pole.

    Facing the nadir, forward is at the top and right is on the right; facing the zenith, forward is
    at the top and right is on the left, as on a star chart.
    """

    pole: Pole
    pan_deg: float

    def _from_middle(self, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array, Array]:
        """Return pixel offsets from the image centre, right and down, and their length."""
        width, height = self.size
        x, y = positions("u", u) - (width - 1) / 2, positions("v", v) - (height - 1) / 2
        radius: Array = np.hypot(x, y)
        return x, y, radius

    def _vectors(self, x: Array, y: Array, omega: Array, sideways: Array) -> Array:
        """Return unit vectors (..., 3) at angles omega from the pole; ``sideways`` is sin(omega) /
        radius.
        """
        if self.pole == "nadir":
            to_pole, right, down = view_axes(self.pan_deg, -90.0)
        else:  # tilting up from the opposite side moves forward to the top
            to_pole, right, down = view_axes(self.pan_deg + 180.0, 90.0)
        vectors = on_plane(np.zeros(3), sideways * x, right, sideways * y, down)
        ahead = np.cos(omega)
        for axis in range(3):
            vectors[..., axis] += ahead * to_pole[axis]
        return vectors

    def _check(self) -> None:
        self._check_placement()
        check_choice("pole", self.pole, get_args(Pole))
        check_angle("pan_deg", self.pan_deg)


@dataclass(frozen=True)
class DomeMaster(PolarScreen):
    """Compensated circle of the paper: the distance from the centre is proportional to the angle.

    Drawn as seen by a viewer: facing the nadir, forward is at the top and right is on the right;
    facing the zenith, forward is at the top and right is on the left, as on a star chart.

    Parameters
    ----------
    size : (width, height)
        Image size; the circle touches the shorter side.
    omega_max_deg : deg
        Angle from the pole at the edge of the circle, up to 180.
    pole
        ``"nadir"`` or ``"zenith"``, at the centre.
    pan_deg : deg
        Direction at the top, right of forward.
    omega_min_deg : deg
        Angle from the pole inside which the circle is empty.
    distance_mm : mm
        Radius of the sphere.
    offset_mm : (x, y, z) mm
        Position of its centre relative to the mirror vertex, in the world frame; for a finite
        sphere only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define a dome.

    Examples
    --------
    >>> dome = DomeMaster((3, 3), omega_max_deg=135.0)
    >>> dome.targets(0, 1)[0, 1].round(12) + 0.0  # the top is forward, one pixel of 1.5 from the nadir
    array([1., 0., 0.])
    """

    size: tuple[int, int]
    omega_max_deg: float
    pole: Pole = "nadir"
    pan_deg: float = 0.0
    omega_min_deg: float = 0.0
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        self._check()
        if not 0 <= self.omega_min_deg < self.omega_max_deg <= 180:
            raise InvalidParameter(
                "omega_min_deg and omega_max_deg must increase within 0 to 180 deg; got "
                f"{self.omega_min_deg:g} and {self.omega_max_deg:g} deg"
            )

    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return unit vectors (..., 3); NaN outside the circle."""
        x, y, radius = self._from_middle(u, v)
        edge = min(self.size) / 2
        # Equidistant projection: radius proportional to omega; sin(omega) / radius is regular at the pole
        per_pixel = np.radians(self.omega_max_deg) / edge
        omega = radius * per_pixel
        vectors = self._vectors(x, y, omega, np.sinc(omega / np.pi) * per_pixel)
        inside = (radius <= edge) & (omega >= np.radians(self.omega_min_deg))
        vectors[~inside] = np.nan
        return vectors

    def zoomed(self, factor: float) -> Self:
        """Return the dome with its maximum angle divided by a factor."""
        check_zoom(factor)
        return replace(self, omega_max_deg=min(180.0, self.omega_max_deg / factor))

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the screen rotated with a direction farther to the right at the top."""
        check_no_tilt(self, tilt_deg)
        return replace(self, pan_deg=self.pan_deg + pan_deg)

    def __str__(self) -> str:
        return f"dome ({self.omega_min_deg:g} to {self.omega_max_deg:.6g} deg from the {self.pole}{self._placement})"


@dataclass(frozen=True)
class LittlePlanet(PolarScreen):
    """Stereographic image about a pole: small circles remain circles, including the horizon.

    Drawn like a dome and extended to the corners: about the nadir, the ground becomes a planet with
    objects on it; about the zenith, it becomes a tunnel around the sky.

    Parameters
    ----------
    size : (width, height)
    hfov_deg : deg
        Angle from the left edge to the right edge through the pole, between 0 and 360.
    pole
        ``"nadir"`` or ``"zenith"``, at the centre.
    pan_deg : deg
        Direction at the top, right of forward.
    distance_mm : mm
        Radius of the sphere.
    offset_mm : (x, y, z) mm
        Position of its centre relative to the mirror vertex, in the world frame; for a finite
        sphere only.

    Raises
    ------
    InvalidParameter
        If the parameters do not define such an image.

    Examples
    --------
    >>> planet = LittlePlanet((4, 4), hfov_deg=180.0)  # the horizon touches the sides
    >>> planet.targets(0, 4)[0, 0].round(3)  # beyond it, forward and left
    array([0.706, 0.706, 0.059])
    """

    size: tuple[int, int]
    hfov_deg: float = 240.0
    pole: Pole = "nadir"
    pan_deg: float = 0.0
    distance_mm: float = np.inf
    offset_mm: Offset = NO_OFFSET

    def __post_init__(self) -> None:
        self._check()
        check_range("hfov_deg", self.hfov_deg, 0, 360, upper_included=False)

    def from_centre(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Return unit vectors (..., 3)."""
        x, y, radius = self._from_middle(u, v)
        per_pixel = np.tan(np.radians(self.hfov_deg / 4)) / (self.size[0] / 2)
        # Stereographic projection: radius proportional to tan(omega / 2), and with t = tan(omega / 2)
        # sin(omega) = 2 t / (1 + t^2), cos(omega) = (1 - t^2) / (1 + t^2)
        half_tangent = radius * per_pixel  # tan(omega / 2)
        return self._vectors(
            x, y, 2 * np.arctan(half_tangent), 2 * per_pixel / (1 + half_tangent**2)
        )

    def zoomed(self, factor: float) -> Self:
        """Return the screen magnified by a factor."""
        check_zoom(factor)
        return replace(
            self,
            hfov_deg=float(
                4 * np.degrees(np.arctan(np.tan(np.radians(self.hfov_deg / 4)) / factor))
            ),
        )

    @validate_arguments
    def panned(self, pan_deg: float, tilt_deg: float = 0.0) -> Self:
        """Return the screen rotated with a direction farther to the right at the top."""
        check_no_tilt(self, tilt_deg)
        return replace(self, pan_deg=self.pan_deg + pan_deg)

    def __str__(self) -> str:
        return (
            f"little planet (hfov {self.hfov_deg:.6g} deg about the {self.pole}{self._placement})"
        )
