"""Perspective lens with the distortion model of OpenCV."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import F_NUMBER, FOCUS, cos4, crossing
from .distortion import Coefficients, distorted, distorted_radius, fold, shrinkage, undistorted, undistorted_radius
from .gaussian import GaussianLens
from .pupil import EntrancePupil


@dataclass(frozen=True)
class Perspective(GaussianLens):
    """Perspective lens, ``h = b0 tan(theta)``, with optional OpenCV distortion.

    Distortion displaces the image of an ideal thin lens as a whole, including its blur
    (:mod:`omnimirror.optics.lenses.distortion`); blur scales with the local magnification.

    A thick lens has its entrance pupil ``entrance_pupil_mm`` towards the mirror from its principal
    point (:mod:`omnimirror.optics.lenses.gaussian`).

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
    entrance_pupil_mm: float = 0.0

    KIND: ClassVar[str] = "perspective"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 1e-2, 1e5, "focal length (f)"),
        "f_number": F_NUMBER,
        "focus_distance_mm": FOCUS,
        "k1": Parameter("", -100.0, 100.0, "radial distortion as in OpenCV, none by default: r^2 of the tangent"),
        "k2": Parameter("", -1e4, 1e4, "radial distortion, r^4"),
        "k3": Parameter("", -1e6, 1e6, "radial distortion, r^6"),
        "p1": Parameter("", -1.0, 1.0, "tangential distortion"),
        "p2": Parameter("", -1.0, 1.0, "tangential distortion"),
        "entrance_pupil_mm": Parameter("mm", -1e4, 1e4, "entrance pupil, from the principal point towards the mirror"),
    }

    def __post_init__(self) -> None:
        self._check()
        self._check_focus()

    @cached_property
    def pupil(self) -> EntrancePupil:
        return EntrancePupil(self.entrance_pupil_mm)

    @property
    def brown(self) -> Coefficients:
        """Distortion coefficients."""
        return self.k1, self.k2, self.k3, self.p1, self.p2

    @property
    def is_symmetric(self) -> bool:
        return not (self.p1 or self.p2)

    def distorted(self, ideal: Array) -> Array:
        c = self.principal_distance
        return c * distorted(ideal / c, self.brown) if any(self.brown) else ideal

    def undistorted(self, image: Array) -> Array:
        c = self.principal_distance
        return c * undistorted(image / c, self.brown) if any(self.brown) else image

    def distorted_height(self, ideal: Array) -> Array:
        k, c = self.brown[:3], self.principal_distance
        if not any(k):
            return ideal
        tangent, last = ideal / c, fold(k)
        if (tangent > last).any():
            raise InvalidParameter(
                f"k1, k2, k3 = {k[0]:g}, {k[1]:g}, {k[2]:g} fold the picture over at {np.degrees(np.arctan(last)):.4g} "
                f"deg from the lens's axis, and the mirror reaches {np.degrees(np.arctan(np.max(tangent))):.4g} deg; "
                "distortion is valid if the picture grows up to there"
            )
        return c * distorted_radius(tangent, k)[0]

    def undistorted_height(self, h: Array) -> Array:
        return self.principal_distance * undistorted_radius(h / self.principal_distance, self.brown[:3])

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        if not any(self.brown[:3]):
            return super().stretch(ideal)
        tangent = ideal / self.principal_distance
        radius, rate = distorted_radius(tangent, self.brown[:3])
        with np.errstate(invalid="ignore"):
            return rate, np.where(tangent == 0.0, 1.0, radius / tangent)

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        origins, ideal = self.entrance_pupil_points(pupil), self.undistorted(image)
        slopes = ideal / self.principal_distance - origins[:, :2] / self.from_pupil
        return origins, np.concatenate([slopes, np.ones((len(ideal), 1))], axis=1)

    def image_of(self, points: Array, directions: Array) -> Array:
        scale = self.principal_distance / self.from_pupil
        return self.distorted(scale * crossing(points, directions, self.focus_distance_mm))

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        """Return cos^4 at the imager, multiplied by the compression by distortion."""
        ideal = self.undistorted(image) / self.principal_distance
        tangent = ideal if pupil is None else ideal + pupil / (2 * self.image_f_number())
        return cos4(tangent) * shrinkage(ideal, self.brown)
