"""Rim ray and mounted mirror, the input and output of all construction methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.errors import InvalidParameter
from ...optics.mirrors import Mirror


@dataclass(frozen=True)
class RimRay:
    """Requirements on the rim: field angle, viewing angle of the lens, and rim radius.

    ``theta_max_deg`` is 0 for an orthographic lens.

    >>> RimRay(135.0, 12.0, 43.9).slope_angle_deg
    61.5
    """

    omega_max_deg: float
    theta_max_deg: float
    rim_radius_mm: float

    def __post_init__(self) -> None:
        theta, omega = self.theta_max_deg, self.omega_max_deg
        if not 0 <= theta < 90:
            raise InvalidParameter(f"theta_max_deg = {theta:g} is outside 0 to 90")
        if not theta < omega < 180 - theta:
            raise InvalidParameter(
                f"omega_max_deg = {omega:g} cannot be reached with theta_max_deg = {theta:g}; it is valid between "
                f"{theta:g} and {180 - theta:g}, where the rim would be seen edge-on"
            )
        if not self.rim_radius_mm > 0:
            raise InvalidParameter(f"rim_radius_mm = {self.rim_radius_mm:g} is not a radius; it is valid above 0")

    @property
    def slope_angle_deg(self) -> float:
        """Return the slope angle beta of the mirror at its rim (Eqs. 2-5)."""
        return (self.omega_max_deg - self.theta_max_deg) / 2

    @property
    def slope(self) -> float:
        """Return the slope dz/dx of the mirror at its rim."""
        return float(np.tan(np.radians(self.slope_angle_deg)))

    def distance_mm(self, rim_sag_mm: float) -> float:
        """Return the lens distance from the vertex, mm; infinite for an orthographic lens."""
        if self.theta_max_deg == 0:
            return float("inf")
        return self.rim_radius_mm / float(np.tan(np.radians(self.theta_max_deg))) - rim_sag_mm

    def place(self, mirror: Mirror, notes: tuple[str, ...] = ()) -> MountedMirror:
        """Return the mirror at the distance that gives the rim the viewing angle Theta."""
        return MountedMirror(mirror, self.distance_mm(float(mirror.sag(mirror.rim_radius_mm))), notes)


@dataclass(frozen=True)
class MountedMirror:
    """Mirror with its lens distance from the vertex (mm; infinite if orthographic) and notes."""

    mirror: Mirror
    distance_mm: float
    notes: tuple[str, ...] = ()
