"""Normal equations of a bundle adjustment in sparse block form.

Shared parameters form one small dense block, and the six parameters of each pose a block of their
own. Poses are eliminated image by image with the Schur complement, at a cost linear in the number
of images (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.typing import Array
from .observations import Stack

MOST_PRODUCTS = 1 << 16  # multiplications per product; OpenBLAS starts threads above
FEWEST_ROWS = 32  # minimum rows per product; for wide matrices threads pay off


class Blocks(NamedTuple):
    """Normal equations ``H d = -g`` with g shared parameters and m poses."""

    shared: Array
    """Shared block (g, g)."""
    cross: Array
    """Coupling blocks (m, g, 6)."""
    motions: Array
    """Pose blocks (m, 6, 6)."""
    shared_gradient: Array
    """Gradient of the shared parameters (g,)."""
    motion_gradients: Array
    """Gradients of the poses (m, 6)."""


def assembled(
    stack: Stack, residuals: Array, d_shared: Array, d_motion: Array, weights: Array, moving: NDArray[np.bool_]
) -> Blocks:
    """Assemble the normal equations.

    Inputs are residuals (n, 2), derivatives (n, 2, g) and (n, 2, 6), weights (n,), and a mask
    ``moving`` (m,) of free poses.
    """
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
    """Return ``one.T @ other`` of rows (n, k), computed in chunks.

    BLAS starts threads even for small products, and they spin for longer than the product takes.
    For a matrix times itself the limit is lower still, so the weights are applied to one factor.
    """
    most = max(MOST_PRODUCTS // one.shape[1] ** 2, FEWEST_ROWS)
    total = np.zeros((one.shape[1], one.shape[1]))
    for first in range(0, len(one), most):
        total += one[first : first + most].T @ other[first : first + most]
    return total


def with_priors(blocks: Blocks, information: Array, pull: Array) -> Blocks:
    """Add priors on shared parameters: information (g, g), and information times deviations (g,)."""
    return blocks._replace(shared=blocks.shared + information, shared_gradient=blocks.shared_gradient + pull)


def solved(blocks: Blocks, damping: float, floor: Array) -> tuple[Array, Array]:
    """Solve for Marquardt's step: shared (g,) and poses (m, 6).

    ``floor`` (g,) is added to the diagonal independently of the damping.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations are singular.
    """
    motions = _damped(blocks.motions, damping)
    inverse_cross, inverse_gradient = _eliminated(motions, blocks)
    enlarged = blocks.shared + np.diag(damping * np.diag(blocks.shared) + floor)
    reduced = enlarged - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    right = blocks.shared_gradient - np.einsum("mgk,mk->g", blocks.cross, inverse_gradient)
    shared = -solved_scaled(reduced, right)
    return shared, -inverse_gradient - np.einsum("mkg,g->mk", inverse_cross, shared)


def reduced_system(blocks: Blocks) -> tuple[Array, Array]:
    """Return the reduced system for free poses: Schur complement (g, g) and gradient (g,)."""
    inverse_cross, inverse_gradient = _eliminated(_damped(blocks.motions, 1e-12), blocks)
    reduced: Array = blocks.shared - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    gradient: Array = blocks.shared_gradient - np.einsum("mgk,mk->g", blocks.cross, inverse_gradient)
    return (reduced + reduced.T) / 2, gradient


def solved_scaled(matrix: Array, right: Array) -> Array:
    """Solve symmetric positive definite equations with diagonal scaling of the unknowns."""
    if not len(right):
        return np.zeros(0)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    lower = np.linalg.cholesky(matrix * scale[:, None] * scale)
    half = np.linalg.solve(lower, right * scale)
    return np.asarray(np.linalg.solve(lower.T, half) * scale)


def _damped(matrices: Array, damping: float) -> Array:
    """Return matrices (..., k, k) with enlarged diagonals; undetermined poses remain unchanged."""
    diagonal = np.einsum("...ii->...i", matrices)
    least = np.maximum(diagonal.max(axis=-1, initial=0.0, keepdims=True) * 1e-14, 1e-30)
    damped = matrices.copy()
    np.einsum("...ii->...i", damped)[...] += damping * diagonal + np.where(diagonal <= least, least, 0.0)
    return damped


def _eliminated(motions: Array, blocks: Blocks) -> tuple[Array, Array]:
    """Return ``C^-1 B^T`` (m, 6, g) and ``C^-1 h`` (m, 6), with rows scaled for radians and mm."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("mii->mi", motions), 1e-300))
    scaled = motions * scale[:, :, None] * scale[:, None, :]
    right = np.concatenate([blocks.cross.transpose(0, 2, 1), blocks.motion_gradients[..., None]], axis=2)
    found = np.linalg.solve(scaled, right * scale[..., None]) * scale[..., None]
    return found[..., :-1], found[..., -1]
