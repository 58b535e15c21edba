"""Models with a circular image in focal lengths, and the camera matrix K of OpenCV."""

from __future__ import annotations

import numpy as np

from ...base.arguments import finite, number, shown
from ...base.errors import InvalidParameter
from ...base.typing import Array
from .radial import LARGEST_PX, Place, RadialModel

SMALLEST_PX = 1e-6


class FocalModel(RadialModel):
    """Model with camera matrix: ``u = fx x + skew y + cx``, ``v = fy y + cy``."""

    focal_px: tuple[float, float]
    skew_px: float

    AFFINE = (((1.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 1.0)), ((0.0, 1.0), (0.0, 0.0)))

    @property
    def matrix(self) -> Array:
        """Matrix (2, 2) from the circular image, in focal lengths, to the image."""
        (fx, fy), skew = self.focal_px, self.skew_px
        return np.array([[fx, skew], [0.0, fy]])

    @property
    def scale_px(self) -> float:
        """Pixels per focal length: geometric mean of fx and fy."""
        fx, fy = self.focal_px
        return fx if fx == fy else float(np.sqrt(fx * fy))

    @property
    def _affine_places(self) -> tuple[Place, ...]:
        fx, fy = self.focal_px
        return (
            Place("fx", "focal_px", 0, "px", 0.01 * fx),
            Place("fy", "focal_px", 1, "px", 0.01 * fy),
            Place("skew", "skew_px", None, "px", 0.01 * fx),
        )

    def _check_focal(self) -> None:
        self._check_radial()
        focal = finite("focal_px", self.focal_px, high=LARGEST_PX, unit="px")
        if focal.shape != (2,) or not focal.min() >= SMALLEST_PX:
            raise InvalidParameter(
                f"focal_px = {shown(self.focal_px)} is not valid; it is valid as (fx, fy), both above 0 px"
            )
        number("skew_px", self.skew_px, low=-LARGEST_PX, high=LARGEST_PX, unit="px")
