"""Base classes of mirrors with a prescribed mapping."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ....base.arguments import coordinates
from ....base.errors import InvalidParameter
from ....base.numerics.lazy import cached_property
from ....base.parameters import Parameter
from ....base.typing import Array
from ..base import RIM_RADIUS, Mirror
from .meridian import GeneratedMeridian, OrthographicMeridian, PerspectiveMeridian

OMEGA_MAX = Parameter("deg", 1.0, 179.0, "field angle at the rim")
OMEGA_MIN = Parameter("deg", 0.0, 170.0, "field angle at the image centre; above 0 the mirror is pointed")
LEAST_THETA_DEG = 1e-3  # smaller viewing angles lose precision; use an orthographic lens
THETA_MAX = Parameter("deg", 0.0, 60.0, "viewing angle of the lens at the rim; 0 for an orthographic lens")


class Mapped(Mirror):
    """Mirror with a prescribed exact mapping for a lens at :attr:`design_distance` from its vertex.

    The image height is normalised by that of the rim: ``tau = tan(theta)/tan(Theta)`` for a
    perspective lens, ``x/M`` for an orthographic one (``theta_max_deg = 0``).
    """

    theta_max_deg: float

    @abstractmethod
    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        """Compute field angles (radians) and derivatives for image heights tau (n,) from 0 to 1."""

    def angles(self, tau: Array) -> Array:
        """Compute the field angles (n,), radians."""
        return self.mapping(tau)[0]

    def rates(self, tau: Array) -> Array:
        """Compute the derivatives (n,) of the field angles."""
        return self.mapping(tau)[1]

    @property
    def design_distance(self) -> float:
        """Distance m from lens to vertex, mm, of the exact mapping; infinite if orthographic."""
        return self._meridian.distance * self.rim_radius_mm

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        M = self.rim_radius_mm
        x = coordinates("x_mm", x_mm) / M
        with np.errstate(invalid="ignore"):  # NaN outside the surface
            z, slope, curvature = self._meridian.profile(np.where((x >= 0) & (x <= 1 + 1e-12), x, np.nan))
        return z * M, slope, curvature / M

    @property
    def _theta_max(self) -> float:
        return float(np.radians(self.theta_max_deg))

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        if self.theta_max_deg == 0:
            return OrthographicMeridian.solve(self.angles, self.rates)
        return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)

    def _omega(self, theta: Array) -> Array:
        """Compute field angles of viewing angles, radians."""
        return self.angles(np.tan(theta) / np.tan(self._theta_max))

    def _domega(self, theta: Array) -> Array:
        """Compute dOmega/dtheta."""
        unit = np.tan(self._theta_max)
        rate: Array = self.rates(np.tan(theta) / unit) / (np.cos(theta) ** 2 * unit)
        return rate

    def _check_reach(self, omega_max_deg: float) -> None:
        """Check that the rim is visible to the lens and its chief rays are reflected outwards."""
        theta = self.theta_max_deg
        if 0 < theta < LEAST_THETA_DEG:
            raise InvalidParameter(
                f"theta_max_deg = {theta:g} is too small for a lens at a distance; it is valid from "
                f"{LEAST_THETA_DEG:g}, or 0 for an orthographic lens"
            )
        if not theta < omega_max_deg < 180 - theta:
            raise InvalidParameter(
                f"omega_max_deg = {omega_max_deg:g} cannot be reached with theta_max_deg = {theta:g}; it is valid "
                f"between {theta:g} and {180 - theta:g}, where the rim would be seen edge-on"
            )


@dataclass(frozen=True)
class Generated(Mapped):
    """:class:`Mapped` mirror specified by its field angle at the rim."""

    omega_max_deg: float
    theta_max_deg: float
    rim_radius_mm: float

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "omega_max_deg": OMEGA_MAX,
        "theta_max_deg": THETA_MAX,
        "rim_radius_mm": RIM_RADIUS,
    }
    MOST_OMEGA_DEG: ClassVar[float] = 180.0
    """Upper bound of the field angle of the mapping, for any lens."""

    def __post_init__(self) -> None:
        self._check_parameters()
        self._check_reach(self.omega_max_deg)
        if self.omega_max_deg >= self.MOST_OMEGA_DEG:
            raise InvalidParameter(
                f"omega_max_deg = {self.omega_max_deg:g} cannot be reached by the {self.KIND} mapping; it is valid "
                f"below {self.MOST_OMEGA_DEG:g}"
            )
        omega_min: float = getattr(self, "omega_min_deg", 0.0)
        if omega_min >= self.omega_max_deg:
            raise InvalidParameter(
                f"omega_min_deg = {omega_min:g} is not below omega_max_deg = {self.omega_max_deg:g}, as it must be"
            )
        self._check_surface()

    @property
    def _omega_max(self) -> float:
        return float(np.radians(self.omega_max_deg))
