"""Object distances: fixed distances from the mirror, or intersections of rays with surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...optics.tracing.meridian import ChiefRays
from .ranges import ends
from .requirements import FieldRequirements

Array = NDArray[Any]


def inverse_distances(field: FieldRequirements, x: Array, z: Array, omega: Array) -> Array:
    """Return inverse distances (1, k), 1/mm, to the first object surface.

    The rays start from points (k,) at field angles (k,) in radians. The distance of a ray without an
    intersection is infinite.

    >>> room = FieldRequirements(omega_max_deg=120, object_plane_distance_mm=700, object_cylinder_radius_mm=2000)
    >>> (1 / inverse_distances(room, np.zeros(3), np.zeros(3), np.radians([0.0, 60.0, 90.0]))).round(6)
    array([[ 700., 1400., 2000.]])
    """
    nearest = np.zeros_like(omega)
    for inverse in _surfaces(field, x, z, omega):
        nearest = np.where(inverse.real > nearest.real, inverse, nearest)
    return np.atleast_2d(nearest)


def distances_mm(field: FieldRequirements) -> tuple[float, ...]:
    """Return the distinct object distances."""
    return tuple(sorted(set(ends(field.object_distance_mm))))


def distances_of(field: FieldRequirements, rays: ChiefRays) -> list[Any]:
    """Return the distances from the mirror points of chief rays (k,) to the objects, mm: a number
    or an array (k,) for each object distance; with a cover, along the optical path.
    """
    if not field.has_surfaces:
        return list(distances_mm(field))
    x, z = rays.last
    with np.errstate(divide="ignore"):
        onward = 1 / inverse_distances(field, x, z, rays.omega)[0]
    return [onward + (0.0 if rays.outside is None else rays.outside.inside)]


def _surfaces(field: FieldRequirements, x: Array, z: Array, omega: Array) -> list[Array]:
    """Return 1/p for each surface; 0 or negative for a ray without an intersection."""
    found = []
    if field.object_plane_distance_mm is not None:
        found.append(np.cos(omega) / (field.object_plane_distance_mm + z))
    if field.object_cylinder_radius_mm is not None:
        found.append(np.sin(omega) / (field.object_cylinder_radius_mm - x))
    return found
