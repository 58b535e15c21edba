"""Skew rays: first intersection with a mirror, reflection, and clearance at circular edges."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.numerics import NEWTON_TOLERANCE
from ...base.typing import Array, Mask
from ..mirrors import Mirror
from ..mirrors.mirror import Conic
from .meridian import ROUNDING

# -- Clearance of rays at edges --------------------------------------------------------------------
#
# A clearance is a smooth function of the ray, in mm: 0 at the edge, positive for transmitted and
# negative for blocked rays. :meth:`omnimirror.optics.tracing.optical_train.OpticalTrain.clearances`
# collects those of all parts of a sensor.


def circle_clearance(across: Array, radius: float) -> Array:
    """Return the clearance (n,), mm, of plane crossings (n, 2) outside a circle.

    The difference of squares ``(r^2 - a^2)/(2 a)`` has the sign of ``r - a`` and its slope at the
    edge, and is smooth for rays through the axis; it can be interpolated over an aperture.

    >>> circle_clearance(np.array([[3.0, 0.0], [0.0, 5.0]]), 4.0).round(3)
    array([-0.875,  1.125])
    """
    if radius <= 0:
        return np.full(across.shape[:-1], np.inf)
    clearance: Array = ((across**2).sum(axis=-1) - radius**2) / (2 * radius)
    return clearance


# -- First intersection with a mirror, and reflection ----------------------------------------------
#
# All coordinates are in the mirror frame: vertex at the origin, z from the lens to the mirror. Rays
# that miss the mirror, or meet its back or its plane beyond the rim, are invalid and NaN.
#
# Along a ray, the height over the surface, ``g(t) = z(t) - sag(r(t))``, is negative on the lens side;
# the first intersection is its first zero. For a convex mirror g is concave: each tangent is above
# it, and Newton's method converges to the first zero from below. For a mirror with a concave zone, a
# parabola with the largest curvature bound replaces the tangent, with the same property. Pure conics
# need no iteration: the root at the ray's entry into the convex body is unique.

CHUNK = 16384  # rays per chunk: their arrays fit in the cache
MAX_STEPS = 100  # a grazing ray halves its distance with each step
LIFT = 1e-6  # offset of reflected rays from the surface, relative to the rim radius
CURVATURE_MARGIN = 1.5  # factor on the largest concave curvature sampled
# Relative to the rim radius; covers valleys between the samples of the lowest point
SAMPLING_MARGIN = 1e-3


class Hits(NamedTuple):
    """Intersections of n rays with a mirror; NaN if invalid."""

    distance: Array
    """(n,), mm, along the ray, in units of the length of its direction."""
    points: Array
    """(n, 3), mm, on the mirror."""
    normals: Array
    """(n, 3) unit normals towards the lens side."""
    valid: Mask
    """(n,) False for rays that miss the mirror or meet its back."""


class Reflections(NamedTuple):
    """Reflections of n rays at a mirror; NaN if invalid."""

    points: Array
    """(n, 3), mm, on the mirror."""
    directions: Array
    """(n, 3) unit vectors of the reflected rays."""
    normals: Array
    """(n, 3) unit normals towards the lens side."""
    valid: Mask
    """(n,) False for rays that miss the mirror or meet it a second time."""


def reflect(directions: Array, normals: Array) -> Array:
    """Return directions (n, 3) after reflection at surfaces with unit normals (n, 3).

    >>> reflect(np.array([[0.6, 0.0, 0.8]]), np.array([[0.0, 0.0, -1.0]]))
    array([[ 0.6,  0. , -0.8]])
    """
    across = np.einsum("...i,...i->...", directions, normals)
    reflected: Array = directions - 2 * across[..., None] * normals
    return reflected


def trace(mirror: Mirror, origins: ArrayLike, directions: ArrayLike) -> Reflections:
    """Reflect rays (n, 3), (n, 3) on a mirror.

    Rays that meet a concave zone a second time are invalid.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Sphere
    >>> rays = trace(Sphere(50.0, 44.0), [[30.0, 0.0, -100.0]], [[0.0, 0.0, 1.0]])
    >>> rays.points, np.degrees(np.arctan2(rays.directions[:, 0], -rays.directions[:, 2])).round(6)
    (array([[30.,  0., 10.]]), array([73.739795]))
    """
    unit = np.asarray(directions, dtype=float)
    unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
    hits = intersect(mirror, origins, unit)
    outgoing = reflect(unit, hits.normals)
    valid = hits.valid
    if hollowness(mirror) > 0 and valid.any():
        valid = valid.copy()
        lifted = hits.points[valid] + LIFT * mirror.rim_radius_mm * outgoing[valid]
        valid[valid] = ~intersect(mirror, lifted, outgoing[valid]).valid
    points, outgoing, normals = (
        np.where(valid[:, None], a, np.nan) for a in (hits.points, outgoing, hits.normals)
    )
    return Reflections(points, outgoing, normals, valid)


def intersect(mirror: Mirror, origins: ArrayLike, directions: ArrayLike) -> Hits:
    """Return the first intersections of rays (n, 3), (n, 3) with the front of a mirror.

    Examples
    --------
    A ray from behind meets the back first:

    >>> from omnimirror.optics.mirrors import Cone
    >>> hits = intersect(Cone(45.0, 20.0), [[10.0, 0.0, -5.0], [10.0, 0.0, 50.0]], [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    >>> hits.distance, hits.valid
    (array([15., nan]), array([ True, False]))
    """
    o, d = np.broadcast_arrays(
        np.asarray(origins, dtype=float), np.asarray(directions, dtype=float)
    )
    o, d = np.atleast_2d(o), np.atleast_2d(d)
    distance = np.full(len(o), np.nan)
    points, normals = np.full((2, len(o), 3), np.nan)
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
        for start in range(0, len(o), CHUNK):
            part = slice(start, start + CHUNK)
            rays = o[part].T, d[part].T
            t = (
                _enter_conic(mirror, *rays)
                if isinstance(mirror, Conic)
                else _approach(mirror, *rays)
            )
            distance[part] = t
            points[part] = o[part] + t[:, None] * d[part]
            normals[part] = normals_at(mirror, points[part])
    return Hits(distance, points, normals, ~np.isnan(distance))


def normals_at(mirror: Mirror, points: Array) -> Array:
    """Return unit normals (n, 3), towards the lens side, at points (n, 3) of a mirror."""
    x, y = points[..., 0], points[..., 1]
    r = np.hypot(x, y)
    slope = mirror.slope(np.minimum(r, mirror.rim_radius_mm))
    cos, sin = _unit(x, y, r)
    length = np.sqrt(1 + slope**2)
    return np.stack([slope * cos / length, slope * sin / length, -1 / length], axis=-1)


@lru_cache(maxsize=64)
def hollowness(mirror: Mirror) -> float:
    """Return the largest concave curvature (1/mm) of the surface, 0 if it is convex.

    The two principal second derivatives of the sag over the plane are z'' and z'/x.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> hollowness(Sphere(50.0, 44.0))
    0.0
    """
    x = np.linspace(0.0, mirror.rim_radius_mm, 1025)
    _, slope, curvature = mirror.profile(x)
    min_curvature = float(min(curvature.min(), (slope[1:] / x[1:]).min()))
    rounding = 1e-9 * float(np.abs(curvature).max())
    return CURVATURE_MARGIN * -min_curvature if min_curvature < -rounding else 0.0


# -- pure conics -----------------------------------------------------------------------------------


def _enter_conic(mirror: Conic, o: Array, d: Array) -> Array:
    """Return entry distances (n,) into ``r^2 - 2 R z + (1 + k) z^2 <= 0``; else NaN.

    The body behind the surface is convex: a ray enters it at most once, at the root with a
    decreasing quadratic form.
    """
    R, k1 = mirror.vertex_radius, 1 + mirror.conic
    (ox, oy, oz), (dx, dy, dz) = o, d
    a = dx * dx + dy * dy + k1 * dz * dz
    b = ox * dx + oy * dy - R * dz + k1 * oz * dz
    c = ox * ox + oy * oy - 2 * R * oz + k1 * oz * oz
    root = np.sqrt(b * b - a * c)
    t: Array = np.where(b < 0, c / (root - b), (-b - root) / a)
    x, y, z = o + t * d
    rim = mirror.rim_radius_mm * (1 + ROUNDING)
    on_it = (t >= 0) & (R - k1 * z > 0) & (x * x + y * y <= rim * rim)
    return np.where(on_it, t, np.nan)


# -- any mirror ------------------------------------------------------------------------------------


def _approach(mirror: Mirror, o: Array, d: Array) -> Array:
    """Return distances (n,) of the first intersections of rays (3, n), from the front; else NaN."""
    rim, sink = mirror.rim_radius_mm, hollowness(mirror)
    t, end = _over_the_mirror(mirror, o, d)
    bend = sink * (d[0] ** 2 + d[1] ** 2)
    hit = np.full(t.shape, np.nan)
    active = np.flatnonzero(t <= end)
    close = NEWTON_TOLERANCE * rim
    for step in range(MAX_STEPS):
        if not active.size:
            break
        s = t[active]
        g, rate = _height(mirror, o[:, active], d[:, active], s)
        if step == 0:
            inside = g > ROUNDING * rim  # enters behind the rim, or starts inside the body
            g = np.where(inside, np.nan, g)
        forward = -2 * g / (rate + np.sqrt(rate * rate - 2 * bend[active] * g))
        forward = np.where(g >= 0, 0.0, forward)  # past the surface by rounding: converged
        s = s + forward
        t[active] = s
        arrived = (forward <= close) & (rate > 0) & (s <= end[active] + close)
        hit[active[arrived]] = s[arrived]
        active = active[(forward > close) & (s <= end[active])]  # NaN and infinity drop out
    return hit


def _over_the_mirror(mirror: Mirror, o: Array, d: Array) -> tuple[Array, Array]:
    """Return the interval (n,), (n,) of rays (3, n) within the mirror's cylinder."""
    rim, ((_, _), (min_sag, _)) = mirror.rim_radius_mm * (1 + ROUNDING), mirror.bounds
    min_sag -= SAMPLING_MARGIN * rim
    a = d[0] ** 2 + d[1] ** 2
    b = o[0] * d[0] + o[1] * d[1]
    c = o[0] ** 2 + o[1] ** 2 - rim * rim
    root = np.sqrt(b * b - a * c)
    enter = np.where(b < 0, c / (root - b), 0.0)  # rays away from the axis start within, or miss
    leave = np.where(b < 0, (root - b) / a, -c / (root + b))  # infinite along the axis
    slab = np.where(d[2] > 0, (min_sag - o[2]) / d[2], 0.0)  # to the height of the lowest point
    return np.maximum(np.maximum(enter, slab), 0.0), leave


def _height(mirror: Mirror, o: Array, d: Array, t: Array) -> tuple[Array, Array]:
    """Return g(t) and g'(t) (n,): height over the surface along rays (3, n), and its derivative."""
    x, y, z = o + t * d
    r = np.sqrt(x * x + y * y)
    sag, slope, _ = mirror.profile(np.minimum(r, mirror.rim_radius_mm))
    cos, sin = _unit(x, y, r)
    return z - sag, d[2] - slope * (cos * d[0] + sin * d[1])


def _unit(x: Array, y: Array, r: Array) -> tuple[Array, Array]:
    """Return cosine and sine of the azimuth; 0 on the axis."""
    on_axis = r == 0
    safe = np.where(on_axis, 1.0, r)
    return np.where(on_axis, 1.0, x / safe), y / safe
