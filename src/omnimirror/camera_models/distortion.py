"""Radial and tangential distortion of a round picture (Brown), in the signs and order of OpenCV."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyroots
from numpy.typing import NDArray

from ..numerics.roots import increasing_root

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = tuple[Array, Array]

SLOWEST = 0.01  # of the rate at the centre, below which a fitted polynomial says nothing of the optics
NODES = 257  # of the table from which inversions start
MOST_STEPS = 30
NOTHING = 1e-60  # a coefficient as small as this moves nothing, and would overflow where it divides
LARGEST_COEFFICIENT = 1e12
CLOSE = 1e-9  # a Newton step this small (relative) leaves an error of about its square


class Distorted(NamedTuple):
    """A point of the distorted picture, and the symmetric matrix of its derivatives to the undistorted one."""

    x: Array
    y: Array
    d_xx: Array
    d_xy: Array
    d_yy: Array


class Distortion(NamedTuple):
    """``x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)``, y' likewise with p1 and p2 exchanged.

    >>> Distortion(k1=-0.1).radius(np.array([0.5]))
    array([0.4875])
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @property
    def is_tangential(self) -> bool:
        return bool(self.p1 or self.p2)

    def radius(self, r: Array) -> Array:
        """Distorted radii of radii, by the radial part alone."""
        s = r * r
        return r * (1 + s * (self.k1 + s * (self.k2 + s * self.k3)))

    def rate(self, r: Array) -> Array:
        """Derivative of :meth:`radius`."""
        s = r * r
        return 1 + s * (3 * self.k1 + s * (5 * self.k2 + s * 7 * self.k3))

    def end(self) -> float:
        """Radius where the distorted one all but stops growing (1 % of its rate at the centre); else infinite."""
        return float(np.sqrt(first_root(np.array([1 - SLOWEST, 3 * self.k1, 5 * self.k2, 7 * self.k3]))))

    def undone(self, radius: Array, end: float) -> Array:
        """Radii (n,) up to ``end`` of distorted radii, by the radial part alone; beyond, ``end``."""
        if not (self.k1 or self.k2 or self.k3) or not radius.size:
            return np.minimum(radius, end)
        radius = np.where(np.isfinite(radius), radius, 0.0)
        far = float(radius.max())
        high = end if np.isfinite(end) else _reach(self, far)
        nodes = np.linspace(0.0, high, NODES)
        values = self.radius(nodes)
        inside = np.minimum(radius, values[-1])
        cell = np.clip(np.searchsorted(values, inside) - 1, 0, NODES - 2)
        start = np.interp(inside, values, nodes)
        return increasing_root(
            lambda r: (self.radius(r) - inside, self.rate(r)), nodes[cell], nodes[cell + 1], start, high
        )

    def applied(self, x: Array, y: Array) -> Distorted:
        """Points of the round picture, distorted."""
        k1, k2, k3, p1, p2 = self
        s = x * x + y * y
        factor = 1 + s * (k1 + s * (k2 + s * k3))
        growth = 2 * (k1 + s * (2 * k2 + 3 * k3 * s))
        xy = x * y
        return Distorted(
            x * factor + 2 * p1 * xy + p2 * (s + 2 * x * x),
            y * factor + 2 * p2 * xy + p1 * (s + 2 * y * y),
            factor + growth * x * x + 2 * p1 * y + 6 * p2 * x,
            growth * xy + 2 * (p1 * x + p2 * y),
            factor + growth * y * y + 6 * p1 * y + 2 * p2 * x,
        )

    def terms(self, x: Array, y: Array) -> tuple[Rows, ...]:
        """Derivatives of the distorted point to k1, k2, k3, p1 and p2, each as (of x, of y)."""
        s = x * x + y * y
        radial = tuple((x * power, y * power) for power in (s, s * s, s**3))
        return (*radial, (2 * x * y, s + 2 * y * y), (s + 2 * x * x, 2 * x * y))

    def removed(self, x: Array, y: Array, end: float) -> tuple[Array, Array, Mask]:
        """Points of the undistorted round picture, and where there are any within ``end`` (a radius)."""
        r = np.hypot(x, y)
        if not any(self):
            return x, y, r <= end
        ratio = self.undone(r, end) / np.where(r > 0, r, 1.0)
        px, py = x * ratio, y * ratio
        solved = np.ones(r.shape, dtype=bool)
        if self.is_tangential:
            px, py, solved = self._refined(x, y, px, py)
        with np.errstate(invalid="ignore"):
            inside = np.hypot(px, py) <= end
            if not self.is_tangential and np.isfinite(end):
                inside = r <= self.radius(np.array(end))
        return px, py, solved & inside

    def _refined(self, x: Array, y: Array, px: Array, py: Array) -> tuple[Array, Array, Mask]:
        """Newton's rule in two dimensions, from what the radial part alone gives."""
        with np.errstate(all="ignore"):
            for _ in range(MOST_STEPS):
                at = self.applied(px, py)
                ex, ey = at.x - x, at.y - y
                determinant = at.d_xx * at.d_yy - at.d_xy**2
                dx = (at.d_yy * ex - at.d_xy * ey) / determinant
                dy = (at.d_xx * ey - at.d_xy * ex) / determinant
                px, py = px - dx, py - dy
                unsolved = np.hypot(dx, dy) > CLOSE * np.hypot(px, py)
                if not unsolved.any():
                    break
        return px, py, (determinant > 0) & ~unsolved


def first_root(coefficients: Array) -> float:
    """Smallest root above 0 of a polynomial, infinite if there is none."""
    known = np.flatnonzero(np.abs(coefficients) > NOTHING)
    roots = polyroots(coefficients[: known[-1] + 1])
    return float(roots.real[(abs(roots.imag) <= 1e-9 * abs(roots)) & (roots.real > 0)].min(initial=np.inf))


def _reach(distortion: Distortion, far: float) -> float:
    """A radius whose distorted one is ``far`` or more, where the radial part grows for ever."""
    high = max(far, 1.0)
    while distortion.radius(np.array(high)) < far:
        high *= 2
    return high
