"""A map of few nodes with cubic curves between them: for boards without room for one of all pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import factorized

from ....errors import InvalidParameter
from ...formats import Code

Array = NDArray[np.float64]
Spans = list[list[tuple[int, int]]]

STEPS = (8, 4)
CLOSE_PX = 0.02
FARTHEST_PX = 400  # between neighbouring nodes: what 32 bits hold, 15 of them fractions
SMOOTH = 1e-2  # of third differences between nodes, beside errors in between


@dataclass(frozen=True)
class MapLattice:
    """Nodes every few pixels of a picture, and in which pixels of each row there is anything.

    Attributes
    ----------
    nodes
        (rows, columns, k), of pixels ((column - 1) ``step``, (row - 1) ``step``): one more before the picture, and two
        after it.
    step
        Pixels between nodes, a power of two.
    spans
        Of each row of pixels, first column and number of columns of each run in which there is something.
    error
        (k,) The largest difference between what is interpolated and what is so.
    """

    nodes: Array
    step: int
    spans: Spans
    error: Array


def lattice_of(values: Array, step: int, there: NDArray[np.bool_] | None = None) -> MapLattice:
    """The lattice of values (h, w, k), NaN where there is none; those that count are ``there``.

    Nodes beyond the values' end are those with which the curves fit the values before it best.
    """
    height, width = values.shape[:2]
    nodes = np.full((_nodes(height, step), _nodes(width, step), values.shape[2]), np.nan)
    inner = values[::step, ::step]
    nodes[1 : 1 + inner.shape[0], 1 : 1 + inner.shape[1]] = inner
    nodes = _completed(nodes, values, step)
    there = np.asarray(np.isfinite(values).all(axis=-1)) if there is None else there
    off = np.abs(interpolated(nodes, step)[:height, :width] - values)[there]
    return MapLattice(nodes, step, [_runs(row) for row in there], off.max(axis=0))


def finest_lattice(values: Array, steps: Sequence[int] = STEPS) -> MapLattice:
    """The lattice with the fewest nodes that keeps places (h, w, 2) within :data:`CLOSE_PX`, or the last of ``steps``.

    Raises
    ------
    InvalidParameter
        The view shrinks the picture, or joins parts of it, so that neighbouring nodes are too far from one another.
    """
    for step in steps:
        found = lattice_of(values, step)
        apart = max(float(np.abs(np.diff(found.nodes, axis=axis)).max()) for axis in (0, 1))
        if np.hypot(*found.error) < CLOSE_PX and apart <= FARTHEST_PX:
            break
    if apart > FARTHEST_PX or np.hypot(*found.error) > 1:
        raise InvalidParameter(
            "this view has steps, or shrinks the picture too much, for a map of few nodes; valid are single views of "
            "about the picture's resolution"
        )
    return found


def spans_of(spans: Spans) -> tuple[list[int], list[int]]:
    """Where the runs of each row start in the list of all, with one more for the end; and all, two numbers each."""
    starts = np.concatenate([[0], np.cumsum([len(row) for row in spans])])
    return starts.tolist(), [number for row in spans for run in row for number in run] or [0, 0]


def listed(items: Iterable[object], in_line: int = 16) -> Code:
    """Join items by commas, in lines."""
    words = [str(item) for item in items]
    return Code(",\n    ".join(",".join(words[i : i + in_line]) for i in range(0, len(words), in_line)))


def _nodes(count: int, step: int) -> int:
    """Nodes along a side of so many pixels: one before it, and two after it."""
    return -(-count // step) + 3


def _completed(nodes: Array, values: Array, step: int) -> Array:
    """Nodes (rows, columns, k) with those that are NaN found by least squares.

    They shall fit the values between them, and otherwise go on as evenly as they can: with small third differences.
    """
    missing = np.isnan(nodes[..., 0]).ravel()
    fit, sought = _curves(nodes.shape[:2], values, step, missing)
    evenness = SMOOTH * _third_differences(nodes.shape[:2])
    evenness = evenness[evenness[:, missing].getnnz(axis=1) > 0]
    known = np.nan_to_num(nodes.reshape(len(missing), -1))
    known[missing] = 0.0
    right = [sought - fit @ known, -evenness @ known]
    left = sparse.vstack([fit, evenness])[:, missing].tocsc()
    solve = factorized((left.T @ left + 1e-12 * sparse.identity(left.shape[1])).tocsc())
    bound = left.T @ np.concatenate(right)
    known[missing] = np.stack([solve(column) for column in bound.T], axis=-1)
    return known.reshape(nodes.shape)


def _curves(shape: tuple[int, int], values: Array, step: int, missing: NDArray[np.bool_]) -> tuple[Any, Array]:
    """The weights of nodes (pixels, nodes) at pixels that have values and need a missing node, and these values."""
    windows = np.lib.stride_tricks.sliding_window_view(missing.reshape(shape), (4, 4))
    reach = np.asarray(windows.any(axis=(2, 3)))
    rows, columns = np.nonzero(np.isfinite(values[..., 0]))
    needs = reach[rows // step, columns // step]
    rows, columns = rows[needs], columns[needs]
    cells = (rows // step)[:, None, None] + np.arange(4)[:, None], (columns // step)[:, None, None] + np.arange(4)
    numbers = (cells[0] * shape[1] + cells[1]).ravel()
    shares = weights(step)[rows % step][:, :, None] * weights(step)[columns % step][:, None, :]
    places = np.repeat(np.arange(len(rows)), 16), numbers
    found = sparse.csr_matrix((shares.ravel(), places), (len(rows), len(missing)))
    return found, values[rows, columns]


def _third_differences(shape: tuple[int, int]) -> Any:
    """Of nodes along rows and along columns, (differences, nodes)."""
    ways = [sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], (max(0, n - 3), n)) for n in shape]
    even = [sparse.identity(n) for n in shape]
    return sparse.vstack([sparse.kron(ways[0], even[1]), sparse.kron(even[0], ways[1])]).tocsr()


def interpolated(nodes: Array, step: int) -> Array:
    """Values of all pixels between nodes (rows, columns, k): Catmull and Rom's cubics, down and then across."""
    for axis in (0, 1):
        at, part = np.divmod(np.arange((nodes.shape[axis] - 3) * step), step)
        shares = weights(step)[part]
        shape = [-1 if i == axis else 1 for i in range(3)]
        nodes = sum(shares[:, i].reshape(shape) * nodes.take(at + i, axis) for i in range(4))  # type: ignore[assignment]
    return nodes


def weights(step: int) -> Array:
    """Weights (step, 4) of four nodes at the pixels between the middle two; multiples of 1/1024 for steps up to 8.

    >>> weights(2)
    array([[ 0.    ,  1.    ,  0.    ,  0.    ],
           [-0.0625,  0.5625,  0.5625, -0.0625]])
    """
    t = np.arange(step) / step
    return np.stack(
        [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2], axis=-1
    ) / 2 + 0.0  # fmt: skip


def _runs(row: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First column and number of columns of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
    return [(int(first), int(last - first)) for first, last in edges.reshape(-1, 2)]
