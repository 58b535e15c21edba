"""Meridian of a mirror with a prescribed mapping from field angle to image height.

In polar coordinates about the lens, ``P = rho (sin theta, cos theta)``, a mirror that reflects the
chief ray of viewing angle theta to field angle ``Omega(theta)`` satisfies

    d ln rho / d theta = tan((Omega(theta) + theta) / 2)

(the law of reflection, Eqs. 2-5); ``ln rho`` is a single integral. For an orthographic lens theta
is 0 and the law is ``z' = tan(Omega(x)/2)``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from ...base.arguments import coordinates
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from .mirror import RIM_RADIUS, Mirror

# -- Meridian with a prescribed mapping ------------------------------------------------------------
#
# In polar coordinates about the lens, ``P = rho (sin theta, cos theta)``, a mirror that reflects the
# chief ray of viewing angle theta to field angle ``Omega(theta)`` satisfies
#
#     d ln rho / d theta = tan((Omega(theta) + theta) / 2)
#
# (the law of reflection, Eqs. 2-5); ``ln rho`` is a single integral. The paper calls its equidistant
# mirror "difficult to obtain by mathematical analysis"; this quadrature gives it exactly. For an
# orthographic lens theta is 0 and the law is ``z' = tan(Omega(x)/2)``.
#
# All lengths in this module are in units of the rim radius.

Curve = Callable[[Array], Array]

CELLS = (
    1024  # cells of the table theta(x); cubic pieces are accurate to 1e-14 before the Newton step
)
FEW_CELLS = 64  # coarse table for its computation
CLOSE = 1e-11  # Newton step after which the linearised mapping is exact to rounding

TERMS = 16  # terms of the series of one piece
NODES = chebyshev.chebpts1(TERMS)
TO_SERIES = 2 / TERMS * chebyshev.chebvander(NODES, TERMS - 1).T
TO_SERIES[0] /= 2
NEGLIGIBLE = 1e-14  # last terms of a series, relative to the largest
MIN_PIECES, MAX_BISECTIONS = 4, 12


class PrescribedMeridian(Protocol):
    """Meridian of a generated mirror; lengths in units of the rim radius."""

    @property
    def distance(self) -> float:
        """Distance m from lens to vertex; infinite for an orthographic lens."""

    def profile(self, x: Array) -> tuple[Array, Array, Array]:
        """Compute sag, slope and curvature at distances x in [0, 1] from the axis."""


@dataclass(frozen=True)
class Primitive:
    """Integral from 0 of a smooth function over [0, high] by piecewise short Chebyshev series.

    Pieces without convergence are bisected; the function may be piecewise smooth, such as a spline
    with knots. Integration divides the truncation error by the number of terms; the result is exact
    to rounding.

    >>> float(Primitive.of(np.exp, 1.0)(np.array(0.5)) - np.expm1(0.5))
    0.0
    """

    edges: Array
    """(pieces + 1,) ends of the pieces."""
    coefficients: Array
    """(terms, pieces): Chebyshev series of the integral."""

    @classmethod
    def of(cls, function: Curve, high: float) -> Primitive:
        low: Array = np.linspace(0.0, high, MIN_PIECES, endpoint=False)
        width: Array = np.full(MIN_PIECES, high / MIN_PIECES)
        done: list[tuple[Array, Array, Array]] = []
        for halving in range(MAX_BISECTIONS + 1):
            series: Array = np.einsum(
                "ij,jk->ik", TO_SERIES, function(low + (NODES[:, None] + 1) / 2 * width)
            )
            size = np.abs(series)
            rough = size[-2:].max(axis=0) > NEGLIGIBLE * size.max()
            if halving == MAX_BISECTIONS:
                rough[:] = False
            done.append((low[~rough], width[~rough], series[:, ~rough]))
            if not rough.any():
                break
            width = np.repeat(width[rough] / 2, 2)
            low = np.repeat(low[rough], 2)
            low[1::2] += width[1::2]
        starts, widths, all_series = (
            np.concatenate(parts, axis=-1) for parts in zip(*done, strict=True)
        )
        order = np.argsort(starts)
        integral: Array = (
            np.asarray(chebyshev.chebint(all_series[:, order], lbnd=-1), float) * widths[order] / 2
        )
        integral[0, 1:] += np.cumsum(integral.sum(axis=0))[:-1]  # sums of series
        return cls(np.append(starts[order], high), integral)

    def __call__(self, x: Array) -> Array:
        piece = np.clip(np.searchsorted(self.edges, x, side="right") - 1, 0, len(self.edges) - 2)
        low, high = self.edges[piece], self.edges[piece + 1]
        at = (2 * x - low - high) / (high - low)
        return np.asarray(
            chebyshev.chebval(at, self.coefficients[:, piece], tensor=False), dtype=np.float64
        )


@dataclass(frozen=True)
class PerspectiveMeridian:
    """Meridian as a function of the viewing angle theta.

    Attributes
    ----------
    angle_and_height : callable
        Field angle, and ln(rho/m), which is 0 on the axis, for viewing angles, all in radians.
    field_and_height : callable
        Field angle, its derivative and ln(rho/m) together, because they share most of the
        computation.
    theta_max : radians
    """

    angle_and_height: Callable[[Array], tuple[Array, Array]]
    field_and_height: Callable[[Array], tuple[Array, Array, Array]]
    theta_max: float

    @classmethod
    def of(
        cls, omega: Curve, domega: Curve, log_rho: Curve, theta_max: float
    ) -> PerspectiveMeridian:
        """Create a meridian from independent curves."""
        return cls(
            lambda t: (omega(t), log_rho(t)), lambda t: (omega(t), domega(t), log_rho(t)), theta_max
        )

    @classmethod
    def solve(cls, omega: Curve, domega: Curve, theta_max: float) -> PerspectiveMeridian:
        """Integrate the mapping from the axis to the rim."""
        log_rho = Primitive.of(lambda theta: np.tan((omega(theta) + theta) / 2), theta_max)
        return cls.of(omega, domega, log_rho, theta_max)

    @cached_property
    def distance(self) -> float:
        """Distance from lens to vertex; it scales the rim radius to 1."""
        end = np.array(self.theta_max)
        return float(np.exp(-self.angle_and_height(end)[1]) / np.sin(end))

    def x(self, theta: Array) -> tuple[Array, Array]:
        """Compute the distance from the axis and its derivative dx/dtheta."""
        return self._x(theta, *self.angle_and_height(theta))

    def _x(self, theta: Array, omega: Array, log_rho: Array) -> tuple[Array, Array]:
        rho = self.distance * np.exp(log_rho)
        # x = rho sin(theta); dx/dtheta with d ln(rho)/dtheta = tan((Omega + theta)/2)
        sin, cos = np.sin(theta), np.cos(theta)
        return rho * sin, rho * (cos + np.tan((omega + theta) / 2) * sin)

    @cached_property
    def _table(self) -> Array:
        """Cubic pieces (4, CELLS) of theta(x), refined by a Newton step."""
        x, coarse = (
            np.linspace(0.0, 1.0, CELLS + 1),
            self._bracketed(np.linspace(0.0, 1.0, FEW_CELLS + 1)),
        )
        theta = _between(_pieces(coarse, 1 / self.x(coarse)[1]), x)
        x_at_theta, rate = self.x(theta)
        theta = theta - (x_at_theta - x) / rate
        x_at_theta, rate = self.x(theta)
        if not np.abs(x_at_theta - x).max() <= CLOSE:
            theta = self._bracketed(x)
            rate = self.x(theta)[1]
        theta[0] = 0.0
        return _pieces(theta, 1 / rate)

    def _bracketed(self, x: Array) -> Array:
        """Invert :meth:`x` by bracketing: viewing angles (n,) of points at x."""
        low, high = np.zeros_like(x), np.full_like(x, self.theta_max)
        theta = x * self.theta_max
        for _ in range(60):  # bisection alone would converge; Newton's method takes over early
            x_at_theta, rate = self.x(theta)
            error = x_at_theta - x
            low, high = np.where(error <= 0, theta, low), np.where(error >= 0, theta, high)
            step = theta - error / rate
            new = np.where((step >= low) & (step <= high), step, (low + high) / 2)
            change = np.abs(new - theta).max()
            theta = new
            if change <= 1e-15 * self.theta_max:
                break
        return theta

    def profile(self, x: Array) -> tuple[Array, Array, Array]:
        theta, omega, domega, log_rho = self._at(x)
        beta = (omega - theta) / 2
        # rho cos(theta) - m, without cancellation near the axis
        z = np.expm1(log_rho) * np.cos(theta) - 2 * np.sin(theta / 2) ** 2
        # z' = tan(beta), beta = (Omega - theta)/2 (Eq. 4); z'' = dbeta/dtheta / cos^2(beta) / (dx/dtheta)
        rate = self._x(theta, omega, log_rho)[1]
        return self.distance * z, np.tan(beta), (domega - 1) / 2 / np.cos(beta) ** 2 / rate

    def _at(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Compute viewing angles at x, exactly 0 on the axis, and the mapping there.

        The table gives an estimate; first-order steps complete it.
        """
        theta = _between(self._table, x)
        for _ in range(2):
            omega, domega, log_rho = self.field_and_height(theta)
            x_at_theta, rate = self._x(theta, omega, log_rho)
            step = (x - x_at_theta) / rate
            log_rho = log_rho + np.tan((omega + theta) / 2) * step
            theta, omega = theta + step, omega + domega * step
            if not (np.abs(step) > CLOSE).any():
                break
        return theta, omega, domega, log_rho


def _pieces(values: Array, rates: Array) -> Array:
    """Return cubic Hermite coefficients (4, cells) of values (cells + 1,)."""
    rise, rate = np.diff(values), rates / (len(values) - 1)
    low, high = rate[:-1], rate[1:]
    return np.stack([values[:-1], low, 3 * rise - 2 * low - high, low + high - 2 * rise])


def _between(pieces: Array, x: Array) -> Array:
    """Evaluate cubic pieces at x."""
    cell_coordinate = x * pieces.shape[1]
    cell = np.fmax(np.fmin(cell_coordinate, pieces.shape[1] - 1), 0.0).astype(int)
    t, (a, b, c, d) = cell_coordinate - cell, pieces[:, cell]
    return np.asarray(a + t * (b + t * (c + t * d)))


@dataclass(frozen=True)
class OrthographicMeridian:
    """Meridian as a function of the distance x from the axis, ``z' = tan(Omega(x)/2)``."""

    omega: Curve
    domega: Curve
    sag: Curve

    distance = float("inf")

    @classmethod
    def solve(cls, omega: Curve, domega: Curve) -> OrthographicMeridian:
        """Integrate the mapping from the axis to the rim."""
        return cls(omega, domega, Primitive.of(lambda x: np.tan(omega(x) / 2), 1.0))

    def profile(self, x: Array) -> tuple[Array, Array, Array]:
        half = self.omega(x) / 2
        return self.sag(x), np.tan(half), self.domega(x) / 2 / np.cos(half) ** 2


# -- Base classes of mirrors with a prescribed mapping ---------------------------------------------

OMEGA_MAX = Parameter("deg", 1.0, 179.0, "field angle at the rim")
OMEGA_MIN = Parameter(
    "deg", 0.0, 170.0, "field angle at the image centre; greater than 0 for a pointed mirror"
)
MIN_THETA_DEG = 1e-3  # smaller viewing angles lose precision; use an orthographic lens
THETA_MAX = Parameter(
    "deg", 0.0, 60.0, "viewing angle of the lens at the rim; 0 for an orthographic lens"
)


class MappingMirror(Mirror):
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
            z, slope, curvature = self._meridian.profile(
                np.where((x >= 0) & (x <= 1 + 1e-12), x, np.nan)
            )
        return z * M, slope, curvature / M

    @property
    def _theta_max(self) -> float:
        return float(np.radians(self.theta_max_deg))

    @cached_property
    def _meridian(self) -> PrescribedMeridian:
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
        if 0 < theta < MIN_THETA_DEG:
            raise InvalidParameter(
                f"theta_max_deg must be at least {MIN_THETA_DEG:g} deg, or 0 for an "
                f"orthographic lens; got {theta:g}"
            )
        if not theta < omega_max_deg < 180 - theta:
            raise InvalidParameter(
                f"omega_max_deg must be {theta:g} to {180 - theta:g} deg with theta_max_deg = "
                f"{theta:g}: at the upper limit the lens views the rim edge-on; got "
                f"{omega_max_deg:g}"
            )


@dataclass(frozen=True)
class PrescribedMapping(MappingMirror):
    """:class:`MappingMirror` mirror specified by its field angle at the rim."""

    omega_max_deg: float
    theta_max_deg: float
    rim_radius_mm: float

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "omega_max_deg": OMEGA_MAX,
        "theta_max_deg": THETA_MAX,
        "rim_radius_mm": RIM_RADIUS,
    }
    MAX_OMEGA_DEG: ClassVar[float] = 180.0
    """Upper bound of the field angle of the mapping, for any lens."""

    def __post_init__(self) -> None:
        self._check_parameters()
        self._check_reach(self.omega_max_deg)
        if self.omega_max_deg >= self.MAX_OMEGA_DEG:
            raise InvalidParameter(
                f"omega_max_deg must be less than {self.MAX_OMEGA_DEG:g} deg for the "
                f"{self.KIND} mapping; got {self.omega_max_deg:g}"
            )
        omega_min: float = getattr(self, "omega_min_deg", 0.0)
        if omega_min >= self.omega_max_deg:
            raise InvalidParameter(
                f"omega_min_deg must be less than omega_max_deg = {self.omega_max_deg:g}; got "
                f"{omega_min:g}"
            )
        self._check_surface()

    @property
    def _omega_max(self) -> float:
        return float(np.radians(self.omega_max_deg))
