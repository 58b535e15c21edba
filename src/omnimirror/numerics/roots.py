"""Roots of increasing functions, many at once: Newton's rule inside a bracket that only shrinks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEWTON_CLOSE = 1e-9  # a Newton step this small (relative) leaves an error of about its square
BISECTION_CLOSE = 4 * np.finfo(float).eps
MAX_STEPS = 200  # bisection alone needs 52


def increasing_root(
    function: Callable[[Array], tuple[Array, Array]], low: Array, high: Array, start: Array, scale: float
) -> Array:
    """Solve f(x) = 0 for each element, given low <= root <= high.

    Parameters
    ----------
    function
        Maps x (n,) to f (n,) and df/dx (n,); f increases with x.
    low, high, start : (n,) arrays
        Bracket and first guess of each root.
    scale
        Size of x against which steps count as small.

    Examples
    --------
    >>> increasing_root(lambda x: (x**3 - 8, 3 * x**2), np.zeros(1), np.full(1, 9.0), np.full(1, 9.0), 1.0)
    array([2.])
    """
    x = np.clip(start, low, high)
    for _ in range(MAX_STEPS):
        f, df = function(x)
        low = np.where(f <= 0, x, low)
        high = np.where(f >= 0, x, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - f / df
        inside = (newton >= low) & (newton <= high)
        x_new = np.where(inside, newton, (low + high) / 2)
        step = np.abs(x_new - x)
        x = x_new
        close = np.where(inside, NEWTON_CLOSE, BISECTION_CLOSE) * scale
        if np.all(step <= close):
            break
    return x
