"""Conical mirror: a straight meridian with an apex on the axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates, number
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import RIM_RADIUS, Mirror


@dataclass(frozen=True)
class Cone(Mirror):
    """Cone ``z = x tan(beta)``: R_t is infinite and R_s = x / sin(beta).

    Its field extends from ``Omega = 2 beta`` to ``2 beta + theta`` of the rim: a narrow band around
    the horizon for beta near 45 deg. It has no single viewpoint (:meth:`pinhole_ring`) unless m ->
    0.

    >>> round(float(Cone(slope_deg=45.0, rim_radius_mm=20.0).sag(10.0)), 12)
    10.0
    """

    slope_deg: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "cone"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "slope_deg": Parameter("deg", 0.1, 89.9, "angle of the surface from the plane across the axis (beta)"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x, slope = coordinates("x_mm", x_mm), float(np.tan(np.radians(self.slope_deg)))
        return x * slope, np.full_like(x, slope), np.zeros_like(x)

    def pinhole_ring(self, mirror_distance_mm: float) -> tuple[float, float]:
        """Return radius and height z (mm) of the ring of virtual pinholes.

        Each half of a meridian is a plane mirror for the rays in that plane; it images the lens at
        ``(-m sin(2 beta), m cos(2 beta))``, on the far side of the axis. All rays pass one point
        only for m -> 0, with the lens at the apex.

        >>> radius, z = Cone(slope_deg=45.0, rim_radius_mm=20.0).pinhole_ring(100.0)
        >>> round(radius, 9), round(z, 9)
        (100.0, 0.0)
        """
        m, twice = number("mirror_distance_mm", mirror_distance_mm), 2 * np.radians(self.slope_deg)
        return m * float(np.sin(twice)), m * float(np.cos(twice))
