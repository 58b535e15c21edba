"""The lowest point of a function of one number that may have several valleys and kinks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def lowest(function: Callable[[float], float], low: float, high: float, scan: int = 129) -> float:
    """Where ``function`` is least between low and high: a scan, then golden sections in the best valley.

    Worst-case merits are maxima of many smooth functions; they have kinks that defeat parabolas and
    can have more than one valley.

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
