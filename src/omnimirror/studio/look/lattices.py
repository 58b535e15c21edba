"""Functions on a square lattice that few exact values are enough for, and that go on beyond where they end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Exact = Callable[[Array], Array]
"""Values (n, m) at places (n, 2); NaN in all of them where there are none."""

STEP = 4  # nodes from one exact value to the next
TAPS = 6  # exact values that are interpolated between, in each direction
NODES, COLUMNS = 64, 128  # of a product
OFF_MIDDLE = np.array([2, 1]) / STEP  # of a cell: where two errors cancel, in the next cell they do not
AROUND = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]
AHEAD = (4, -6, 4, -1)  # of the nodes in a line, the next one of which a cubic through them comes to
BEYOND = 4  # nodes past the end, so that cubic interpolation reaches it


def lattice_of(exact: Exact, side: Array) -> Array:
    """Values (n, n, m) at ``(side[column], side[row])``, each right to the rounding of float32.

    Every fourth node is exact, and Lagrange's polynomials of six of them lie between: where all of these are known, and
    where a further exact value in the cell or in those about it agrees. All others are exact too.

    Parameters
    ----------
    exact
        What is wanted. Cells of STEP nodes are looked into where it is known next to them.
    side : (n,)
        Evenly spaced; n - 1 is a multiple of STEP.

    Examples
    --------
    >>> asked = []
    >>> def waves(at):
    ...     asked.append(len(at))
    ...     return np.where(np.hypot(*at.T) < 1, np.sin(at.sum(axis=1)), np.nan)[:, None]
    >>> found = lattice_of(waves, np.linspace(-1.1, 1.1, 257))
    >>> found.shape, bool(abs(found[100, 130, 0] - np.sin((230 - 256) * 2.2 / 256)) < 1e-8)
    ((257, 257, 1), True)
    >>> sum(asked) < 257**2 / 3
    True
    """
    coarse = _at(exact, side[::STEP], side[::STEP])
    known: Mask = np.asarray(np.isfinite(coarse).all(axis=2))
    values, smooth = _interpolated(coarse, known, side, exact)
    reached = _windows(np.logical_or, np.pad(known, 1), 4)
    mine = _nodes_of(reached & ~smooth)
    mine[::STEP, ::STEP] = False
    values[~_nodes_of(smooth)] = np.nan
    values[::STEP, ::STEP] = coarse
    row, column = np.nonzero(mine)
    values[row, column] = exact(np.stack([side[column], side[row]], axis=-1))
    return values


def _interpolated(coarse: Array, known: Mask, side: Array, exact: Exact) -> tuple[Array, Mask]:
    """Values (n, n, m) between exact ones, and the cells (k, k) in which they hold."""
    cells = len(coarse) - 1
    filled = np.where(known[..., None], coarse, 0.0)
    values = _between(_between(filled).transpose(1, 0, 2)).transpose(1, 0, 2)
    first = np.clip(np.arange(cells) - TAPS // 2 + 1, 0, cells + 1 - TAPS)
    smooth: Mask = _windows(np.logical_and, known, TAPS)[np.ix_(first, first)]

    row, column = np.nonzero(smooth)
    swapped = (row + column) % 2 == 1
    right, down = (np.where(swapped, a, b) for a, b in (OFF_MIDDLE, OFF_MIDDLE[::-1]))
    at_row, at_column = (STEP * (row + down)).astype(int), (STEP * (column + right)).astype(int)
    true = exact(np.stack([side[at_column], side[at_row]], axis=-1))
    rounding = np.spacing(np.nanmax(np.abs(filled), axis=(0, 1)).astype(np.float32))
    rough = np.zeros_like(smooth)
    rough[row, column] = ~(np.abs(values[at_row, at_column] - true) <= rounding).all(axis=1)
    smooth &= ~_windows(np.logical_or, np.pad(rough, 1), 3)
    return values, smooth


def weights_between(at: Array, first: NDArray[np.intp]) -> Array:
    """How much values one apart count at places (n,) between them, by Lagrange's polynomials of TAPS of them each.

    >>> weights_between(np.array([2.5]), np.array([0])) * 256
    array([[   3.,  -25.,  150.,  150.,  -25.,    3.]])
    """
    weights = np.zeros((len(at), int(first[-1]) + TAPS))
    for k in range(TAPS):
        others = [j for j in range(TAPS) if j != k]
        weights[np.arange(len(at)), first + k] = np.prod([(at - first - j) / (k - j) for j in others], axis=0)
    return weights


def _between(exact: Array) -> Array:
    """Values (STEP k + 1, n, m) of exact ones (k + 1, n, m) along the first axis.

    By products so small that BLAS leaves them to this thread: others wait for more a tenth of a second, busily.
    """
    cells = len(exact) - 1
    at = np.arange(STEP * cells + 1) / STEP
    first = np.clip(np.floor(at).astype(int) - TAPS // 2 + 1, 0, cells + 1 - TAPS)
    flat = exact.reshape(cells + 1, -1)
    values = np.empty((len(at), flat.shape[1]))
    for begin in range(0, len(at), NODES):
        nodes = slice(begin, begin + NODES)
        low = first[begin]
        weights = weights_between(at[nodes] - low, first[nodes] - low)
        for left in range(0, flat.shape[1], COLUMNS):
            columns = slice(left, left + COLUMNS)
            np.matmul(weights, flat[low : low + weights.shape[1], columns], out=values[nodes, columns])
    return values.reshape(len(at), *exact.shape[1:])


def _at(exact: Exact, x: Array, y: Array) -> Array:
    """Values (len(y), len(x), m) over all pairs."""
    found = exact(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    return found.reshape(len(y), len(x), -1)


def _nodes_of(cells: Mask) -> Mask:
    """The nodes (n, n) in and around cells (k, k)."""
    count = STEP * len(cells) + 1
    nodes = np.zeros((count, count), np.bool_)
    wide = cells.repeat(STEP, axis=0).repeat(STEP, axis=1)
    for dx in (0, 1):
        for dy in (0, 1):
            nodes[dy : count - 1 + dy, dx : count - 1 + dx] |= wide
    return nodes


def _windows(combine: np.ufunc, values: Mask, side: int) -> Mask:
    """Every ``side`` x ``side`` values combined to one."""
    for _ in range(2):
        values = combine.reduce([values[i : len(values) - side + 1 + i] for i in range(side)]).T
    return values


def continued(values: Array) -> Array:
    """A lattice (n, n, m), filled in for some nodes around where it is known, as its third differences go on."""
    known: Mask = np.asarray(np.isfinite(values).all(axis=2))
    for _ in range(BEYOND):
        beside = _windows(np.logical_or, np.pad(known, 1), 3)
        row, column = np.nonzero(beside & ~known)
        values[row, column] = found = _next(values, row, column)
        known[row, column] = np.isfinite(found).all(axis=1)
    return values


def _next(values: Array, row: NDArray[np.intp], column: NDArray[np.intp]) -> Array:
    """Values (k, m) of nodes: those that they have, or the mean of what the lines of nodes around them come to."""
    total, told = np.zeros((len(row), values.shape[2])), np.zeros((len(row), values.shape[2]))
    last = len(values) - 1
    for dx, dy in AROUND:
        ends = row + len(AHEAD) * dy, column + len(AHEAD) * dx
        (inside,) = np.nonzero((np.minimum(*ends) >= 0) & (np.maximum(*ends) <= last))
        guess = sum(a * values[row[inside] + k * dy, column[inside] + k * dx] for k, a in enumerate(AHEAD, 1))
        is_told = np.isfinite(guess)
        total[inside] += np.where(is_told, guess, 0.0)
        told[inside] += is_told
    old = values[row, column]
    with np.errstate(invalid="ignore"):
        return np.where(np.isnan(old), total / told, old)
