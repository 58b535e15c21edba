"""Zernike polynomials (Noll, J. Opt. Soc. Am. 66, 207, 1976) as sums of powers of x and y."""

from __future__ import annotations

from functools import lru_cache
from math import comb, factorial, sqrt

import numpy as np
from numpy.typing import NDArray

from ...numerics.zernike import noll, terms_of

Array = NDArray[np.float64]

LARGEST_ORDER = 6
TERMS = terms_of(LARGEST_ORDER)
"""How many Zernike terms there are up to the largest order, and powers ``x^i y^j``."""


def power_place(i: int, j: int) -> int:
    """Where ``x^i y^j`` stands among the powers: those of one order after one another, y growing.

    >>> [power_place(*ij) for ij in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
    [0, 1, 2, 3, 4, 5]
    """
    return (i + j) * (i + j + 1) // 2 + j


@lru_cache(maxsize=1)
def zernike_powers() -> Array:
    """Coefficients (terms, terms) of the powers of x and y (columns) in each of Noll's terms (rows), rms 1 on the disk.

    >>> zernike_powers()[3, [0, 3, 5]].round(4)  # Z4 = sqrt(3) (2 r^2 - 1)
    array([-1.7321,  3.4641,  3.4641])
    """
    table = np.zeros((TERMS, TERMS))
    for row in range(TERMS):
        n, m = noll(row + 1)
        scale = sqrt(n + 1) * (sqrt(2.0) if m else 1.0)
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
