"""The largest of many smooth functions made small: a sequence of linear programmes with a trust region.

At each point the functions are taken for straight; the linear programme

    least t   so that   g_i + J_i d <= t,   c_j + K_j d <= 0,   |d| <= trust

finds the step that presses the largest one down most within the trust region, which grows where the
straight functions foretold well and shrinks where they did not (Madsen and Schjaer-Jacobsen 1978). Where
as many functions touch the optimum as there are variables, convergence is quadratic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FIRST_TRUST, LAST_TRUST = 0.1, 1e-9
FORETOLD_WELL = 0.9  # of the gain; a step that brings less is tried again with what it showed of the curvature
NOTHING = 1e-10  # gain that ends the search where the optimum is 0
FEW_ROWS = 1000  # programmes of no more are solved at once, as quickly
KEPT = 1e-10  # a row that is violated by no more is kept
PENALTY = 100.0  # price of a violated constraint, in units of the objective


class Rows(NamedTuple):
    """Functions at a point and their derivatives: (r,) to be made small, (c,) to be kept at 0 or below."""

    objective: Array
    constraints: Array
    objective_jacobian: Array
    constraint_jacobian: Array


class ObjectiveValues(NamedTuple):
    objective: Array
    constraints: Array


@dataclass(frozen=True)
class Minimum:
    """Where the sequence ended.

    Attributes
    ----------
    y : (dim,)
    value
        Largest function there (for a spread: half of largest minus least).
    violation
        Largest constraint, 0 where all are kept.
    history
        Value after each accepted step, the start first.
    """

    y: Array
    value: float
    violation: float
    history: tuple[float, ...]


def solve_minimax(
    values: Callable[[Array], ObjectiveValues],
    rows: Callable[[Array], Rows],
    start: Array,
    bounds: tuple[Array, Array],
    is_spread: bool = False,
    tolerance: float = 1e-8,
    most_steps: int = 200,
    first_trust: float = FIRST_TRUST,
    on_step: Callable[[float], None] | None = None,
) -> Minimum:
    """Minimise the largest objective function under constraints, from ``start`` (dim,).

    Parameters
    ----------
    values, rows
        The functions without and with their derivatives; values that are not finite are refused as a step.
    bounds
        Lowest and highest coordinates, (dim,) each.
    is_spread
        Minimise half of largest minus least instead.
    tolerance
        Relative decrease that is not worth another step.
    first_trust
        Longest first step in every coordinate.
    on_step
        Called with the value after every accepted step.

    Examples
    --------
    The point whose greatest distance from 0 and 3 is least:

    >>> def values(y):
    ...     return ObjectiveValues(np.array([y[0] ** 2, (y[0] - 3) ** 2]), np.array([-1.0]))
    >>> def rows(y):
    ...     return Rows(*values(y), np.array([2 * y, 2 * (y - 3)]), np.zeros((1, 1)))
    >>> round(float(solve_minimax(values, rows, np.zeros(1), (np.full(1, -9.0), np.full(1, 9.0))).y[0]), 6)
    1.5
    """
    y = np.clip(start, *bounds)
    here = _price(values(y), is_spread)
    history, trust = [here.value], first_trust
    linear = rows(y)
    for _ in range(most_steps):
        step, foretold = _programme(linear, y, bounds, trust, is_spread)
        gain = here.price - foretold
        if not gain > max(tolerance * abs(here.value), NOTHING):
            break
        ahead = values(y + step)
        there = _price(ahead, is_spread)
        if there.price > here.price - FORETOLD_WELL * gain and np.isfinite(there.price):
            bent = _bent(linear, ahead, step)
            other, _ = _programme(bent, y, bounds, trust, is_spread)
            elsewhere = _price(values(y + other), is_spread)
            if elsewhere.price < there.price:
                step, there = other, elsewhere
        quality = (here.price - there.price) / gain if np.isfinite(there.price) else -1.0
        if quality > 0.01:
            y, here, linear = y + step, there, rows(y + step)
            history.append(here.value)
            if on_step:
                on_step(here.value)
        trust = min(trust * 2, 1.0) if quality > 0.75 else trust / 4 if quality < 0.25 else trust
        if trust < LAST_TRUST:
            break
    return Minimum(y, here.value, here.violation, tuple(history))


def minimise_mean(
    values: Callable[[Array], ObjectiveValues],
    rows: Callable[[Array], Rows],
    start: Array,
    bounds: tuple[Array, Array],
    tolerance: float = 1e-9,
    most_steps: int = 200,
    on_step: Callable[[float], None] | None = None,
) -> Minimum:
    """Minimise a single smooth function under constraints: sequential quadratic programming (SciPy's SLSQP).

    As :func:`solve_minimax`, for an objective of one row; the least price met on the way is returned.
    """
    from scipy.optimize import minimize

    best, history = np.clip(start, *bounds), [_price(values(np.clip(start, *bounds)), False).value]
    least = _price(values(best), False)

    def function(y: Array) -> float:
        nonlocal best, least
        price = _price(values(y), False)
        if price.price < least.price:
            best, least = y.copy(), price
            history.append(price.value)
            if on_step:
                on_step(price.value)
        return price.value if np.isfinite(price.value) else 1e3 + abs(history[0])

    minimize(
        function,
        best,
        jac=lambda y: rows(y).objective_jacobian[0],
        constraints={
            "type": "ineq",
            "fun": lambda y: -np.nan_to_num(values(y).constraints, nan=1e3),
            "jac": lambda y: -np.nan_to_num(rows(y).constraint_jacobian),
        },
        bounds=[(None if np.isinf(a) else a, None if np.isinf(b) else b) for a, b in zip(*bounds, strict=True)],
        method="SLSQP",
        options={"maxiter": most_steps, "ftol": tolerance},
    )
    return Minimum(best, least.value, least.violation, tuple(history))


class _Price(NamedTuple):
    value: float
    violation: float
    price: float


def _price(v: ObjectiveValues, is_spread: bool) -> _Price:
    """What a point costs: its value, and its violation of constraints at a price."""
    if not np.isfinite(v.objective).all() or not np.isfinite(v.constraints).all():
        return _Price(np.inf, np.inf, np.inf)
    value = float(np.ptp(v.objective)) / 2 if is_spread else float(v.objective.max())
    violation = max(float(v.constraints.max(initial=0.0)), 0.0)
    return _Price(value, violation, value + PENALTY * violation)


def _bent(linear: Rows, ahead: ObjectiveValues, step: Array) -> Rows:
    """The linear model moved so that it holds at the end of a step."""
    J, K = linear.objective_jacobian, linear.constraint_jacobian
    return Rows(ahead.objective - J @ step, ahead.constraints - K @ step, J, K)


def _programme(
    linear: Rows, y: Array, bounds: tuple[Array, Array], trust: float, is_spread: bool
) -> tuple[Array, float]:
    """The step (dim,) within the trust region, and the price that the linear model foretells for it."""
    dim = y.size
    g, J = _within_reach(linear.objective, linear.objective_jacobian, trust, is_spread)
    c, K = linear.constraints, linear.constraint_jacobian
    near = c + trust * np.abs(K).sum(axis=1) > 0
    c, K = c[near], K[near]
    ones, zeros = np.ones((len(g), 1)), np.zeros((len(g), 1))
    # unknowns: the step, t, the level of a spread, and how far constraints are violated
    A = [np.hstack([J, -ones, -ones if is_spread else zeros, zeros])]
    b = [-g]
    if is_spread:
        A.append(np.hstack([-J, -ones, ones, zeros]))
        b.append(g)
    A.append(np.hstack([K, np.zeros((len(c), 2)), -np.ones((len(c), 1))]))
    b.append(-c)
    low, high = np.maximum(bounds[0] - y, -trust), np.minimum(bounds[1] - y, trust)
    begin = np.concatenate([_foremost(part[:, :dim], limit, low, high) for part, limit in zip(A, b, strict=True)])
    ranges = [*zip(low, high, strict=True), (None, None), (None, None), (0, None)]
    x = _least(np.r_[np.zeros(dim), 1.0, 0.0, PENALTY], np.vstack(A), np.concatenate(b), ranges, begin)
    if x is None:
        return np.zeros(dim), np.inf
    return np.clip(x[:dim], low, high), float(x[dim] + PENALTY * x[-1])


def _foremost(A: Array, b: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Which of rows (n, dim) are the largest in the middle of a box or that of one of its sides."""
    is_foremost = np.zeros(len(b), dtype=bool)
    if len(b):
        corners = np.vstack([np.zeros_like(low), np.diag(low), np.diag(high)])
        is_foremost[np.argmax(A @ corners.T - b[:, None], axis=0)] = True
    return is_foremost


def _least(
    cost: Array, A: Array, b: Array, ranges: Sequence[tuple[float | None, float | None]], begin: NDArray[np.bool_]
) -> Array | None:
    """The point within ranges where A x <= b and a linear cost is least; None where there is none.

    Of the thousands of rows that sample a few smooth curves hardly more touch the optimum than there are unknowns: a
    programme of few rows is solved, and those that its solution violates most, a peak of each curve, are added until
    there are none.
    """
    from scipy.optimize import linprog

    used = begin.copy() if len(b) > FEW_ROWS else np.ones(len(b), dtype=bool)
    while True:
        found = linprog(cost, A[used], b[used], bounds=ranges, method="highs")
        if found.x is None:
            return None
        over = np.pad(A @ found.x - b, 1, constant_values=-np.inf)
        peaks = (over[1:-1] >= over[:-2]) & (over[1:-1] >= over[2:]) & (over[1:-1] > KEPT) & ~used
        if not peaks.any():
            least: Array = found.x
            return least
        used |= peaks


def _within_reach(g: Array, J: Array, trust: float, is_spread: bool) -> tuple[Array, Array]:
    """The rows that can become the largest within the trust region."""
    reach = trust * np.abs(J).sum(axis=1)
    keep = g + reach >= (g - reach).max()
    if is_spread:
        keep |= g - reach <= (g + reach).min()
    return g[keep], J[keep]
