"""Mappings of points at finite distance: ground plane and cylinder, drawn to scale in the image.

The field angle of a chief ray then depends on its mirror point, and the law of :mod:`.meridian`
becomes a differential equation with an unknown scale. It is solved by collocation: Newton's method
solves the integral equation at Chebyshev nodes together with the condition at the rim, equivalent
to shooting for m at spectral order. Derivatives are complex steps without cancellation. If much of
the field is concentrated in little of the image, as for a plane observed up to 89.9 deg, a change
of variable (:class:`Crowding`) concentrates the nodes: about 60 replace 500 evenly spaced ones.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev
from numpy.typing import ArrayLike, NDArray

from ....base.arguments import check_fields, coordinates
from ....base.errors import InvalidParameter
from ....base.numerics.lazy import cached_property
from ....base.parameters import Parameter
from ....base.typing import Array
from .base import OMEGA_MIN, Generated
from .meridian import GeneratedMeridian, OrthographicMeridian, PerspectiveMeridian

MOST_NODES = 512
NEWTON_STEPS = 40
STEP = 1e-30  # complex-step size: its square is negligible


@dataclass(frozen=True)
class Crowding:
    """Change of variable from s to t, denser at fast changes of the field angle.

    Omega is an arc tangent of the image height with complex poles at ``middle +- i width``,
    relative to the image height of the rim; ``t = end (middle + width sinh(...))`` moves the poles
    away from the image.

    >>> places = Crowding(middle=0.0, width=0.001, end=0.2)
    >>> t = places.t(np.array([0.0, 0.5, 1.0]))
    >>> t.round(5), places.s(t).round(12)
    (array([0.     , 0.00447, 0.2    ]), array([0. , 0.5, 1. ]))
    """

    middle: float
    width: float
    end: float

    @cached_property
    def _reach(self) -> tuple[float, float]:
        """Argument of sinh at s = 0, and its increase up to s = 1."""
        low, high = (math.asinh((share - self.middle) / self.width) for share in (0.0, 1.0))
        return low, high - low

    def t(self, s: Array) -> Array:
        """Compute the viewing angle, or the distance from the axis."""
        low, span = self._reach
        t: Array = self.end * (self.middle + self.width * np.sinh(low + span * s))
        return t

    def rate(self, s: Array) -> Array:
        """Compute dt/ds."""
        low, span = self._reach
        rate: Array = self.end * self.width * span * np.cosh(low + span * s)
        return rate

    def s(self, t: Array) -> Array:
        """Compute the inverse of :meth:`t`."""
        low, span = self._reach
        s: Array = (np.arcsinh((t / self.end - self.middle) / self.width) - low) / span
        return s


@dataclass(frozen=True)
class Solution:
    """Height along the meridian as a series in s, and height of the rim, for rim radius 1."""

    places: Crowding
    series: Chebyshev
    rim_z: float

    def y(self, t: Array) -> Array:
        """Compute the height at t: ln(rho/m), or z."""
        return np.asarray(self.series(self.places.s(t)), float)


@dataclass(frozen=True)
class FiniteMapping(Generated):
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
        return self._course(t)[:2]

    def _course(self, t: Array) -> tuple[Array, Array, Array]:
        """Compute the field angle, dOmega/dt and the height y."""
        y, rim_z = self._solution.y(t), self._solution.rim_z
        law = self._law(t, y, rim_z)
        dx, dz = self._ray(t + 1j * STEP, y + 1j * STEP * law, rim_z)
        omega = np.arctan2(dx.real, dz.real)
        return omega, (dx.imag * dz.real - dz.imag * dx.real) / (dx.real**2 + dz.real**2) / STEP, y

    def _place(self, t: Array) -> tuple[Array, Array]:
        """Compute the field angle and the height y."""
        y = self._solution.y(t)
        return np.arctan2(*self._ray(t, y, self._solution.rim_z)), y

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        if self.theta_max_deg == 0:
            return OrthographicMeridian(lambda x: self._place(x)[0], lambda x: self._field(x)[1], self._solution.y)
        return PerspectiveMeridian(self._place, self._course, self._theta_max)

    # -- the differential equation -----------------------------------------------------------------

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
        return y - float(np.log(1 / (1 / np.tan(self._theta_max) - rim_z) / np.sin(self._theta_max)))

    @cached_property
    def _solution(self) -> Solution:
        nodes = 32
        while True:
            solution = self._collocate(nodes)
            if solution is not None:
                size = np.abs(solution.series.coef)
                if size[-4:].max() <= 1e-15 * size.max() or nodes >= MOST_NODES:
                    return solution
            elif nodes >= MOST_NODES:
                raise InvalidParameter(
                    f"no {self.KIND} mirror with these distances reaches omega_max_deg = {self.omega_max_deg:g} at "
                    f"theta_max_deg = {self.theta_max_deg:g}; it is valid for smaller angles or farther objects"
                )
            nodes *= 2

    def _collocate(self, count: int) -> Solution | None:
        """Solve the equations on ``count`` nodes by Newton's method; None without convergence."""
        places = Crowding(*self._poles(), end=self._theta_max or 1.0)
        nodes, integral, last = _integration(count)
        s = (nodes + 1) / 2
        t, weights = places.t(s), places.rate(s) / 2
        integral, last = integral * weights, last * weights
        rim_z = float(np.tan((self._omega_max - self._theta_max) / 2)) / 2  # of a paraboloid
        y = integral @ np.tan((self._omega_max * t / places.end + (t if self.theta_max_deg else 0.0)) / 2)
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
        coefficients = np.linalg.solve(chebyshev.chebvander(nodes, count - 1), self._law(t, y, rim_z) * weights * 2)
        return Solution(places, Chebyshev(coefficients, domain=[0.0, 1.0]).integ(lbnd=0.0), rim_z)


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
        **Generated.PARAMETERS,
        "plane_distance_mm": Parameter("mm", *DISTANCE, "mirror vertex to the plane, towards the lens and beyond (H)"),
    }
    MOST_OMEGA_DEG: ClassVar[float] = 90.0

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
        **Generated.PARAMETERS,
        "omega_min_deg": Parameter(
            "deg", 1.0, OMEGA_MIN.high, "field angle at the image centre; the mirror is pointed"
        ),
        "cylinder_radius_mm": Parameter("mm", *DISTANCE, "radius of the cylinder, beyond that of the rim"),
    }

    def __post_init__(self) -> None:
        check_fields(self)
        if self.cylinder_radius_mm <= self.rim_radius_mm:
            raise InvalidParameter(
                f"cylinder_radius_mm = {self.cylinder_radius_mm:g} does not clear the mirror; it is valid above "
                f"rim_radius_mm = {self.rim_radius_mm:g}"
            )
        super().__post_init__()

    def _target(self, tau: Any, rim_z: Any) -> tuple[Any, Any]:
        R = self.cylinder_radius_mm / self.rim_radius_mm
        low = -R / np.tan(np.radians(self.omega_min_deg))
        high = rim_z - (R - 1) / np.tan(self._omega_max)
        return R, low + (high - low) * tau

    def _poles(self) -> tuple[float, float]:
        begin, end = (1 / math.tan(omega) for omega in (math.radians(self.omega_min_deg), self._omega_max))
        return begin / (begin - end), 1 / (begin - end)
