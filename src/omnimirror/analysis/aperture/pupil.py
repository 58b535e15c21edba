"""Sampling of the aperture, a unit disk: for spot diagrams, densities and exact integration.

The x and y axes of the aperture are those of the unflipped image, right and down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array

MOST_RINGS = 500


class Pupil(NamedTuple):
    """Points of the unit disk with their relative areas."""

    points: Array
    """Points (n, 2)."""
    weights: Array
    """Weights (n,) with sum 1."""


def hexapolar(rings: int) -> Pupil:
    """Return the centre and 6, 12, 18 ... points on rings, for spot diagrams.

    >>> pupil = hexapolar(2)
    >>> len(pupil.points), pupil.weights.sum().round(12)
    (19, np.float64(1.0))
    """
    _check(rings)
    ring = np.repeat(np.arange(rings + 1), [1, *(6 * np.arange(1, rings + 1))])
    place = np.concatenate([[0.0], *(np.arange(6 * j) / (6 * j) for j in range(1, rings + 1))])
    radius, phi = ring / rings, 2 * np.pi * place
    borders = np.clip((np.arange(rings + 2) - 0.5) / rings, 0, 1)  # halfway to the neighbouring rings
    area = np.diff(borders**2) / np.maximum(6 * np.arange(rings + 1), 1)
    return Pupil(np.stack([radius * np.cos(phi), radius * np.sin(phi)], axis=-1), area[ring])


def fibonacci(count: int) -> Pupil:
    """Return points on a spiral with equal areas, for densities.

    >>> fibonacci(100).points.shape
    (100, 2)
    """
    if not 1 <= count <= 10_000_000:
        raise InvalidParameter(f"a pupil of {count} points is not valid; it takes 1 to 10000000")
    i = np.arange(count) + 0.5
    radius, phi = np.sqrt(i / count), i * np.pi * (3 - 5**0.5)
    points = np.stack([radius * np.cos(phi), radius * np.sin(phi)], axis=-1)
    return Pupil(points, np.full(count, 1 / count))


def gaussian(rings: int) -> Pupil:
    """Return rings and spokes for exact integration of polynomials (Gauss in the squared radius).

    >>> x, y = gaussian(4).points.T
    >>> float(gaussian(4).weights @ (x**4 * y**2)).__round__(12)  # 1/64
    0.015625
    """
    _check(rings)
    u, weight = np.polynomial.legendre.leggauss(rings)
    radius, spokes = np.sqrt((u + 1) / 2), 4 * rings
    phi = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    points = np.stack([np.outer(radius, np.cos(phi)), np.outer(radius, np.sin(phi))], axis=-1).reshape(-1, 2)
    return Pupil(points, np.repeat(weight / 2 / spokes, spokes))


def _check(rings: int) -> None:
    if not (1 <= rings <= MOST_RINGS and int(rings) == rings):
        raise InvalidParameter(f"rings = {rings} is not a whole number from 1 to {MOST_RINGS}")
