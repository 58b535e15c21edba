"""Orthogonal polynomials of optical surfaces: Zernike polynomials and Forbes polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb, factorial, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .typing import Array

# -- Zernike polynomials: Noll's order, RMS 1 over the unit disc (J. Opt. Soc. Am. 66, 207, 1976) ----


def noll(j: int) -> tuple[int, int]:
    """Return order n and signed frequency m of Noll's term j; cosine terms have m >= 0.

    >>> [noll(j) for j in (1, 2, 3, 4, 5, 6, 11)]
    [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (4, 0)]
    """
    n = int((sqrt(8 * j - 7) - 1) // 2)
    rest = j - n * (n + 1) // 2 - 1
    m = (rest + 1) // 2 * 2 if n % 2 == 0 else rest // 2 * 2 + 1
    return n, m if j % 2 == 0 or m == 0 else -m


def zernike_terms(order: int) -> int:
    """Return the number of terms up to an order.

    >>> zernike_terms(6)
    28
    """
    return (order + 1) * (order + 2) // 2


def zernike_values(x: ArrayLike, y: ArrayLike, terms: Sequence[int]) -> Array:
    """Compute the values (n, t) of Noll's terms at points (n,) of the unit disc.

    >>> zernike_values([0.0, 1.0], [0.0, 0.0], [4])[:, 0].round(4)  # sqrt(3) (2 r^2 - 1)
    array([-1.7321,  1.7321])
    """
    from scipy.special import eval_jacobi

    # R_n^m(r) = r^m P_k^(0,m)(2 r^2 - 1) with the Jacobi polynomial of degree k = (n - m) / 2, and
    # r^m cos(m phi), r^m sin(m phi) are the real and imaginary parts of z^m.
    z = np.asarray(x, dtype=float) + 1j * np.asarray(y, dtype=float)
    argument = 2 * np.abs(z) ** 2 - 1
    radial: dict[tuple[int, int], Array] = {}  # shared by sine and cosine
    around: dict[int, NDArray[np.complex128]] = {0: np.ones_like(z)}
    values = np.empty((len(z), len(terms)))
    for column, j in enumerate(terms):
        n, m = noll(j)
        k = abs(m)
        if k not in around:
            around[k] = z**k
        if (n, k) not in radial:
            radial[n, k] = sqrt((n + 1) * (2 if k else 1)) * eval_jacobi(
                (n - k) // 2, 0, k, argument
            )
        values[:, column] = radial[n, k] * (around[k].imag if m < 0 else around[k].real)
    return values


def monomial_index(i: int, j: int) -> int:
    """Return the index of ``x^i y^j`` among the powers: by order, then by increasing power of y.

    >>> [monomial_index(*ij) for ij in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
    [0, 1, 2, 3, 4, 5]
    """
    return (i + j) * (i + j + 1) // 2 + j


@lru_cache(maxsize=4)
def zernike_powers(order: int) -> Array:
    """Return the coefficients (terms, terms) of powers of x and y (columns) in Noll's terms (rows)
    up to an order.

    >>> zernike_powers(4)[3, [0, 3, 5]].round(4)  # Z4 = sqrt(3) (2 r^2 - 1)
    array([-1.7321,  3.4641,  3.4641])
    """
    terms = zernike_terms(order)
    table = np.zeros((terms, terms))
    for row in range(terms):
        n, m = noll(row + 1)
        scale = sqrt(n + 1) * (sqrt(2.0) if m else 1.0)
        # R_n^m = sum_s (-1)^s (n - s)! / (s! ((n + m)/2 - s)! ((n - m)/2 - s)!) r^(n - 2 s)
        for s in range((n - abs(m)) // 2 + 1):
            a = (-1) ** s * factorial(n - s) / factorial(s)
            a /= factorial((n + abs(m)) // 2 - s) * factorial((n - abs(m)) // 2 - s)
            _add_harmonic(table[row], scale * a, (n - abs(m)) // 2 - s, m)
    return table


def _add_harmonic(row: Array, factor: float, rings: int, m: int) -> None:
    """Add ``factor r^(2 rings) r^|m| cos(m phi)``, or the sine of a negative m."""
    for k in range(abs(m) + 1):  # (x + iy)^|m|
        imaginary = k % 2 == 1
        if imaginary != (m < 0):
            continue
        sign = (-1) ** (k // 2)
        for r in range(rings + 1):  # (x^2 + y^2)^rings
            row[monomial_index(abs(m) - k + 2 * (rings - r), k + 2 * r)] += (
                factor * sign * comb(abs(m), k) * comb(rings, r)
            )


# -- Forbes polynomials of rotationally symmetric aspheres (Opt. Express 15, 5218; 18, 13851) ------


def qbfs_values(u: ArrayLike, count: int) -> Array:
    """Compute ``u^2 (1 - u^2) Q_m(u^2)``, (n, count), at normalised radii u (n,), m from 0.

    These are the terms of an asphere relative to its best-fit sphere, along the normal of the
    sphere. The mean square slope over the angle asin(u) is the sum of the squared coefficients.

    >>> qbfs_values([0.5], 3).round(6)  # Q0 = 1, Q1 = (13 - 16 u^2)/sqrt(19)
    array([[0.1875  , 0.387139, 0.238047]])
    """
    # Recurrences of Forbes (Opt. Express 18, 13851), which make the slopes orthonormal, x = u^2:
    # P_m = (2 - 4 x) P_(m-1) - P_(m-2), Q_m = (P_m - g_(m-1) Q_(m-1) - h_(m-2) Q_(m-2)) / f_m.
    x = np.asarray(u, dtype=float) ** 2
    p, q = [2.0 + 0 * x, 6.0 - 8.0 * x], [1.0 + 0 * x, (13.0 - 16.0 * x) / np.sqrt(19.0)]
    f, g = [2.0, np.sqrt(19.0) / 2], [-0.5]
    for m in range(2, count):
        h = -m * (m - 1) / (2 * f[m - 2])
        g.append(-(1 + g[m - 2] * h) / f[m - 1])
        f.append(np.sqrt(m * (m + 1) + 3 - g[m - 1] ** 2 - h**2))
        p.append((2 - 4 * x) * p[m - 1] - p[m - 2])
        q.append((p[m] - g[m - 1] * q[m - 1] - h * q[m - 2]) / f[m])
    values: Array = (x * (1 - x))[:, None] * np.stack(q[:count], axis=1)
    return values
