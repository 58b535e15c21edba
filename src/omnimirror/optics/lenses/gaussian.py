"""Gaussian optics of lenses at finite distance, relative to the entrance pupil.

Let e be the distance of the entrance pupil from the principal point towards the mirror. Relative to
the pupil, a thick lens is equivalent to a thin one of principal distance
``c = f / (1 - (f - e) v)``, with the vergence ``v = 1/s0`` of the plane in focus, and its blur is
``(f/F) c (v - 1/s)``. For e = 0 these are Eqs. 25 and 28. Both follow from the lens equation at the
principal planes: the ray from the pupil centre meets the plane in focus at ``s0 tan(theta)``,
imaged with the magnification ``b0/L0``.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import choice, coordinates, number
from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.typing import Array
from .base import BLUR_MODES, BlurMode, DepthOfField, Lens, ThroughFocus


class GaussianLens(Lens):
    """Lens at finite distance, with focal length and F-number f/D."""

    focal_length_mm: float
    f_number: float

    TELECENTRIC: ClassVar[bool] = False

    @property
    def principal_point_mm(self) -> float:
        """Position of the principal point, towards the mirror from the reference point."""
        return 0.0

    @property
    def pupil_from_principal(self) -> float:
        """Distance e (mm) of the entrance pupil from the principal point, towards the mirror."""
        return self.pupil.at_mm - self.principal_point_mm

    def _check_focus(self) -> None:
        if self.focus_distance_mm <= self.principal_point_mm + self.focal_length_mm:
            place = self.principal_point_mm
            where = f" in front of the principal point at {place:g}" if place else ""
            raise InvalidParameter(
                f"focus_distance_mm = {self.focus_distance_mm:g} is not beyond the focal length; "
                f"it is valid above focal_length_mm = {self.focal_length_mm:g}{where}"
            )
        if self.focus_distance_mm <= self.pupil.at_mm:
            raise InvalidParameter(
                f"focus_distance_mm = {self.focus_distance_mm:g} is not beyond the entrance pupil; "
                f"it is valid above {self.pupil.at_mm:g}"
            )

    @property
    def nearest_focus_mm(self) -> float:
        """Smallest focus distance, slightly beyond focal length and entrance pupil."""
        f = self.focal_length_mm
        return max(self.principal_point_mm + 1.0001 * f, self.pupil.at_mm + 0.0001 * f)

    @property
    def image_distance(self) -> float:
        """Distance b0 (mm) from principal point to imager in focus (Eq. 25)."""
        return 1 / (1 / self.focal_length_mm - 1 / (self.focus_distance_mm - self.principal_point_mm))

    @property
    def imager_mm(self) -> float:
        """Distance from the reference point to the imager, mm; by default that of a thin lens."""
        return self.image_distance - self.principal_point_mm

    @cached_property
    def principal_distance(self) -> float:
        """Undistorted image height (mm) per tangent of the viewing angle."""
        return float(self.through_focus(1 / self.from_pupil).image_scale)

    @property
    def from_pupil(self) -> float:
        """Distance (mm) from the entrance pupil to the plane in focus."""
        return self.focus_distance_mm - self.pupil.at_mm

    def hyperfocal_distance(self, tolerance: float) -> float:
        """Compute the hyperfocal distance f^2 / (delta F), mm, for a blur delta in mm."""
        return self.focal_length_mm**2 / (number("tolerance", tolerance, above=0, unit="mm") * self.f_number)

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.principal_distance * x / w

    def ideal_height_rate(self, x: Array, w: Array, slope: Array, drift: Array | float = 0.0) -> Array:
        return self.principal_distance * (w - x * slope) / (w * (w - drift * x * w / (x**2 + w**2)))

    @property
    def stop_number(self) -> float:
        return self.f_number

    @property
    def aperture_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length_mm / self.f_number / 2

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        return np.concatenate([self.aperture_radius * pupil, np.full((len(pupil), 1), self.pupil.at_mm)], axis=1)

    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        return np.broadcast_to(self.aperture_radius * np.eye(2, 3), (len(pupil), 2, 3))

    def focus_coordinate(self, L: ArrayLike) -> Array:
        """Compute the vergence at the entrance pupil."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / (coordinates("L", L) - self.pupil.at_mm))

    def distance_of(self, coordinate: ArrayLike) -> Array:
        with np.errstate(divide="ignore"):
            return np.asarray(1 / coordinates("coordinate", coordinate) + self.pupil.at_mm)

    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        choice("mode", mode, BLUR_MODES)
        f, F = self.focal_length_mm, self.f_number
        c = f / (1 - (f - self.pupil_from_principal) * coordinate)  # Eq. 25
        return ThroughFocus(f * (c if mode == "exact" else f) / F, c, F * c / f)

    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        choice("mode", mode, BLUR_MODES)
        f, s0, at = self.focal_length_mm, self.from_pupil, self.pupil.at_mm
        dropped = f - self.pupil_from_principal if mode == "exact" else 0.0
        spread = number("tolerance", tolerance, low=0, unit="mm") * self.f_number * (s0 - dropped)
        far = f**2 * s0 / (f**2 - spread) + at if spread < f**2 else np.inf
        return DepthOfField(f**2 * s0 / (f**2 + spread) + at, far)
