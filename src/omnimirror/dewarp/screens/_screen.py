"""Common parts of all screens: interfaces, placement and validation."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import format_value, number, numbers, validate_arguments
from ...base.errors import InvalidParameter
from ...base.typing import Array

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
