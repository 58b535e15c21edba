"""Numerical methods: small matrix products, bracketed roots, least squares and orthogonal polynomials."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import comb, factorial, isfinite, isnan, sqrt
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .typing import Array

# -- Products with small matrices ------------------------------------------------------------------

MAX_MULTIPLICATIONS = 1 << 17
"""Maximum number of multiplications per product; OpenBLAS uses threads from twice as many."""


def matrix_product(rows: NDArray[Any], matrix: NDArray[Any]) -> NDArray[Any]:
    """Compute ``rows @ matrix`` for many rows (n, d) and a matrix (d, k), k at least 2, in blocks.

    OpenBLAS distributes large products over its own threads. These spin for 0.1 s after each
    product, and occasionally mix up rows of concurrent callers (0.3.31, some rows in one of 40
    calls with three threads).

    >>> matrix_product(np.ones((3, 2)), np.array([[1.0, 2.0], [3.0, 4.0]]))
    array([[4., 6.],
           [4., 6.],
           [4., 6.]])
    """
    result = np.empty((len(rows), matrix.shape[1]), np.result_type(rows, matrix))
    count = max(1, MAX_MULTIPLICATIONS // matrix.size)
    for first in range(0, len(rows), count):
        piece = slice(first, first + count)
        np.matmul(rows[piece], matrix, out=result[piece])
    return result


# -- Bracketed root finding ------------------------------------------------------------------------
# Bracketing converges also for functions that are NaN in places or discontinuous.

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


def increasing_inverse(
    function: Callable[[Array], tuple[Array, Array]], values: Array, nodes: Array, at_nodes: Array
) -> Array:
    """Invert an increasing function with a table of it; values beyond the table give its ends.

    Parameters
    ----------
    function
        Maps x (n,) to f (n,) and df/dx (n,).
    values : (n,)
        Values of f.
    nodes, at_nodes : (k,)
        Table of x and f, from which brackets and initial values are taken.

    Examples
    --------
    >>> x = np.linspace(0.0, 3.0, 4)
    >>> increasing_inverse(lambda x: (x**3, 3 * x**2), np.array([8.0, 99.0]), x, x**3)
    array([2., 3.])
    """
    inside = np.clip(values, at_nodes[0], at_nodes[-1])
    cell = np.clip(np.searchsorted(at_nodes, inside) - 1, 0, len(nodes) - 2)

    def difference(x: Array) -> tuple[Array, Array]:
        f, df = function(x)
        return f - inside, df

    start = np.interp(inside, at_nodes, nodes)
    return increasing_root(difference, nodes[cell], nodes[cell + 1], start, float(nodes[-1]))


def sign_change(function: Callable[[float], float], low: float, high: float, xtol: float) -> float:
    """Return the position between ``low`` and ``high`` at which a function changes its sign.

    Unlike SciPy's ``brentq`` it accepts NaN, which counts as non-negative, and SciPy is not imported
    [1]_. If rounding hides the change of sign, the end with the smaller absolute value is returned.

    .. [1] T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a
       nonlinear function without using derivatives, Adv. Eng. Softw. 28 (1997).

    >>> round(sign_change(lambda x: x * x - 2, 0.0, 2.0, 1e-12), 9)
    1.414213562
    >>> round(sign_change(lambda x: -1.0 if x < 0.3 else float("nan"), 0.0, 1.0, 1e-12), 9)
    0.3
    >>> sign_change(lambda x: 1.0 + x, 0.0, 2.0, 1e-12)
    0.0
    """
    f_low, f_high = float(function(low)), float(function(high))
    if (f_low < 0) == (f_high < 0):
        return high if abs(f_high) < abs(f_low) or isnan(f_low) else low
    # Chandrupatla: inverse quadratic interpolation through the ends a, b of the bracket and the
    # previous end c where it is monotonic, otherwise bisection, at a + t (b - a).
    a, b, f_a, f_b, t = low, high, f_low, f_high, 0.5
    while True:
        x = a + t * (b - a)
        f = float(function(x))
        if (f < 0) == (f_a < 0):
            c, f_c = a, f_a
        else:
            b, c, f_b, f_c = a, b, f_a, f_b
        a, f_a = x, f
        nearer, f_nearer = (a, f_a) if abs(f_a) < abs(f_b) or isnan(f_b) else (b, f_b)
        min_t = (xtol + BISECTION_TOLERANCE * abs(nearer)) / abs(b - a) if a != b else 1.0
        if min_t > 0.5 or f_nearer == 0:
            return nearer
        t = 0.5
        if isfinite(f_b) and isfinite(f_c) and f_c != f_b and f_c != f_a:
            xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
            if phi**2 < xi and (1 - phi) ** 2 < 1 - xi:
                t = f_a / (f_b - f_a) * f_c / (f_b - f_c)
                t += (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
        t = min(max(t, min_t), 1 - min_t)


# -- Levenberg-Marquardt minimisation --------------------------------------------------------------

INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-3, 1e-10, 1e12


class HasCost(Protocol):
    """State of a minimisation."""

    @property
    def cost(self) -> float:
        """Minimised sum."""


State = TypeVar("State", bound=HasCost)


def levenberg_marquardt(
    state: State,
    linearise: Callable[[State], Callable[[float], State | None]],
    max_steps: int,
    relative_tolerance: float,
    exact_cost: float = 0.0,
    on_step: Callable[[float], None] | None = None,
) -> State:
    """Minimise the cost of a state by damped Gauss-Newton steps.

    A successful step divides the damping by 5. Consecutive failures multiply it by 2, 4, 8, ...
    (Nielsen, "Damping parameter in Marquardt's method", 1999).

    Parameters
    ----------
    state
        Initial state.
    linearise
        Maps a state to a function from the damping to the state after a step; None for an invalid
        state.
    max_steps
        Maximum number of successful steps.
    relative_tolerance
        Relative decrease of the cost that ends the iteration.
    exact_cost
        Cost that ends the iteration.
    on_step
        Called with the cost after every successful step.

    Examples
    --------
    The minimum of Rosenbrock's function, the sum of squares of 10 (y - x^2) and 1 - x:

    >>> from typing import NamedTuple
    >>> class Point(NamedTuple):
    ...     at: Array
    ...     residuals: Array
    ...     cost: float
    >>> def point(at):
    ...     residuals = np.array([10 * (at[1] - at[0] ** 2), 1 - at[0]])
    ...     return Point(at, residuals, float(residuals @ residuals))
    >>> def linearise(here):
    ...     jacobian = np.array([[-20 * here.at[0], 10.0], [-1.0, 0.0]])
    ...     normal, gradient = jacobian.T @ jacobian, jacobian.T @ here.residuals
    ...     return lambda damping: point(here.at + damped_step(normal, gradient, damping))
    >>> levenberg_marquardt(point(np.array([-1.2, 1.0])), linearise, 50, 1e-12).at.round(9)
    array([1., 1.])
    """
    damping = INITIAL_DAMPING
    for _ in range(max_steps):
        after_step, before, growth = linearise(state), state.cost, 2.0
        while damping < MAX_DAMPING:
            trial = after_step(damping)
            if trial is not None and trial.cost <= before:
                break
            damping, growth = damping * growth, growth * 2
        else:
            break
        state, damping = trial, max(damping / 5, MIN_DAMPING)
        if on_step is not None:
            on_step(state.cost)
        if before - state.cost <= relative_tolerance * before or state.cost <= exact_cost:
            break
    return state


def damped_step(normal: Array, gradient: Array, damping: float) -> Array:
    """Return the step (n,) of dense normal equations (n, n) with damping relative to the diagonal.

    Parameters without an effect are not changed.

    >>> damped_step(np.diag([4.0, 0.0]), np.array([8.0, 0.0]), 1.0)
    array([-1., -0.])
    """
    size = np.sqrt(np.diag(normal))
    size = np.where(size > 0, size, 1.0)
    scaled = normal / np.outer(size, size) + damping * np.eye(len(size))
    step: Array = -np.linalg.solve(scaled, gradient / size) / size
    return step


# -- Zernike and Forbes polynomials ----------------------------------------------------------------


def noll(j: int) -> tuple[int, int]:
    """Return order n and signed frequency m of Noll's term j; cosine terms have m >= 0.

    >>> [noll(j) for j in (1, 2, 3, 4, 5, 6, 11)]
    [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (4, 0)]
    """
    n = int((sqrt(8 * j - 7) - 1) // 2)
    rest = j - n * (n + 1) // 2 - 1
    m = (rest + 1) // 2 * 2 if n % 2 == 0 else rest // 2 * 2 + 1
    return n, m if j % 2 == 0 or m == 0 else -m


def zernike_terms(order: int) -> int:
    """Return the number of terms up to an order.

    >>> zernike_terms(6)
    28
    """
    return (order + 1) * (order + 2) // 2


def zernike_values(x: ArrayLike, y: ArrayLike, terms: Sequence[int]) -> Array:
    """Compute the values (n, t) of Noll's terms at points (n,) of the unit disc.

    >>> zernike_values([0.0, 1.0], [0.0, 0.0], [4])[:, 0].round(4)  # sqrt(3) (2 r^2 - 1)
    array([-1.7321,  1.7321])
    """
    from scipy.special import eval_jacobi

    # R_n^m(r) = r^m P_k^(0,m)(2 r^2 - 1) with the Jacobi polynomial of degree k = (n - m) / 2, and
    # r^m cos(m phi), r^m sin(m phi) are the real and imaginary parts of z^m.
    z = np.asarray(x, dtype=float) + 1j * np.asarray(y, dtype=float)
    argument = 2 * np.abs(z) ** 2 - 1
    radial: dict[tuple[int, int], Array] = {}  # shared by sine and cosine
    around: dict[int, NDArray[np.complex128]] = {0: np.ones_like(z)}
    values = np.empty((len(z), len(terms)))
    for column, j in enumerate(terms):
        n, m = noll(j)
        k = abs(m)
        if k not in around:
            around[k] = z**k
        if (n, k) not in radial:
            radial[n, k] = sqrt((n + 1) * (2 if k else 1)) * eval_jacobi(
                (n - k) // 2, 0, k, argument
            )
        values[:, column] = radial[n, k] * (around[k].imag if m < 0 else around[k].real)
    return values


def monomial_index(i: int, j: int) -> int:
    """Return the index of ``x^i y^j`` among the powers: by order, then by increasing power of y.

    >>> [monomial_index(*ij) for ij in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
    [0, 1, 2, 3, 4, 5]
    """
    return (i + j) * (i + j + 1) // 2 + j


@lru_cache(maxsize=4)
def zernike_powers(order: int) -> Array:
    """Return the coefficients (terms, terms) of powers of x and y (columns) in Noll's terms (rows)
    up to an order.

    >>> zernike_powers(4)[3, [0, 3, 5]].round(4)  # Z4 = sqrt(3) (2 r^2 - 1)
    array([-1.7321,  3.4641,  3.4641])
    """
    terms = zernike_terms(order)
    table = np.zeros((terms, terms))
    for row in range(terms):
        n, m = noll(row + 1)
        scale = sqrt(n + 1) * (sqrt(2.0) if m else 1.0)
        # R_n^m = sum_s (-1)^s (n - s)! / (s! ((n + m)/2 - s)! ((n - m)/2 - s)!) r^(n - 2 s)
        for s in range((n - abs(m)) // 2 + 1):
            a = (-1) ** s * factorial(n - s) / factorial(s)
            a /= factorial((n + abs(m)) // 2 - s) * factorial((n - abs(m)) // 2 - s)
            _add_harmonic(table[row], scale * a, (n - abs(m)) // 2 - s, m)
    return table


def _add_harmonic(row: Array, factor: float, rings: int, m: int) -> None:
    """Add ``factor r^(2 rings) r^|m| cos(m phi)``, or the sine of a negative m."""
    for k in range(abs(m) + 1):  # (x + iy)^|m|
        imaginary = k % 2 == 1
        if imaginary != (m < 0):
            continue
        sign = (-1) ** (k // 2)
        for r in range(rings + 1):  # (x^2 + y^2)^rings
            row[monomial_index(abs(m) - k + 2 * (rings - r), k + 2 * r)] += (
                factor * sign * comb(abs(m), k) * comb(rings, r)
            )


# -- Forbes polynomials of rotationally symmetric aspheres (Opt. Express 15, 5218; 18, 13851) ------


def qbfs_values(u: ArrayLike, count: int) -> Array:
    """Compute ``u^2 (1 - u^2) Q_m(u^2)``, (n, count), at normalised radii u (n,), m from 0.

    These are the terms of an asphere relative to its best-fit sphere, along the normal of the
    sphere. The mean square slope over the angle asin(u) is the sum of the squared coefficients.

    >>> qbfs_values([0.5], 3).round(6)  # Q0 = 1, Q1 = (13 - 16 u^2)/sqrt(19)
    array([[0.1875  , 0.387139, 0.238047]])
    """
    # Recurrences of Forbes (Opt. Express 18, 13851), which make the slopes orthonormal, x = u^2:
    # P_m = (2 - 4 x) P_(m-1) - P_(m-2), Q_m = (P_m - g_(m-1) Q_(m-1) - h_(m-2) Q_(m-2)) / f_m.
    x = np.asarray(u, dtype=float) ** 2
    p, q = [2.0 + 0 * x, 6.0 - 8.0 * x], [1.0 + 0 * x, (13.0 - 16.0 * x) / np.sqrt(19.0)]
    f, g = [2.0, np.sqrt(19.0) / 2], [-0.5]
    for m in range(2, count):
        h = -m * (m - 1) / (2 * f[m - 2])
        g.append(-(1 + g[m - 2] * h) / f[m - 1])
        f.append(np.sqrt(m * (m + 1) + 3 - g[m - 1] ** 2 - h**2))
        p.append((2 - 4 * x) * p[m - 1] - p[m - 2])
        q.append((p[m] - g[m - 1] * q[m - 1] - h * q[m - 2]) / f[m])
    values: Array = (x * (1 - x))[:, None] * np.stack(q[:count], axis=1)
    return values
