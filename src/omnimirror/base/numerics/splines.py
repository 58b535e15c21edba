"""Even and odd cubic splines on uniform knots, defined by their values at the knots."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..typing import Array


class SplineBasis(NamedTuple):
    """Basis of splines on knots h, 2 h ... n h: polynomials of x from the start of a cell."""

    step: float
    cells: Array
    """Coefficients (n, 4, n) by cell, power, and value at the knot."""

    def at(self, x: Array) -> Array:
        """Return the weights (m, n) of the knot values in the spline at x (m,)."""
        cell, t = _place(x, self.step, len(self.cells))
        c, t = self.cells[cell], t[:, None]
        shares: Array = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3]))
        return shares

    def of(self, values: Array) -> Spline:
        """Return the spline with values (n,) at the knots."""
        return Spline(self.step, self.cells @ values)


class Spline(NamedTuple):
    """Piecewise cubic on uniform knots from 0."""

    step: float
    cells: Array
    """Coefficients (n, 4) of x from the start of each cell."""

    def __call__(self, x: Array) -> Array:
        cell, t = _place(x, self.step, len(self.cells))
        c = self.cells[cell]
        value: Array = c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3]))
        return value

    def rate(self, x: Array) -> Array:
        """Evaluate the derivative."""
        cell, t = _place(x, self.step, len(self.cells))
        c = self.cells[cell]
        value: Array = c[..., 1] + t * (2 * c[..., 2] + 3 * t * c[..., 3])
        return value

    def end_of_growth(self, slowest: float) -> float:
        """Return the first position at which the derivative falls below a value; the last knot if
        there is none.
        """
        for cell, (_, b, c, d) in enumerate(self.cells.tolist()):
            for t in sorted(_crossings(3 * d, 2 * c, b - slowest)):
                if 0 <= t <= self.step:
                    return cell * self.step + t
        return len(self.cells) * self.step


def _crossings(a: float, b: float, c: float) -> list[float]:
    """Return the position at which ``a t^2 + b t + c`` crosses 0 downwards."""
    square = b * b - 4 * a * c
    if square < 0 or (a == 0 and b >= 0):
        return []
    # Root with negative slope, in the form without cancellation, valid for a = 0.
    root = square**0.5
    return [2 * c / (-b + root)] if b < 0 else [(-b - root) / (2 * a)]


def _place(x: Array, step: float, count: int) -> tuple[NDArray[np.intp], Array]:
    cell = np.fmin(np.fmax(x / step, 0), count - 1).astype(np.intp)  # NaN maps to the first cell
    return cell, x - cell * step


@lru_cache(maxsize=64)
def odd_basis(count: int, end: float) -> SplineBasis:
    """Return the basis of odd splines, ``f(-x) = -f(x)``, on ``count`` uniform knots up to ``end``,
    3 or more.

    >>> spline = odd_basis(4, 2.0).of(np.array([0.5, 1.0, 1.5, 2.0]) ** 3)
    >>> spline(np.array([0.3, 1.7])).round(12)  # what is a cubic is met exactly
    array([0.027, 4.913])
    """
    at_zero = np.zeros((2, count + 1 + count + 1))
    at_zero[0, 0] = 1.0  # f(0)
    at_zero[1, count + 1] = 1.0  # f''(0)
    basis = _solved(count, end, at_zero)
    basis.cells[0, [0, 2]] = 0.0  # exact zero: rounding would affect radii near the axis
    return basis


@lru_cache(maxsize=64)
def even_basis(count: int, end: float) -> SplineBasis:
    """Return the basis of even splines, ``f(-x) = f(x)``, on ``count`` uniform knots up to ``end``;
    parabolic in the first cell.

    >>> spline = even_basis(4, 2.0).of(np.array([0.5, 1.0, 1.5, 2.0]) ** 2)
    >>> spline(np.array([0.3, 1.7])).round(12)
    array([0.09, 2.89])
    """
    h = end / count
    at_zero = np.zeros((2, count + 1 + count + 1))
    at_zero[0, [0, 1]] = -1 / h, 1 / h  # f'(0) in the first cell
    at_zero[0, [count + 1, count + 2]] = -h / 3, -h / 6
    at_zero[1, [count + 1, count + 2]] = 1.0, -1.0
    return _solved(count, end, at_zero)


def _solved(count: int, end: float, at_zero: Array) -> SplineBasis:
    """Solve for values y and second derivatives m of knots 0 to n from two equations at 0, (y0 ...
    yn, m0 ... mn).
    """
    n, h = count, end / count
    matrix, given = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, n))
    matrix[:2] = at_zero
    for i in range(1, n + 1):  # values
        matrix[1 + i, i], given[1 + i, i - 1] = 1.0, 1.0
    for i in range(1, n):
        # Continuous first derivative: m[i-1] + 4 m[i] + m[i+1] = 6 (y[i-1] - 2 y[i] + y[i+1]) / h^2
        row = n + 1 + i
        matrix[row, n + i : n + i + 3] = 1.0, 4.0, 1.0
        matrix[row, i - 1 : i + 2] = np.array([-6.0, 12.0, -6.0]) / h**2
    matrix[-1, 2 * n - 1 :] = 1.0, -2.0, 1.0  # continuous f''' at knot n - 1
    y, m = np.split(np.linalg.solve(matrix, given), 2)
    cells = np.stack(
        [y[:-1], np.diff(y, axis=0) / h - h * (2 * m[:-1] + m[1:]) / 6, m[:-1] / 2, np.diff(m, axis=0) / (6 * h)],
        axis=1,
    )
    return SplineBasis(h, cells)
