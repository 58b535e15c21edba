"""Mirrors with a prescribed mapping: distant objects, ground plane, cylinder, and custom tables.

One class per mapping; the meridian is computed in :mod:`.prescribed_mapping`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import InvalidType, check_fields, coordinates, floats, format_value, number
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from .measured import MAPPING_FILE
from .mirror import APEX, RIM_RADIUS, Hyperboloid, Paraboloid, conic_profile, near_apex
from .prescribed_mapping import (
    OMEGA_MIN,
    THETA_MAX,
    Curve,
    MappingMirror,
    OrthographicMeridian,
    PerspectiveMeridian,
    PrescribedMapping,
    PrescribedMeridian,
)

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

__all__ = [
    "MAPPINGS",
    "Conformal",
    "CylinderMapping",
    "Equiangular",
    "Equiareal",
    "Equidistant",
    "GroundPlane",
    "MappingMirror",
    "PrescribedMapping",
    "Rectifying",
    "TabulatedMapping",
    "UnitAspect",
]


# -- Mappings for distant objects ------------------------------------------------------------------
#
# ``tau`` is the image height normalised by that of the rim. Each class defines Omega(tau), which
# determines the surface (see :mod:`.prescribed_mapping`).


@dataclass(frozen=True)
class Equidistant(PrescribedMapping):
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
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        **PrescribedMapping.PARAMETERS,
        "omega_min_deg": OMEGA_MIN,
    }

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, low = coordinates("tau", tau), float(np.radians(self.omega_min_deg))
        return low + (self._omega_max - low) * tau, np.full_like(tau, self._omega_max - low)

    @cached_property
    def _meridian(self) -> PrescribedMeridian:
        if self.theta_max_deg > 0:
            return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)
        return _straight_line(np.radians(self.omega_min_deg), self._omega_max)


@dataclass(frozen=True)
class Equiangular(PrescribedMapping):
    """Equiangular mirror: field angle ``Omega = Omega_min + alpha theta``.

    The mirror of Chahl and Srinivasan: ``rho ~ cos((Omega + theta)/2)^(-2/(alpha + 1))``. For an
    orthographic lens it is equidistant.

    >>> round(Equiangular(135.0, 12.0, 1.0).design_distance, 11)
    3.91625328435
    """

    omega_min_deg: float = 0.0

    KIND: ClassVar[str] = "equiangular"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        **PrescribedMapping.PARAMETERS,
        "omega_min_deg": OMEGA_MIN,
    }

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, low = coordinates("tau", tau), float(np.radians(self.omega_min_deg))
        span, Theta = self._omega_max - low, self._theta_max
        if Theta == 0:
            return low + span * tau, np.full_like(tau, span)
        tangent = tau * np.tan(Theta)
        return low + span / Theta * np.arctan(tangent), span / Theta * np.tan(Theta) / (
            1 + tangent**2
        )

    @cached_property
    def _meridian(self) -> PrescribedMeridian:
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
        lambda x: low + k * x,
        lambda x: np.full_like(x, k),
        lambda x: -2 / k * _log_cosine_ratio(low / 2, k / 2 * x),
    )


def _log_cosine_ratio(a: float, t: Array) -> Array:
    """Compute ``ln(cos(a + t)/cos(a))`` with full relative precision near t = 0."""
    ratio: Array = np.log1p(-2 * np.sin(t / 2) * np.sin(a + t / 2) / np.cos(a))
    return ratio


@dataclass(frozen=True)
class Conformal(PrescribedMapping):
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
        return (
            surface.single_viewpoint_distance if isinstance(surface, Hyperboloid) else float("inf")
        )

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
class UnitAspect(PrescribedMapping):
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
    def _meridian(self) -> PrescribedMeridian:
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
class Equiareal(PrescribedMapping):
    """Equal-area mapping of solid angles: ``sin(Omega/2)^2`` is linear in ``tan(theta)^2``.

    The field angle on the axis is Omega_min; if it is positive, the mapping has square-root
    behaviour and ``dOmega/dtau`` is 0 there. For an orthographic lens without Omega_min it is the
    sphere.

    >>> round(Equiareal(135.0, 12.0, 1.0).design_distance, 11)
    4.07235176766
    """

    omega_min_deg: float = 0.0

    KIND: ClassVar[str] = "equiareal"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        **PrescribedMapping.PARAMETERS,
        "omega_min_deg": OMEGA_MIN,
    }

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau = coordinates("tau", tau)
        low, high = np.sin(np.radians(self.omega_min_deg) / 2), np.sin(self._omega_max / 2)
        if low == 0:
            return 2 * np.arcsin(high * tau), 2 * high / np.sqrt(1 - (high * tau) ** 2)
        span = high**2 - low**2
        sine = np.sqrt(low**2 + span * tau**2)
        return 2 * np.arcsin(sine), 2 * span * tau / (sine * np.sqrt(1 - sine**2))

    @cached_property
    def _meridian(self) -> PrescribedMeridian:
        if self.theta_max_deg > 0:
            return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)
        if self.omega_min_deg > 0:
            return OrthographicMeridian.solve(*_both(self.mapping))
        A = 1 / np.sin(self._omega_max / 2)
        return OrthographicMeridian(
            *_both(self.mapping), lambda x: x**2 / (A + np.sqrt(A**2 - x**2))
        )


@dataclass(frozen=True)
class Rectifying(PrescribedMapping):
    """Perspective image of a distant plane: ``tan(Omega) = kappa tan(theta)``.

    >>> round(Rectifying(75.0, 12.0, 1.0).design_distance, 11)
    4.23651210948
    """

    KIND: ClassVar[str] = "rectifying"
    MAX_OMEGA_DEG: ClassVar[float] = 90.0

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, high = coordinates("tau", tau), np.tan(self._omega_max)
        return np.arctan(high * tau), high / (1 + (high * tau) ** 2)

    @cached_property
    def _meridian(self) -> PrescribedMeridian:
        if self.theta_max_deg > 0:
            return PerspectiveMeridian.solve(self._omega, self._domega, self._theta_max)
        kappa = float(np.tan(self._omega_max))

        def sag(x: Array) -> Array:  # integral of (sqrt(1 + t^2) - 1)/t, t = kappa x
            rise = (kappa * x) ** 2 / (1 + np.sqrt(1 + (kappa * x) ** 2))
            value: Array = (rise - np.log1p(rise / 2)) / kappa
            return value

        return OrthographicMeridian(*_both(self.mapping), sag)


# -- Mappings for finite distances: ground plane and cylinder --------------------------------------
#
# The field angle of a chief ray then depends on its mirror point, and the law of :mod:`.prescribed_mapping`
# becomes a differential equation with an unknown scale. It is solved by collocation: Newton's method
# solves the integral equation at Chebyshev nodes together with the condition at the rim, equivalent
# to shooting for m at spectral order. Derivatives are complex steps without cancellation. If much of
# the field is concentrated in little of the image, as for a plane observed up to 89.9 deg, a change
# of variable (:class:`NodeConcentration`) concentrates the nodes: about 60 replace 500 evenly spaced ones.

MAX_NODES = 512
NEWTON_STEPS = 40
STEP = 1e-30  # complex-step size: its square is negligible


@dataclass(frozen=True)
class NodeConcentration:
    """Change of variable from s to t, denser at fast changes of the field angle.

    Omega is an arc tangent of the image height with complex poles at ``centre +- i width``,
    relative to the image height of the rim; ``t = end (centre + width sinh(...))`` moves the poles
    away from the image.

    >>> nodes = NodeConcentration(centre=0.0, width=0.001, end=0.2)
    >>> t = nodes.t(np.array([0.0, 0.5, 1.0]))
    >>> t.round(5), nodes.s(t).round(12)
    (array([0.     , 0.00447, 0.2    ]), array([0. , 0.5, 1. ]))
    """

    centre: float
    width: float
    end: float

    @cached_property
    def _sinh_range(self) -> tuple[float, float]:
        """Argument of sinh at s = 0, and its increase up to s = 1."""
        low, high = (math.asinh((fraction - self.centre) / self.width) for fraction in (0.0, 1.0))
        return low, high - low

    def t(self, s: Array) -> Array:
        """Compute the viewing angle, or the distance from the axis."""
        low, span = self._sinh_range
        t: Array = self.end * (self.centre + self.width * np.sinh(low + span * s))
        return t

    def rate(self, s: Array) -> Array:
        """Compute dt/ds."""
        low, span = self._sinh_range
        rate: Array = self.end * self.width * span * np.cosh(low + span * s)
        return rate

    def s(self, t: Array) -> Array:
        """Compute the inverse of :meth:`t`."""
        low, span = self._sinh_range
        s: Array = (np.arcsinh((t / self.end - self.centre) / self.width) - low) / span
        return s


@dataclass(frozen=True)
class Solution:
    """Height along the meridian as a series in s, and height of the rim, for rim radius 1."""

    concentration: NodeConcentration
    series: Chebyshev
    rim_z: float

    def y(self, t: Array) -> Array:
        """Compute the height at t: ln(rho/m), or z."""
        return np.asarray(self.series(self.concentration.s(t)), float)


@dataclass(frozen=True)
class FiniteMapping(PrescribedMapping):
    """Mirror with an image height linear along a line of object points, fixed to the mirror.

    Internally, ``t`` is theta (perspective) or x (orthographic) and ``y`` is ``ln(rho/m)`` or z.
    """

    @abstractmethod
    def _target(self, tau: Any, rim_z: Any) -> tuple[Any, Any]:
        """Return object points (x, z), in rim radii, of image heights tau."""

    @abstractmethod
    def _poles(self) -> tuple[float, float]:
        """Return the image height of fastest field-angle change, and its width."""

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau, Theta = coordinates("tau", tau), self._theta_max
        if Theta == 0:
            return self._field(tau)
        unit = np.tan(Theta)
        omega, rate = self._field(np.arctan(tau * unit))
        return omega, rate * unit / (1 + (tau * unit) ** 2)

    def _field(self, t: Array) -> tuple[Array, Array]:
        """Compute the field angle and dOmega/dt, including the dependence on the meridian."""
        return self._field_and_height(t)[:2]

    def _field_and_height(self, t: Array) -> tuple[Array, Array, Array]:
        """Compute the field angle, dOmega/dt and the height y."""
        y, rim_z = self._solution.y(t), self._solution.rim_z
        law = self._law(t, y, rim_z)
        dx, dz = self._ray(t + 1j * STEP, y + 1j * STEP * law, rim_z)
        omega = np.arctan2(dx.real, dz.real)
        return omega, (dx.imag * dz.real - dz.imag * dx.real) / (dx.real**2 + dz.real**2) / STEP, y

    def _angle_and_height(self, t: Array) -> tuple[Array, Array]:
        """Compute the field angle and the height y."""
        y = self._solution.y(t)
        return np.arctan2(*self._ray(t, y, self._solution.rim_z)), y

    @cached_property
    def _meridian(self) -> PrescribedMeridian:
        if self.theta_max_deg == 0:
            return OrthographicMeridian(
                lambda x: self._angle_and_height(x)[0],
                lambda x: self._field(x)[1],
                self._solution.y,
            )
        return PerspectiveMeridian(self._angle_and_height, self._field_and_height, self._theta_max)

    # -- differential equation ---------------------------------------------------------------------

    def _ray(self, t: Any, y: Any, rim_z: Any) -> tuple[Any, Any]:
        """Return the vector ``(dx, -dz)`` from mirror point to object point."""
        if self.theta_max_deg == 0:
            tau, x, z = t, t, y
        else:
            m = 1 / np.tan(self._theta_max) - rim_z
            tau = np.tan(t) / np.tan(self._theta_max)
            x, z = m * np.exp(y) * np.sin(t), m * (np.exp(y) * np.cos(t) - 1)
        target_x, target_z = self._target(tau, rim_z)
        return target_x - x, z - target_z

    def _law(self, t: Any, y: Any, rim_z: Any) -> Any:
        """Compute dy/dt = tan((Omega + theta)/2), also for complex numbers."""
        dx, dz = self._ray(t, y, rim_z)
        half = dx / (np.sqrt(dx * dx + dz * dz) + dz)
        if self.theta_max_deg == 0:
            return half
        other = np.tan(t / 2)
        return (half + other) / (1 - half * other)

    def _end(self, y: float, rim_z: float) -> float:
        """Return the residual at the rim, which must be at x = 1 and height rim_z."""
        if self.theta_max_deg == 0:
            return y - rim_z
        return y - float(
            np.log(1 / (1 / np.tan(self._theta_max) - rim_z) / np.sin(self._theta_max))
        )

    @cached_property
    def _solution(self) -> Solution:
        nodes = 32
        while True:
            solution = self._collocate(nodes)
            if solution is not None:
                size = np.abs(solution.series.coef)
                if size[-4:].max() <= 1e-15 * size.max() or nodes >= MAX_NODES:
                    return solution
            elif nodes >= MAX_NODES:
                raise InvalidParameter(
                    f"no {self.KIND} mirror at these distances reaches omega_max_deg = "
                    f"{self.omega_max_deg:g} at theta_max_deg = {self.theta_max_deg:g}; "
                    "reduce the angles or increase the object distance"
                )
            nodes *= 2

    def _collocate(self, count: int) -> Solution | None:
        """Solve the equations on ``count`` nodes by Newton's method; None without convergence."""
        concentration = NodeConcentration(*self._poles(), end=self._theta_max or 1.0)
        nodes, integral, last = _integration(count)
        s = (nodes + 1) / 2
        t, weights = concentration.t(s), concentration.rate(s) / 2
        integral, last = integral * weights, last * weights
        rim_z = (
            float(np.tan((self._omega_max - self._theta_max) / 2)) / 2
        )  # initial value: the height of a paraboloid
        y = integral @ np.tan(
            (self._omega_max * t / concentration.end + (t if self.theta_max_deg else 0.0)) / 2
        )
        for _ in range(NEWTON_STEPS):
            with np.errstate(all="ignore"):
                law = self._law(t, y, rim_z)
                by_y = self._law(t, y + 1j * STEP, rim_z).imag / STEP
                by_z = self._law(t, y, rim_z + 1j * STEP).imag / STEP
                y_end = float(last @ law)
                missing = self._end(y_end, rim_z)
                slope = (self._end(y_end, rim_z + 1e-6) - self._end(y_end, rim_z - 1e-6)) / 2e-6
            residual = np.append(y - integral @ law, missing)
            jacobian = np.zeros((count + 1, count + 1))
            jacobian[:-1, :-1] = np.eye(count) - integral * by_y
            jacobian[:-1, -1] = -integral @ by_z
            jacobian[-1, :-1] = last * by_y
            jacobian[-1, -1] = last @ by_z + slope
            if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
                return None
            try:
                step = np.linalg.solve(jacobian, residual)
            except np.linalg.LinAlgError:
                return None
            y, rim_z = y - step[:-1], rim_z - float(step[-1])
            if np.abs(step).max() <= 1e-14 * max(1.0, float(np.abs(y).max())):
                break
        else:
            return None
        coefficients = np.linalg.solve(
            chebyshev.chebvander(nodes, count - 1), self._law(t, y, rim_z) * weights * 2
        )
        return Solution(
            concentration, Chebyshev(coefficients, domain=[0.0, 1.0]).integ(lbnd=0.0), rim_z
        )


@lru_cache(maxsize=8)
def _integration(count: int) -> tuple[Array, Array, Array]:
    """Return Chebyshev nodes, and integration matrices to each node and to 1."""
    nodes: NDArray[np.float64] = chebyshev.chebpts1(count)
    to_series = np.linalg.inv(chebyshev.chebvander(nodes, count - 1))
    integrals = np.stack([chebyshev.chebint(unit, lbnd=-1) for unit in np.eye(count)])  # rows T_k
    at_nodes = chebyshev.chebvander(nodes, count) @ integrals.T
    at_end = chebyshev.chebvander(np.ones(1), count) @ integrals.T
    return nodes, at_nodes @ to_series, (at_end @ to_series)[0]


DISTANCE = (1e-3, 1e7)


@dataclass(frozen=True)
class GroundPlane(FiniteMapping):
    """Plan view of a plane at finite distance, perpendicular to the axis.

    ``plane_distance_mm`` is the distance of the plane from the mirror vertex, on the lens side (z =
    -H). For a distant plane it is the :class:`Rectifying` mirror.

    >>> mirror = GroundPlane(60.0, 12.0, 40.0, plane_distance_mm=800.0)
    >>> omega, _ = mirror.mapping([0.5, 1.0])
    >>> np.degrees(omega).round(3)
    array([41.218, 60.   ])
    """

    plane_distance_mm: float

    KIND: ClassVar[str] = "ground-plane"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        **PrescribedMapping.PARAMETERS,
        "plane_distance_mm": Parameter(
            "mm", *DISTANCE, "distance from the mirror vertex to the plane beyond the lens (H)"
        ),
    }
    MAX_OMEGA_DEG: ClassVar[float] = 90.0

    def _target(self, tau: Any, rim_z: Any) -> tuple[Any, Any]:
        H = self.plane_distance_mm / self.rim_radius_mm
        return (1 + (H + rim_z) * np.tan(self._omega_max)) * tau, -H

    def _poles(self) -> tuple[float, float]:
        return 0.0, 1 / math.tan(self._omega_max)


@dataclass(frozen=True)
class CylinderMapping(FiniteMapping):
    """Cylinder about the axis: its height coordinate is linear in the image height.

    The image centre corresponds to ``omega_min_deg`` > 0 on the cylinder; the mirror has an apex.

    >>> mirror = CylinderMapping(110.0, 12.0, 40.0, omega_min_deg=60.0, cylinder_radius_mm=1000.0)
    >>> mirror.is_pointed
    True
    """

    omega_min_deg: float
    cylinder_radius_mm: float

    KIND: ClassVar[str] = "cylinder"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        **PrescribedMapping.PARAMETERS,
        "omega_min_deg": Parameter(
            "deg",
            1.0,
            OMEGA_MIN.high,
            "field angle at the image centre; greater than 0 for a pointed mirror",
        ),
        "cylinder_radius_mm": Parameter(
            "mm", *DISTANCE, "radius of the cylinder, greater than that of the rim"
        ),
    }

    def __post_init__(self) -> None:
        check_fields(self)
        if self.cylinder_radius_mm <= self.rim_radius_mm:
            raise InvalidParameter(
                "cylinder_radius_mm must be greater than rim_radius_mm = "
                f"{self.rim_radius_mm:g}; got {self.cylinder_radius_mm:g}"
            )
        super().__post_init__()

    def _target(self, tau: Any, rim_z: Any) -> tuple[Any, Any]:
        R = self.cylinder_radius_mm / self.rim_radius_mm
        low = -R / np.tan(np.radians(self.omega_min_deg))
        high = rim_z - (R - 1) / np.tan(self._omega_max)
        return R, low + (high - low) * tau

    def _poles(self) -> tuple[float, float]:
        start, end = (
            1 / math.tan(omega) for omega in (math.radians(self.omega_min_deg), self._omega_max)
        )
        return start / (start - end), 1 / (start - end)


# -- Custom mappings -------------------------------------------------------------------------------

DEGREE = 5  # quintic in tau, for a smooth curvature of the mirror
MAX_ROWS = 4096


def check_rows(omega_deg: Sequence[float], height: Sequence[float]) -> None:
    """Check the table of a mapping.

    Raises
    ------
    InvalidParameter
        If the columns differ in length, have too few rows, or do not increase from the image
        centre.
    """
    if len(omega_deg) != len(height):
        raise InvalidParameter(
            f"omega_deg and height must have equally many values; got {len(omega_deg)} and {len(height)}"
        )
    if len(omega_deg) <= DEGREE:
        raise InvalidParameter(
            f"omega_deg must have at least {DEGREE + 1} values; got {len(omega_deg)}"
        )
    if height[0] != 0.0:
        raise InvalidParameter(f"height must start with 0, at the image centre; got {height[0]:g}")
    for name, column in (("omega_deg", omega_deg), ("height", height)):
        if not np.all(np.diff(column) > 0):
            i = int(np.argmin(np.diff(column) > 0))
            raise InvalidParameter(
                f"{name} must increase; got {column[i]:g} and {column[i + 1]:g} in rows {i + 1} and {i + 2}"
            )


@dataclass(frozen=True)
class TabulatedMapping(MappingMirror):
    """Mirror with a tabulated mapping: image heights, in any unit, of increasing field angles.

    A quintic spline interpolates Omega as a function of height. The first height is 0, the image
    centre; the mirror is smooth if the field angle there is 0, and pointed otherwise. The last row
    is the rim.

    Raises
    ------
    InvalidParameter
        If there are too few rows, columns differ in length or do not increase, or the rim is not
        visible to the lens.

    Examples
    --------
    >>> omega = np.linspace(0, 120, 41)
    >>> stereographic = TabulatedMapping(tuple(omega), tuple(np.tan(np.radians(omega) / 2)), 12.0, 40.0)
    >>> from omnimirror.optics.mirrors import UnitAspect
    >>> float(abs(stereographic.sag(30.0) - UnitAspect(120.0, 12.0, 40.0).sag(30.0))) < 1e-6
    True
    """

    omega_deg: tuple[float, ...]
    height: tuple[float, ...]
    theta_max_deg: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "tabulated-mapping"
    FILES = (MAPPING_FILE,)
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "omega_deg": Parameter(
            "deg", 0.0, 179.0, "field angles, increasing from the image centre to the rim"
        ),
        "height": Parameter(
            "", 0.0, 1e9, "image heights at these angles in any unit, increasing from 0"
        ),
        "theta_max_deg": THETA_MAX,
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._take_columns(self.omega_deg, self.height)
        self._check_parameters()
        check_rows(self.omega_deg, self.height)
        self._check_reach(self.omega_deg[-1])
        self._check_surface()

    def _take_columns(self, omega_deg: ArrayLike, height: ArrayLike) -> None:
        object.__setattr__(self, "omega_deg", floats("omega_deg", omega_deg))
        object.__setattr__(self, "height", floats("height", height))

    @classmethod
    def unchecked(
        cls, omega_deg: Array, height: Array, theta_max_deg: float, rim_radius_mm: float
    ) -> TabulatedMapping:
        """Create a mirror without the costly check of its surface, for iterations."""
        mirror = object.__new__(cls)
        mirror._take_columns(omega_deg, height)
        object.__setattr__(mirror, "theta_max_deg", theta_max_deg)
        object.__setattr__(mirror, "rim_radius_mm", rim_radius_mm)
        check_rows(mirror.omega_deg, mirror.height)
        mirror._check_reach(mirror.omega_deg[-1])
        return mirror

    def checked(self) -> TabulatedMapping:
        """Return the mirror after the check that its surface extends to the rim."""
        self._check()
        return self

    @classmethod
    def from_function(
        cls,
        height: Callable[[Array], ArrayLike],
        omega_max_deg: float,
        theta_max_deg: float,
        rim_radius_mm: float,
        omega_min_deg: float = 0.0,
        tolerance: float = 1e-11,
    ) -> TabulatedMapping:
        """Create the mirror of a function from field angles (n,) to image heights.

        Rows are added until the spline agrees with the function halfway between rows, within
        ``tolerance`` relative to the height of the rim.

        Raises
        ------
        InvalidParameter
            If the function does not increase from 0 at the centre, or is not smooth enough for 4096
            rows.

        Examples
        --------
        >>> mirror = TabulatedMapping.from_function(lambda omega: np.sin(omega / 2), 135.0, 12.0, 1.0)
        >>> round(mirror.design_distance, 9)
        4.072351768
        """
        if not callable(height):
            raise InvalidType(
                f"height must be a function of field angles (n,) in radians; got {format_value(height)}"
            )
        low, high = number("omega_min_deg", omega_min_deg), number("omega_max_deg", omega_max_deg)
        tolerance = number("tolerance", tolerance, above=0.0)
        rows = 64
        while True:
            # sinusoidal spacing: denser at the rim, with steeper mappings
            fractions = np.sin(np.pi / 2 * np.linspace(0.0, 1.0, rows + 1))
            omega = np.radians(low + (high - low) * fractions)
            between = (omega[1:] + omega[:-1]) / 2
            h, heights_between = (coordinates("height(omega)", height(a)) for a in (omega, between))
            if (h.shape, heights_between.shape) != (omega.shape, between.shape):
                raise InvalidParameter(
                    f"the mapping function must return one height per field angle, shape ({len(omega)},); got {h.shape}"
                )
            if not (np.isfinite(h).all() and np.isfinite(heights_between).all()):
                raise InvalidParameter(
                    "the mapping function must return finite heights over the field"
                )
            mirror = cls(tuple(np.degrees(omega)), tuple(h), theta_max_deg, rim_radius_mm)
            angles, rate = mirror.mapping(heights_between / h[-1])
            error = float(np.abs((angles - between) / rate).max())
            if error <= tolerance:
                return mirror
            rows *= 2
            if rows > MAX_ROWS:
                raise InvalidParameter(
                    f"the mapping function must be smooth: the error with {MAX_ROWS} rows "
                    f"is {error:.2g} of the rim's height; use a table, or a tolerance "
                    f"above {tolerance:g}"
                )

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline]:
        from scipy.interpolate import make_interp_spline

        tau, omega = np.array(self.height) / self.height[-1], np.radians(self.omega_deg)
        if self.omega_deg[0] == 0.0:  # smooth: symmetric continuation across the axis
            tau, omega = np.concatenate([-tau[:0:-1], tau]), np.concatenate([-omega[:0:-1], omega])
        spline = make_interp_spline(tau, omega, k=DEGREE)
        return spline, spline.derivative()

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau = coordinates("tau", tau)
        return self.angles(tau), self.rates(tau)

    def angles(self, tau: Array) -> Array:
        tau = coordinates("tau", tau)
        omega = np.asarray(self._splines[0](tau))
        if self.omega_deg[0] == 0.0 and (np.abs(tau) < APEX).any():
            omega = near_apex(tau, tau * self.rates(tau), omega)
        return omega

    def rates(self, tau: Array) -> Array:
        return np.asarray(self._splines[1](coordinates("tau", tau)))


# -- Registry of mappings --------------------------------------------------------------------------

MAPPINGS: dict[str, type[MappingMirror]] = {
    cls.KIND: cls
    for cls in (
        Equidistant,
        Equiangular,
        Conformal,
        UnitAspect,
        Equiareal,
        Rectifying,
        GroundPlane,
        CylinderMapping,
        TabulatedMapping,
    )
}
"""Mappings by name, which is also the kind of the mirror."""
