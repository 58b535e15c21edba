"""Objectives and constraints of the optimiser, as rows with exact derivatives in a design space.

The objective is a merit, or the slack of requirements: relative violations of limits and relative
changes of given numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.numerics.lazy import cached_property
from ...base.numerics.minimax import ObjectiveValues, Rows
from ...optics.batch.bases import Basis
from ..criteria.merits import FieldValues, Merit
from ..criteria.ranges import ends
from .variables import DesignSpace, State

Array = NDArray[Any]

STEP = 1e-30  # imaginary step; without cancellation it may be arbitrarily small
LEAST_DOMEGA_DU = 0.05  # dOmega/du, radians; smaller values count as a folded mapping
LEAST_COS_INCIDENCE = 0.01  # cosine of the angle of incidence; smaller values count as edge-on
TIGHT = 1e-4  # relative tightening at the nodes, which keeps limits met between them
IMAGE, CLEAR = "image_radius_px", "omega_min_deg"  # constraints other than limits
Key = int | str


@dataclass(frozen=True)
class Slack:
    """Requirements that may be relaxed (elastic constraints) by a minimal relative amount.

    Attributes
    ----------
    keys
        Limits by index, :data:`IMAGE`, :data:`CLEAR`. All others are constraints.
    numbers
        Free numbers with their requested values and the sign of the permitted change.
    margin
        Relative tightening of all other requirements, which keeps them met between the evaluated
        angles.
    """

    keys: tuple[Key, ...]
    numbers: tuple[tuple[str, float, int], ...] = ()
    margin: float = 0.0


@dataclass(frozen=True)
class Objective:
    """Merit, or slack of requirements, over fractions u of the rim radius, the last of them 1."""

    space: DesignSpace
    goal: Merit | Slack
    u: Array

    def values(self, y: Array) -> ObjectiveValues:
        """Return rows and constraints at a point (dim,)."""
        rows, constraints = self._parts(y[None], self.space.state(y[None], self.u, self._basis))
        return ObjectiveValues(rows[0], constraints[0])

    def rows(self, y: Array) -> Rows:
        """Return rows and constraints at a point (dim,) with complex-step derivatives."""
        stepped = y + 1j * STEP * np.eye(self.space.dim)
        g, c = self._parts(stepped, self.space.state(stepped, self.u, self._basis))
        return Rows(g[0].real, c[0].real, g.imag.T / STEP, c.imag.T / STEP)

    def shown(self, value: float) -> float:
        """Return the merit in its unit, or the largest relative violation, from the largest row."""
        if isinstance(self.goal, Slack):
            return value
        return float(self.goal.shown(np.asarray(value * self._scale)))

    @property
    def is_spread(self) -> bool:
        return isinstance(self.goal, Merit) and self.goal.is_spread

    @property
    def is_mean(self) -> bool:
        return isinstance(self.goal, Merit) and self.goal.is_mean

    @property
    def is_about_sharpness(self) -> bool:
        """Return whether the goal or a limit depends on the focus."""
        own = isinstance(self.goal, Merit) and self.goal.is_sharpness
        return own or any(limit.of.is_sharpness for limit in self.space.problem.limits)

    @property
    def asked(self) -> tuple[Key, ...]:
        """Return the keys of all limits, image size and view past the camera."""
        problem = self.space.problem
        keys: list[Key] = [*range(len(problem.limits))]
        keys += [IMAGE] if problem.has_image_to_fit else []
        keys += [CLEAR] if problem.has_view_to_clear else []
        return tuple(keys)

    def missed(self, y: Array) -> dict[Key, float]:
        """Return relative violations at a point (dim,); negative if a requirement is met."""
        state = self.space.state(y[None], self.u, self._basis)
        return {key: float(rows.max()) for key, rows in self._requirements(state)}

    @cached_property
    def _basis(self) -> Basis:
        return self.space.basis(self.u)

    @cached_property
    def _scale(self) -> float:
        """Return the scale of the rows, the rim radius for lengths."""
        is_length = isinstance(self.goal, Merit) and self.goal.quantity.unit == "mm"
        return ends(self.space.problem.rim_radius_mm)[1] if is_length else 1.0

    def _parts(self, y: Array, state: State) -> tuple[Array, Array]:
        with np.errstate(all="ignore"):
            required = dict(self._requirements(state))
            constraints = [LEAST_DOMEGA_DU - state.domega_du, LEAST_COS_INCIDENCE - state.cos_incidence]
            given, margin = tuple[Key, ...](), TIGHT
            if isinstance(self.goal, Slack):
                given, margin = self.goal.keys, TIGHT + self.goal.margin
                rows = [required[key] for key in given] + [self._moved(y, *n) for n in self.goal.numbers]
                objective = _beside(rows, len(y))
            else:
                objective = self._merit(self.goal, state)
            constraints += [margin + part for key, part in required.items() if key not in given]
            return objective, _beside(constraints, len(y))

    def _moved(self, y: Array, name: str, asked: float, sign: int) -> Array:
        """Return the relative change of a free number."""
        value = np.exp(y[:, self.space.names.index(name), None])
        moved: Array = sign * (value / asked - 1)
        return moved

    def _merit(self, merit: Merit, state: State) -> Array:
        field = state.field.at(self._counting(state)())
        if merit.is_mean:
            area, weights = np.exp(field.log_area), field.solid_angle
            mean: Array = (area * weights).sum(axis=1, keepdims=True) / weights.sum(axis=1, keepdims=True)
            return mean
        return _beside([*merit.rows(field)], len(state.omega)) / self._scale

    def _requirements(self, state: State) -> Iterator[tuple[Key, Array]]:
        return requirements_of(self.space, state.field, self._counting(state), state.omega, state.hidden, state.image)

    def _counting(self, state: State) -> Counting:
        """Return the counted columns of the first design, to which all derivatives refer."""
        return partial(self.space.counting, state.omega[:1].real, state.hidden[:1].real)


Counting = Callable[..., NDArray[np.intp]]
"""Function that returns the counted columns between two field angles in degrees."""


def requirements_of(
    space: DesignSpace, field: FieldValues, counting: Counting, omega: Array, hidden: Array, image: Array
) -> Iterator[tuple[Key, Array]]:
    """Yield the relative violations of each requirement as rows (b, r)."""
    problem = space.problem
    if problem.has_image_to_fit:
        yield IMAGE, image - 1
    if problem.has_view_to_clear:
        yield CLEAR, space.hidden_from(omega, hidden)
    for i, limit in enumerate(problem.limits):
        yield i, limit.excess(field.at(counting(*(limit.omega_deg or ()))), len(problem.distances_mm))


def _beside(rows: list[Array], count: int) -> Array:
    """Concatenate rows of shapes (count or 1, r)."""
    return np.concatenate([np.broadcast_to(r, (count, r.shape[1])) for r in rows], axis=1)
