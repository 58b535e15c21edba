"""Local quadratic maps from a board to the image, fitted to the corners around a point.

No camera model is required. Over two or three squares, the image of a plane in any mirror is
quadratic within a few 0.01 px, which suffices to predict the next corner and the curvature of its
edges.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....base.typing import Array

REACH = 1.3
"""Standard deviation of the Gaussian weights of neighbouring corners, in board units."""
STIFFNESS = np.array([0.0, 1e-6, 1e-6, 4e-3, 4e-3, 4e-3])
"""Regularisation of the second derivatives for few corners."""


class LocalMaps(NamedTuple):
    """Second-order Taylor series from the board to the image around m points, in board units."""

    pixels: Array
    """Expansion points (m, 2), px."""
    first: Array
    """Derivatives (m, 2, 2) of the pixel (first axis) along the board's x and y, px per unit."""
    second: Array
    """Second derivatives (m, 2, 2, 2) of the pixel (first axis)."""
    support: Array
    """Sum (m,) of the weights of the fitted corners."""

    def at(self, offsets: Array) -> Array:
        """Return pixels (m, n, 2) of board points relative to each expansion point.

        Points have the shape (n, 2) or (m, n, 2).
        """
        bend = np.einsum("maij,...ni,...nj->mna" if offsets.ndim == 2 else "maij,mni,mnj->mna",
                         self.second, offsets, offsets, optimize=True)  # fmt: skip
        straight = np.einsum("mai,...ni->mna" if offsets.ndim == 2 else "mai,mni->mna", self.first, offsets)
        return np.asarray(self.pixels[:, None] + straight + bend / 2)

    def spacing(self) -> Array:
        """Return the smaller side (m,) of the board unit in the image, px."""
        return np.asarray(np.linalg.norm(self.first, axis=1).min(axis=1))


def maps_about(places: Array, pixels: Array, at: Array, *, leave_out: bool = False, reach: float = REACH) -> LocalMaps:
    """Fit local maps around points of the board by weighted least squares.

    Parameters
    ----------
    places : (k, 2)
        Known corners on the board, in units of about their spacing.
    pixels : (k, 2)
        Known corners in the image.
    at : (m, 2)
        Expansion points on the board.
    leave_out
        Whether a corner at an expansion point is excluded from its own map, for checks.
    reach
        Standard deviation of the weights, in the same units.
    """
    offsets = places[None] - at[:, None]
    squares = np.sum(offsets**2, axis=2)
    weights = np.exp(-squares / (2 * reach**2))
    weights[squares > (3.2 * reach) ** 2] = 0.0
    if leave_out:
        weights[squares < 1e-9] = 0.0
    x, y = offsets[..., 0], offsets[..., 1]
    basis = np.stack([np.ones_like(x), x, y, x * x / 2, x * y, y * y / 2], axis=2)
    weighted = basis * weights[..., None]
    normal = np.einsum("mki,mkj->mij", weighted, basis, optimize=True)
    support = weights.sum(axis=1)
    normal += (support[:, None, None] + 1e-12) * np.diag(STIFFNESS + 1e-9)
    middle = pixels.mean(axis=0)
    terms = np.linalg.solve(normal, np.einsum("mki,ka->mia", weighted, pixels - middle, optimize=True))
    second = terms[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 2).transpose(0, 3, 1, 2)
    return LocalMaps(terms[:, 0] + middle, terms[:, 1:3].transpose(0, 2, 1), second, support)


def inverted(maps: LocalMaps, u: Array, v: Array) -> tuple[Array, Array]:
    """Return board places (2, m, n) of pixels (m, n), and their derivatives (2, 2, m, n).

    The first axis of the derivatives is that of the places. Newton's method from the linear part of
    the map converges to rounding over a square in three steps. Components are separate arrays
    because sums over axes of length 2 are slow.
    """
    (a, b), (c, d) = maps.first.transpose(1, 2, 0)[..., None]
    (aa, ab), (_, bb) = maps.second[:, 0].transpose(1, 2, 0)[..., None]
    (cc, cd), (_, dd) = maps.second[:, 1].transpose(1, 2, 0)[..., None]
    u, v = u - maps.pixels[:, :1], v - maps.pixels[:, 1:]
    determinant = a * d - b * c
    x, y = (d * u - b * v) / determinant, (a * v - c * u) / determinant
    for step in range(4):
        ux, uy = aa * x + ab * y, ab * x + bb * y
        vx, vy = cc * x + cd * y, cd * x + dd * y
        a1, b1, c1, d1 = a + ux, b + uy, c + vx, d + vy
        determinant = a1 * d1 - b1 * c1
        determinant = np.where(np.abs(determinant) < 1e-9, 1e-9, determinant)
        if step == 3:
            break
        du = u - (a * x + b * y) - (ux * x + uy * y) / 2
        dv = v - (c * x + d * y) - (vx * x + vy * y) / 2
        x = x + np.clip((d1 * du - b1 * dv) / determinant, -1, 1)
        y = y + np.clip((a1 * dv - c1 * du) / determinant, -1, 1)
    return np.stack([x, y]), np.array([[d1, -b1], [-c1, a1]]) / determinant
