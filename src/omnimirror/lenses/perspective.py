"""The ordinary lens: from a point, with the distortion that OpenCV states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import choice
from ..errors import InvalidParameter
from ..parameters import Parameter
from .base import BLUR_MODES, F_NUMBER, FOCUS, Array, BlurMode, DepthOfField, Lens, ThroughFocus, cos4, crossing
from .distortion import Coefficients, distorted, distorted_radius, fold, shrinkage, undistorted, undistorted_radius


@dataclass(frozen=True)
class Perspective(Lens):
    """An ordinary lens: ``h = b0 tan(theta)``, ``1/b0 = 1/f - 1/L0``; distorted, if it is, as OpenCV states it.

    Distortion moves what an ideal thin lens shows, whole cones of light at a time
    (:mod:`omnimirror.lenses.distortion`); a blur grows and shrinks with the picture about it.

    >>> lens = Perspective(focal_length_mm=11.6, f_number=4.0, focus_distance_mm=212.0)
    >>> round(lens.image_distance, 4), round(lens.image_f_number(), 4)
    (12.2715, 4.2315)
    """

    focal_length_mm: float
    f_number: float
    focus_distance_mm: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    KIND: ClassVar[str] = "perspective"
    TELECENTRIC: ClassVar[bool] = False
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 1e-2, 1e5, "focal length (f)"),
        "f_number": F_NUMBER,
        "focus_distance_mm": FOCUS,
        "k1": Parameter("", -100.0, 100.0, "radial distortion as in OpenCV, none by default: r^2 of the tangent"),
        "k2": Parameter("", -1e4, 1e4, "radial distortion, r^4"),
        "k3": Parameter("", -1e6, 1e6, "radial distortion, r^6"),
        "p1": Parameter("", -1.0, 1.0, "tangential distortion"),
        "p2": Parameter("", -1.0, 1.0, "tangential distortion"),
    }

    def __post_init__(self) -> None:
        self._check()
        if self.focus_distance_mm <= self.focal_length_mm:
            raise InvalidParameter(
                f"focus_distance_mm = {self.focus_distance_mm:g} is not beyond the focal length; "
                f"it is valid above focal_length_mm = {self.focal_length_mm:g}"
            )

    @property
    def image_distance(self) -> float:
        """Distance b0 (mm) from lens to imager when focused (Eq. 25)."""
        return float(self.through_focus(1 / self.focus_distance_mm).image_scale)

    def hyperfocal_distance(self, tolerance: float) -> float:
        """L_inf = f^2 / (delta F), mm, for a permissible blur delta in mm."""
        return self.focal_length_mm**2 / (tolerance * self.f_number)

    def ideal_height(self, x: Array, w: Array) -> Array:
        return self.image_distance * x / w

    def ideal_height_rate(self, x: Array, w: Array, slope: Array) -> Array:
        return self.image_distance * (w - x * slope) / w**2

    @property
    def brown(self) -> Coefficients:
        """Its distortion."""
        return self.k1, self.k2, self.k3, self.p1, self.p2

    @property
    def is_symmetric(self) -> bool:
        return not (self.p1 or self.p2)

    def distorted(self, ideal: Array) -> Array:
        return self.image_distance * distorted(ideal / self.image_distance, self.brown) if any(self.brown) else ideal

    def undistorted(self, image: Array) -> Array:
        return self.image_distance * undistorted(image / self.image_distance, self.brown) if any(self.brown) else image

    def distorted_height(self, ideal: Array) -> Array:
        k, b0 = self.brown[:3], self.image_distance
        if not any(k):
            return ideal
        tangent, last = ideal / b0, fold(k)
        if (tangent > last).any():
            raise InvalidParameter(
                f"k1, k2, k3 = {k[0]:g}, {k[1]:g}, {k[2]:g} fold the picture over at {np.degrees(np.arctan(last)):.4g} "
                f"deg from the lens's axis, and the mirror reaches {np.degrees(np.arctan(np.max(tangent))):.4g} deg; "
                "distortion is valid if the picture grows up to there"
            )
        return b0 * distorted_radius(tangent, k)[0]

    def undistorted_height(self, h: Array) -> Array:
        return self.image_distance * undistorted_radius(h / self.image_distance, self.brown[:3])

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        tangent = ideal / self.image_distance
        radius, rate = distorted_radius(tangent, self.brown[:3])
        with np.errstate(invalid="ignore"):
            return rate, np.where(tangent == 0.0, 1.0, radius / tangent)

    @property
    def stop_number(self) -> float:
        return self.f_number

    @property
    def aperture_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length_mm / self.f_number / 2

    def entrance_pupil_points(self, pupil: Array) -> Array:
        return np.concatenate([self.aperture_radius * pupil, np.zeros((len(pupil), 1))], axis=1)

    def entrance_pupil_motion(self, pupil: Array) -> Array:
        return np.broadcast_to(self.aperture_radius * np.eye(2, 3), (len(pupil), 2, 3))

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        origins, ideal = self.entrance_pupil_points(pupil), self.undistorted(image)
        in_focus = np.concatenate([ideal / self.image_distance, np.ones((len(ideal), 1))], axis=1)
        return origins, in_focus - origins / self.focus_distance_mm

    def image_of(self, points: Array, directions: Array) -> Array:
        L0 = self.focus_distance_mm
        return self.distorted(self.image_distance / L0 * crossing(points, directions, L0))

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """cos^4 of the angle at the imager, and more where distortion packs more of the world into an area of it."""
        ideal = self.undistorted(image) / self.image_distance
        tangent = ideal if pupil is None else ideal + pupil / (2 * self.image_f_number())
        return cos4(tangent) * shrinkage(ideal, self.brown)

    def focus_coordinate(self, L: ArrayLike) -> Array:
        """The vergence 1/L; its inverse is the same."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / np.asarray(L, dtype=float))

    def through_focus(self, coordinate: Any, mode: BlurMode = "exact") -> ThroughFocus:
        choice("mode", mode, BLUR_MODES)
        f, F = self.focal_length_mm, self.f_number
        b0 = f / (1 - f * coordinate)  # Eq. 25
        return ThroughFocus(f * (b0 if mode == "exact" else f) / F, b0, F * b0 / f)

    def depth_of_field(self, tolerance: float, mode: BlurMode = "exact") -> DepthOfField:
        choice("mode", mode, BLUR_MODES)
        f, L0 = self.focal_length_mm, self.focus_distance_mm
        dropped = f if mode == "exact" else 0.0
        spread = tolerance * self.f_number * (L0 - dropped)
        far = f**2 * L0 / (f**2 - spread) if spread < f**2 else np.inf
        return DepthOfField(f**2 * L0 / (f**2 + spread), far)
