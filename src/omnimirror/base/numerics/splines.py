"""Cubic splines on even knots that are odd or even about 0, by the values at their knots."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SplineBasis(NamedTuple):
    """Each knot's share in a spline on the knots h, 2 h .. n h, as polynomials of x from the start of each cell."""

    step: float
    cells: Array
    """(n, 4, n) coefficients: of the cell, of the power, to the value at the knot."""

    def at(self, x: Array) -> Array:
        """Shares (m, n) of the knots' values in the spline at x (m,)."""
        cell, t = _place(x, self.step, len(self.cells))
        c, t = self.cells[cell], t[:, None]
        shares: Array = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3]))
        return shares

    def of(self, values: Array) -> Spline:
        """The spline that has these values (n,) at the knots."""
        return Spline(self.step, self.cells @ values)


class Spline(NamedTuple):
    """A piecewise cubic on even knots from 0."""

    step: float
    cells: Array
    """(n, 4) coefficients of x from the start of each cell."""

    def __call__(self, x: Array) -> Array:
        cell, t = _place(x, self.step, len(self.cells))
        c = self.cells[cell]
        value: Array = c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3]))
        return value

    def rate(self, x: Array) -> Array:
        """Its derivative."""
        cell, t = _place(x, self.step, len(self.cells))
        c = self.cells[cell]
        value: Array = c[..., 1] + t * (2 * c[..., 2] + 3 * t * c[..., 3])
        return value

    def end_of_growth(self, slowest: float) -> float:
        """Where the derivative first falls below a value; the last knot, if nowhere."""
        for cell, (_, b, c, d) in enumerate(self.cells.tolist()):
            for t in sorted(_crossings(3 * d, 2 * c, b - slowest)):
                if 0 <= t <= self.step:
                    return cell * self.step + t
        return len(self.cells) * self.step


def _crossings(a: float, b: float, c: float) -> list[float]:
    """Where ``a t^2 + b t + c`` falls through 0."""
    square = b * b - 4 * a * c
    if square < 0 or (a == 0 and b >= 0):
        return []
    # The falling root of the two, in the form that does not cancel, a = 0 included.
    root = square**0.5
    return [2 * c / (-b + root)] if b < 0 else [(-b - root) / (2 * a)]


def _place(x: Array, step: float, count: int) -> tuple[NDArray[np.intp], Array]:
    cell = np.fmin(np.fmax(x / step, 0), count - 1).astype(np.intp)  # what is no number is in the first
    return cell, x - cell * step


@lru_cache(maxsize=64)
def odd_basis(count: int, end: float) -> SplineBasis:
    """Of splines with ``f(-x) = -f(x)``, on ``count`` even knots up to ``end``, 3 or more.

    >>> spline = odd_basis(4, 2.0).of(np.array([0.5, 1.0, 1.5, 2.0]) ** 3)
    >>> spline(np.array([0.3, 1.7])).round(12)  # what is a cubic is met exactly
    array([0.027, 4.913])
    """
    at_zero = np.zeros((2, count + 1 + count + 1))
    at_zero[0, 0] = 1.0  # f(0)
    at_zero[1, count + 1] = 1.0  # f''(0)
    basis = _solved(count, end, at_zero)
    basis.cells[0, [0, 2]] = 0.0  # but for rounding, which radii next to the axis would be made of
    return basis


@lru_cache(maxsize=64)
def even_basis(count: int, end: float) -> SplineBasis:
    """Of splines with ``f(-x) = f(x)``, on ``count`` even knots up to ``end``; within the first, parabolas.

    >>> spline = even_basis(4, 2.0).of(np.array([0.5, 1.0, 1.5, 2.0]) ** 2)
    >>> spline(np.array([0.3, 1.7])).round(12)
    array([0.09, 2.89])
    """
    h = end / count
    at_zero = np.zeros((2, count + 1 + count + 1))
    at_zero[0, [0, 1]] = -1 / h, 1 / h  # f'(0), from the values and second derivatives of the first cell
    at_zero[0, [count + 1, count + 2]] = -h / 3, -h / 6
    at_zero[1, [count + 1, count + 2]] = 1.0, -1.0
    return _solved(count, end, at_zero)


def _solved(count: int, end: float, at_zero: Array) -> SplineBasis:
    """From two equations at 0 for the values y and second derivatives m of knots 0 to n, (y0 .. yn, m0 .. mn)."""
    n, h = count, end / count
    matrix, given = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, n))
    matrix[:2] = at_zero
    for i in range(1, n + 1):  # values
        matrix[1 + i, i], given[1 + i, i - 1] = 1.0, 1.0
    for i in range(1, n):  # the first derivative is continuous
        row = n + 1 + i
        matrix[row, n + i : n + i + 3] = 1.0, 4.0, 1.0
        matrix[row, i - 1 : i + 2] = np.array([-6.0, 12.0, -6.0]) / h**2
    matrix[-1, 2 * n - 1 :] = 1.0, -2.0, 1.0  # and the third, across the last knot but one
    y, m = np.split(np.linalg.solve(matrix, given), 2)
    cells = np.stack(
        [y[:-1], np.diff(y, axis=0) / h - h * (2 * m[:-1] + m[1:]) / 6, m[:-1] / 2, np.diff(m, axis=0) / (6 * h)],
        axis=1,
    )
    return SplineBasis(h, cells)
