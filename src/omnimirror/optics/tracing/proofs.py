"""Proof that the field angle of a polynomial mirror increases everywhere, also between nodes.

With w = m + z, the sign of dOmega/dx (Eq. 8) is that of
``2 z'' (w^2 + x^2) + (w - x z')(1 + z'^2)``, or of z'' for an orthographic lens: a polynomial on
each piece. The Bernstein coefficients of a polynomial bound its range; the bounds converge as a
piece is bisected.
"""

from __future__ import annotations

from math import comb

import numpy as np

from ...base.typing import Array
from ..mirrors import Mirror

MOST_HALVINGS = 48
ROUNDING = 1e-12  # relative to the coefficients of a piece
DEGREE = 5


def stops_growing(mirror: Mirror, m: float) -> float | None:
    """Return the distance (mm) from the axis at which the field angle stops increasing.

    None if it increases everywhere, or if the sag is not piecewise polynomial.

    >>> from omnimirror.optics.mirrors import SampledProfile
    >>> x = np.linspace(0, 10, 11)
    >>> stops_growing(SampledProfile(tuple(x), tuple(0.01 * x**2)), np.inf) is None
    True
    >>> wavy = SampledProfile(tuple(x), tuple(0.01 * x**2 + 1e-2 * np.cos(3 * x)), uncertainty_um=0)
    >>> stops_growing(wavy, np.inf) < 10
    True
    """
    breaks = mirror.breaks
    if breaks is None:
        return None
    start, step = breaks[:-1], np.diff(breaks)
    z = _taylor(mirror, start, step)
    scale = step
    slope = _derivative(z) / scale
    curvature = _derivative(slope) / scale
    if np.isinf(m):
        growth = curvature
    else:
        w = z.copy()
        w[0] += m
        x = np.stack([start, step])
        one = np.ones((1, len(step)))
        growth = _sum(
            2 * _product(curvature, _sum(_product(w, w), _product(x, x))),
            _product(_sum(w, -_product(x, slope)), _sum(one, _product(slope, slope))),
        )
    return _first_not_positive(growth, start, step)


def _taylor(mirror: Mirror, start: Array, step: Array) -> Array:
    """Return the quintic coefficients (6, pieces) of the sag in t, 0 to 1."""
    sides = [mirror.profile(start), mirror.profile(start + step)]
    (z0, s0, c0), (z1, s1, c1) = ((z, s * step, c * step**2) for z, s, c in sides)
    dz, ds, dc = z1 - z0 - s0 - c0 / 2, s1 - s0 - c0, c1 - c0
    return np.stack([z0, s0, c0 / 2, 10 * dz - 4 * ds + dc / 2, -15 * dz + 7 * ds - dc, 6 * dz - 3 * ds + dc / 2])


def _derivative(a: Array) -> Array:
    return a[1:] * np.arange(1, len(a))[:, None]


def _product(a: Array, b: Array) -> Array:
    found = np.zeros((len(a) + len(b) - 1, a.shape[1]))
    for i, row in enumerate(a):
        found[i : i + len(b)] += row * b
    return found


def _sum(a: Array, b: Array) -> Array:
    found = np.zeros((max(len(a), len(b)), a.shape[1]))
    found[: len(a)] += a
    found[: len(b)] += b
    return found


def _first_not_positive(polynomials: Array, start: Array, step: Array) -> float | None:
    """Return the first place, mm, with a negative polynomial; None if none."""
    d = len(polynomials) - 1
    to_bernstein = np.array([[comb(i, k) / comb(d, k) for k in range(d + 1)] for i in range(d + 1)])
    halves = np.array([[comb(i, k) / 2**i for k in range(d + 1)] for i in range(d + 1)])
    b = to_bernstein @ polynomials
    slack = ROUNDING * np.abs(polynomials).sum(axis=0)
    for _ in range(MOST_HALVINGS):
        failed = (b[0] < -slack) | (b[-1] < -slack)
        if failed.any():
            at = np.where(b[0] < -slack, start, start + step)
            return float(at[failed].min())
        open_ = (b < -slack).any(axis=0)
        if not open_.any():
            return None
        b, start, step, slack = b[:, open_], start[open_], step[open_] / 2, slack[open_]
        left, right = halves @ b, (halves @ b[::-1])[::-1]
        b, start = np.concatenate([left, right], axis=1), np.concatenate([start, start + step])
        step, slack = np.concatenate([step, step]), np.concatenate([slack, slack])
    return None  # within rounding of 0
