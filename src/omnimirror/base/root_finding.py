"""Bracketed root finding: many increasing functions at once, and one function that may be
discontinuous.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .typing import Array

NEWTON_TOLERANCE = 1e-9  # relative Newton step whose error is about its square
BISECTION_TOLERANCE = 4 * np.finfo(float).eps
MAX_STEPS = 200  # bisection alone requires 52


def increasing_root(
    function: Callable[[Array], tuple[Array, Array]],
    low: Array,
    high: Array,
    start: Array,
    scale: float,
) -> Array:
    """Solve f(x) = 0 for each element, given low <= root <= high.

    Parameters
    ----------
    function
        Maps x (n,) to f (n,) and df/dx (n,); f increases with x.
    low, high, start : (n,) arrays
        Bracket and initial value of each root.
    scale
        Reference magnitude of x for the relative step size.

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
        close = np.where(inside, NEWTON_TOLERANCE, BISECTION_TOLERANCE) * scale
        if np.all(step <= close):
            break
    return x


def sign_change(function: Callable[[float], float], low: float, high: float, xtol: float) -> float:
    """Return the position between ``low`` and ``high`` at which a function changes its sign.

    Unlike SciPy's ``brentq`` it accepts NaN, which counts as non-negative. If rounding hides the
    change of sign, the end with the smaller absolute value is returned.

    >>> round(sign_change(lambda x: x * x - 2, 0.0, 2.0, 1e-12), 9)
    1.414213562
    >>> round(sign_change(lambda x: -1.0 if x < 0.3 else float("nan"), 0.0, 1.0, 1e-12), 9)
    0.3
    >>> sign_change(lambda x: 1.0 + x, 0.0, 2.0, 1e-12)
    0.0
    """
    from scipy.optimize import brentq

    f_low, f_high = function(low), function(high)
    if (f_low < 0) == (f_high < 0):
        return high if abs(f_high) < abs(f_low) or np.isnan(f_low) else low
    values: dict[float, float] = {low: f_low, high: f_high}

    def evaluate(x: float) -> float:
        return values[x] if x in values else function(x)

    if np.isfinite([f_low, f_high]).all():
        try:
            return float(brentq(evaluate, low, high, xtol=xtol))
        except ValueError:  # NaN between the ends
            pass
    while abs(high - low) > xtol + BISECTION_TOLERANCE * max(abs(low), abs(high)):
        middle = (low + high) / 2
        low, high = (low, middle) if (function(middle) < 0) == (f_high < 0) else (middle, high)
    return (low + high) / 2
