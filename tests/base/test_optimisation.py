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
    _minimise_bracket,
    _penalised,
    _trust_region_step,
    minimise_brackets,
    minimise_mean,
    minimise_scalar,
    minimise_with_derivative,
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

    result = solve_minimax(values, rows, np.zeros(degree), bounds(degree))
    assert result.value == pytest.approx(2.0 ** (1 - degree), rel=1e-4)


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

    result = solve_minimax(values, rows, np.array([1.0, -0.1]), bounds(2))
    assert result.value == pytest.approx(1.9522245, abs=1e-6)
    assert list(result.history) == sorted(result.history, reverse=True)
    assert len(result.history) <= 12


def test_as_many_active_functions_as_variables_converge_quadratically():
    """Largest of |10 (y - x^2)| and |1 - x|, after Rosenbrock, from the end of the bent valley."""

    def values(y):
        e = np.array([10 * (y[1] - y[0] ** 2), 1 - y[0]])
        return ObjectiveValues(np.concatenate([e, -e]), np.full(1, -1.0))

    def rows(y):
        J = np.array([[-20 * y[0], 10.0], [-1.0, 0.0]])
        return LinearisedValues(*values(y), np.vstack([J, -J]), np.zeros((1, 2)))

    result = solve_minimax(values, rows, np.array([-1.2, 1.0]), bounds(2))
    np.testing.assert_allclose(result.y, 1.0, atol=1e-9)
    assert result.value == pytest.approx(0.0, abs=1e-9)
    assert len(result.history) <= 9


@pytest.mark.parametrize(
    ("offset", "slope", "moves"),
    [
        (1e3, 5e-5, False),  # 0.1 gains 5e-6; less than 1e-8 of the value
        (1e3, 2e-4, True),
        (0.0, 5e-10, False),  # 5e-11; less than 1e-10
        (0.0, 2e-9, True),
    ],
)
def test_small_gains_end_the_iteration(offset, slope, moves):
    def values(y):
        return ObjectiveValues(offset + slope * np.array([y[0] - 3, 3 - y[0]]), np.zeros(0))

    def rows(y):
        return LinearisedValues(*values(y), slope * np.array([[1.0], [-1.0]]), np.zeros((0, 1)))

    result = solve_minimax(values, rows, np.zeros(1), bounds(1))
    assert (len(result.history) > 1) == moves


def test_at_most_200_steps_of_length_1_within_the_bounds():
    def values(y):
        return ObjectiveValues(np.array([-y[0]]), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(*values(y), np.array([[-1.0]]), np.zeros((1, 1)))

    result = solve_minimax(values, rows, np.zeros(1), bounds(1))
    assert result.y[0] == pytest.approx(0.1 + 0.2 + 0.4 + 0.8 + 196)
    result = solve_minimax(values, rows, np.full(1, 9.0), (np.full(1, -2.0), np.full(1, 5.5)))
    assert (result.y[0], result.value, result.history) == (5.5, -5.5, (-5.5,))
    result = solve_minimax(values, rows, np.full(1, 2.0), (np.full(1, -2.0), np.full(1, 2.15)))
    assert result.y[0] == pytest.approx(2.15, abs=1e-12)


@pytest.mark.parametrize("is_spread", [False, True])
def test_price_adds_100_times_the_violation(is_spread):
    objective = np.array([1.0, 5.0, 2.0])
    value = 2.0 if is_spread else 5.0
    for constraints, violation in (([], 0.0), ([-3.0, -1.0], 0.0), ([-3.0, 0.25, 0.125], 0.25)):
        result = _penalised(ObjectiveValues(objective, np.array(constraints)), is_spread)
        assert result == (value, violation, value + 100 * violation)
    for bad in (
        ObjectiveValues(objective, np.full(2, np.nan)),
        ObjectiveValues(objective * np.inf, np.zeros(2)),
    ):
        assert _penalised(bad, is_spread) == (np.inf,) * 3


def test_spread_has_free_level():
    """Points sin and cos + level: the spread of a - y x is minimal for the slope of the secant."""
    x = np.linspace(0, 1, 201)
    result = solve_minimax(
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
    assert result.y[0] == pytest.approx(slope, abs=1e-4)
    assert result.value == pytest.approx((1 - (slope - slope * level)) / 2, abs=1e-5)


@pytest.mark.parametrize("method", [solve_minimax, minimise_mean])
def test_constraints_hold_from_infeasible_start(method):
    """The nearest point to (3, 0) of the disc of radius 1."""

    def values(y):
        return ObjectiveValues(np.array([(y[0] - 3) ** 2 + y[1] ** 2]), np.array([y @ y - 1]))

    def rows(y):
        return LinearisedValues(*values(y), np.array([[2 * (y[0] - 3), 2 * y[1]]]), 2 * y[None])

    result = method(values, rows, np.array([2.0, 2.0]), bounds(2))
    np.testing.assert_allclose(result.y, [1.0, 0.0], atol=2e-3)
    assert result.value == pytest.approx(4.0, abs=1e-4)
    assert result.violation < 1e-6


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

    result = minimise_mean(values, rows, np.array([2.0, -1.0]), bounds(2))
    np.testing.assert_allclose(result.y, [0.7, 0.49], atol=1e-4)


@pytest.mark.parametrize("is_spread", [False, True])
def test_row_selection_satisfies_all_rows(is_spread, monkeypatch):
    """Compared with the programme of all rows, written independently; the solver receives at most
    2.5 % of them."""
    x, rng = np.linspace(-1, 1, 4001), np.random.default_rng(7)
    row_counts = []

    def counting(cost, A, *arguments, **options):
        row_counts.append(len(A))
        return linprog(cost, A, *arguments, **options)

    monkeypatch.setattr(scipy.optimize, "linprog", counting)
    for dim in (2, 5):
        J = np.cos(np.outer(x, np.arange(1, dim + 1)) * 2 + rng.normal(size=dim))
        K = np.sin(np.outer(x, np.arange(1, dim + 1)) * 3 + rng.normal(size=dim))
        g, c = np.exp(x) * np.sin(7 * x), np.cos(5 * x) - 0.9
        linear, trust = LinearisedValues(g, c, J, K), 0.6
        row_counts.clear()
        step, prediction = _trust_region_step(linear, np.zeros(dim), bounds(dim), trust, is_spread)
        assert max(row_counts) <= len(x) / 40
        smallest, largest, broken = (
            np.tile(unknown, (len(x), 1)) for unknown in np.eye(3)
        )  # inactive next to the step
        A = np.vstack(
            [np.hstack([J, -largest]), np.hstack([-J, smallest]), np.hstack([K, -broken])]
        )
        is_row = np.ones(3 * len(x), dtype=bool)
        is_row[len(x) : 2 * len(x)] = is_spread
        cost = [*np.zeros(dim), *((-0.5, 0.5) if is_spread else (0.0, 1.0)), VIOLATION_PENALTY]
        ranges = [*[(-trust, trust)] * dim, (None, None), (None, None), (0, None)]
        solution = linprog(cost, A[is_row], np.concatenate([-g, g, -c])[is_row], bounds=ranges)
        assert prediction == pytest.approx(solution.fun, rel=1e-7)
        np.testing.assert_allclose(step, solution.x[:dim], atol=1e-6)


@pytest.mark.parametrize("max_steps", [0, 1, 2, 200])
def test_linear_functions_need_one_evaluation_per_step(max_steps):
    """|y - 3| from 0: the step doubles from 0.1 to at most 1, each has the predicted gain, and none
    is repeated."""
    evaluations, steps = [], []

    def values(y):
        evaluations.append(float(y[0]))
        return ObjectiveValues(np.array([y[0] - 3, 3 - y[0]]), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(
            np.array([y[0] - 3, 3 - y[0]]),
            np.full(1, -1.0),
            np.array([[1.0], [-1.0]]),
            np.zeros((1, 1)),
        )

    result = solve_minimax(
        values, rows, np.zeros(1), bounds(1), max_steps=max_steps, on_step=steps.append
    )
    path = np.minimum(np.cumsum([0.0, 0.1, 0.2, 0.4, 0.8, 1.0, 1.0]), 3.0)[: max_steps + 1]
    np.testing.assert_allclose(evaluations, path, atol=1e-9)
    np.testing.assert_allclose(result.history, 3 - path, atol=1e-9)
    assert steps == list(result.history[1:])
    assert result.violation == 0.0


def test_steps_to_non_finite_values_are_rejected():
    """-log y decreases up to y = 2, where it is undefined: the trust region shrinks until the step
    ends before."""

    def values(y):
        return ObjectiveValues(-np.log(y) if y[0] < 2 else np.full(1, np.nan), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(*values(y), -1 / y[:, None], np.zeros((1, 1)))

    result = solve_minimax(values, rows, np.ones(1), bounds(1))
    assert 2 - 1e-6 < result.y[0] < 2
    assert 2 - result.y[0] > 1e-10  # for steps down to 1e-9
    assert len(result.history) < 30
    assert result.value == pytest.approx(-np.log(2), abs=1e-6)


@pytest.mark.parametrize("offset", [1e6, 0.0, -1e6])
def test_mean_is_minimised_next_to_non_finite_values(offset):
    """The first step, of the length of the derivative, ends where the function is undefined: of a
    value above that of the start, whatever its magnitude."""
    evaluations = []

    def values(y):
        evaluations.append(float(y[0]))
        value = offset + 10 * (y[0] - 1.9) ** 2 if y[0] < 2.5 else np.nan
        return ObjectiveValues(np.array([value]), np.full(1, -1.0))

    def rows(y):
        return LinearisedValues(*values(y), 20 * (y - 1.9)[None], np.zeros((1, 1)))

    steps = []
    result = minimise_mean(values, rows, np.zeros(1), bounds(1), on_step=steps.append)
    assert max(evaluations) > 2.5
    assert result.y[0] == pytest.approx(1.9, abs=1e-4)
    assert result.value == pytest.approx(offset, abs=1e-6)
    assert result.history[0] == offset + 10 * 1.9**2
    assert steps == list(result.history[1:])
    assert list(result.history) == sorted(result.history, reverse=True)


# -- Scalar functions -------------------------------------------------------------------------------


def test_golden_section_search_starts_from_a_scan_of_129_points():
    """Each later evaluation reduces the bracket, at first two intervals of the scan, by the golden
    ratio, down to 1e-10 of the range."""
    evaluations = []

    def function(x):
        evaluations.append(x)
        return abs(x - 0.7312) ** 1.5

    assert minimise_scalar(function, -2.0, 6.0) == pytest.approx(0.7312, abs=1e-9)
    np.testing.assert_allclose(evaluations[:129], np.linspace(-2.0, 6.0, 129), atol=1e-12)
    reductions = np.log(2 / 128 / 1e-10) / np.log((1 + np.sqrt(5)) / 2)
    assert len(evaluations) - 129 == 2 + np.ceil(reductions)
    assert np.abs(np.array(evaluations[129:]) - 0.7312).max() < 8 / 128


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("scan", [2, 3, 9])
def test_golden_section_search_reaches_the_ends(sign, scan):
    end = minimise_scalar(lambda x: sign * x, 2.0, 5.0, scan=scan)
    assert end == pytest.approx(2.0 if sign > 0 else 5.0, abs=1e-8)
    for high in (2.0, 1.0, np.nan):
        assert minimise_scalar(lambda x: pytest.fail("evaluated"), 2.0, high) == 2.0


def test_golden_section_search_ends_at_the_resolution_of_numbers():
    """Between 1e6 and the number 40 further: the bracket ends at 4 steps of rounding, about 1e-9."""
    evaluations = []
    high = 1e6 + 40 * np.spacing(1e6)
    minimise_scalar(lambda x: evaluations.append(x) or (x - 1e6) ** 2, 1e6, high, scan=3)
    assert 5 <= len(evaluations) < 20


def worst_of(*pieces):
    """Return the largest of functions given with their derivatives, as ``minimise_with_derivative``
    requires it; the number of calls is in its attribute."""

    def worst(x):
        worst.calls += 1
        values = np.stack([f(x) for f, _ in pieces])
        index = values.argmax(axis=0)
        slopes = np.stack([df(x) + 0 * x for _, df in pieces])
        pick = index[None]
        return (
            np.take_along_axis(values, pick, 0)[0],
            np.take_along_axis(slopes, pick, 0)[0],
            index,
        )

    worst.calls = 0
    return worst


WAVE = (lambda x: np.cos(3 * x) + 0.1 * x, lambda x: -3 * np.sin(3 * x) + 0.1)


@pytest.mark.parametrize(
    ("pieces", "low", "high", "expected"),
    [
        # minima of cos 3x + 0.1 x lie at sin 3x = 1/30, the first of them is the lowest
        ([WAVE], 0.0, 6.0, (np.pi - np.arcsin(1 / 30)) / 3),
        ([WAVE], 1.5, 6.0, (3 * np.pi - np.arcsin(1 / 30)) / 3),
        # the same curve from the right: its last minimum is the lowest
        (
            [(lambda x: WAVE[0](-x), lambda x: -WAVE[1](-x))],
            -6.0,
            0.0,
            -(np.pi - np.arcsin(1 / 30)) / 3,
        ),
        # a kink of 1 - x and 3 x
        ([(lambda x: 1 - x, lambda x: -1.0), (lambda x: 3 * x, lambda x: 3.0)], -2.0, 5.0, 0.25),
        # of steep and flat parts
        (
            [(lambda x: -1e-3 * (x - 1), lambda x: -1e-3), (lambda x: 1e4 * x, lambda x: 1e4)],
            -2.0,
            5.0,
            1e-3 / (1e4 + 1e-3),
        ),
        ([(lambda x: (x - 0.3) ** 4, lambda x: 4 * (x - 0.3) ** 3)], -1.0, 1.5, 0.3),
        ([(lambda x: x, lambda x: 1.0)], -2.0, 5.0, -2.0),
        ([(lambda x: -x, lambda x: -1.0)], -2.0, 5.0, 5.0),
    ],
)
def test_minimum_with_derivative(pieces, low, high, expected):
    result = minimise_with_derivative(worst_of(*pieces), low, high)
    is_flat = pieces[0][0](np.array([0.3]))[0] == 0  # (x - 0.3)^4, to its rounding
    assert result == pytest.approx(expected, abs=1e-3 if is_flat else 2e-11 * (high - low) + 1e-9)
    for empty in (low, low - 1.0, np.nan):
        assert minimise_with_derivative(lambda x: pytest.fail("evaluated"), low, empty) == low


@pytest.mark.parametrize("lower", [0, 1])
@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("steep", [0.3, 1.0, 3.0])
def test_lowest_of_several_kinks_is_returned(lower, mirror, steep):
    """Two valleys between grid points, with equal slopes or one steeper, that differ by 0.001."""
    at, slopes = mirror * np.array([-0.7217, 0.9139]), np.array([1.0, steep])
    depth = np.where(np.arange(2) == lower, 0.0, 1e-3)

    def worst(x):
        values = depth[:, None] + slopes[:, None] * np.abs(x - at[:, None])
        valley = values.argmin(axis=0)
        side = np.where(x > at[valley], 1.0, -1.0)
        return values.min(axis=0), side * slopes[valley], 2.0 * valley + (side > 0)

    result = minimise_with_derivative(worst, -2.0, 2.0)
    assert result == pytest.approx(at[lower], abs=1e-10)


def test_derivatives_are_sampled_at_65_points_and_used():
    """A parabola has its minimum at the zero of the secant; further steps close the bracket."""
    sizes, worst = [], worst_of((lambda x: (x - 0.123) ** 2, lambda x: 2 * (x - 0.123)))

    def function(x):
        sizes.append(x)
        return worst(x)

    assert minimise_with_derivative(function, -1.0, 1.0) == pytest.approx(0.123, abs=1e-11)
    np.testing.assert_allclose(sizes[0], np.linspace(-1.0, 1.0, 65), atol=1e-15)
    assert abs(sizes[1][0] - 0.123) < 1e-14
    assert {len(x) for x in sizes[1:]} == {1}
    assert len(sizes) < 30
    # two minima of equal depth: both are refined
    wave = worst_of((lambda x: np.cos(3 * x), lambda x: -3 * np.sin(3 * x)))
    result = minimise_with_derivative(wave, 0.0, 6.0)
    assert min(abs(result - np.pi / 3), abs(result - np.pi)) < 1e-9
    assert wave.calls > 10


def kinks(count, rng):
    """Return convex functions max(a (x - x1)^2 - p, s (x - x2)) with minima between 0 and 1."""
    at = rng.uniform(0.05, 0.95, count)
    left, right = 10 ** rng.uniform(-3, 3, (2, count))
    bend = rng.uniform(0.0, 5.0, count) * (np.arange(count) % 3 > 0)
    flat = np.arange(count) % 3 == 2  # one smooth function instead of a kink

    def worst(x, rows):
        d = x - at[rows]
        a = np.where(flat[rows], bend[rows] + 0.1, 0.0)
        below, above = -left[rows] * d + bend[rows] * d**2, right[rows] * d + bend[rows] * d**2
        is_above = above > below
        value = np.where(flat[rows], a * d**2, np.maximum(below, above))
        slope = np.where(
            flat[rows], 2 * a * d, np.where(is_above, right[rows], -left[rows]) + 2 * bend[rows] * d
        )
        return value, slope, np.where(flat[rows], 0, is_above).astype(float)

    return at, worst


def end_of(x, worst, count):
    return np.stack([x, *worst(x, slice(None))]).reshape(4, count)


def test_simultaneous_brackets_equal_single_brackets():
    """Kinks and smooth minima at known positions are found to 1e-11; converged rows are not
    evaluated."""
    count = 300
    at, worst = kinks(count, np.random.default_rng(5))
    low, high = at - 0.04, at + 0.03 + 1e-3 * np.arange(count) / count
    a, b = end_of(low, worst, count), end_of(high, worst, count)
    rises, falls = b[2] > 0, a[2] < 0
    assert (rises & falls).mean() > 0.9
    a, b, rows_of = a[:, rises & falls], b[:, rises & falls], np.flatnonzero(rises & falls)
    evaluations = []

    def function(x, rows):
        evaluations.append(len(x))
        assert len(x) == len(rows_of[rows])
        return worst(x, rows_of[rows])

    result = minimise_brackets(a, b, 1e-11, function)
    np.testing.assert_allclose(result, at[rows_of], rtol=0, atol=2e-11)
    assert len(evaluations) < 36
    assert evaluations[0] == len(rows_of)
    assert evaluations == sorted(evaluations, reverse=True)
    assert sum(evaluations) < 17 * len(rows_of)
    for k in range(0, len(rows_of), 10):
        steps = []

        def single(x, row=rows_of[k : k + 1], steps=steps):
            steps.append(x)
            return worst(x, row)

        minimum = _minimise_bracket(tuple(a[:, k]), tuple(b[:, k]), 1e-11, single)
        assert minimum == pytest.approx(at[rows_of[k]], abs=2e-11)
        assert len(steps) < 36


def test_brackets_with_wrong_slopes_are_bisected():
    """A function that decreases at both ends or rises at both: the midpoint decides."""
    ends = np.zeros((4, 3)), np.zeros((4, 3))
    ends[1][0] = 1.0
    ends[0][2], ends[1][2] = (-1.0, -1.0, 1.0), (1.0, -1.0, 1.0)
    ends[1][1] = 0.5
    evaluations = []

    def worst(x, rows):
        evaluations.append(x)
        return x, np.ones_like(x), np.zeros_like(x)

    minimise_brackets(*ends, 0.4, worst)
    np.testing.assert_allclose(evaluations[0], [0.5, 0.5, 0.5])
    assert (
        _minimise_bracket((0.0, 0.0, -1.0, 0.0), (1.0, 0.0, -1.0, 0.0), 0.6, lambda x: (x, x, x))
        == 0.25
    )
