"""Polynomial fits of functions of the aperture to a few hundred rays."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from .pupil import gaussian

RINGS = 12  # of the fitted pupil
DEGREE = 10

FITTED = gaussian(RINGS)
"""Pupil of the fitted rays."""


def basis(points: Array) -> Array:
    """Return products of Chebyshev polynomials (n, terms) at points (n, 2) of the disk."""
    x, y = (np.polynomial.chebyshev.chebvander(c, DEGREE) for c in points.T)
    i, j = orders()
    return x[:, i] * y[:, j]


def orders() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the orders (terms,), (terms,) in x and y of the products."""
    i, j = np.indices((DEGREE + 1, DEGREE + 1)).reshape(2, -1)
    low = i + j <= DEGREE
    return i[low], j[low]


@cache
def fit() -> Array:
    """Return the linear map (terms, n) from values at the fitted pupil to coefficients."""
    return fitted_at(FITTED.points)


def fitted_at(points: Array) -> Array:
    """Return the linear map (terms, n) from values at displaced points (n, 2) to coefficients."""
    root = np.sqrt(FITTED.weights)
    inverse = np.linalg.pinv(root[:, None] * basis(points)) * root
    return inverse.astype(np.float64)


@cache
def slopes() -> tuple[Array, Array]:
    """Return derivatives (n, terms), (n, terms) of the products by x and y at the fitted pupil."""
    turned = np.polynomial.chebyshev.chebder(np.eye(DEGREE + 1))
    (x, y), (dx, dy) = (
        [make(c) for c in FITTED.points.T]
        for make in (
            lambda c: np.polynomial.chebyshev.chebvander(c, DEGREE),
            lambda c: np.polynomial.chebyshev.chebvander(c, DEGREE - 1) @ turned,
        )
    )
    i, j = orders()
    by_x: Array = dx[:, i] * y[:, j]
    by_y: Array = x[:, i] * dy[:, j]
    return by_x, by_y


@cache
def integral() -> Array:
    """Return the linear map (terms, 2 n) from x and y derivatives to coefficients."""
    root = np.tile(np.sqrt(FITTED.weights), 2)
    inverse: Array = np.linalg.pinv(root[:, None] * np.concatenate(slopes())) * root
    return inverse
