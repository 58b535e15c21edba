"""Mirror ball: a reflecting sphere at a large camera distance."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...base.arguments import number
from ...base.errors import InvalidParameter
from ...base.parameters import Uncertainty
from ...base.typing import Array
from ..frames import Mount
from .base import Optics
from .radial import Law, Place, RadialModel


@dataclass(frozen=True)
class MirrorBall(RadialModel):
    """Reflecting ball, or its part within a circular rim, for distant camera and objects.

    For parallel rays, a sphere of radius A deflects the ray at distance x from its axis by twice
    the slope angle, ``sin(Omega / 2) = x / A``: the projection is exactly equal-area.

    Parameters
    ----------
    centre_px : (u, v)
        Centre of the ball's outline; integers are pixel centres.
    rim_radius_px : px
        Radius of the outline.
    field_deg : deg
        Full field angle: the rim is at ``Omega = field_deg / 2``. A complete ball has nearly 360
        deg, a convex traffic mirror much less.
    image_size : (width, height)
    mount
        Orientation of the camera.
    uncertainty : Uncertainty, optional
        Covariance of the calibrated parameters.

    Raises
    ------
    InvalidParameter
        If the radius is not positive, or the field is outside 0 to 360 deg.

    Examples
    --------
    At half the rim radius of a complete ball, ``sin(Omega / 2) = 1/2``:

    >>> ball = MirrorBall((511.5, 511.5), 500.0, 360.0, (1024, 1024))
    >>> np.degrees(ball.omega_from_radius(np.array([250.0]))).round(9)
    array([60.])
    """

    centre_px: tuple[float, float]
    rim_radius_px: float
    field_deg: float
    image_size: tuple[int, int]
    mount: Mount = field(default_factory=Mount)
    uncertainty: Uncertainty | None = field(default=None, repr=False)
    optics: Optics = field(default="mirror", init=False, repr=False)

    KIND = "ball"

    def __post_init__(self) -> None:
        self._check_radial()
        number("rim_radius_px", self.rim_radius_px, above=0.0, unit="px")
        number("field_deg", self.field_deg)
        if not 0 < self.field_deg <= 360:
            raise InvalidParameter(
                f"field_deg = {self.field_deg:g} is not the full angle of a field; it is valid above 0, up to 360"
            )

    @property
    def _places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        return (Place("rim_radius_px", "rim_radius_px", None, "px", 1.0),), ()

    @property
    def _law_end(self) -> float:
        return float(np.radians(self.field_deg / 2))

    def _law_radius(self, omega: Array) -> Array:
        return self._ball_radius_px * np.sin(omega / 2)

    def _law(self, omega: Array) -> Law:
        radius = self._law_radius(omega)
        return Law(radius, self._ball_radius_px / 2 * np.cos(omega / 2), (radius / self.rim_radius_px)[:, None])

    def _law_inverse(self, radius: Array) -> Array:
        return 2 * np.arcsin(np.minimum(radius / self._ball_radius_px, 1.0))

    @property
    def _ball_radius_px(self) -> float:
        """Radius of the complete ball's outline, which the rim may truncate."""
        return self.rim_radius_px / float(np.sin(self._law_end / 2))
