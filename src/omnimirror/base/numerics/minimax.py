"""Minimax optimisation of smooth functions: sequential linear programming with a trust region.

At each point the functions are linearised; the linear programme

    min t   subject to   g_i + J_i d <= t,   c_j + K_j d <= 0,   |d| <= trust

yields the step with the largest predicted decrease of the maximum within the trust region. The
region grows after accurate predictions and shrinks otherwise (Madsen and Schjaer-Jacobsen 1978). If
as many functions are active at the optimum as there are variables, convergence is quadratic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..typing import Array

FIRST_TRUST, LAST_TRUST = 0.1, 1e-9
FORETOLD_WELL = 0.9  # fraction of the predicted gain; otherwise second-order correction
NOTHING = 1e-10  # gain that ends the search if the optimum is 0
FEW_ROWS = 1000  # smaller programmes are solved without row selection
KEPT = 1e-10  # feasibility tolerance of a row
PENALTY = 100.0  # price of a violated constraint, in units of the objective


class Rows(NamedTuple):
    """Functions and their derivatives at a point: objectives (r,), and constraints (c,) with c <=
    0.
    """

    objective: Array
    constraints: Array
    objective_jacobian: Array
    constraint_jacobian: Array


class ObjectiveValues(NamedTuple):
    objective: Array
    constraints: Array


@dataclass(frozen=True)
class Minimum:
    """Result of :func:`solve_minimax`.

    Attributes
    ----------
    y : (dim,)
    value
        Largest function at y (for a spread: half the difference of maximum and minimum).
    violation
        Largest constraint violation, 0 for a feasible point.
    history
        Value after each accepted step, including the start.
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
        Functions without and with their derivatives; steps to non-finite values are rejected.
    bounds
        Lowest and highest coordinates, (dim,) each.
    is_spread
        Minimise half the difference of maximum and minimum instead.
    tolerance
        Relative decrease below which the iteration stops.
    first_trust
        Maximum length of the first step in each coordinate.
    on_step
        Called with the value after every accepted step.

    Examples
    --------
    Minimise the maximum distance of a point from 0 and 3:

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
    """Minimise a single smooth function under constraints: sequential quadratic programming
    (SciPy's SLSQP).

    Arguments are those of :func:`solve_minimax`, for one objective; the result is the iterate of
    lowest price.
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
    """Return the price of a point: its value plus the penalty of constraint violations."""
    if not np.isfinite(v.objective).all() or not np.isfinite(v.constraints).all():
        return _Price(np.inf, np.inf, np.inf)
    value = float(np.ptp(v.objective)) / 2 if is_spread else float(v.objective.max())
    violation = max(float(v.constraints.max(initial=0.0)), 0.0)
    return _Price(value, violation, value + PENALTY * violation)


def _bent(linear: Rows, ahead: ObjectiveValues, step: Array) -> Rows:
    """Return the linear model shifted to the exact values at the end of a step (second-order
    correction).
    """
    J, K = linear.objective_jacobian, linear.constraint_jacobian
    return Rows(ahead.objective - J @ step, ahead.constraints - K @ step, J, K)


def _programme(
    linear: Rows, y: Array, bounds: tuple[Array, Array], trust: float, is_spread: bool
) -> tuple[Array, float]:
    """Return the step (dim,) within the trust region, and its predicted price."""
    dim = y.size
    g, J = _within_reach(linear.objective, linear.objective_jacobian, trust, is_spread)
    c, K = linear.constraints, linear.constraint_jacobian
    near = c + trust * np.abs(K).sum(axis=1) > 0
    c, K = c[near], K[near]
    ones, zeros = np.ones((len(g), 1)), np.zeros((len(g), 1))
    # unknowns: step, t, level of a spread, constraint violation
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
    """Return the rows (n, dim) that are largest at the centre of a box or of one of its sides."""
    is_foremost = np.zeros(len(b), dtype=bool)
    if len(b):
        corners = np.vstack([np.zeros_like(low), np.diag(low), np.diag(high)])
        is_foremost[np.argmax(A @ corners.T - b[:, None], axis=0)] = True
    return is_foremost


def _least(
    cost: Array, A: Array, b: Array, ranges: Sequence[tuple[float | None, float | None]], begin: NDArray[np.bool_]
) -> Array | None:
    """Solve a linear programme: minimum cost with A x <= b within ranges; None if infeasible.

    Among thousands of rows that sample a few smooth curves, about as many are active at the optimum
    as there are unknowns. A programme of few rows is solved, and the most violated rows, one peak
    per curve, are added until the solution is feasible.
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
    """Return the rows that can become the largest within the trust region."""
    reach = trust * np.abs(J).sum(axis=1)
    keep = g + reach >= (g - reach).max()
    if is_spread:
        keep |= g - reach <= (g + reach).min()
    return g[keep], J[keep]
