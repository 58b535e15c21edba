"""Rays in space that meet a mirror with a form error: where they meet it without one, and on from there.

The form is a matter of micrometres, so that a few steps of Newton's rule along the ray come from the one surface to the
other. What misses the mirror without its form error is not valid; at the rim that is decided by its meridian.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mirrors import Mirror
from ..mirrors.form import MirrorForm
from . import space
from .reflection import Surface
from .space import Reflections, reflect

Array = NDArray[np.float64]

STEPS = 12
CLOSE = 1e-12  # of the rim radius: a height over the surface that is rounding


def trace(mirror: Mirror, form: MirrorForm, origins: Array, directions: Array) -> Reflections:
    """Reflect rays (n, 3), (n, 3) on a mirror with a form error; see :func:`omnimirror.tracing.space.trace`.

    >>> from omnimirror.mirrors import Sphere
    >>> higher = MirrorForm((1,), (2.0,))  # by 2 um, everywhere
    >>> formed = trace(Sphere(50.0, 44.0), higher, np.array([[30.0, 0.0, -100.0]]), np.array([[0.0, 0.0, 1.0]]))
    >>> formed.points
    array([[30.   ,  0.   , 10.002]])
    """
    found = space.trace(mirror, origins, directions)
    if form.is_empty:
        return found
    valid = found.valid.copy()
    points, outgoing, normals = found.points.copy(), found.directions.copy(), found.normals.copy()
    way = np.broadcast_to(directions, points.shape)[valid]
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    at, surface, arrived = _met(mirror, form, points[valid], way)
    points[valid], normals[valid], outgoing[valid] = at, surface.normals, reflect(way, surface.normals)
    valid[valid] = arrived
    points[~valid] = normals[~valid] = outgoing[~valid] = np.nan
    return Reflections(points, outgoing, normals, valid)


def _met(mirror: Mirror, form: MirrorForm, points: Array, way: Array) -> tuple[Array, Surface, NDArray[np.bool_]]:
    """Points (n, 3) of the formed surface on rays through points close by, the surface there, and whether they are."""
    close = CLOSE * mirror.rim_radius_mm
    surface = Surface(mirror, points[:, :2], form)
    for _ in range(STEPS):
        over = points[:, 2] - surface.points[:, 2]
        if not (np.abs(over) > close).any():
            break
        rate = way[:, 2] - (surface.slopes * way[:, :2]).sum(axis=1)
        points = points - (over / rate)[:, None] * way
        surface = Surface(mirror, points[:, :2], form)
    return points, surface, np.abs(points[:, 2] - surface.points[:, 2]) <= 10 * close
