"""How a board lies in the picture about one of its corners: a quadratic map, fitted to the corners around it.

No camera is asked. Over two or three squares any mirror's picture of a plane is quadratic to a few hundredths of
a pixel, which is enough to say where the next corner must be and how its edges bend.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH = 1.3
"""Standard deviation, in units of the board, of the weights that corners around have."""
STIFFNESS = np.array([0.0, 1e-6, 1e-6, 4e-3, 4e-3, 4e-3])
"""What keeps the second derivatives small where too few corners tell them."""


class LocalMaps(NamedTuple):
    """From the board to the picture, about m points: second-order Taylor series in units of the board."""

    pixels: Array
    """(m, 2): the points themselves, px."""
    first: Array
    """(m, 2, 2): derivatives of the pixel (first axis) along the board's x and y, px per unit."""
    second: Array
    """(m, 2, 2, 2): second derivatives of the pixel (first axis)."""
    support: Array
    """(m,): sum of the weights of the corners that a map was fitted to."""

    def at(self, offsets: Array) -> Array:
        """Pixels (m, n, 2) of points (n, 2) or (m, n, 2) of the board, counted from each map's own."""
        bend = np.einsum("maij,...ni,...nj->mna" if offsets.ndim == 2 else "maij,mni,mnj->mna",
                         self.second, offsets, offsets, optimize=True)  # fmt: skip
        straight = np.einsum("mai,...ni->mna" if offsets.ndim == 2 else "mai,mni->mna", self.first, offsets)
        return np.asarray(self.pixels[:, None] + straight + bend / 2)

    def spacing(self) -> Array:
        """The lesser of the two sides (m,) of the board's unit in the picture, px."""
        return np.asarray(np.linalg.norm(self.first, axis=1).min(axis=1))


def maps_about(places: Array, pixels: Array, at: Array, *, leave_out: bool = False, reach: float = REACH) -> LocalMaps:
    """The maps about points of the board, by weighted least squares.

    Parameters
    ----------
    places : (k, 2)
        Of the known corners on the board, in units of about the distance between them.
    pixels : (k, 2)
        Of the known corners in the picture.
    at : (m, 2)
        Places on the board to fit about.
    leave_out
        Whether a corner that is itself such a place is left out of its own map, as a check of it needs.
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
    """Places (2, m, n) on the board of pixels (m, n), and derivatives (2, 2, m, n) of places (first axis) by pixels.

    Newton's method from the straight part of the map, which three steps bring to rounding over a square. Components
    stand apart, since sums over axes of two are slow.
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
