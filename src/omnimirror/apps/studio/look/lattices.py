"""Adaptive interpolation on a square lattice from few exact values, with extrapolation beyond the
boundary."""

from __future__ import annotations

from collections.abc import Callable
from math import comb

import numpy as np
from numpy.typing import NDArray

from ....base.typing import Array, Mask

Exact = Callable[[Array], Array]
"""Function that returns values (n, m) at points (n, 2); rows of NaN outside the domain."""
Index = NDArray[np.intp]
PartOf = Callable[[Array], Index]
"""Function that returns the part indices (...) of values (..., m)."""

STEP = 4  # spacing of the exact values, nodes
OFF_MIDDLE = (2, 1)  # test point of a cell, off centre, where errors of both axes can cancel
TAPS = 10  # taps of the interpolation in each direction
MARGIN = TAPS // 2 - 1  # taps before the cell
CLOSE = 0.5  # accepted error in float32 roundings at the test point; errors elsewhere in the cell remain below 1
TOGETHER = 64  # cells per matrix product
ALONG = [(1, 0), (-1, 0), (0, 1), (0, -1)]
AROUND = [*ALONG, (1, 1), (-1, -1), (1, -1), (-1, 1)]
BEYOND = 4  # extrapolated nodes beyond the boundary, for cubic interpolation


def lattice_of(exact: Exact, side: Array, part_of: PartOf | None = None) -> Array:
    """Return values (n, n, m) at ``(side[column], side[row])``, accurate to float32 rounding.

    Exact values are computed at every fourth node. Cells between them use 10-point Lagrange
    interpolation if the values exist, or can be extrapolated, and test points in the cell or its
    neighbours agree; all other nodes are computed exactly.

    Parameters
    ----------
    exact
        Exact function. It is evaluated in cells of STEP nodes next to its domain.
    side : (n,)
        Evenly spaced coordinates; n - 1 is a multiple of STEP.
    part_of
        Parts of the lattice, with discontinuities of value or derivative between them. One part by
        default.

    Examples
    --------
    >>> asked = []
    >>> def waves(at):
    ...     asked.append(len(at))
    ...     return np.where(np.hypot(*at.T) < 1, np.sin(at.sum(axis=1)), np.nan)[:, None]
    >>> found = lattice_of(waves, np.linspace(-1.1, 1.1, 257))
    >>> found.shape, bool(abs(found[100, 130, 0] - np.sin((230 - 256) * 2.2 / 256)) < 1e-8)
    ((257, 257, 1), True)
    >>> sum(asked) < 257**2 / 4
    True
    """

    def at(row: Index, column: Index) -> Array:
        return exact(np.stack([side[column], side[row]], axis=-1))

    cells = (len(side) - 1) // STEP
    coarse = at(*(STEP * np.indices((cells + 1, cells + 1)).reshape(2, -1))).reshape(cells + 1, cells + 1, -1)
    known: Mask = np.asarray(np.isfinite(coarse).all(axis=2))
    parts = np.zeros(known.shape, np.intp) if part_of is None else part_of(coarse)
    of_cells = np.full((cells + 1, cells + 1, STEP, STEP, coarse.shape[2]), np.nan)
    done = np.zeros((cells, cells), np.bool_)
    for part in sorted(set(parts[known].tolist())):
        row, column, between = _interpolated(coarse, known & (parts == part), at)
        of_cells[row, column], done[row, column] = between, True
    values = of_cells.swapaxes(1, 2).reshape(STEP * (cells + 1), -1, coarse.shape[2])[: len(side), : len(side)]
    mine = _nodes_of(_windows(np.logical_or, np.pad(known, 1), 4) & ~done)
    mine[::STEP, ::STEP] = False
    values[::STEP, ::STEP] = coarse
    row, column = np.nonzero(mine)
    if row.size:
        values[row, column] = at(row, column)
    return values


def _interpolated(coarse: Array, known: Mask, at: Callable[[Index, Index], Array]) -> tuple[Index, Index, Array]:
    """Return rows and columns (c,) of smooth cells, from the mask of known coarse values (k, k, m),
    and interpolated values (c, STEP, STEP, m) of their nodes."""
    filled = _filled(np.where(known[..., None], coarse, np.nan), TAPS, ALONG, TAPS - 2)
    inside, smooth = (
        np.pad(_windows(np.logical_and, mask, TAPS), MARGIN) for mask in (known, np.isfinite(filled[..., 0]))
    )
    row, column = np.nonzero(smooth & _windows(np.logical_and, known, 2))
    between = _between(filled, row, column)
    kept = _agree(row, column, between, inside, at)[row, column]
    return row[kept], column[kept], between[kept]


def _agree(row: Index, column: Index, between: Array, inside: Mask, at: Callable[[Index, Index], Array]) -> Mask:
    """Check interpolated values in cells (k, k) at test points; return the cells that pass and have
    no failing neighbour.

    Test points are taken in every other cell, and twice in each cell whose stencil contains
    extrapolated values.
    """
    close = CLOSE * np.spacing(np.abs(between).max(axis=(0, 1, 2), initial=0.0).astype(np.float32))
    answers = np.zeros((2, len(inside) + 2, len(inside) + 2), np.bool_)
    is_inside = inside[row, column]
    for k, (down, right) in enumerate((OFF_MIDDLE, OFF_MIDDLE[::-1])):
        (tried,) = np.nonzero(~is_inside | ((row % 2 == k) & ((row + column) % 2 == 0)))
        if not tried.size:
            continue
        true = at(STEP * row[tried] + down, STEP * column[tried] + right)
        agrees = (np.abs(between[tried, down, right] - true) <= close).all(axis=1)
        answers[agrees.astype(int), row[tried] + 1, column[tried] + 1] = True
    refuted, confirmed = (_windows(np.logical_or, answer, 3) for answer in answers)
    return np.asarray(confirmed & ~refuted)


def weights_between(at: Array, first: Index) -> Array:
    """Return the Lagrange weights of TAPS equidistant values at points (n,) between them.

    >>> (weights_between(np.array([4.5]), np.array([0])) * 2**16)[0, :4]
    array([   35.,  -405.,  2268., -8820.])
    """
    weights = np.zeros((len(at), int(first[-1]) + TAPS))
    for k in range(TAPS):
        others = [j for j in range(TAPS) if j != k]
        weights[np.arange(len(at)), first + k] = np.prod([(at - first - j) / (k - j) for j in others], axis=0)
    return weights


def _between(exact: Array, row: Index, column: Index) -> Array:
    """Interpolate coarse values (k, k, m) in cells (c,); return (c, STEP, STEP, m).

    The matrix products are small enough for BLAS to run them in the calling thread; larger ones
    start threads that busy-wait for up to 0.1 s.
    """
    along = weights_between(MARGIN + np.arange(STEP) / STEP, np.zeros(STEP, np.intp))
    weights = np.kron(along, along).T
    windows = np.lib.stride_tricks.sliding_window_view(exact, (TAPS, TAPS), axis=(0, 1))
    values = np.empty((len(row), exact.shape[2], STEP**2))
    for first in range(0, len(row), TOGETHER):
        part = slice(first, first + TOGETHER)
        about = windows[row[part] - MARGIN, column[part] - MARGIN].reshape(-1, TAPS**2)
        np.matmul(about, weights, out=values[part].reshape(-1, STEP**2))
    return values.reshape(len(row), exact.shape[2], STEP, STEP).transpose(0, 2, 3, 1)


def _nodes_of(cells: Mask) -> Mask:
    """Return the mask (n, n) of the nodes in and around cells (k, k)."""
    count = STEP * len(cells) + 1
    nodes = np.zeros((count, count), np.bool_)
    wide = cells.repeat(STEP, axis=0).repeat(STEP, axis=1)
    for dx in (0, 1):
        for dy in (0, 1):
            nodes[dy : count - 1 + dy, dx : count - 1 + dx] |= wide
    return nodes


def _windows(combine: np.ufunc, values: Mask, side: int) -> Mask:
    """Combine every ``side`` x ``side`` window of values."""
    for _ in range(2):
        values = combine.reduce([values[i : len(values) - side + 1 + i] for i in range(side)]).T
    return values


def continued(values: Array) -> Array:
    """Extrapolate a lattice (n, n, m) by several nodes beyond its known values, with third
    differences."""
    return _filled(values, 4, AROUND, BEYOND)


def _filled(values: Array, terms: int, ways: list[tuple[int, int]], layers: int) -> Array:
    """Extrapolate values (n, n, m) layer by layer with polynomials through ``terms`` collinear
    nodes."""
    known: Mask = np.asarray(np.isfinite(values).all(axis=2))
    for _ in range(layers):
        beside = _windows(np.logical_or, np.pad(known, 1), 3)
        row, column = np.nonzero(beside & ~known)
        values[row, column] = found = _next(values, known, row, column, terms, ways)
        known[row, column] = np.isfinite(found).all(axis=1)
    return values


def _next(values: Array, known: Mask, row: Index, column: Index, terms: int, ways: list[tuple[int, int]]) -> Array:
    """Return values (k, m) of nodes: the known values, or the mean extrapolation along the given
    directions."""
    total, told = np.zeros((len(row), values.shape[2])), np.zeros((len(row), values.shape[2]))
    ahead = [-comb(terms, k) * (-1) ** k for k in range(1, terms + 1)]  # finite differences of order ``terms`` vanish
    around = np.pad(known, terms)
    for dx, dy in ways:
        line = [(row + k * dy, column + k * dx) for k in range(1, terms + 1)]
        (inside,) = np.nonzero(
            around[line[0][0] + terms, line[0][1] + terms] & around[line[-1][0] + terms, line[-1][1] + terms]
        )
        guess = sum(a * values[y[inside], x[inside]] for a, (y, x) in zip(ahead, line, strict=True))
        is_told = np.isfinite(guess)
        total[inside] += np.where(is_told, guess, 0.0)
        told[inside] += is_told
    old = values[row, column]
    with np.errstate(invalid="ignore"):
        return np.where(np.isnan(old), total / told, old)
