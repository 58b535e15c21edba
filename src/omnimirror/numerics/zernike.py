"""Zernike polynomials, as Noll numbers and scales them (J. Opt. Soc. Am. 66, 207, 1976): rms 1 over the unit disk."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def noll(j: int) -> tuple[int, int]:
    """Order n and signed frequency m of Noll's term j; cosines have m >= 0.

    >>> [noll(j) for j in (1, 2, 3, 4, 5, 6, 11)]
    [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (4, 0)]
    """
    n = int((sqrt(8 * j - 7) - 1) // 2)
    rest = j - n * (n + 1) // 2 - 1
    m = (rest + 1) // 2 * 2 if n % 2 == 0 else rest // 2 * 2 + 1
    return n, m if j % 2 == 0 or m == 0 else -m


def terms_of(order: int) -> int:
    """How many terms there are up to an order.

    >>> terms_of(6)
    28
    """
    return (order + 1) * (order + 2) // 2


def zernike_values(x: ArrayLike, y: ArrayLike, terms: Sequence[int]) -> Array:
    """Values (n, t) of Noll's terms at points (n,) of the unit disk.

    >>> zernike_values([0.0, 1.0], [0.0, 0.0], [4])[:, 0].round(4)  # sqrt(3) (2 r^2 - 1)
    array([-1.7321,  1.7321])
    """
    from scipy.special import eval_jacobi

    z = np.asarray(x, dtype=float) + 1j * np.asarray(y, dtype=float)
    argument = 2 * np.abs(z) ** 2 - 1
    radial: dict[tuple[int, int], Array] = {}  # of sine and cosine alike
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
