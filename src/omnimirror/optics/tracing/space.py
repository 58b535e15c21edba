"""Rays in space: where they first meet a mirror from its front, and how they leave it.

Everything is in the mirror's own frame: vertex at the origin, z from the lens to the mirror. A ray that
misses the mirror, meets it from behind or beyond its rim is not valid and NaN, never a number.

Along a ray the height over the surface, ``g(t) = z(t) - sag(r(t))``, starts below 0 on the side of the
lens, and the first hit is its first zero. For a convex mirror g is concave, so each tangent lies above
it and Newton's rule comes up to the first zero from below without ever passing it. A mirror with a
hollow zone gets, instead of the tangent, the parabola that its worst curvature allows; the same holds.
Pure conics need no iteration: the root at which the ray enters the convex body is unique.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.numerics.roots import NEWTON_CLOSE
from ..mirrors import Mirror
from ..mirrors.conics import Conic
from .meridian import ROUNDING

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHUNK = 1 << 14  # rays worked on at a time: their arrays stay in the cache
MAX_STEPS = 100  # a ray that grazes the surface halves its distance with each step
LIFT = 1e-6  # of the rim radius, by which a reflected ray starts off the surface it leaves
CURVATURE_MARGIN = 1.5  # on the hollowest of the points examined
SAMPLING_MARGIN = 1e-3  # of the rim radius; the lowest point is that of samples, and a valley is deeper between them


class Hits(NamedTuple):
    """Where n rays meet a mirror; NaN where not valid."""

    distance: Array
    """(n,) mm along the ray, in units of the length of its direction."""
    points: Array
    """(n, 3) mm, on the mirror."""
    normals: Array
    """(n, 3) unit vectors across the surface, towards the side of the lens."""
    valid: Mask
    """(n,) False for rays that miss, or meet the mirror from behind."""


class Reflections(NamedTuple):
    """How n rays leave a mirror; NaN where not valid."""

    points: Array
    """(n, 3) mm, on the mirror."""
    directions: Array
    """(n, 3) unit vectors of the reflected rays."""
    normals: Array
    """(n, 3) unit vectors towards the side of the lens."""
    valid: Mask
    """(n,) False for rays that miss, or that the mirror sends against itself."""


def reflect(directions: Array, normals: Array) -> Array:
    """Directions (n, 3) after reflection on surfaces of unit normals (n, 3).

    >>> reflect(np.array([[0.6, 0.0, 0.8]]), np.array([[0.0, 0.0, -1.0]]))
    array([[ 0.6,  0. , -0.8]])
    """
    across = np.einsum("...i,...i->...", directions, normals)
    reflected: Array = directions - 2 * across[..., None] * normals
    return reflected


def trace(mirror: Mirror, origins: ArrayLike, directions: ArrayLike) -> Reflections:
    """Reflect rays (n, 3), (n, 3) on a mirror.

    Rays that a hollow mirror would send against itself are not valid; a convex one cannot.

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
    points, outgoing, normals = (np.where(valid[:, None], a, np.nan) for a in (hits.points, outgoing, hits.normals))
    return Reflections(points, outgoing, normals, valid)


def intersect(mirror: Mirror, origins: ArrayLike, directions: ArrayLike) -> Hits:
    """First points at which rays (n, 3), (n, 3) meet the front of a mirror.

    Examples
    --------
    A ray that comes from behind meets the back first:

    >>> from omnimirror.optics.mirrors import Cone
    >>> hits = intersect(Cone(45.0, 20.0), [[10.0, 0.0, -5.0], [10.0, 0.0, 50.0]], [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    >>> hits.distance, hits.valid
    (array([15., nan]), array([ True, False]))
    """
    o, d = np.broadcast_arrays(np.asarray(origins, dtype=float), np.asarray(directions, dtype=float))
    o, d = np.atleast_2d(o), np.atleast_2d(d)
    distance = np.full(len(o), np.nan)
    points, normals = np.full((2, len(o), 3), np.nan)
    with np.errstate(all="ignore"):  # whatever comes out not finite is not valid
        for start in range(0, len(o), CHUNK):
            part = slice(start, start + CHUNK)
            rays = o[part].T, d[part].T
            t = _enter_conic(mirror, *rays) if isinstance(mirror, Conic) else _approach(mirror, *rays)
            distance[part] = t
            points[part] = o[part] + t[:, None] * d[part]
            normals[part] = normals_at(mirror, points[part])
    return Hits(distance, points, normals, ~np.isnan(distance))


def normals_at(mirror: Mirror, points: Array) -> Array:
    """Unit normals (n, 3) towards the side of the lens, at points (n, 3) of a mirror."""
    x, y = points[..., 0], points[..., 1]
    r = np.hypot(x, y)
    slope = mirror.slope(np.minimum(r, mirror.rim_radius_mm))
    cos, sin = _unit(x, y, r)
    length = np.sqrt(1 + slope**2)
    return np.stack([slope * cos / length, slope * sin / length, -1 / length], axis=-1)


@lru_cache(maxsize=64)
def hollowness(mirror: Mirror) -> float:
    """Upward curvature (1/mm) that the surface has against the sense of a convex one, 0 if it is convex.

    The two principal second derivatives of the sag over the plane are z'' and z'/x.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> hollowness(Sphere(50.0, 44.0))
    0.0
    """
    x = np.linspace(0.0, mirror.rim_radius_mm, 1025)
    _, slope, curvature = mirror.profile(x)
    lowest = float(min(curvature.min(), (slope[1:] / x[1:]).min()))
    rounding = 1e-9 * float(np.abs(curvature).max())
    return CURVATURE_MARGIN * -lowest if lowest < -rounding else 0.0


# -- pure conics -----------------------------------------------------------------------------------


def _enter_conic(mirror: Conic, o: Array, d: Array) -> Array:
    """Distance (n,) at which rays (3, n) enter the body ``r^2 - 2 R z + (1 + k) z^2 <= 0``; NaN where not.

    The body behind the surface is convex, so a ray enters it once at most: at the root where the
    quadratic form falls.
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
    on_it = (t >= 0) & (R - k1 * z > 0) & (x * x + y * y <= rim * rim) & np.isfinite(t)
    return np.where(on_it, t, np.nan)


# -- any mirror ------------------------------------------------------------------------------------


def _approach(mirror: Mirror, o: Array, d: Array) -> Array:
    """Distance (n,) of the first hit of rays (3, n), approached from the front; NaN where there is none."""
    rim, sink = mirror.rim_radius_mm, hollowness(mirror)
    t, end = _over_the_mirror(mirror, o, d)
    bend = sink * (d[0] ** 2 + d[1] ** 2)
    found = np.full(t.shape, np.nan)
    on_way = np.flatnonzero(t <= end)
    close = NEWTON_CLOSE * rim
    for step in range(MAX_STEPS):
        if not on_way.size:
            break
        s = t[on_way]
        g, rate = _height(mirror, o[:, on_way], d[:, on_way], s)
        if step == 0:
            inside = g > ROUNDING * rim  # it comes in behind the rim, or starts inside the body
            g = np.where(inside, np.nan, np.minimum(g, 0.0))
        forward = -2 * g / (rate + np.sqrt(rate * rate - 2 * bend[on_way] * g))
        forward = np.where(g >= 0, 0.0, forward)  # rounding has brought it through: it is there
        s = s + forward
        t[on_way] = s
        arrived = (forward <= close) & (rate > 0) & (s <= end[on_way] + close)
        found[on_way[arrived]] = s[arrived]
        on_way = on_way[(forward > close) & (s <= end[on_way])]  # NaN and infinity drop out
    return found


def _over_the_mirror(mirror: Mirror, o: Array, d: Array) -> tuple[Array, Array]:
    """First and last distance (n,) at which rays (3, n) are over the mirror's disk and not below its lowest point."""
    rim, ((_, _), (lowest, _)) = mirror.rim_radius_mm * (1 + ROUNDING), mirror.bounds
    lowest -= SAMPLING_MARGIN * rim
    a = d[0] ** 2 + d[1] ** 2
    b = o[0] * d[0] + o[1] * d[1]
    c = o[0] ** 2 + o[1] ** 2 - rim * rim
    root = np.sqrt(b * b - a * c)
    enter = np.where(b < 0, c / (root - b), (-b - root) / a)
    leave = np.where(b < 0, (root - b) / a, -c / (root + b))
    along = a == 0
    enter = np.where(along, np.where(c <= 0, -np.inf, np.nan), enter)
    leave = np.where(along, np.inf, leave)
    slab = np.where((d[2] > 0) & (o[2] < lowest), (lowest - o[2]) / d[2], 0.0)
    return np.maximum(np.maximum(enter, slab), 0.0), leave


def _height(mirror: Mirror, o: Array, d: Array, t: Array) -> tuple[Array, Array]:
    """g(t) and g'(t) (n,): height over the surface along rays (3, n), and its rate."""
    x, y, z = o + t * d
    r = np.sqrt(x * x + y * y)
    sag, slope, _ = mirror.profile(np.minimum(r, mirror.rim_radius_mm))
    cos, sin = _unit(x, y, r)
    return z - sag, d[2] - slope * (cos * d[0] + sin * d[1])


def _unit(x: Array, y: Array, r: Array) -> tuple[Array, Array]:
    """Cosine and sine of the azimuth; the axis itself counts as azimuth 0."""
    on_axis = r == 0
    safe = np.where(on_axis, 1.0, r)
    return np.where(on_axis, 1.0, x / safe), y / safe
