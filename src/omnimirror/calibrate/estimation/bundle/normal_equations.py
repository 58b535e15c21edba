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
    root = np.sqrt(weights)[:, None]
    e = (residuals * root).reshape(-1)
    a = (d_shared * root[..., None]).reshape(len(e), -1)
    b = (d_motion * root[..., None]).reshape(len(e), 6)
    count, shared = len(stack.slices), a.shape[1]
    cross, blocks, gradients = np.zeros((count, shared, 6)), np.zeros((count, 6, 6)), np.zeros((count, 6))
    for i, where in enumerate(stack.slices):
        if not moving[i]:
            blocks[i] = np.eye(6)
            continue
        rows = slice(2 * where.start, 2 * where.stop)
        cross[i] = a[rows].T @ b[rows]
        blocks[i] = b[rows].T @ b[rows]
        gradients[i] = b[rows].T @ e[rows]
    return Blocks(a.T @ a, cross, blocks, a.T @ e, gradients)


def with_priors(blocks: Blocks, information: Array, pull: Array) -> Blocks:
    """With priors on the shared parameters: information (g,) and information times how far they are off (g,)."""
    return blocks._replace(
        shared=blocks.shared + np.diag(information), shared_gradient=blocks.shared_gradient + information * pull
    )


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


def reduced_matrix(blocks: Blocks) -> Array:
    """What pictures say of the shared parameters when motions are free: the Schur complement (g, g)."""
    inverse_cross, _ = _eliminated(_damped(blocks.motions, 1e-12), blocks)
    reduced: Array = blocks.shared - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    return (reduced + reduced.T) / 2


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
