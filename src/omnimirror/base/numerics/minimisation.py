"""The lowest point of a function of one number that may have several valleys and kinks.

Worst-case merits are maxima of many smooth functions; they have kinks that defeat parabolas and can have more than
one valley.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Found: TypeAlias = tuple[Array, Array, NDArray[Any]]
Slopes = Callable[[Array], Found]
"""Of places: the largest of many smooth functions, its derivative, and which of them it is; all of the shape of the
places."""
Rows: TypeAlias = NDArray[np.intp] | slice
End: TypeAlias = tuple[float, ...]
"""Of a bracket: a place, and the value, derivative and index there."""

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
    seen = np.stack([x, *worst(x)])
    a, b = seen[:, :-1], seen[:, 1:]
    (xa, fa, ga, _), (xb, fb, gb, _) = a, b
    valleys = (ga < 0) & (gb > 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        meet = (fa * gb - fb * ga - ga * gb * (xa - xb)) / (gb - ga)  # height at which the tangents at both ends meet
    lowest = int(seen[1].argmin())
    valleys &= meet < seen[1, lowest]
    ends = [(tuple(map(float, a[:, i])), tuple(map(float, b[:, i]))) for i in np.flatnonzero(valleys)]
    found = [_bottom(*both, close * (high - low), worst) for both in ends]
    if len(ends) == 1 and x[lowest] in (ends[0][0][0], ends[0][1][0]):  # it lies below both ends of its bracket
        return found[0]
    tried = np.array([*found, x[lowest]])
    return float(tried[worst(tried)[0].argmin()])


def _bottom(a: End, b: End, close: float, worst: Slopes) -> float:
    """As :func:`bottoms`, of one function: by plain numbers, which cost a fifth of arrays of one."""
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
    """Where functions that fall at a and rise at b are least, to within ``close``.

    Both ends are (4, ...) arrays: places, and the value, derivative and index that ``worst`` found there. It is asked
    for some places and told of which rows they are: once few are left, of these only.

    Each function is the largest of many smooth ones. Where the tangents at both ends meet is a good guess
    for the kink between two of them; where one is the largest at both ends, the zero of its derivative is.
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
    """The next places: where tangents meet, or cross zero, within their brackets; else the middle."""
    (x, fa, ga, ja), (_, fb, gb, jb) = a, b
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(ja == jb, -ga * width, fb - fa - gb * width) / np.where(ja == jb, gb - ga, ga - gb)
    good = np.isfinite(step) & (ga < 0) & (gb > 0)
    edge = EDGE * width
    return np.asarray(x + np.where(good, np.minimum(np.maximum(step, edge), width - edge), width / 2))
