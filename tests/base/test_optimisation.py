"""Sequential linear programming on minimax problems with known solutions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from scipy.optimize import linprog

from omnimirror.base.optimisation import (
    VIOLATION_PENALTY,
    LinearisedValues,
    ObjectiveValues,
    _trust_region_step,
    minimise_mean,
    solve_minimax,
)


def bounds(dim):
    return np.full(dim, -1e3), np.full(dim, 1e3)


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_minimax_polynomial_is_chebyshev(degree):
    """x^n minus lower powers has the minimum deviation 2^(1-n) from 0 over [-1, 1]."""
    x = np.cos(np.linspace(0, np.pi, 421))
    powers = x[:, None] ** np.arange(degree)

    def values(y):
        e = x**degree + powers @ y
        return ObjectiveValues(np.concatenate([e, -e]), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(*values(y), np.vstack([powers, -powers]), np.zeros((1, degree)))

    found = solve_minimax(values, rows, np.zeros(degree), bounds(degree))
    assert found.value == pytest.approx(2.0 ** (1 - degree), rel=1e-4)


def test_minimax_textbook_problem():
    """First problem of Charalambous and Bandler: the minimax value is 1.9522245."""

    def values(y):
        a, b = y
        return ObjectiveValues(
            np.array([a**2 + b**4, (2 - a) ** 2 + (2 - b) ** 2, 2 * np.exp(b - a)]),
            np.full(1, -1.0),
        )

    def rows(y):
        a, b = y
        e = 2 * np.exp(b - a)
        J = np.array([[2 * a, 4 * b**3], [-2 * (2 - a), -2 * (2 - b)], [-e, e]])
        return LinearisedValues(*values(y), J, np.zeros((1, 2)))

    found = solve_minimax(values, rows, np.array([1.0, -0.1]), bounds(2))
    assert found.value == pytest.approx(1.9522245, abs=1e-6)
    assert list(found.history) == sorted(found.history, reverse=True)


def test_spread_has_free_level():
    """Points sin and cos + level: the spread of a - y x is minimal for the slope of the secant."""
    x = np.linspace(0, 1, 201)
    found = solve_minimax(
        lambda y: ObjectiveValues(np.exp(x) - y[0] * x, np.full(1, -1.0)),
        lambda y: LinearisedValues(
            np.exp(x) - y[0] * x, np.full(1, -1.0), -x[:, None], np.zeros((1, 1))
        ),
        np.zeros(1),
        bounds(1),
        is_spread=True,
    )
    slope = np.e - 1
    level = np.log(slope)
    assert found.y[0] == pytest.approx(slope, abs=1e-4)
    assert found.value == pytest.approx((1 - (slope - slope * level)) / 2, abs=1e-5)


@pytest.mark.parametrize("method", [solve_minimax, minimise_mean])
def test_constraints_hold_from_infeasible_start(method):
    """The nearest point to (3, 0) of the disk of radius 1."""

    def values(y):
        return ObjectiveValues(np.array([(y[0] - 3) ** 2 + y[1] ** 2]), np.array([y @ y - 1]))

    def rows(y):
        return LinearisedValues(*values(y), np.array([[2 * (y[0] - 3), 2 * y[1]]]), 2 * y[None])

    found = method(values, rows, np.array([2.0, 2.0]), bounds(2))
    np.testing.assert_allclose(found.y, [1.0, 0.0], atol=2e-3)
    assert found.value == pytest.approx(4.0, abs=1e-4)
    assert found.violation < 1e-6


def test_mean_minimum_has_zero_derivative():
    def values(y):
        return ObjectiveValues(
            np.array([np.cosh(y[0] - 0.7) + (y[1] - y[0] ** 2) ** 2]), np.full(1, -1.0)
        )

    def rows(y):
        r = y[1] - y[0] ** 2
        return LinearisedValues(
            *values(y), np.array([[np.sinh(y[0] - 0.7) - 4 * y[0] * r, 2 * r]]), np.zeros((1, 2))
        )

    found = minimise_mean(values, rows, np.array([2.0, -1.0]), bounds(2))
    np.testing.assert_allclose(found.y, [0.7, 0.49], atol=1e-4)


@pytest.mark.parametrize("is_spread", [False, True])
def test_row_selection_satisfies_all_rows(is_spread, monkeypatch):
    """Compared with the programme of all rows, written independently; the solver receives at most
    2.5 % of them."""
    x, rng = np.linspace(-1, 1, 4001), np.random.default_rng(7)
    handed = []

    def counting(cost, A, *rest, **options):
        handed.append(len(A))
        return linprog(cost, A, *rest, **options)

    monkeypatch.setattr(scipy.optimize, "linprog", counting)
    for dim in (2, 5):
        J = np.cos(np.outer(x, np.arange(1, dim + 1)) * 2 + rng.normal(size=dim))
        K = np.sin(np.outer(x, np.arange(1, dim + 1)) * 3 + rng.normal(size=dim))
        g, c = np.exp(x) * np.sin(7 * x), np.cos(5 * x) - 0.9
        linear, trust = LinearisedValues(g, c, J, K), 0.6
        handed.clear()
        step, foretold = _trust_region_step(linear, np.zeros(dim), bounds(dim), trust, is_spread)
        assert max(handed) <= len(x) / 40
        least, largest, broken = (
            np.tile(unknown, (len(x), 1)) for unknown in np.eye(3)
        )  # inactive next to the step
        A = np.vstack([np.hstack([J, -largest]), np.hstack([-J, least]), np.hstack([K, -broken])])
        keep = np.ones(3 * len(x), dtype=bool)
        keep[len(x) : 2 * len(x)] = is_spread
        cost = [*np.zeros(dim), *((-0.5, 0.5) if is_spread else (0.0, 1.0)), VIOLATION_PENALTY]
        ranges = [*[(-trust, trust)] * dim, (None, None), (None, None), (0, None)]
        whole = linprog(cost, A[keep], np.concatenate([-g, g, -c])[keep], bounds=ranges)
        assert foretold == pytest.approx(whole.fun, rel=1e-7)
        np.testing.assert_allclose(step, whole.x[:dim], atol=1e-6)


@pytest.mark.parametrize("max_steps", [0, 1, 2, 200])
def test_linear_functions_need_one_evaluation_per_step(max_steps):
    """|y - 3| from 0: the step doubles from 0.1 to at most 1, each has the predicted gain, and none
    is repeated."""
    evaluated, told = [], []

    def values(y):
        evaluated.append(float(y[0]))
        return ObjectiveValues(np.array([y[0] - 3, 3 - y[0]]), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(
            np.array([y[0] - 3, 3 - y[0]]),
            np.full(1, -1.0),
            np.array([[1.0], [-1.0]]),
            np.zeros((1, 1)),
        )

    found = solve_minimax(
        values, rows, np.zeros(1), bounds(1), max_steps=max_steps, on_step=told.append
    )
    path = np.minimum(np.cumsum([0.0, 0.1, 0.2, 0.4, 0.8, 1.0, 1.0]), 3.0)[: max_steps + 1]
    np.testing.assert_allclose(evaluated, path, atol=1e-9)
    np.testing.assert_allclose(found.history, 3 - path, atol=1e-9)
    assert told == list(found.history[1:])
    assert found.violation == 0.0


def test_steps_to_non_finite_values_are_rejected():
    """-log y decreases up to y = 2, where it is undefined: the trust region shrinks until the step
    ends before."""

    def values(y):
        return ObjectiveValues(-np.log(y) if y[0] < 2 else np.full(1, np.nan), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(*values(y), -1 / y[:, None], np.zeros((1, 1)))

    found = solve_minimax(values, rows, np.ones(1), bounds(1))
    assert 2 - 1e-6 < found.y[0] < 2
    assert found.value == pytest.approx(-np.log(2), abs=1e-6)
