"""A merit of a design space as rows for the optimiser: at a point, with exact derivatives, under constraints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from .freeform import Basis
from .merits import Merit, merit_named
from .minimax import Rows, Values
from .optics import DEGREE
from .problem import STEP, DesignSpace, State

Array = NDArray[np.float64]

LEAST_TURNING = 0.05  # dOmega/du, radians: a mapping that turns less counts as folded
LEAST_FACING = 0.05  # w - x z' over M: a surface that faces the lens less counts as hidden


@dataclass(frozen=True)
class Objective:
    """One merit over some fractions u of the rim radius, the last of them 1.

    Attributes
    ----------
    limits
        Other merits by name, and the numbers that they may not exceed.
    """

    space: DesignSpace
    merit: Merit
    u: Array
    limits: Mapping[str, float]

    def values(self, y: Array) -> Values:
        """Rows and constraints at a point (dim,)."""
        rows, constraints = self._parts(self.space.state(y[None], self.u, self._basis))
        return Values(rows[0], constraints[0])

    def rows(self, y: Array) -> Rows:
        """Rows and constraints at a point (dim,), with their derivatives."""
        g, c = self._parts(self.space.derivatives(y, self.u, self._basis))
        return Rows(g[0].real, c[0].real, g.imag.T / STEP, c.imag.T / STEP)

    def shown(self, value: float) -> float:
        """The merit in its unit, from the largest row."""
        return float(self.merit.shown(np.asarray(value * self._scale)))

    @property
    def is_about_sharpness(self) -> bool:
        """Whether the focus matters, to the merit or to a limit."""
        return self.merit.is_sharpness or any(merit_named(name).is_sharpness for name in self.limits)

    @cached_property
    def _basis(self) -> Basis:
        return self.space.basis(self.u)

    @cached_property
    def _scale(self) -> float:
        """Rows of lengths come in units of the rim radius, so that a violated constraint costs more than it gains."""
        return self.space.problem.rim_radius_mm if self.merit.unit == "mm" else 1.0

    def _parts(self, state: State) -> tuple[Array, Array]:
        with np.errstate(all="ignore"):
            counts = state.omega[0].real >= self.space.problem.omega_min_deg * DEGREE - 1e-12
            if self.merit.is_mean:
                area, weights = np.exp(state.field.log_area[:, counts]), state.field.solid_angle[:, counts]
                rows = (area * weights).sum(axis=1, keepdims=True) / weights.sum(axis=1, keepdims=True)
            else:
                rows = _counting(self.merit, state, counts) / self._scale
            return rows, self._constraints(state, counts)

    def _constraints(self, state: State, counts: NDArray[np.bool_]) -> Array:
        p = self.space.problem
        parts = [LEAST_TURNING - state.turning, LEAST_FACING - state.facing]
        if np.isfinite(p.sag_max_mm):
            parts.append(state.sag / p.sag_max_mm - 1)
        if np.isfinite(p.length_max_mm):
            parts.append(state.field.length / p.length_max_mm - 1)
        for name, limit in self.limits.items():
            merit = merit_named(name)
            most = merit.hidden(np.asarray(limit, dtype=float))
            rows = _counting(merit, state, counts)
            if merit.is_spread:
                lowest = rows[0].real.argmin()
                rows, most = rows - rows[:, lowest : lowest + 1], 2 * most
            parts.append((rows - most) / max(abs(float(most)), 1e-3 if merit.unit else 1.0))
        return np.concatenate([np.broadcast_to(p, (len(state.omega), p.shape[1])) for p in parts], axis=1)


def check_limits(limits: Mapping[str, float]) -> None:
    """Refuse limits that no design can be held to, InvalidParameter."""
    for name, limit in limits.items():
        merit = merit_named(name)
        if merit.is_mean:
            raise InvalidParameter(f"{name} cannot be limited, only minimised")
        with np.errstate(all="ignore"):
            reachable = limit > 0 and np.isfinite(merit.hidden(np.asarray(limit))) and (merit.unit or limit > 1)
        if not reachable:
            raise InvalidParameter(f"{name} = {limit:g} is no limit; it is valid above {0 if merit.unit else 1}")


def _counting(merit: Merit, state: State, counts: NDArray[np.bool_]) -> Array:
    """All rows of a merit beside each other (b, r), as many wherever the field that counts begins."""
    rows = [np.broadcast_to(r, (len(state.omega), r.shape[1])) for r in merit.rows(state.field)]
    which = np.maximum(np.arange(counts.size), counts.argmax())  # those inside repeat the first one that counts
    return np.concatenate([r[:, which] if r.shape[1] == counts.size else r for r in rows], axis=1)
