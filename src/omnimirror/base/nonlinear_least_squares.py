"""Levenberg-Marquardt minimisation of sums of squares, for any structure of the normal equations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from .typing import Array

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
