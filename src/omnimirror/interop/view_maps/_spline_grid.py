"""Coarse node grids with cubic interpolation, for shaders and devices without memory for full maps.

The interpolation is separable and uses Catmull-Rom cubics. Nodes outside the data are chosen by
least squares so that the curves fit the data up to its border.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import factorized

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ..export_formats import SourceCode

Runs = list[list[tuple[int, int]]]
"""First column and length of each run of valid pixels, by rows."""

STEPS = (8, 4)
MAX_ERROR_PX = 0.02
"""Interpolation error that :func:`finest_grid` accepts before it tries the next step."""
MAX_DISCONTINUITY_PX = 1
MAX_NODE_DISTANCE_PX = 400
"""Difference of neighbouring nodes that 32-bit numbers with 15 fractional bits represent."""
SMOOTHNESS_WEIGHT = 1e-2
"""Weight of third differences between nodes relative to interpolation errors."""


@dataclass(frozen=True)
class SplineGrid:
    """Nodes of a cubic interpolation and the valid pixels of an image.

    Attributes
    ----------
    nodes
        (rows, columns, k) values at the pixels ((column - 1) ``step``, (row - 1) ``step``): one
        node before the image and two after it.
    step
        Node spacing, px, a power of two.
    runs
        Runs of valid pixels by rows.
    error
        (k,) Maximum interpolation error at valid pixels.
    """

    nodes: Array
    step: int
    runs: Runs
    error: Array


def spline_grid(values: Array, step: int, valid: NDArray[np.bool_] | None = None) -> SplineGrid:
    """Fit a grid to values on a pixel raster.

    Parameters
    ----------
    values
        (h, w, k) values; NaN for missing pixels.
    step
        Node spacing, px.
    valid
        (h, w) pixels that count for runs and error; default: all finite ones.
    """
    height, width = values.shape[:2]
    shape = _node_count(height, step), _node_count(width, step), values.shape[2]
    nodes = np.full(shape, np.nan)
    samples = values[::step, ::step]
    nodes[1 : 1 + samples.shape[0], 1 : 1 + samples.shape[1]] = samples
    nodes = _extrapolate(nodes, values, step)
    if valid is None:
        valid = np.asarray(np.isfinite(values).all(axis=-1))
    error = np.abs(interpolate(nodes, step)[:height, :width] - values)[valid]
    return SplineGrid(nodes, step, [_runs(row) for row in valid], error.max(axis=0))


def finest_grid(values: Array, steps: Sequence[int] = STEPS) -> SplineGrid:
    """Return the coarsest grid with an error below 0.02 px, or the grid of the last step.

    Parameters
    ----------
    values
        (h, w, 2) pixel coordinates; NaN for missing pixels.
    steps
        Node spacings to try, px, from coarse to fine.

    Raises
    ------
    InvalidParameter
        If the map is discontinuous or minifies too much.
    """
    for step in steps:
        grid = spline_grid(values, step)
        distance = max(float(np.abs(np.diff(grid.nodes, axis=axis)).max()) for axis in (0, 1))
        if np.hypot(*grid.error) < MAX_ERROR_PX and distance <= MAX_NODE_DISTANCE_PX:
            break
    if distance > MAX_NODE_DISTANCE_PX or np.hypot(*grid.error) > MAX_DISCONTINUITY_PX:
        raise InvalidParameter(
            "the view must be continuous and not minify strongly for a map of few nodes; use a "
            "single view of about the resolution of the source image"
        )
    return grid


def run_table(runs: Runs) -> tuple[list[int], list[int]]:
    """Return the index of the first run of each row, plus the total, and all runs as a flat list."""
    starts = np.concatenate([[0], np.cumsum([len(row) for row in runs])])
    flat = [number for row in runs for run in row for number in run]
    return starts.tolist(), flat or [0, 0]


def join_lines(items: Iterable[object], per_line: int = 16) -> SourceCode:
    """Join items with commas, in lines of ``per_line`` items."""
    items_text = [str(item) for item in items]
    lines = (",".join(items_text[i : i + per_line]) for i in range(0, len(items_text), per_line))
    return SourceCode(",\n    ".join(lines))


def _node_count(pixels: int, step: int) -> int:
    """Return the number of nodes along a side: one before it and two after it."""
    return -(-pixels // step) + 3


def _extrapolate(nodes: Array, values: Array, step: int) -> Array:
    """Replace NaN nodes (rows, columns, k) by least squares.

    Minimise |fit x - values|^2 + w^2 |third differences of x|^2 over the missing nodes x: the
    curves fit the data between nodes and continue smoothly elsewhere.
    """
    missing = np.isnan(nodes[..., 0]).ravel()
    fit, targets = _interpolation_matrix(nodes.shape[:2], values, step, missing)
    smoothness = SMOOTHNESS_WEIGHT * _third_differences(nodes.shape[:2])
    smoothness = smoothness[smoothness[:, missing].getnnz(axis=1) > 0]
    node_values = np.nan_to_num(nodes.reshape(len(missing), -1))
    node_values[missing] = 0.0
    right = np.concatenate([targets - fit @ node_values, -smoothness @ node_values])
    matrix = sparse.vstack([fit, smoothness])[:, missing].tocsc()
    normal = matrix.T @ matrix + 1e-12 * sparse.identity(matrix.shape[1])
    solve = factorized(normal.tocsc())
    node_values[missing] = np.stack([solve(column) for column in (matrix.T @ right).T], axis=-1)
    return node_values.reshape(nodes.shape)


def _interpolation_matrix(
    shape: tuple[int, int], values: Array, step: int, missing: NDArray[np.bool_]
) -> tuple[Any, Array]:
    """Return node weights (pixels, nodes) and values of valid pixels next to missing nodes."""
    windows = np.lib.stride_tricks.sliding_window_view(missing.reshape(shape), (4, 4))
    affected = np.asarray(windows.any(axis=(2, 3)))
    rows, columns = np.nonzero(np.isfinite(values[..., 0]))
    relevant = affected[rows // step, columns // step]
    rows, columns = rows[relevant], columns[relevant]
    node_rows = (rows // step)[:, None, None] + np.arange(4)[:, None]
    node_columns = (columns // step)[:, None, None] + np.arange(4)
    numbers = (node_rows * shape[1] + node_columns).ravel()
    table = catmull_rom_weights(step)
    contributions = table[rows % step][:, :, None] * table[columns % step][:, None, :]
    indices = np.repeat(np.arange(len(rows)), 16), numbers
    matrix = sparse.csr_matrix((contributions.ravel(), indices), (len(rows), len(missing)))
    return matrix, values[rows, columns]


def _third_differences(shape: tuple[int, int]) -> Any:
    """Return third differences along rows and columns as a matrix (differences, nodes)."""
    along = [sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], (max(0, n - 3), n)) for n in shape]
    same = [sparse.identity(n) for n in shape]
    vertical, horizontal = sparse.kron(along[0], same[1]), sparse.kron(same[0], along[1])
    return sparse.vstack([vertical, horizontal]).tocsr()


def interpolate(nodes: Array, step: int) -> Array:
    """Interpolate nodes (rows, columns, k) at all pixels, first vertically, then horizontally."""
    for axis in (0, 1):
        cell, offset = np.divmod(np.arange((nodes.shape[axis] - 3) * step), step)
        contributions = catmull_rom_weights(step)[offset]
        shape = [-1 if i == axis else 1 for i in range(3)]
        terms = [contributions[:, i].reshape(shape) * nodes.take(cell + i, axis) for i in range(4)]
        nodes = terms[0] + terms[1] + terms[2] + terms[3]
    return nodes


def catmull_rom_weights(step: int) -> Array:
    """Return the weights (step, 4) of four nodes at the pixels between the middle two.

    They are multiples of 1/1024 for steps up to 8.

    >>> catmull_rom_weights(2)
    array([[ 0.    ,  1.    ,  0.    ,  0.    ],
           [-0.0625,  0.5625,  0.5625, -0.0625]])
    """
    t = np.arange(step) / step
    weights = [
        -t + 2 * t**2 - t**3,
        2 - 5 * t**2 + 3 * t**3,
        t + 4 * t**2 - 3 * t**3,
        t**3 - t**2,
    ]
    return np.stack(weights, axis=-1) / 2 + 0.0  # + 0.0 turns -0.0 into 0.0


def _runs(row: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first column and length of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
    return [(int(first), int(last - first)) for first, last in edges.reshape(-1, 2)]
