"""Panoramas: the cylinder, and the sphere as an equirectangular image."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import number, positions, validate_arguments
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import pan_tilt_direction
from ._screen import (
    NO_OFFSET,
    CentredScreen,
    Offset,
    check_angle,
    check_choice,
    check_range,
    check_zoom,
)

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
