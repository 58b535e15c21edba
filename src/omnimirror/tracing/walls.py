"""Transparent walls: what passes through them and what they throw back, and cylinders that bend rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def wall_transmission(incidence: ArrayLike, refractive_index: float) -> Array:
    """Share of unpolarised light (n,) that passes a clear wall, at angles of incidence in radians.

    Fresnel's formulas; (1 - R)/(1 + R) for each polarisation sums the reflections between both sides. What does
    not pass is thrown back.

    >>> wall_transmission(np.radians([0.0, 45.0]), 1.5).round(4)  # 12/13 straight through
    array([0.9231, 0.9073])
    """
    angle = np.asarray(incidence, dtype=float)
    cos_i, cos_t = np.cos(angle), np.sqrt(1 - (np.sin(angle) / refractive_index) ** 2)
    rs = ((cos_i - refractive_index * cos_t) / (cos_i + refractive_index * cos_t)) ** 2
    rp = ((refractive_index * cos_i - cos_t) / (refractive_index * cos_i + cos_t)) ** 2
    passed: Array = ((1 - rs) / (1 + rs) + (1 - rp) / (1 + rp)) / 2
    return passed


class Passage(NamedTuple):
    """Rays (n,) that leave a tube from inside."""

    points: Array
    """(n, 3): where they leave it."""
    directions: Array
    """(n, 3), unit vectors: whereto, outside."""
    met: Array
    """(n, 3): where they meet the inner side."""
    thrown_back: Array
    """(n, 3), unit vectors: the part that the wall throws back, inside."""
    passed: Array
    """(n,): share of the light that passes; 1 and unchanged along the axis, where the wall is never met."""


def through_tube(
    points: Array, directions: Array, axis: Array, outer_radius: float, wall: float, refractive_index: float
) -> Passage:
    """Rays from inside a tube about an axis through the origin, traced out through its wall by Snell's law.

    Parameters
    ----------
    points, directions : (n, 3)
    axis : (3,) unit vector
    outer_radius, wall
        In the unit of the points.
    refractive_index
    """
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.linalg.norm(np.cross(d, axis), axis=1) > 1e-9
    met, inwards = _meet(points, d, axis, outer_radius - wall)
    inside = _refracted(d, inwards, 1 / refractive_index)
    left, normal = _meet(met, inside, axis, outer_radius)
    out = _refracted(inside, normal, refractive_index)
    cosine = -np.einsum("ni,ni->n", d, inwards)
    back = d + 2 * cosine[:, None] * inwards
    passed = wall_transmission(np.arccos(np.clip(cosine, 0, 1)), refractive_index)
    keep = across[:, None]
    return Passage(
        np.where(keep, left, points),
        np.where(keep, out, d),
        np.where(keep, met, points),
        np.where(keep, back, d),
        np.where(across, passed, 1.0),
    )


def _meet(points: Array, d: Array, axis: Array, radius: float) -> tuple[Array, Array]:
    """Where rays from inside meet a cylinder, and its unit normals there, towards the axis."""
    p, q = points - np.outer(points @ axis, axis), d - np.outer(d @ axis, axis)
    a, b, c = (np.einsum("ni,ni->n", *pair) for pair in ((q, q), (p, q), (p, p)))
    t = (-b + np.sqrt(np.maximum(b**2 - a * (c - radius**2), 0))) / np.maximum(a, 1e-18)
    return points + t[:, None] * d, -(p + t[:, None] * q) / radius


def _refracted(d: Array, normal: Array, ratio: float) -> Array:
    """Unit directions behind a surface, Snell's law; ``ratio`` is the index before over the one behind."""
    cosine = -np.einsum("ni,ni->n", d, normal)
    behind = np.sqrt(np.maximum(1 - ratio**2 * (1 - cosine**2), 0))
    turned: Array = ratio * d + (ratio * cosine - behind)[:, None] * normal
    return turned
