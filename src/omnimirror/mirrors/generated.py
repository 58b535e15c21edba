"""Mirrors generated from a wanted mapping of field angles to the image, by quadrature.

In polar coordinates about the lens, ``P = rho (sin theta, cos theta)``, a mirror that sends the
chief ray of viewing angle theta to field angle ``Omega(theta)`` obeys

    d ln rho / d theta = tan((Omega(theta) + theta) / 2)

(the law of reflection, Eqs. 2-5), so that ``ln rho`` is one integral. The paper holds that its
equidistant mirror is "difficult to obtain by mathematical analysis"; it is this one quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike

from ..errors import InvalidParameter
from ..parameters import Parameter
from .base import RIM_RADIUS, Array, Mirror

GUESS_DEGREE = 32  # of theta(x)/x, from which one step of Newton's rule leads to full precision


def converged_series(function: Callable[[Array], Array], high: float) -> Chebyshev:
    """Chebyshev series of a smooth function over [0, high], of as many terms as it needs.

    Its last terms are at most 1e-13 of its first; the noise of steep functions lies a little below. An
    integral divides that by the number of terms, and is then exact to rounding.

    >>> converged_series(np.exp, 1.0).degree()
    32
    """
    degree = 32
    while True:
        series = Chebyshev.interpolate(function, degree, domain=[0.0, high])
        size = np.abs(series.coef)
        if size[-4:].max() <= 1e-13 * size.max() or degree >= 1024:
            return series
        degree *= 2


@dataclass(frozen=True)
class GeneratedMeridian:
    """A meridian as a function of the viewing angle theta; lengths in units of its rim radius.

    Attributes
    ----------
    omega, domega : callables
        Field angle and its derivative for an array of viewing angles, all in radians.
    log_rho : Chebyshev series of ln(rho/m) over [0, theta_max]
    distance : lens to vertex, m
    """

    omega: Callable[[Array], Array]
    domega: Callable[[Array], Array]
    theta_max: float
    log_rho: Chebyshev
    distance: float

    def theta(self, x: Array) -> Array:
        """Viewing angle of the point at x, the inverse of :meth:`x`; exactly 0 on the axis."""
        guess: Array = x * self._theta_over_x(x)
        return guess - (self.x(guess) - x) / self.dx(guess)

    @cached_property
    def _theta_over_x(self) -> Chebyshev:
        return Chebyshev.interpolate(lambda x: self._solve_theta(x) / x, GUESS_DEGREE, domain=[0.0, 1.0])

    @classmethod
    def solve(
        cls, omega: Callable[[Array], Array], domega: Callable[[Array], Array], theta_max: float
    ) -> GeneratedMeridian:
        """Integrate the mapping from the axis to the rim and scale the rim to 1."""

        def integrand(theta: Array) -> Array:
            return np.tan((omega(theta) + theta) / 2)

        series = converged_series(integrand, theta_max).integ(lbnd=0.0)
        distance = float(np.exp(-series(theta_max)) / np.sin(theta_max))
        return cls(omega, domega, theta_max, series, distance)

    def x(self, theta: Array) -> Array:
        x: Array = self.distance * np.exp(self.log_rho(theta)) * np.sin(theta)
        return x

    def z(self, theta: Array) -> Array:
        # rho cos(theta) - m, without the cancellation near the axis
        z: Array = np.expm1(self.log_rho(theta)) * np.cos(theta) - 2 * np.sin(theta / 2) ** 2
        return self.distance * z

    def dx(self, theta: Array) -> Array:
        rate = np.tan((self.omega(theta) + theta) / 2)
        dx: Array = np.exp(self.log_rho(theta)) * (np.cos(theta) + rate * np.sin(theta))
        return self.distance * dx

    def _solve_theta(self, x: Array) -> Array:
        """Viewing angle of x, by Newton's rule from a fine table."""
        nodes = np.linspace(0.0, self.theta_max, 257)
        theta = np.interp(x, self.x(nodes), nodes)
        for _ in range(4):  # quadratic convergence from 1e-5: the third step already changes nothing
            theta = theta - (self.x(theta) - x) / self.dx(theta)
        return theta


@dataclass(frozen=True)
class Equidistant(Mirror):
    """The exact equidistant mirror: image height proportional to the field angle, all the way.

    ``Omega = k tan(theta)``, ``k = Omega_max / tan(Theta)``, seen by a perspective lens at
    :attr:`design_distance` from the vertex. (The paper's polynomial E-DI is .49 % off that line.)

    >>> mirror = Equidistant(omega_max_deg=135.0, theta_max_deg=12.0, rim_radius_mm=1.0)
    >>> round(mirror.design_distance, 11)
    3.9242676015...
    """

    omega_max_deg: float
    theta_max_deg: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "equidistant"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "omega_max_deg": Parameter("deg", 1.0, 179.0, "field angle at the rim"),
        "theta_max_deg": Parameter("deg", 0.1, 60.0, "viewing angle of the lens at the rim"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        for name in ("omega_max_deg", "theta_max_deg"):
            self.PARAMETERS[name].check(name, getattr(self, name))
        if not self.theta_max_deg < self.omega_max_deg < 180 - self.theta_max_deg:
            raise InvalidParameter(
                f"omega_max_deg = {self.omega_max_deg:g} cannot be reached with theta_max_deg = "
                f"{self.theta_max_deg:g}; it is valid between {self.theta_max_deg:g} and "
                f"{180 - self.theta_max_deg:g}, where the rim would be seen edge-on"
            )
        self._check()

    @property
    def design_distance(self) -> float:
        """Distance m from lens to vertex, mm, for which the mapping is exact."""
        return self._meridian.distance * self.rim_radius_mm

    @cached_property
    def _meridian(self) -> GeneratedMeridian:
        theta_max = float(np.radians(self.theta_max_deg))
        k = float(np.radians(self.omega_max_deg)) / np.tan(theta_max)
        return GeneratedMeridian.solve(lambda theta: k * np.tan(theta), lambda theta: k / np.cos(theta) ** 2, theta_max)

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        M, g = self.rim_radius_mm, self._meridian
        x = np.asarray(x_mm, dtype=float) / M
        theta = np.where((x >= 0) & (x <= 1 + 1e-12), g.theta(x), np.nan)
        beta = (g.omega(theta) - theta) / 2
        curvature = (g.domega(theta) - 1) / 2 / np.cos(beta) ** 2 / g.dx(theta)
        return g.z(theta) * M, np.tan(beta), curvature / M
