"""Mappings of directions, for distant objects.

``tau`` is the image height normalised by that of the rim. Each class defines Omega(tau), which
determines the surface (see :mod:`.meridian`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ....base.arguments import coordinates
from ....base.numerics.lazy import cached_property
from ....base.parameters import Parameter
from ....base.typing import Array
from ..conics import Hyperboloid, Paraboloid, conic_profile
from .base import OMEGA_MIN, Generated
from .meridian import Curve, GeneratedMeridian, OrthographicMeridian, PerspectiveMeridian


@dataclass(frozen=True)
class Equidistant(Generated):
    """Equidistant mirror: image height exactly proportional to the field angle.

    ``Omega = Omega_min + k tan(theta)`` for a perspective lens at :attr:`design_distance` from the
    vertex. (The paper's polynomial E-DI deviates by 0.49 %.) For an orthographic lens it is
    ``z = -(2/k) ln cos(k x/2)``, the paper's Eq. 22 with corrected sign.

    >>> mirror = Equidistant(omega_max_deg=135.0, theta_max_deg=12.0, rim_radius_mm=1.0)
    >>> round(mirror.design_distance, 11)
    3.9242676015...
    """

    omega_min_deg: float = 0.0

    KIND: ClassVar[str] = "equidistant"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {**Generated.PARAMETERS, "omega_min_deg": OMEGA_MIN}

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, low = coordinates("tau", tau), float(np.radians(self.omega_min_deg))
        return low + (self._omega_max - low) * tau, np.full_like(tau, self._omega_max - low)

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        if self.theta_max_deg > 0:
            return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)
        return _straight_line(np.radians(self.omega_min_deg), self._omega_max)


@dataclass(frozen=True)
class Equiangular(Generated):
    """Equiangular mirror: field angle ``Omega = Omega_min + alpha theta``.

    The mirror of Chahl and Srinivasan: ``rho ~ cos((Omega + theta)/2)^(-2/(alpha + 1))``. For an
    orthographic lens it is equidistant.

    >>> round(Equiangular(135.0, 12.0, 1.0).design_distance, 11)
    3.91625328435
    """

    omega_min_deg: float = 0.0

    KIND: ClassVar[str] = "equiangular"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {**Generated.PARAMETERS, "omega_min_deg": OMEGA_MIN}

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, low = coordinates("tau", tau), float(np.radians(self.omega_min_deg))
        span, Theta = self._omega_max - low, self._theta_max
        if Theta == 0:
            return low + span * tau, np.full_like(tau, span)
        tangent = tau * np.tan(Theta)
        return low + span / Theta * np.arctan(tangent), span / Theta * np.tan(Theta) / (1 + tangent**2)

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        low, Theta = float(np.radians(self.omega_min_deg)), self._theta_max
        if Theta == 0:
            return _straight_line(low, self._omega_max)
        alpha = (self._omega_max - low) / Theta
        return PerspectiveMeridian.of(
            lambda theta: low + alpha * theta,
            lambda theta: np.full_like(theta, alpha),
            lambda theta: -2 / (alpha + 1) * _log_cosine_ratio(low / 2, (alpha + 1) / 2 * theta),
            Theta,
        )


def _both(mapping: Callable[[Array], tuple[Array, Array]]) -> tuple[Curve, Curve]:
    """Split a mapping into functions for the field angle and its derivative."""
    return lambda x: mapping(x)[0], lambda x: mapping(x)[1]


def _straight_line(low: float, high: float) -> OrthographicMeridian:
    """Return the meridian for Omega linear in x from low to high, in closed form."""
    k = high - low
    return OrthographicMeridian(
        lambda x: low + k * x, lambda x: np.full_like(x, k), lambda x: -2 / k * _log_cosine_ratio(low / 2, k / 2 * x)
    )


def _log_cosine_ratio(a: float, t: Array) -> Array:
    """Compute ``ln(cos(a + t)/cos(a))`` with full relative precision near t = 0."""
    ratio: Array = np.log1p(-2 * np.sin(t / 2) * np.sin(a + t / 2) / np.cos(a))
    return ratio


@dataclass(frozen=True)
class Conformal(Generated):
    """Conformal mapping of the viewing sphere: ``tan(Omega/2) = K tan(theta/2)``.

    This is the hyperboloid with the lens at its outer focus, or the paraboloid with an orthographic
    lens, in closed form; :attr:`surface` is the equivalent conic.

    >>> mirror = Conformal(135.0, 12.0, 1.0)
    >>> round(mirror.design_distance, 11), mirror.surface.KIND
    (3.55007544592, 'hyperboloid')
    """

    KIND: ClassVar[str] = "conformal"

    @property
    def surface(self) -> Hyperboloid | Paraboloid:
        """Equivalent conic."""
        return conformal_conic(self._omega_max, self._theta_max, self.rim_radius_mm)

    @property
    def design_distance(self) -> float:
        surface = self.surface
        return surface.single_viewpoint_distance if isinstance(surface, Hyperboloid) else float("inf")

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, Theta, high = coordinates("tau", tau), self._theta_max, np.tan(self._omega_max / 2)
        if Theta == 0:
            return 2 * np.arctan(high * tau), 2 * high / (1 + (high * tau) ** 2)
        tangent = tau * np.tan(Theta)
        half = tangent / (1 + np.sqrt(1 + tangent**2))  # tan(theta/2)
        K = high / np.tan(Theta / 2)
        dhalf = np.tan(Theta) / (1 + tangent**2) * (1 + half**2) / 2
        return 2 * np.arctan(K * half), 2 * K * dhalf / (1 + (K * half) ** 2)

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x, (R, k) = coordinates("x_mm", x_mm), self._radius_and_conic
        inside = (x >= 0) & (x <= self.rim_radius_mm * (1 + 1e-12))
        return conic_profile(np.where(inside, x, np.nan), R, k)

    @cached_property
    def _radius_and_conic(self) -> tuple[float, float]:
        return self.surface.vertex_radius, self.surface.conic


def conformal_conic(omega_max: float, theta_max: float, rim: float) -> Hyperboloid | Paraboloid:
    """Return the single-viewpoint conic for the angles (radians) at its rim (mm).

    With ``K = tan(Omega/2)/tan(theta/2)`` the eccentricity is ``C/B = (K + 1)/(K - 1)``; in polar
    coordinates about the lens, ``rho = (C^2 - B^2)/(C cos(theta) - B)``.
    """
    if theta_max == 0:
        return Paraboloid(rim / float(np.tan(omega_max / 2)), rim)
    K = np.tan(omega_max / 2) / np.tan(theta_max / 2)
    e = (K + 1) / (K - 1)
    B = rim / np.sin(theta_max) * (e * np.cos(theta_max) - 1) / (e**2 - 1)
    return Hyperboloid(float(B * np.sqrt(e**2 - 1)), float(B), rim)


@dataclass(frozen=True)
class UnitAspect(Generated):
    """Unit aspect ratio of small squares at every field angle: ``tan(theta) = s tan(Omega/2)``.

    With ``v = tan(theta/2)^2`` and ``c = 1 + 2/s`` the integral is elementary:
    ``rho = m (1 + v) (1 - c v)^(1/c - 1)``. For an orthographic lens it is the paraboloid.

    >>> round(UnitAspect(135.0, 12.0, 1.0).design_distance, 11)
    3.55612053404
    """

    KIND: ClassVar[str] = "unit-aspect"

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, high = coordinates("tau", tau), np.tan(self._omega_max / 2)
        return 2 * np.arctan(high * tau), 2 * high / (1 + (high * tau) ** 2)

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        high = float(np.tan(self._omega_max / 2))
        if self.theta_max_deg == 0:
            return OrthographicMeridian(*_both(self.mapping), lambda x: high * x**2 / 2)
        c = 1 + 2 * high / float(np.tan(self._theta_max))

        def log_rho(theta: Array) -> Array:
            v = np.tan(theta / 2) ** 2
            value: Array = np.log1p(v) + (1 / c - 1) * np.log1p(-c * v)
            return value

        return PerspectiveMeridian.of(self._omega, self._domega, log_rho, self._theta_max)


@dataclass(frozen=True)
class Equiareal(Generated):
    """Equal-area mapping of solid angles: ``sin(Omega/2)^2`` is linear in ``tan(theta)^2``.

    The field angle on the axis is Omega_min; if it is positive, the mapping has square-root
    behaviour and ``dOmega/dtau`` is 0 there. For an orthographic lens without Omega_min it is the
    sphere.

    >>> round(Equiareal(135.0, 12.0, 1.0).design_distance, 11)
    4.07235176766
    """

    omega_min_deg: float = 0.0

    KIND: ClassVar[str] = "equiareal"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {**Generated.PARAMETERS, "omega_min_deg": OMEGA_MIN}

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau = coordinates("tau", tau)
        low, high = np.sin(np.radians(self.omega_min_deg) / 2), np.sin(self._omega_max / 2)
        if low == 0:
            return 2 * np.arcsin(high * tau), 2 * high / np.sqrt(1 - (high * tau) ** 2)
        span = high**2 - low**2
        sine = np.sqrt(low**2 + span * tau**2)
        return 2 * np.arcsin(sine), 2 * span * tau / (sine * np.sqrt(1 - sine**2))

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        if self.theta_max_deg > 0:
            return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)
        if self.omega_min_deg > 0:
            return OrthographicMeridian.solve(*_both(self.mapping))
        A = 1 / np.sin(self._omega_max / 2)
        return OrthographicMeridian(*_both(self.mapping), lambda x: x**2 / (A + np.sqrt(A**2 - x**2)))


@dataclass(frozen=True)
class Rectifying(Generated):
    """Perspective image of a distant plane: ``tan(Omega) = kappa tan(theta)``.

    >>> round(Rectifying(75.0, 12.0, 1.0).design_distance, 11)
    4.23651210948
    """

    KIND: ClassVar[str] = "rectifying"
    MOST_OMEGA_DEG: ClassVar[float] = 90.0

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, high = coordinates("tau", tau), np.tan(self._omega_max)
        return np.arctan(high * tau), high / (1 + (high * tau) ** 2)

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        if self.theta_max_deg > 0:
            return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)
        kappa = float(np.tan(self._omega_max))

        def sag(x: Array) -> Array:  # integral of (sqrt(1 + t^2) - 1)/t, t = kappa x
            rise = (kappa * x) ** 2 / (1 + np.sqrt(1 + (kappa * x) ** 2))
            value: Array = (rise - np.log1p(rise / 2)) / kappa
            return value

        return OrthographicMeridian(*_both(self.mapping), sag)
