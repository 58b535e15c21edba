"""Reflection points by compiled kernels: of tensors that a processor holds, where the package was compiled.

They search as :mod:`omnimirror.interop.torch.reflection` does, by the same tables, in double precision whatever the
tensors are. What they find carries no gradient; the step that records one is taken there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...native import backend
from ...tracing.reflection import MirrorTables
from ...tracing.reflection.beginning import NOT_SETTLED, SEEN, SETTLED, Search
from .library import Tensor, torch

Array = NDArray[np.float64]


def serves(like: Tensor) -> bool:
    """Whether kernels take such tensors.

    >>> serves(torch.zeros(3)) == backend.is_compiled
    True
    """
    return backend.is_compiled and like.device.type == "cpu"


class SeenPoints(NamedTuple):
    """Where targets are seen."""

    points: tuple[Tensor, Tensor, Tensor]
    slopes: tuple[Tensor, Tensor]
    inverse: tuple[Tensor, Tensor, Tensor]
    """(xx, xy, yy) of the inverse of the way's second derivatives."""
    valid: Tensor
    is_open: Tensor
    """Not settled: whether there is a reflection has to be found out otherwise."""


def reflections(
    tables: MirrorTables,
    search: Search,
    pupil: tuple[Tensor, ...],
    telecentric: bool,
    target: tuple[Tensor, ...],
    distant: bool,
) -> SeenPoints:
    """Where the lens sees targets, components (n,) in the mirror's frame: points, or unit vectors if distant."""
    asked = _columns(target)
    rows, states = np.empty((8, asked.shape[1])), np.empty(asked.shape[1], np.uint8)
    x, y, z = (_number(part) for part in pupil)
    surface, until = tables.surface((x, y, z), telecentric), search.until(SETTLED, float(np.hypot(x, y)) / abs(z))
    backend.kernels.find_reflections(
        surface, until, tables.by_omega, tables.omegas, tables.middle_mm, distant, asked, rows, states
    )
    x, y, z, sx, sy, a, b, c = _tensors(rows, target[0])
    state = torch.from_numpy(states)
    return SeenPoints((x, y, z), (sx, sy), (a, b, c), state == SEEN, state == NOT_SETTLED)


class Meetings(NamedTuple):
    """Where rays meet the mirror."""

    points: tuple[Tensor, Tensor, Tensor]
    slopes: tuple[Tensor, Tensor]
    valid: Tensor


def meetings(
    tables: MirrorTables, search: Search, pupil: tuple[Tensor, ...], way: tuple[Tensor, ...], close: float
) -> Meetings:
    """Where rays from the pupil meet the mirror, components (n,) of their ways in its frame."""
    assert tables.depth is not None  # of a telecentric lens rays do not come from a pupil
    asked = _columns(way)
    rows, states = np.empty((6, asked.shape[1])), np.empty(asked.shape[1], np.uint8)
    surface = tables.surface(tuple(_number(part) for part in pupil), False)
    backend.kernels.meet_mirror(surface, search.until(close), tables.depth, tables.most_tangent, asked, rows, states)
    x, y, z, sx, sy, _ = _tensors(rows, way[0])
    return Meetings((x, y, z), (sx, sy), torch.from_numpy(states) == SEEN)


def _number(part: Tensor) -> float:
    return float(part.detach() if hasattr(part, "detach") else part)


def _columns(parts: tuple[Tensor, ...]) -> Array:
    """Components, of which some may be numbers that all share, as an array (3, n)."""
    columns = np.empty((3, len(parts[0])))
    for column, part in zip(columns, parts, strict=True):
        column[:] = part.detach().numpy() if isinstance(part, torch.Tensor) else part
    return columns


def _tensors(rows: Array, like: Tensor) -> tuple[Tensor, ...]:
    """Rows as tensors of the same type."""
    return tuple(torch.from_numpy(rows).to(like.dtype).unbind(0))
