"""Screens: what every pixel of a straightened picture looks at.

Screens are drawn as seen from inside or from above, in the world frame of :mod:`omnimirror.frames`;
none of them knows which way round the raw picture is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..frames import pan_tilt_direction, view_axes

Array = NDArray[np.float64]
Pole = Literal["nadir", "zenith"]

LARGEST_PX = 100_000


@runtime_checkable
class Screen(Protocol):
    """What every output pixel looks at: a direction, or a point at a finite distance."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        ...

    @property
    def is_distant(self) -> bool:
        """Whether the targets are directions to infinitely distant points, rather than points in mm."""
        ...

    def targets(self, first_row: int, last_row: int) -> Array:
        """What rows from ``first_row`` up to but without ``last_row`` look at, (rows, width, 3), world frame.

        NaN where a pixel of the screen looks at nothing.
        """
        ...

    def __str__(self) -> str:
        """A few words for messages: what it shows, in degrees."""
        ...


@dataclass(frozen=True)
class Cylinder:
    """A panorama: columns linear in pan, rows linear in tilt.

    Parameters
    ----------
    size : (width, height)
    tilt_min_deg, tilt_max_deg : deg
        Elevation of the lower and upper edge, -90 to 90.
    pan_deg : deg
        What the centre looks at, right of forward.
    span_deg : deg
        From the left edge to the right edge, up to 360.

    Examples
    --------
    >>> panorama = Cylinder((360, 90), tilt_min_deg=-45.0, tilt_max_deg=45.0)
    >>> panorama.targets(44, 45)[0, 180].round(4)  # half a degree right of the centre and above it
    array([ 0.9999, -0.0087,  0.0087])
    """

    size: tuple[int, int]
    tilt_min_deg: float
    tilt_max_deg: float
    pan_deg: float = 0.0
    span_deg: float = 360.0
    is_distant = True

    def __post_init__(self) -> None:
        _check_size(self.size)
        if not -90 <= self.tilt_min_deg < self.tilt_max_deg <= 90:
            raise InvalidParameter(
                f"elevations from {self.tilt_min_deg:g} to {self.tilt_max_deg:g} deg make no panorama; they are "
                "valid from -90 to 90, the smaller one first"
            )
        _check_range("span_deg", self.span_deg, 0, 360, upper_included=True)
        _check_angle("pan_deg", self.pan_deg)

    def pans(self) -> Array:
        """Pan of every column (width,), radians."""
        width = self.size[0]
        return np.radians(self.pan_deg + ((np.arange(width) + 0.5) / width - 0.5) * self.span_deg)

    def tilts(self) -> Array:
        """Tilt of every row (height,), radians."""
        height = self.size[1]
        span = self.tilt_max_deg - self.tilt_min_deg
        return np.radians(self.tilt_max_deg - (np.arange(height) + 0.5) / height * span)

    def targets(self, first_row: int, last_row: int) -> Array:
        """Directions (rows, width, 3)."""
        return pan_tilt_direction(self.pans(), self.tilts()[first_row:last_row, None])

    def __str__(self) -> str:
        around = "" if self.span_deg == 360 else f"{self.span_deg:g} deg around pan {self.pan_deg:g}, "
        return f"panorama ({around}elevation {self.tilt_min_deg:.6g} to {self.tilt_max_deg:.6g} deg)"


@dataclass(frozen=True)
class Plane:
    """A perspective view: what a camera without distortion would see.

    Parameters
    ----------
    size : (width, height)
    pan_deg, tilt_deg : deg
        What the centre looks at, right of forward and above the horizon.
    roll_deg : deg
        How far the view is turned clockwise about its centre.
    hfov_deg : deg
        Angle from the left edge to the right edge, between 0 and 180.

    Examples
    --------
    >>> view = Plane((3, 3), hfov_deg=90.0)
    >>> view.targets(1, 2)[0, 1] + 0.0  # the centre looks forward
    array([1., 0., 0.])
    """

    size: tuple[int, int]
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 90.0
    is_distant = True

    def __post_init__(self) -> None:
        _check_size(self.size)
        for name in ("pan_deg", "tilt_deg", "roll_deg"):
            _check_angle(name, getattr(self, name))
        _check_range("hfov_deg", self.hfov_deg, 0, 180, upper_included=False)

    @property
    def focal_px(self) -> float:
        """Distance of the plane from the eye, in its pixels."""
        return float(self.size[0] / 2 / np.tan(np.radians(self.hfov_deg / 2)))

    def targets(self, first_row: int, last_row: int) -> Array:
        """Directions (rows, width, 3), of length 1 at the centre."""
        width, height = self.size
        forward, right, down = view_axes(self.pan_deg, self.tilt_deg, self.roll_deg)
        x = (np.arange(width) - (width - 1) / 2) / self.focal_px
        y = (np.arange(first_row, last_row) - (height - 1) / 2) / self.focal_px
        return forward + x[None, :, None] * right + y[:, None, None] * down

    def __str__(self) -> str:
        roll = f", roll {self.roll_deg:g}" if self.roll_deg else ""
        return f"perspective view (pan {self.pan_deg:g}, tilt {self.tilt_deg:g}{roll}, hfov {self.hfov_deg:.6g} deg)"


@dataclass(frozen=True)
class Dome:
    """The paper's compensated circle: the distance from the centre grows in proportion to the angle.

    Drawn as it would be seen: looking down at the nadir, forward is at the top and right is right;
    looking up at the zenith, forward is at the top and right is left, as on a star chart.

    Parameters
    ----------
    size : (width, height)
        The circle touches the shorter side.
    omega_max_deg : deg
        Angle from the pole at the edge of the circle, up to 180.
    pole
        ``"nadir"`` or ``"zenith"``, at the centre.
    pan_deg : deg
        What is at the top, right of forward.
    omega_min_deg : deg
        Angle from the pole inside which the circle stays empty.

    Examples
    --------
    >>> dome = Dome((3, 3), omega_max_deg=135.0)
    >>> dome.targets(0, 1)[0, 1].round(12) + 0.0  # the top is forward, one pixel of 1.5 from the nadir
    array([1., 0., 0.])
    """

    size: tuple[int, int]
    omega_max_deg: float
    pole: Pole = "nadir"
    pan_deg: float = 0.0
    omega_min_deg: float = 0.0
    is_distant = True

    def __post_init__(self) -> None:
        _check_size(self.size)
        if not 0 <= self.omega_min_deg < self.omega_max_deg <= 180:
            raise InvalidParameter(
                f"angles from {self.omega_min_deg:g} to {self.omega_max_deg:g} deg make no dome; they are valid "
                "from 0 to 180, the smaller one first"
            )
        if self.pole not in get_args(Pole):
            raise InvalidParameter(f"pole = {self.pole!r} is not one of {', '.join(get_args(Pole))}")
        _check_angle("pan_deg", self.pan_deg)

    def targets(self, first_row: int, last_row: int) -> Array:
        """Directions (rows, width, 3); NaN outside the circle."""
        width, height = self.size
        if self.pole == "nadir":
            to_pole, right, down = view_axes(self.pan_deg, -90.0)
        else:  # tilting up from the opposite side brings forward to the top
            to_pole, right, down = view_axes(self.pan_deg + 180.0, 90.0)
        x = np.arange(width) - (width - 1) / 2
        y = np.arange(first_row, last_row)[:, None] - (height - 1) / 2
        radius = np.hypot(x, y)
        omega = radius * np.radians(self.omega_max_deg) / (min(self.size) / 2)
        inside = (radius <= min(self.size) / 2) & (omega >= np.radians(self.omega_min_deg))
        # sin(omega) / radius, with its limit at the centre
        sideways = np.sinc(omega / np.pi) * np.radians(self.omega_max_deg) / (min(self.size) / 2)
        directions: Array = np.cos(omega)[..., None] * to_pole
        directions += (sideways * x)[..., None] * right + (sideways * y)[..., None] * down
        directions[~inside] = np.nan
        return directions

    def __str__(self) -> str:
        return f"dome ({self.omega_min_deg:g} to {self.omega_max_deg:.6g} deg from the {self.pole})"


def _check_size(size: tuple[int, int]) -> None:
    if len(size) != 2 or not all(1 <= n <= LARGEST_PX and int(n) == n for n in size):
        raise InvalidParameter(f"size = {size} is not a width and a height from 1 to {LARGEST_PX} px")


def _check_angle(name: str, angle_deg: float) -> None:
    if not np.isfinite(angle_deg):
        raise InvalidParameter(f"{name} = {angle_deg} is not an angle in degrees")


def _check_range(name: str, value: float, low: float, high: float, upper_included: bool) -> None:
    if not (low < value < high or (upper_included and value == high)):
        bound = f"up to {high:g}" if upper_included else f"below {high:g}"
        raise InvalidParameter(f"{name} = {value:g} is valid above {low:g} and {bound} deg")
