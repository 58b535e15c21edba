"""Minimisation of scalar functions with several minima, and minimax optimisation under constraints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .typing import Array

# -- Scalar functions with several minima and kinks -------------------------------------------------
#
# Worst-case merits are maxima of many smooth functions: their kinks prevent parabolic interpolation.

WorstValues: TypeAlias = tuple[Array, Array, NDArray[Any]]
WorstFunction = Callable[[Array], WorstValues]
"""Maximum of many smooth functions at given positions, its derivative, and the index of the largest
function; all of the shape of the positions.
"""
RowIndices: TypeAlias = NDArray[np.intp] | slice
BracketEnd: TypeAlias = tuple[float, ...]
"""End of a bracket: position, and the value, derivative and index there."""

MAX_BRACKET_STEPS = 60
MIN_BRACKET_REDUCTION = 1e-3  # minimum fraction of a bracket removed by each step
BISECTION_PERIOD = 4  # period of bisection steps


def minimise_scalar(
    function: Callable[[float], float], low: float, high: float, scan: int = 129
) -> float:
    """Minimise a scalar function on [low, high] by a grid scan and golden-section search.

    >>> round(minimise_scalar(lambda x: abs(x - 0.3) + 0.1 * np.cos(9 * x), -1.0, 1.0), 6)
    0.3
    >>> minimise_scalar(lambda x: x, 1.0, 1.0 + 1e-15)  # interval near the floating-point resolution
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


def minimise_with_derivative(
    worst: WorstFunction, low: float, high: float, scan: int = 65, close: float = 1e-11
) -> float:
    """Minimise a scalar function with known derivative on [low, high], to a relative tolerance
    ``close``.

    A grid scan brackets the minima; those with tangents below the best grid point are refined.

    >>> def kinked(x):
    ...     values = np.stack([(x - 0.2) ** 2, 0.5 - x])
    ...     index = values.argmax(axis=0)
    ...     return values.max(axis=0), np.where(index == 0, 2 * (x - 0.2), -1.0), index
    >>> round(minimise_with_derivative(kinked, 0.0, 2.0), 9)  # (x - 0.2)^2 = 0.5 - x
    0.441619849
    """
    if not high > low:
        return low
    x = np.linspace(low, high, scan)
    samples = np.stack([x, *worst(x)])
    a, b = samples[:, :-1], samples[:, 1:]
    (xa, fa, ga, _), (xb, fb, gb, _) = a, b
    valleys = (ga < 0) & (gb > 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # The tangents fa + ga (x - xa) and fb + gb (x - xb) intersect at this value, a lower bound of
        # a convex function between a and b.
        lower_bounds = (fa * gb - fb * ga - ga * gb * (xa - xb)) / (gb - ga)
    lowest = int(samples[1].argmin())
    valleys &= lower_bounds < samples[1, lowest]
    brackets = [
        (tuple(map(float, a[:, i])), tuple(map(float, b[:, i]))) for i in np.flatnonzero(valleys)
    ]
    minima = [_minimise_bracket(*ends, close * (high - low), worst) for ends in brackets]
    if len(brackets) == 1 and x[lowest] in (brackets[0][0][0], brackets[0][1][0]):
        return minima[0]  # below both ends
    candidates = np.array([*minima, x[lowest]])
    return float(candidates[worst(candidates)[0].argmin()])


def _minimise_bracket(a: BracketEnd, b: BracketEnd, close: float, worst: WorstFunction) -> float:
    """Minimise one function as :func:`minimise_brackets` does; scalars take 20 % of the time of arrays of
    length 1.
    """
    for step in range(1, MAX_BRACKET_STEPS + 1):
        (xa, fa, ga, ja), (xb, fb, gb, jb) = a, b
        width = xb - xa
        if width <= close:
            break
        c = xa + width / 2
        if step % BISECTION_PERIOD and ga < 0 < gb:
            # as in _next_positions
            step_x = -ga * width / (gb - ga) if ja == jb else (fb - fa - gb * width) / (ga - gb)
            margin = MIN_BRACKET_REDUCTION * width
            c = xa + min(max(step_x, margin), width - margin) if isfinite(step_x) else c
        f, g, j = (float(part[0]) for part in worst(np.array([c])))
        if g > 0:
            b = c, f, g, j
        else:
            a = c, f, g, j
    return (a[0] + b[0]) / 2


def minimise_brackets(
    a: Array, b: Array, close: float | Array, worst: Callable[[Array, RowIndices], WorstValues]
) -> Array:
    """Minimise functions that decrease at a and increase at b, to within ``close``.

    Both ends are (4, ...) arrays: position, and the value, derivative and index from ``worst``.
    ``worst`` is called with positions and the indices of their rows; when few rows remain, with
    these only.

    Each function is the maximum of many smooth ones. The intersection of the tangents at both ends
    approximates the kink between two of them; if one function is the largest at both ends, the zero
    of its derivative is used.
    """
    for step in range(1, MAX_BRACKET_STEPS + 1):
        width = b[0] - a[0]
        open_ = width > close
        if not open_.any():
            break
        c = _next_positions(a, b, width) if step % BISECTION_PERIOD else (a[0] + b[0]) / 2
        remaining = np.flatnonzero(open_)
        if 2 * len(remaining) > len(c):
            samples = np.stack([c, *worst(c, slice(None))])
        else:
            samples = np.zeros_like(a)
            samples[:, remaining] = c[remaining], *worst(c[remaining], remaining)
        rises = samples[2] > 0
        a, b = np.where(open_ & ~rises, samples, a), np.where(open_ & rises, samples, b)
    return np.asarray((a[0] + b[0]) / 2)


def _next_positions(a: Array, b: Array, width: Array) -> Array:
    """Return the next positions: tangent intersections or zeros within their brackets, otherwise
    midpoints.
    """
    (x, fa, ga, ja), (_, fb, gb, jb) = a, b
    # The tangents fa + ga s and fb + gb (s - w) intersect at s = (fb - fa - gb w) / (ga - gb). If one
    # function is the largest at both ends, the secant zero of its derivative is -ga w / (gb - ga).
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(ja == jb, -ga * width, fb - fa - gb * width) / np.where(
            ja == jb, gb - ga, ga - gb
        )
    is_valid = np.isfinite(step) & (ga < 0) & (gb > 0)
    margin = MIN_BRACKET_REDUCTION * width
    return np.asarray(
        x + np.where(is_valid, np.minimum(np.maximum(step, margin), width - margin), width / 2)
    )


# -- Minimax optimisation: sequential linear programming with a trust region ------------------------
#
# At each point the functions are linearised; the linear programme
#
#     min t   subject to   g_i + J_i d <= t,   c_j + K_j d <= 0,   |d| <= trust
#
# yields the step with the largest predicted decrease of the maximum within the trust region. The
# region grows after accurate predictions and shrinks otherwise (Madsen and Schjaer-Jacobsen 1978). If
# as many functions are active at the optimum as there are variables, convergence is quadratic.

INITIAL_TRUST_RADIUS, MIN_TRUST_RADIUS = 0.1, 1e-9
MIN_PREDICTED_FRACTION = 0.9  # fraction of the predicted gain; otherwise second-order correction
MIN_GAIN = 1e-10  # gain that ends the search if the optimum is 0
MAX_UNSELECTED_ROWS = 1000  # smaller programmes are solved without row selection
FEASIBILITY_TOLERANCE = 1e-10  # feasibility tolerance of a row
VIOLATION_PENALTY = 100.0  # price of a violated constraint, in units of the objective


class LinearisedValues(NamedTuple):
    """Functions and their derivatives at a point: objectives (r,), and constraints (c,) with c <=
    0.
    """

    objective: Array
    constraints: Array
    objective_jacobian: Array
    constraint_jacobian: Array


class ObjectiveValues(NamedTuple):
    """Functions at a point: objectives (r,), and constraints (c,) with c <= 0."""

    objective: Array
    constraints: Array


@dataclass(frozen=True)
class MinimaxResult:
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
    rows: Callable[[Array], LinearisedValues],
    start: Array,
    bounds: tuple[Array, Array],
    is_spread: bool = False,
    tolerance: float = 1e-8,
    max_steps: int = 200,
    initial_trust_radius: float = INITIAL_TRUST_RADIUS,
    final_trust: float = MIN_TRUST_RADIUS,
    min_gain: float = MIN_GAIN,
    on_step: Callable[[float], None] | None = None,
) -> MinimaxResult:
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
    initial_trust_radius
        Maximum length of the first step in each coordinate.
    final_trust
        Length of a step below which the iteration stops.
    min_gain
        Absolute decrease below which the iteration stops.
    on_step
        Called with the value after every accepted step.

    Examples
    --------
    Minimise the maximum distance of a point from 0 and 3:

    >>> def values(y):
    ...     return ObjectiveValues(np.array([y[0] ** 2, (y[0] - 3) ** 2]), np.array([-1.0]))
    >>> def rows(y):
    ...     return LinearisedValues(*values(y), np.array([2 * y, 2 * (y - 3)]), np.zeros((1, 1)))
    >>> round(float(solve_minimax(values, rows, np.zeros(1), (np.full(1, -9.0), np.full(1, 9.0))).y[0]), 6)
    1.5
    """
    y = np.clip(start, *bounds)
    here = _penalised(values(y), is_spread)
    history, trust = [here.value], initial_trust_radius
    linear = rows(y)
    for _ in range(max_steps):
        step, predicted = _trust_region_step(linear, y, bounds, trust, is_spread)
        gain = here.price - predicted
        if not gain > max(tolerance * abs(here.value), min_gain):
            break
        ahead = values(y + step)
        there = _penalised(ahead, is_spread)
        if there.price > here.price - MIN_PREDICTED_FRACTION * gain and np.isfinite(there.price):
            corrected = _second_order_model(linear, ahead, step)
            second_step, _ = _trust_region_step(corrected, y, bounds, trust, is_spread)
            second = _penalised(values(y + second_step), is_spread)
            if second.price < there.price:
                step, there = second_step, second
        quality = (here.price - there.price) / gain if np.isfinite(there.price) else -1.0
        if quality > 0.01:
            y, here, linear = y + step, there, rows(y + step)
            history.append(here.value)
            if on_step:
                on_step(here.value)
        trust = min(trust * 2, 1.0) if quality > 0.75 else trust / 4 if quality < 0.25 else trust
        if trust < final_trust:
            break
    return MinimaxResult(y, here.value, here.violation, tuple(history))


def minimise_mean(
    values: Callable[[Array], ObjectiveValues],
    rows: Callable[[Array], LinearisedValues],
    start: Array,
    bounds: tuple[Array, Array],
    tolerance: float = 1e-9,
    max_steps: int = 200,
    on_step: Callable[[float], None] | None = None,
) -> MinimaxResult:
    """Minimise a single smooth function under constraints: sequential quadratic programming
    (SciPy's SLSQP).

    Arguments are those of :func:`solve_minimax`, for one objective; the result is the iterate with
    the lowest penalty function.
    """
    from scipy.optimize import minimize

    best = np.clip(start, *bounds)
    lowest = _penalised(values(best), False)
    history = [lowest.value]

    def function(y: Array) -> float:
        nonlocal best, lowest
        price = _penalised(values(y), False)
        if price.price < lowest.price:
            best, lowest = y.copy(), price
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
        bounds=[
            (None if np.isinf(a) else a, None if np.isinf(b) else b)
            for a, b in zip(*bounds, strict=True)
        ],
        method="SLSQP",
        options={"maxiter": max_steps, "ftol": tolerance},
    )
    return MinimaxResult(best, lowest.value, lowest.violation, tuple(history))


class _Penalised(NamedTuple):
    """Value, constraint violation and exact penalty function (price) of a point."""

    value: float
    violation: float
    price: float


def _penalised(v: ObjectiveValues, is_spread: bool) -> _Penalised:
    """Return the price of a point: its value plus the penalty of constraint violations."""
    if not np.isfinite(v.objective).all() or not np.isfinite(v.constraints).all():
        return _Penalised(np.inf, np.inf, np.inf)
    value = float(np.ptp(v.objective)) / 2 if is_spread else float(v.objective.max())
    violation = float(v.constraints.max(initial=0.0))
    return _Penalised(value, violation, value + VIOLATION_PENALTY * violation)


def _second_order_model(
    linear: LinearisedValues, ahead: ObjectiveValues, step: Array
) -> LinearisedValues:
    """Return the linear model shifted to the exact values at the end of a step (second-order
    correction).
    """
    J, K = linear.objective_jacobian, linear.constraint_jacobian
    return LinearisedValues(ahead.objective - J @ step, ahead.constraints - K @ step, J, K)


def _trust_region_step(
    linear: LinearisedValues, y: Array, bounds: tuple[Array, Array], trust: float, is_spread: bool
) -> tuple[Array, float]:
    """Return the step (dim,) within the trust region, and its predicted price."""
    dim = y.size
    g, J = _reachable_rows(linear.objective, linear.objective_jacobian, trust, is_spread)
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
    selected = np.concatenate(
        [_initial_rows(part[:, :dim], limit, low, high) for part, limit in zip(A, b, strict=True)]
    )
    ranges = [*zip(low, high, strict=True), (None, None), (None, None), (0, None)]
    x = _solve_linear_programme(
        np.r_[np.zeros(dim), 1.0, 0.0, VIOLATION_PENALTY],
        np.vstack(A),
        np.concatenate(b),
        ranges,
        selected,
    )
    if x is None:
        return np.zeros(dim), np.inf
    return np.clip(x[:dim], low, high), float(x[dim] + VIOLATION_PENALTY * x[-1])


def _initial_rows(A: Array, b: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Return the rows (n, dim) that are largest at the centre of a box or of one of its sides."""
    selected = np.zeros(len(b), dtype=bool)
    if len(b):
        corners = np.vstack([np.zeros_like(low), np.diag(low), np.diag(high)])
        selected[np.argmax(A @ corners.T - b[:, None], axis=0)] = True
    return selected


def _solve_linear_programme(
    cost: Array,
    A: Array,
    b: Array,
    ranges: Sequence[tuple[float | None, float | None]],
    selected: NDArray[np.bool_],
) -> Array | None:
    """Solve a linear programme: minimum cost with A x <= b within ranges; None if infeasible.

    Among thousands of rows that sample a few smooth curves, about as many are active at the optimum
    as there are unknowns. A programme of few rows is solved, and the most violated rows, one peak
    per curve, are added until the solution is feasible.
    """
    from scipy.optimize import linprog

    used = selected.copy() if len(b) > MAX_UNSELECTED_ROWS else np.ones(len(b), dtype=bool)
    while True:
        solution = linprog(cost, A[used], b[used], bounds=ranges, method="highs")
        if solution.x is None:
            return None
        excess = np.pad(A @ solution.x - b, 1, constant_values=-np.inf)
        peaks = (
            (excess[1:-1] >= excess[:-2])
            & (excess[1:-1] >= excess[2:])
            & (excess[1:-1] > FEASIBILITY_TOLERANCE)
            & ~used
        )
        if not peaks.any():
            optimum: Array = solution.x
            return optimum
        used |= peaks


def _reachable_rows(g: Array, J: Array, trust: float, is_spread: bool) -> tuple[Array, Array]:
    """Return the rows that can become the largest within the trust region."""
    reach = trust * np.abs(J).sum(axis=1)
    keep = g + reach >= (g - reach).max()
    if is_spread:
        keep |= g - reach <= (g + reach).min()
    return g[keep], J[keep]
