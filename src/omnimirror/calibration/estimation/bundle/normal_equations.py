"""Normal equations of a bundle adjustment, in the blocks in which they are nearly empty.

Parameters that all pictures share stand in one small dense block, the six numbers of each motion in a block of their
own; motions are eliminated by the Schur complement, picture by picture, so that the cost grows with the number of
pictures and no faster (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .observations import Stack

Array = NDArray[np.float64]

MOST_PRODUCTS = 1 << 16  # of two numbers in one product of matrices; OpenBLAS takes threads for more
FEWEST_ROWS = 32  # at a time, whatever that comes to: of wide ones its threads are worth it


class Blocks(NamedTuple):
    """Normal equations ``H d = -g`` with g shared parameters and m motions."""

    shared: Array
    """(g, g)"""
    cross: Array
    """(m, g, 6)"""
    motions: Array
    """(m, 6, 6)"""
    shared_gradient: Array
    """(g,)"""
    motion_gradients: Array
    """(m, 6)"""


def assembled(
    stack: Stack, residuals: Array, d_shared: Array, d_motion: Array, weights: Array, moving: NDArray[np.bool_]
) -> Blocks:
    """Blocks from residuals (n, 2), derivatives (n, 2, g) and (n, 2, 6), weights (n,); ``moving`` (m,) motions."""
    together = np.concatenate([d_shared, d_motion, residuals[..., None]], axis=2)
    weighted = (together * weights[:, None, None]).reshape(2 * len(weights), -1)
    together = together.reshape(weighted.shape)
    count, g = len(stack.slices), d_shared.shape[2]
    cross, blocks, gradients = np.zeros((count, g, 6)), np.zeros((count, 6, 6)), np.zeros((count, 6))
    square, gradient = np.zeros((g, g)), np.zeros(g)
    for i, where in enumerate(stack.slices):
        rows = slice(2 * where.start, 2 * where.stop)
        product = _product(together[rows], weighted[rows])
        square += product[:g, :g]
        gradient += product[:g, -1]
        if moving[i]:
            cross[i], blocks[i], gradients[i] = product[:g, g:-1], product[g:-1, g:-1], product[g:-1, -1]
        else:
            blocks[i] = np.eye(6)
    return Blocks(square, cross, blocks, gradient, gradients)


def _product(one: Array, other: Array) -> Array:
    """``one.T @ other`` of rows (n, k), a few at a time.

    BLAS wakes its threads for so little already, which then spin for longer than it takes; for a matrix times itself
    it does so from still fewer rows on, so that the weights go into one of the two.
    """
    most = max(MOST_PRODUCTS // one.shape[1] ** 2, FEWEST_ROWS)
    total = np.zeros((one.shape[1], one.shape[1]))
    for first in range(0, len(one), most):
        total += one[first : first + most].T @ other[first : first + most]
    return total


def with_priors(blocks: Blocks, information: Array, pull: Array) -> Blocks:
    """With priors on the shared parameters: information (g, g) and information times how far they are off (g,)."""
    return blocks._replace(shared=blocks.shared + information, shared_gradient=blocks.shared_gradient + pull)


def solved(blocks: Blocks, damping: float, floor: Array) -> tuple[Array, Array]:
    """Marquardt's step: shared (g,) and motions (m, 6); ``floor`` (g,) is added to the diagonal whatever the damping.

    Raises
    ------
    numpy.linalg.LinAlgError
        The equations do not determine it.
    """
    motions = _damped(blocks.motions, damping)
    inverse_cross, inverse_gradient = _eliminated(motions, blocks)
    enlarged = blocks.shared + np.diag(damping * np.diag(blocks.shared) + floor)
    reduced = enlarged - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    right = blocks.shared_gradient - np.einsum("mgk,mk->g", blocks.cross, inverse_gradient)
    shared = -solved_scaled(reduced, right)
    return shared, -inverse_gradient - np.einsum("mkg,g->mk", inverse_cross, shared)


def reduced_system(blocks: Blocks) -> tuple[Array, Array]:
    """What pictures say of the shared parameters when motions are free: Schur complement (g, g), and gradient (g,)."""
    inverse_cross, inverse_gradient = _eliminated(_damped(blocks.motions, 1e-12), blocks)
    reduced: Array = blocks.shared - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    gradient: Array = blocks.shared_gradient - np.einsum("mgk,mk->g", blocks.cross, inverse_gradient)
    return (reduced + reduced.T) / 2, gradient


def solved_scaled(matrix: Array, right: Array) -> Array:
    """Solution of symmetric positive equations whose unknowns have very different sizes."""
    if not len(right):
        return np.zeros(0)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    lower = np.linalg.cholesky(matrix * scale[:, None] * scale)
    half = np.linalg.solve(lower, right * scale)
    return np.asarray(np.linalg.solve(lower.T, half) * scale)


def _damped(matrices: Array, damping: float) -> Array:
    """Matrices (.., k, k) with their diagonals enlarged; a motion that nothing determines stays where it is."""
    diagonal = np.einsum("...ii->...i", matrices)
    least = np.maximum(diagonal.max(axis=-1, initial=0.0, keepdims=True) * 1e-14, 1e-30)
    damped = matrices.copy()
    np.einsum("...ii->...i", damped)[...] += damping * diagonal + np.where(diagonal <= least, least, 0.0)
    return damped


def _eliminated(motions: Array, blocks: Blocks) -> tuple[Array, Array]:
    """``C^-1 B^T`` (m, 6, g) and ``C^-1 h`` (m, 6), with rows scaled, since they are radians and millimetres."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("mii->mi", motions), 1e-300))
    scaled = motions * scale[:, :, None] * scale[:, None, :]
    right = np.concatenate([blocks.cross.transpose(0, 2, 1), blocks.motion_gradients[..., None]], axis=2)
    found = np.linalg.solve(scaled, right * scale[..., None]) * scale[..., None]
    return found[..., :-1], found[..., -1]
