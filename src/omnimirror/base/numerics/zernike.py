"""Zernike polynomials with Noll's numbering and scaling (J. Opt. Soc. Am. 66, 207, 1976): RMS 1
over the unit disk.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb, factorial, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..typing import Array


def noll(j: int) -> tuple[int, int]:
    """Return order n and signed frequency m of Noll's term j; cosine terms have m >= 0.

    >>> [noll(j) for j in (1, 2, 3, 4, 5, 6, 11)]
    [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (4, 0)]
    """
    n = int((sqrt(8 * j - 7) - 1) // 2)
    rest = j - n * (n + 1) // 2 - 1
    m = (rest + 1) // 2 * 2 if n % 2 == 0 else rest // 2 * 2 + 1
    return n, m if j % 2 == 0 or m == 0 else -m


def terms_of(order: int) -> int:
    """Return the number of terms up to an order.

    >>> terms_of(6)
    28
    """
    return (order + 1) * (order + 2) // 2


def zernike_values(x: ArrayLike, y: ArrayLike, terms: Sequence[int]) -> Array:
    """Compute the values (n, t) of Noll's terms at points (n,) of the unit disk.

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
            radial[n, k] = sqrt((n + 1) * (2 if k else 1)) * eval_jacobi((n - k) // 2, 0, k, argument)
        values[:, column] = radial[n, k] * (around[k].imag if m < 0 else around[k].real)
    return values


def power_place(i: int, j: int) -> int:
    """Return the index of ``x^i y^j`` among the powers: by order, then by increasing power of y.

    >>> [power_place(*ij) for ij in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
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
    terms = terms_of(order)
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
            row[power_place(abs(m) - k + 2 * (rings - r), k + 2 * r)] += (
                factor * sign * comb(abs(m), k) * comb(rings, r)
            )
