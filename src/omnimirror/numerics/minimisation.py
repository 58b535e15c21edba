"""The lowest point of a function of one number that may have several valleys and kinks.

Worst-case merits are maxima of many smooth functions; they have kinks that defeat parabolas and can have more than
one valley.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Found: TypeAlias = tuple[Array, Array, NDArray[Any]]
Slopes = Callable[[Array], Found]
"""Of places: the largest of many smooth functions, its derivative, and which of them it is; all of the shape of the
places."""
Rows: TypeAlias = NDArray[np.intp] | slice

MOST_STEPS = 60
EDGE = 1e-3  # of a bracket, which every step cuts off at least
HALVING = 4  # every so many steps the bracket is halved, whatever the tangents say


def lowest(function: Callable[[float], float], low: float, high: float, scan: int = 129) -> float:
    """Where ``function`` is least between low and high: a scan, then golden sections in the best valley.

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
    rounding = 4 * np.finfo(float).eps * max(abs(a), abs(b))  # an interval this narrow cannot shrink any more
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
    """Where a function whose derivative is known is least between low and high, to ``close`` of the interval.

    A scan finds the valleys; all whose tangents reach below the best place of the scan are gone down.

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
    f, g, _ = worst(x)
    a, b, fa, fb, ga, gb = x[:-1], x[1:], f[:-1], f[1:], g[:-1], g[1:]
    valleys = (ga < 0) & (gb > 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        meet = (fa * gb - fb * ga - ga * gb * (a - b)) / (gb - ga)  # height at which the tangents at both ends meet
    valleys &= meet < f.min()
    found = np.append(bottoms(a[valleys], b[valleys], close * (high - low), lambda v, _: worst(v)), x[f.argmin()])
    return float(found[worst(found)[0].argmin()])


def bottoms(a: Array, b: Array, close: float | Array, worst: Callable[[Array, Rows], Found]) -> Array:
    """Where functions that fall at a and rise at b are least, to within ``close``; arrays of one shape.

    ``worst`` is asked for some places and told of which rows they are: once few are left, of these only.

    Each function is the largest of many smooth ones. Where the tangents at both ends meet is a good guess
    for the kink between two of them; where one is the largest at both ends, the zero of its derivative is.
    """
    if not a.size:
        return a
    everywhere = slice(None)
    (fa, ga, ja), (fb, gb, jb) = worst(a, everywhere), worst(b, everywhere)
    for step in range(1, MOST_STEPS + 1):
        open_ = b - a > close
        if not open_.any():
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            c = np.where(ja == jb, a - ga * (b - a) / (gb - ga), a + (fb - fa - gb * (b - a)) / (ga - gb))
        middle = (a + b) / 2
        edge = EDGE * (b - a)
        good = np.isfinite(c) & (ga < 0) & (gb > 0) if step % HALVING else np.zeros_like(open_)
        c = np.where(good, np.clip(c, a + edge, b - edge), middle)
        left = np.flatnonzero(open_)
        if 2 * len(left) > len(a):
            f, g, j = worst(c, everywhere)
        else:
            f, g, j = (np.zeros_like(old) for old in (fa, ga, ja))
            f[left], g[left], j[left] = worst(c[left], left)
        rises, falls = open_ & (g > 0), open_ & ~(g > 0)
        a, fa, ga, ja = (np.where(falls, new, old) for new, old in ((c, a), (f, fa), (g, ga), (j, ja)))
        b, fb, gb, jb = (np.where(rises, new, old) for new, old in ((c, b), (f, fb), (g, gb), (j, jb)))
    return (a + b) / 2
