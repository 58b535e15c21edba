"""Circular screens about a pole: the compensated circle of the paper, and the little planet."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import positions, validate_arguments
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import view_axes
from ._screen import (
    NO_OFFSET,
    CentredScreen,
    Offset,
    check_angle,
    check_choice,
    check_no_tilt,
    check_range,
    check_zoom,
    on_plane,
)

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
