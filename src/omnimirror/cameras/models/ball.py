"""The mirror ball: a reflecting sphere seen from far away."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import number
from ...base.errors import InvalidParameter
from ...base.parameters import Uncertainty
from ..frames import Mount
from .base import Optics
from .radial import Law, Place, RadialModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MirrorBall(RadialModel):
    """A reflecting ball, or the part of one inside a circular rim, seen from far away and far from things.

    Under parallel rays a sphere of radius A turns the ray at distance x from its axis by twice the
    slope angle, ``sin(Omega / 2) = x / A``: the picture is exactly equal in area.

    Parameters
    ----------
    centre_px : (u, v)
        Centre of the ball's circle; integers are pixel centres.
    rim_radius_px : px
        Radius of the circle.
    field_deg : deg
        Full angle of the field, so that the rim sees ``Omega = field_deg / 2``. A whole ball shows
        nearly 360 deg, a convex traffic mirror much less.
    image_size : (width, height)
    mount
        How the camera that looks at the ball stands.
    uncertainty : Uncertainty, optional
        Covariance of the parameters, of a calibration.

    Raises
    ------
    InvalidParameter
        For a radius that is not above 0, or a field outside 0 to 360 deg.

    Examples
    --------
    Half-way to the rim of a whole ball, ``sin(Omega / 2) = 1/2``:

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
        """Radius of the whole ball's outline, of which the rim may cut off a part."""
        return self.rim_radius_px / float(np.sin(self._law_end / 2))
