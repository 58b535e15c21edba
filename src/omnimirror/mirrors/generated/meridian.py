"""The meridian that has a wanted mapping, seen by a perspective or an orthographic lens.

In polar coordinates about the lens, ``P = rho (sin theta, cos theta)``, a mirror that sends the
chief ray of viewing angle theta to field angle ``Omega(theta)`` obeys

    d ln rho / d theta = tan((Omega(theta) + theta) / 2)

(the law of reflection, Eqs. 2-5), so that ``ln rho`` is one integral. The paper holds that its
equidistant mirror is "difficult to obtain by mathematical analysis"; it is this one quadrature.
Under an orthographic lens theta is 0 and the law is ``z' = tan(Omega(x)/2)``.

All lengths here are in units of the rim radius.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]

CELLS = 1024  # of the table theta(x); cubic pieces err by 1e-13 or so, and one step of Newton's rule by its square
MOST_TERMS = 2048  # of a series; a mapping given by a table has a few thousand pieces and needs most of them


class GeneratedMeridian(Protocol):
    """What a generated mirror asks of its meridian; lengths in units of the rim radius."""

    @property
    def distance(self) -> float:
        """Lens to vertex, m; infinite under an orthographic lens."""

    def profile(self, x: Array) -> tuple[Array, Array, Array]:
        """Sag, slope and curvature at distances x in [0, 1] from the axis."""


def converged_series(function: Curve, high: float) -> Chebyshev:
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
        if size[-4:].max() <= 1e-13 * size.max() or degree >= MOST_TERMS:
            return series
        degree *= 2


@dataclass(frozen=True)
class PerspectiveMeridian:
    """A meridian as a function of the viewing angle theta.

    Attributes
    ----------
    omega, domega : callables
        Field angle and its derivative for an array of viewing angles, all in radians.
    theta_max : radians
    log_rho : callable
        ln(rho/m) of an array of viewing angles; 0 on the axis.
    """

    omega: Curve
    domega: Curve
    theta_max: float
    log_rho: Curve

    @classmethod
    def solve(cls, omega: Curve, domega: Curve, theta_max: float) -> PerspectiveMeridian:
        """Integrate the mapping from the axis to the rim."""
        series = converged_series(lambda theta: np.tan((omega(theta) + theta) / 2), theta_max)
        return cls(omega, domega, theta_max, series.integ(lbnd=0.0))

    @cached_property
    def distance(self) -> float:
        """Lens to vertex; it scales the rim to 1."""
        end = np.array(self.theta_max)
        return float(np.exp(-self.log_rho(end)) / np.sin(end))

    def x(self, theta: Array) -> tuple[Array, Array]:
        """Distance from the axis and its derivative dx/dtheta."""
        rho = self.distance * np.exp(self.log_rho(theta))
        sin, cos = np.sin(theta), np.cos(theta)
        return rho * sin, rho * (cos + np.tan((self.omega(theta) + theta) / 2) * sin)

    def z(self, theta: Array) -> Array:
        # rho cos(theta) - m, without the cancellation near the axis
        z: Array = np.expm1(self.log_rho(theta)) * np.cos(theta) - 2 * np.sin(theta / 2) ** 2
        return self.distance * z

    def theta(self, x: Array) -> Array:
        """Viewing angle of the point at x, the inverse of :meth:`x`; exactly 0 on the axis."""
        angles, rates = self._table
        cell = np.clip(np.nan_to_num(x * CELLS), 0, CELLS - 1).astype(int)
        t = x * CELLS - cell
        a, b = angles[cell], angles[cell + 1]
        da, db = rates[cell] / CELLS, rates[cell + 1] / CELLS
        guess: Array = a + t * (da + t * (3 * (b - a) - 2 * da - db + t * (da + db - 2 * (b - a))))
        found, rate = self.x(guess)
        return guess - (found - x) / rate

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """Viewing angles and dtheta/dx at evenly spaced x, by Newton's rule inside brackets."""
        x = np.linspace(0.0, 1.0, CELLS + 1)
        low, high = np.zeros_like(x), np.full_like(x, self.theta_max)
        theta = x * self.theta_max
        for _ in range(60):  # bisection alone would reach the last digit; Newton's rule takes over early
            found, rate = self.x(theta)
            error = found - x
            low, high = np.where(error <= 0, theta, low), np.where(error >= 0, theta, high)
            step = theta - error / rate
            new = np.where((step >= low) & (step <= high), step, (low + high) / 2)
            change = np.abs(new - theta).max()
            theta = new
            if change <= 1e-15 * self.theta_max:
                break
        theta[0] = 0.0
        return theta, 1 / self.x(theta)[1]

    def profile(self, x: Array) -> tuple[Array, Array, Array]:
        theta = self.theta(x)
        beta = (self.omega(theta) - theta) / 2
        return self.z(theta), np.tan(beta), (self.domega(theta) - 1) / 2 / np.cos(beta) ** 2 / self.x(theta)[1]


@dataclass(frozen=True)
class OrthographicMeridian:
    """A meridian as a function of the distance x from the axis, ``z' = tan(Omega(x)/2)``."""

    omega: Curve
    domega: Curve
    sag: Curve

    distance = float("inf")

    @classmethod
    def solve(cls, omega: Curve, domega: Curve) -> OrthographicMeridian:
        """Integrate the mapping from the axis to the rim."""
        series = converged_series(lambda x: np.tan(omega(x) / 2), 1.0)
        return cls(omega, domega, series.integ(lbnd=0.0))

    def profile(self, x: Array) -> tuple[Array, Array, Array]:
        half = self.omega(x) / 2
        return self.sag(x), np.tan(half), self.domega(x) / 2 / np.cos(half) ** 2
