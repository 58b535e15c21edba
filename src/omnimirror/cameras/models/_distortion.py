"""Radial and tangential distortion of a circular image (Brown), with OpenCV's signs and order."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial.polynomial import polyadd, polyder, polymul, polyroots, polysub

from ...base.numerics import increasing_inverse
from ...base.typing import Array, Mask

Rows = tuple[Array, Array]

MIN_RATE = 0.01  # relative to the centre: limit of validity of fitted polynomials
INVERSION_NODES = 257  # nodes of the table of initial values for inversion
MAX_STEPS = 30
MAX_COEFFICIENT = 1e12
NEWTON_TOLERANCE = 1e-9  # relative Newton step; the remaining error is about its square


class DistortedPoints(NamedTuple):
    """Point of the distorted image, and its matrix of derivatives with respect to the undistorted
    one.
    """

    x: Array
    y: Array
    d_xx: Array
    d_xy: Array
    d_yx: Array
    d_yy: Array


class DistortionModel(Protocol):
    """Distortion of points of a circular image, before the affine matrix."""

    @property
    def _fields(self) -> tuple[str, ...]: ...

    @property
    def is_radial(self) -> bool:
        """True if radial coefficients are not 0."""
        ...

    @property
    def is_tangential(self) -> bool:
        """True if tangential coefficients are not 0."""
        ...

    def radius(self, r: Array) -> Array:
        """Compute distorted radii from undistorted radii, by the radial part."""
        ...

    def rate(self, r: Array) -> Array:
        """Compute the derivative of :meth:`radius`."""
        ...

    def max_radius(self) -> float:
        """Return the radius at which the rate falls to 1 % of that at the centre; else infinity."""
        ...

    def distort(self, x: Array, y: Array) -> DistortedPoints:
        """Distort points of the circular image."""
        ...

    def parameter_derivatives(self, x: Array, y: Array) -> tuple[Rows, ...]:
        """Return derivatives of x and of y of the distorted point with respect to the fields."""
        ...


class Distortion(NamedTuple):
    """``x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)``; y' with p1 and p2
    exchanged.

    >>> Distortion(k1=-0.1).radius(np.array([0.5]))
    array([0.4875])
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def is_radial(self) -> bool:
        return bool(self.k1 or self.k2 or self.k3)

    @property
    def is_tangential(self) -> bool:
        return bool(self.p1 or self.p2)

    def radius(self, r: Array) -> Array:
        """Compute distorted radii from undistorted radii, by the radial part."""
        s = r * r
        return r * (1 + s * (self.k1 + s * (self.k2 + s * self.k3)))

    def rate(self, r: Array) -> Array:
        """Compute the derivative of :meth:`radius`."""
        s = r * r
        return 1 + s * (3 * self.k1 + s * (5 * self.k2 + s * 7 * self.k3))

    def max_radius(self) -> float:
        """Return the radius at which the rate falls to 1 % of that at the centre; else infinity."""
        return float(
            np.sqrt(
                smallest_positive_root(
                    np.array([1 - MIN_RATE, 3 * self.k1, 5 * self.k2, 7 * self.k3])
                )
            )
        )

    def distort(self, x: Array, y: Array) -> DistortedPoints:
        """Distort points of the circular image."""
        k1, k2, k3, p1, p2 = self
        s = x * x + y * y
        factor = 1 + s * (k1 + s * (k2 + s * k3))
        growth = 2 * (k1 + s * (2 * k2 + 3 * k3 * s))
        return _distort_radial_tangential(x, y, factor, growth, p1, p2)

    def parameter_derivatives(self, x: Array, y: Array) -> tuple[Rows, ...]:
        """Return derivatives of the distorted point with respect to k1 to k3, p1 and p2."""
        s = x * x + y * y
        radial = tuple((x * power, y * power) for power in (s, s * s, s**3))
        return (*radial, *_tangential_terms(x, y, s))


class Rational(NamedTuple):
    """``x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)``, plus p1, p2
    terms.

    >>> Rational(k1=0.2, k4=0.2).radius(np.array([0.5]))
    array([0.5])
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def is_radial(self) -> bool:
        return any(self[:6])

    @property
    def is_tangential(self) -> bool:
        return bool(self.p1 or self.p2)

    def radius(self, r: Array) -> Array:
        """Compute distorted radii from undistorted radii, by the radial part."""
        numerator, denominator, _, _ = self._parts(r * r)
        return np.asarray(r * numerator / denominator)

    def rate(self, r: Array) -> Array:
        """Compute the derivative of :meth:`radius`."""
        s = r * r
        numerator, denominator, d_numerator, d_denominator = self._parts(s)
        return np.asarray(
            numerator / denominator
            + 2 * s * (d_numerator * denominator - numerator * d_denominator) / denominator**2
        )

    def max_radius(self) -> float:
        """Return the radius of a vanishing or diverging rate; else infinity."""
        # With s = r^2, r' = r N(s) / D(s) and dr'/dr = (N D + 2 s (N' D - N D')) / D^2.
        numerator, denominator = np.array([1.0, *self[:3]]), np.array([1.0, *self[3:6]])
        cross = polysub(
            polymul(polyder(numerator), denominator), polymul(numerator, polyder(denominator))
        )
        rate = polysub(
            polyadd(polymul(numerator, denominator), polymul([0.0, 2.0], cross)),
            MIN_RATE * polymul(denominator, denominator),
        )
        return float(
            np.sqrt(min(smallest_positive_root(rate), smallest_positive_root(denominator)))
        )

    def distort(self, x: Array, y: Array) -> DistortedPoints:
        """Distort points of the circular image."""
        numerator, denominator, d_numerator, d_denominator = self._parts(x * x + y * y)
        growth = 2 * (d_numerator * denominator - numerator * d_denominator) / denominator**2
        return _distort_radial_tangential(x, y, numerator / denominator, growth, self.p1, self.p2)

    def parameter_derivatives(self, x: Array, y: Array) -> tuple[Rows, ...]:
        """Return derivatives of the distorted point with respect to k1 to k6, p1 and p2."""
        s = x * x + y * y
        numerator, denominator, _, _ = self._parts(s)
        factors = [
            power / denominator for power in (s, s * s, s**3)
        ]  # derivatives with respect to k1, k2, k3
        factors += [
            -factor * numerator / denominator for factor in factors
        ]  # derivatives with respect to k4, k5, k6
        return (*((x * factor, y * factor) for factor in factors), *_tangential_terms(x, y, s))

    def _parts(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """Return numerator and denominator, and their derivatives with respect to r^2."""
        k1, k2, k3, k4, k5, k6, *_ = self
        return (
            1 + s * (k1 + s * (k2 + s * k3)),
            1 + s * (k4 + s * (k5 + s * k6)),
            k1 + s * (2 * k2 + 3 * k3 * s),
            k4 + s * (2 * k5 + 3 * k6 * s),
        )


class ThinPrism(NamedTuple):
    """``x' = x + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4``; y' with p1 and p2 exchanged, s3
    and s4.

    >>> ThinPrism(s1=0.1).distort(np.array([1.0]), np.array([0.0])).x
    array([1.1])
    """

    p1: float = 0.0
    p2: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0

    @property
    def is_radial(self) -> bool:
        return False

    @property
    def is_tangential(self) -> bool:
        return any(self)

    def radius(self, r: Array) -> Array:
        """Return the radii unchanged."""
        return r

    def rate(self, r: Array) -> Array:
        """Return ones."""
        return np.ones_like(r)

    def max_radius(self) -> float:
        """Return infinity."""
        return np.inf

    def distort(self, x: Array, y: Array) -> DistortedPoints:
        """Distort points of the circular image."""
        s = x * x + y * y
        at = _distort_radial_tangential(x, y, np.ones_like(s), np.zeros_like(s), self.p1, self.p2)
        right, down = 2 * self.s1 + 4 * self.s2 * s, 2 * self.s3 + 4 * self.s4 * s
        return DistortedPoints(
            at.x + s * (self.s1 + self.s2 * s),
            at.y + s * (self.s3 + self.s4 * s),
            at.d_xx + right * x,
            at.d_xy + right * y,
            at.d_yx + down * x,
            at.d_yy + down * y,
        )

    def parameter_derivatives(self, x: Array, y: Array) -> tuple[Rows, ...]:
        """Return derivatives of the distorted point with respect to p1, p2 and s1 to s4."""
        s = x * x + y * y
        zero = np.zeros_like(s)
        return (*_tangential_terms(x, y, s), (s, zero), (s * s, zero), (zero, s), (zero, s * s))


def _distort_radial_tangential(
    x: Array, y: Array, factor: Array, growth: Array, p1: float, p2: float
) -> DistortedPoints:
    """Apply a radial factor, whose derivative with respect to x is ``growth x``, and tangential
    distortion.
    """
    s, xy = x * x + y * y, x * y
    across = growth * xy + 2 * (p1 * x + p2 * y)
    return DistortedPoints(
        x * factor + 2 * p1 * xy + p2 * (s + 2 * x * x),
        y * factor + 2 * p2 * xy + p1 * (s + 2 * y * y),
        factor + growth * x * x + 2 * p1 * y + 6 * p2 * x,
        across,
        across,
        factor + growth * y * y + 6 * p1 * y + 2 * p2 * x,
    )


def _tangential_terms(x: Array, y: Array, s: Array) -> tuple[Rows, Rows]:
    """Return derivatives of the distorted point with respect to p1 and p2."""
    return (2 * x * y, s + 2 * y * y), (s + 2 * x * x, 2 * x * y)


# -- Inversion -------------------------------------------------------------------------------------


def undistort_radius(distortion: DistortionModel, radius: Array, end: float) -> Array:
    """Invert the radial part: radii (n,) up to ``end`` of distorted radii; ``end`` beyond."""
    if not distortion.is_radial or not radius.size:
        return np.minimum(radius, end)
    radius = np.where(np.isfinite(radius), radius, 0.0)
    high = _bracket_end(distortion, float(radius.max()), end)
    nodes = np.linspace(0.0, high, INVERSION_NODES)
    return increasing_inverse(
        lambda r: (distortion.radius(r), distortion.rate(r)),
        radius,
        nodes,
        distortion.radius(nodes),
    )


def undistort_points(
    distortion: DistortionModel, x: Array, y: Array, end: float
) -> tuple[Array, Array, Mask]:
    """Remove distortion from points of the circular image, within a radius."""
    r = np.hypot(x, y)
    if not (distortion.is_radial or distortion.is_tangential):
        return x, y, r <= end
    ratio = undistort_radius(distortion, r, end) / np.where(r > 0, r, 1.0)
    px, py = x * ratio, y * ratio
    is_solved = np.ones(r.shape, dtype=bool)
    if distortion.is_tangential:
        px, py, is_solved = _refine_points(distortion, x, y, px, py)
    with np.errstate(invalid="ignore"):
        inside = np.hypot(px, py) <= end
        if not distortion.is_tangential and np.isfinite(end):
            inside = r <= distortion.radius(np.array(end))
    return px, py, is_solved & inside


def _refine_points(
    distortion: DistortionModel, x: Array, y: Array, px: Array, py: Array
) -> tuple[Array, Array, Mask]:
    """Refine undistorted points from the radial solution by Newton's method in two dimensions."""
    with np.errstate(all="ignore"):
        for _ in range(MAX_STEPS):
            at = distortion.distort(px, py)
            ex, ey = at.x - x, at.y - y
            determinant = at.d_xx * at.d_yy - at.d_xy * at.d_yx
            dx = (at.d_yy * ex - at.d_xy * ey) / determinant
            dy = (at.d_xx * ey - at.d_yx * ex) / determinant
            px, py = px - dx, py - dy
            is_unsolved = np.hypot(dx, dy) > NEWTON_TOLERANCE * np.hypot(px, py)
            if not is_unsolved.any():
                break
    return px, py, (determinant > 0) & ~is_unsolved


def _bracket_end(distortion: DistortionModel, distorted: float, end: float) -> float:
    """Return a radius whose distorted radius is at least ``distorted``, or else the end."""
    high = max(distorted, 1.0)
    while high < end and distortion.radius(np.array(high)) < distorted:
        high *= 2
    return min(high, end)


def smallest_positive_root(coefficients: Array) -> float:
    """Return the smallest positive root of a polynomial with a constant term, infinity if there is
    none.

    The roots of the reversed polynomial are the reciprocals. Its leading coefficient is the constant
    term; therefore tiny high orders do not degrade the small roots.

    >>> smallest_positive_root(np.array([1.0, -0.75, 1e-45]))
    1.3333333333333333
    """
    roots = polyroots(coefficients[::-1])
    real = roots.real[(abs(roots.imag) <= 1e-9 * abs(roots)) & (roots.real > 0)]
    return float(1 / real.max()) if len(real) else float("inf")
