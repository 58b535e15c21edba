"""Piecewise cubic tables of mirror meridians on a device, and the compiled search on the CPU."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.native import backend
from ...base.typing import Array
from ...calibration.sensor_parameters import ParameterLocation, profile_derivatives
from ...optics.mirrors import Mirror
from ...optics.tracing.reflection import (
    CELLS,
    NOT_CONVERGED,
    SETTLED,
    VISIBLE,
    MirrorTables,
    Search,
    cubic_pieces,
    radii,
)
from ._library import Tensor, torch

Vector = tuple[Tensor, Tensor, Tensor]

# -- cubic tables --------------------------------------------------------------------------------


def shape_derivative_table(mirror: Mirror, parameter: ParameterLocation) -> Array:
    """Return cubic coefficients (n, 8) of the derivatives of sag and slope with respect to a
    parameter.
    """
    sag, slope, curvature = profile_derivatives(mirror, radii(mirror), (parameter,))[..., 0]
    step = mirror.rim_radius_mm / CELLS
    pieces = [cubic_pieces(sag, slope * step), cubic_pieces(slope, curvature * step)]
    return np.concatenate(pieces, axis=1)


class PiecewiseCubic:
    """One or several piecewise cubic functions of a position in cells.

    Outside the table, the first and last pieces are extrapolated.

    Parameters
    ----------
    table : (n, 4 k) array
        Coefficients of n pieces of k functions.
    dtype, device
        Type and device of the coefficients.
    """

    def __init__(self, table: Array, dtype: object, device: object) -> None:
        coefficients = torch.as_tensor(table.T.copy(), dtype=dtype, device=device)
        self.coefficients = coefficients.unbind(0)
        self.last = len(table) - 1

    def locate(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Return the cell (n,) of positions and the offset in it."""
        cell = position.detach().clamp(0, self.last).to(torch.int64)
        return cell, position - cell

    def value(self, location: tuple[Tensor, Tensor], function: int = 0) -> Tensor:
        """Return the values (n,) of a function."""
        t = location[1]
        a, b, c, d = self._coefficients(location[0], function)
        return a + t * (b + t * (c + t * d))

    def value_and_derivative(
        self, location: tuple[Tensor, Tensor], function: int = 0
    ) -> tuple[Tensor, Tensor]:
        """Return the values (n,) of a function and its derivatives per cell."""
        t = location[1]
        a, b, c, d = self._coefficients(location[0], function)
        return a + t * (b + t * (c + t * d)), b + t * (2 * c + t * (3 * d))

    def _coefficients(self, cell: Tensor, function: int) -> list[Tensor]:
        rows = self.coefficients[4 * function : 4 * function + 4]
        return [row.index_select(0, cell) for row in rows]


# -- compiled search -----------------------------------------------------------------------------
# The kernels use the same tables as the search in _reflection, in double precision for all types.
# Their results carry no gradient; the differentiable Newton step is applied in _reflection.


def has_kernels(like: Tensor) -> bool:
    """Return whether compiled kernels accept tensors on the device of a tensor.

    >>> has_kernels(torch.zeros(3)) == backend.is_compiled
    True
    """
    return backend.is_compiled and like.device.type == "cpu"


class CompiledReflections(NamedTuple):
    """Reflection points of targets."""

    points: Vector
    slopes: tuple[Tensor, Tensor]
    inverse_hessian: Vector
    """(xx, xy, yy) of the inverse second derivatives of the optical path length."""
    valid: Tensor
    is_open: Tensor
    """True if the search did not converge."""


def compiled_reflections(
    tables: MirrorTables,
    search: Search,
    pupil: tuple[Tensor, ...],
    telecentric: bool,
    target: tuple[Tensor, ...],
    distant: bool,
) -> CompiledReflections:
    """Find the reflection points of targets (n,) in the mirror frame.

    Targets are points, or unit vectors if ``distant``.
    """
    inputs = _columns(target)
    rows, states = np.empty((8, inputs.shape[1])), np.empty(inputs.shape[1], np.uint8)
    x, y, z = (_as_float(part) for part in pupil)
    surface = tables.surface((x, y, z), telecentric)
    until = search.until(SETTLED, float(np.hypot(x, y)) / abs(z))
    backend.kernels.find_reflections(
        surface,
        until,
        tables.by_omega,
        tables.omegas,
        tables.middle_mm,
        distant,
        inputs,
        rows,
        states,
    )
    x, y, z, sx, sy, a, b, c = _tensors(rows, target[0])
    state = torch.from_numpy(states)
    return CompiledReflections(
        (x, y, z), (sx, sy), (a, b, c), state == VISIBLE, state == NOT_CONVERGED
    )


class CompiledIntersections(NamedTuple):
    """Intersections of rays with the mirror."""

    points: Vector
    slopes: tuple[Tensor, Tensor]
    valid: Tensor


def compiled_intersections(
    tables: MirrorTables,
    search: Search,
    pupil: tuple[Tensor, ...],
    direction: tuple[Tensor, ...],
    tolerance: float,
) -> CompiledIntersections:
    """Intersect rays from the pupil in directions (n,) with the mirror, in the mirror frame."""
    assert tables.depth is not None  # rays of a telecentric lens do not start at a pupil
    inputs = _columns(direction)
    rows, states = np.empty((6, inputs.shape[1])), np.empty(inputs.shape[1], np.uint8)
    x, y, z = (_as_float(part) for part in pupil)
    surface, until = tables.surface((x, y, z), False), search.until(tolerance)
    backend.kernels.intersect_mirror(
        surface, until, tables.depth, tables.max_tangent, inputs, rows, states
    )
    x, y, z, sx, sy, _ = _tensors(rows, direction[0])
    return CompiledIntersections((x, y, z), (sx, sy), torch.from_numpy(states) == VISIBLE)


def _as_float(part: Tensor) -> float:
    return float(part.detach() if hasattr(part, "detach") else part)


def _columns(parts: tuple[Tensor, ...]) -> Array:
    """Return components, of which some can be constants, as an array (3, n)."""
    columns = np.empty((3, len(parts[0])))
    for column, part in zip(columns, parts, strict=True):
        column[:] = part.detach().numpy() if isinstance(part, torch.Tensor) else part
    return columns


def _tensors(rows: Array, like: Tensor) -> tuple[Tensor, ...]:
    """Return the rows of an array as tensors of the type of another."""
    return tuple(torch.from_numpy(rows).to(like.dtype).unbind(0))
