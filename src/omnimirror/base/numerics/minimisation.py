"""Global minimisation of a scalar function with several minima and kinks.

Worst-case merits are maxima of many smooth functions: their kinks prevent parabolic interpolation,
and they can have more than one minimum.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..typing import Array

Found: TypeAlias = tuple[Array, Array, NDArray[Any]]
Slopes = Callable[[Array], Found]
"""Maximum of many smooth functions at given positions, its derivative, and the index of the largest
function; all of the shape of the positions.
"""
Rows: TypeAlias = NDArray[np.intp] | slice
End: TypeAlias = tuple[float, ...]
"""End of a bracket: position, and the value, derivative and index there."""

MOST_STEPS = 60
EDGE = 1e-3  # minimum fraction of a bracket removed by each step
HALVING = 4  # period of bisection steps


def lowest(function: Callable[[float], float], low: float, high: float, scan: int = 129) -> float:
    """Minimise a scalar function on [low, high] by a grid scan and golden-section search.

    >>> round(lowest(lambda x: abs(x - 0.3) + 0.1 * np.cos(9 * x), -1.0, 1.0), 6)
    0.3
    >>> lowest(lambda x: x, 1.0, 1.0 + 1e-15)  # an interval of a few roundings ends too
    1.0...
    """
    if not high > low:
        return low
    grid = np.linspace(low, high, scan)
    i = int(np.argmin([function(float(x)) for x in grid]))
    a, b = float(grid[max(i - 1, 0)]), float(grid[min(i + 1, scan - 1)])
    golden = (5**0.5 - 1) / 2
    c, d = b - golden * (b - a), a + golden * (b - a)
    fc, fd = function(c), function(d)
    rounding = 4 * np.finfo(float).eps * max(abs(a), abs(b))  # floating-point resolution
    while b - a > max(1e-10 * (high - low), rounding):
        if fc < fd:
            b, d, fd = d, c, fc
            c = b - golden * (b - a)
            fc = function(c)
        else:
            a, c, fc = c, d, fd
            d = a + golden * (b - a)
            fd = function(d)
    return (a + b) / 2


def lowest_with_slopes(worst: Slopes, low: float, high: float, scan: int = 65, close: float = 1e-11) -> float:
    """Minimise a scalar function with known derivative on [low, high], to a relative tolerance
    ``close``.

    A grid scan brackets the minima; those with tangents below the best grid point are refined.

    >>> def kinks(x):
    ...     both = np.stack([(x - 0.2) ** 2, 0.5 - x])
    ...     which = both.argmax(axis=0)
    ...     return both.max(axis=0), np.where(which == 0, 2 * (x - 0.2), -1.0), which
    >>> round(lowest_with_slopes(kinks, 0.0, 2.0), 9)  # where (x - 0.2)^2 = 0.5 - x
    0.441619849
    """
    if not high > low:
        return low
    x = np.linspace(low, high, scan)
    seen = np.stack([x, *worst(x)])
    a, b = seen[:, :-1], seen[:, 1:]
    (xa, fa, ga, _), (xb, fb, gb, _) = a, b
    valleys = (ga < 0) & (gb > 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        meet = (fa * gb - fb * ga - ga * gb * (xa - xb)) / (gb - ga)  # tangent intersection
    lowest = int(seen[1].argmin())
    valleys &= meet < seen[1, lowest]
    ends = [(tuple(map(float, a[:, i])), tuple(map(float, b[:, i]))) for i in np.flatnonzero(valleys)]
    found = [_bottom(*both, close * (high - low), worst) for both in ends]
    if len(ends) == 1 and x[lowest] in (ends[0][0][0], ends[0][1][0]):  # below both ends
        return found[0]
    tried = np.array([*found, x[lowest]])
    return float(tried[worst(tried)[0].argmin()])


def _bottom(a: End, b: End, close: float, worst: Slopes) -> float:
    """Minimise one function as :func:`bottoms` does; scalars take 20 % of the time of arrays of
    length 1.
    """
    for step in range(1, MOST_STEPS + 1):
        (xa, fa, ga, ja), (xb, fb, gb, jb) = a, b
        width = xb - xa
        if width <= close:
            break
        c = xa + width / 2
        if step % HALVING and ga < 0 < gb:
            away = -ga * width / (gb - ga) if ja == jb else (fb - fa - gb * width) / (ga - gb)
            c = xa + min(max(away, EDGE * width), width - EDGE * width) if isfinite(away) else c
        f, g, j = (float(part[0]) for part in worst(np.array([c])))
        if g > 0:
            b = c, f, g, j
        else:
            a = c, f, g, j
    return (a[0] + b[0]) / 2


def bottoms(a: Array, b: Array, close: float | Array, worst: Callable[[Array, Rows], Found]) -> Array:
    """Minimise functions that decrease at a and increase at b, to within ``close``.

    Both ends are (4, ...) arrays: position, and the value, derivative and index from ``worst``.
    ``worst`` is called with positions and the indices of their rows; when few rows remain, with
    these only.

    Each function is the maximum of many smooth ones. The intersection of the tangents at both ends
    approximates the kink between two of them; if one function is the largest at both ends, the zero
    of its derivative is used.
    """
    for step in range(1, MOST_STEPS + 1):
        width = b[0] - a[0]
        open_ = width > close
        if not open_.any():
            break
        c = _between(a, b, width) if step % HALVING else (a[0] + b[0]) / 2
        left = np.flatnonzero(open_)
        if 2 * len(left) > len(c):
            found = np.stack([c, *worst(c, slice(None))])
        else:
            found = np.zeros_like(a)
            found[:, left] = c[left], *worst(c[left], left)
        rises = found[2] > 0
        a, b = np.where(open_ & ~rises, found, a), np.where(open_ & rises, found, b)
    return np.asarray((a[0] + b[0]) / 2)


def _between(a: Array, b: Array, width: Array) -> Array:
    """Return the next positions: tangent intersections or zeros within their brackets, otherwise
    midpoints.
    """
    (x, fa, ga, ja), (_, fb, gb, jb) = a, b
    # The tangents fa + ga s and fb + gb (s - w) intersect at s = (fb - fa - gb w) / (ga - gb). If one
    # function is the largest at both ends, the secant zero of its derivative is -ga w / (gb - ga).
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(ja == jb, -ga * width, fb - fa - gb * width) / np.where(ja == jb, gb - ga, ga - gb)
    good = np.isfinite(step) & (ga < 0) & (gb > 0)
    edge = EDGE * width
    return np.asarray(x + np.where(good, np.minimum(np.maximum(step, edge), width - edge), width / 2))
