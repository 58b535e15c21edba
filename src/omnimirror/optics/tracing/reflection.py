"""Reflection of rays at a mirror: first intersection of skew rays, clearance at circular edges, and
reflection points between an entrance pupil and an object, by Fermat's principle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.native import backend, kernel_array
from ...base.numerics import NEWTON_TOLERANCE
from ...base.typing import Array, Mask
from ..mirrors import Mirror
from ..mirrors.mirror import NO_FORM, Conic, MirrorForm, SurfaceHeights
from .meridian import ROUNDING, trace_chief_rays

__all__ = [
    "CELLS",
    "CELLS_BEYOND_RIM",
    "LIFT",
    "MAX_STEPS",
    "MAX_STEP_LENGTH",
    "RAYS_PER_CHUNK",
    "REFLECTION_TOLERANCE",
    "RIM_SLACK",
    "TIP",
    "Hits",
    "MirrorSurface",
    "MirrorTables",
    "RayEndpoints",
    "ReflectionPoints",
    "Reflections",
    "circle_clearance",
    "continued_profile",
    "cubic_pieces",
    "footprint",
    "hollowness",
    "intersect",
    "meridian_table",
    "normals_at",
    "radii",
    "reflect",
    "specular_points",
    "trace",
]

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

RAYS_PER_CHUNK = 16384  # rays per chunk: their arrays fit in the cache
MAX_INTERSECTION_STEPS = 100  # a grazing ray halves its distance with each step
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
        for start in range(0, len(o), RAYS_PER_CHUNK):
            part = slice(start, start + RAYS_PER_CHUNK)
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
    cos, sin = _unit_radial(x, y, r)
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
    for step in range(MAX_INTERSECTION_STEPS):
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
    cos, sin = _unit_radial(x, y, r)
    return z - sag, d[2] - slope * (cos * d[0] + sin * d[1])


def _unit_radial(x: Array, y: Array, r: Array) -> tuple[Array, Array]:
    """Return cosine and sine of the azimuth; 0 on the axis."""
    on_axis = r == 0
    safe = np.where(on_axis, 1.0, r)
    return np.where(on_axis, 1.0, x / safe), y / safe


# -- Limits of the search --------------------------------------------------------------------------

MAX_STEPS = 60
MAX_STEP_LENGTH = (
    0.3  # relative to the rim radius, and to the distance from the apex of a pointed mirror
)
REFLECTION_TOLERANCE = 1e-9  # largest deviation from the law of reflection, as a sine
RIM_SLACK = 1e-9  # relative tolerance at the rim


# -- Ray endpoints and reflection points -----------------------------------------------------------


@dataclass(frozen=True)
class RayEndpoints:
    """Points (n, 3), mm, or unit vectors (n, 3) from the mirror if they are distant."""

    xyz: Array
    distant: bool = False

    @classmethod
    def of(cls, xyz: ArrayLike, distant: bool = False) -> RayEndpoints:
        """Create ends from any array-like; directions may have any non-zero length."""
        ends = np.atleast_2d(np.asarray(xyz, dtype=float))
        if distant:
            with np.errstate(invalid="ignore", divide="ignore"):
                ends = ends / np.linalg.norm(ends, axis=-1, keepdims=True)
        return cls(ends, distant)

    def __getitem__(self, index: slice | NDArray[np.integer]) -> RayEndpoints:
        return RayEndpoints(self.xyz[index], self.distant)

    def spread(self, count: int) -> RayEndpoints:
        """Return ``count`` ends, broadcast from one or as many."""
        return RayEndpoints(np.broadcast_to(self.xyz, (count, 3)), self.distant)


class ReflectionPoints(NamedTuple):
    """Mirror points of n pairs of ends; NaN if invalid, except for ``points``."""

    points: Array
    """(n, 3), mm; beyond the rim, on the mirror's smooth continuation."""
    normals: Array
    """(n, 3) unit vectors towards the lens side."""
    to_pupils: Array
    """(n, 3) unit vectors from the mirror points."""
    to_targets: Array
    """(n, 3) unit vectors from the mirror points."""
    path: Array
    """(n,), mm: optical path length; for a distant end, from a plane through the vertex."""
    reflects: Mask
    """(n,) True for a reflection with both ends in front of the (continued) surface."""
    valid: Mask
    """(n,) True if the point is also within the rim and the path is unobstructed."""
    facing_points: Array
    """(n, 3), mm: points of the mirror facing the pupils; a second mirror, if present."""

    @property
    def chief_slopes(self) -> Array:
        """Slopes (n, 2), against the axis, of the rays to the pupils."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes: Array = self.to_pupils[:, :2] / self.to_pupils[:, 2:]
        return slopes


# -- Continued mirror surface ----------------------------------------------------------------------


def continued_profile(mirror: Mirror, x: Array) -> tuple[Array, Array, Array]:
    """Return sag, slope and curvature of a mirror, continued beyond its rim by a parabola.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> [float(v) for v in continued_profile(Sphere(50.0, 30.0), np.array([32.0]))[0].round(6)]
    [11.578125]
    """
    inside = np.minimum(x, mirror.rim_radius_mm)
    sag, slope, curvature = mirror.profile(inside)
    beyond = x - inside
    bend = np.where(beyond > 0, np.maximum(curvature, 0.0), curvature)
    return sag + slope * beyond + bend * beyond**2 / 2, slope + bend * beyond, bend


class MirrorSurface:
    """Points of the continued surface over (x, y) with first and second derivatives."""

    def __init__(self, mirror: Mirror, xy: Array, form: MirrorForm = NO_FORM) -> None:
        x, y = xy[:, 0], xy[:, 1]
        r = np.hypot(x, y)
        sag, slope, bend = continued_profile(mirror, r)
        on_axis = r == 0
        safe = np.where(on_axis, 1.0, r)
        cos, sin = np.where(on_axis, 1.0, x / safe), y / safe
        hoop = np.where(on_axis, bend, slope / safe)
        self.points = np.stack([x, y, sag], axis=-1)
        self.slopes = np.stack([slope * cos, slope * sin], axis=-1)
        self.second = (
            bend * cos * cos + hoop * sin * sin,
            (bend - hoop) * cos * sin,
            bend * sin * sin + hoop * cos * cos,
        )
        if not form.is_empty:
            self._add(form.heights(mirror.rim_radius_mm, xy))

    def _add(self, form: SurfaceHeights) -> None:
        self.points[:, 2] += form.z
        self.slopes += np.stack([form.gx, form.gy], axis=-1)
        xx, xy, yy = self.second
        self.second = xx + form.hxx, xy + form.hxy, yy + form.hyy

    @property
    def tangents(self) -> Array:
        """Derivatives (n, 2, 3) of the points with respect to x and y."""
        tangents = np.zeros((len(self.points), 2, 3))
        tangents[:, 0, 0] = tangents[:, 1, 1] = 1.0
        tangents[:, :, 2] = self.slopes
        return tangents

    @property
    def bend(self) -> Array:
        """Second derivatives (n, 2, 2) of the height over (x, y)."""
        xx, xy, yy = self.second
        return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=1)

    @property
    def normals(self) -> Array:
        """Unit normals (n, 3) towards the lens side."""
        normals = np.concatenate([self.slopes, np.full((len(self.points), 1), -1.0)], axis=1)
        unit: Array = normals / np.sqrt(np.einsum("ni,ni->n", normals, normals))[:, None]
        return unit


# -- Lookup tables ---------------------------------------------------------------------------------

CELLS = 1024  # from vertex to rim: cubic pieces of sag and slope are accurate to 1e-9 mm and 1e-9
CELLS_BEYOND_RIM = 256  # cells of the same width beyond the rim, for iterates outside the mirror
TIP = 1e-3  # of the rim radius: initial points keep this distance from an apex


@dataclass(frozen=True)
class MirrorTables:
    """Tables of a mirror, in cubic pieces of four coefficients for each function.

    Parameters
    ----------
    meridian : (n, 8)
        Sag and slope as functions of the distance from the axis, ``cell_mm`` per piece.
    by_omega : (m, 4)
        Distance from the axis as a function of the field angle about ``middle_mm``, between
        ``omegas``.
    depth : (k, 4) or None
        Depth from the lens as a function of the ray's tangent, up to ``max_tangent``; None if
        telecentric.
    rim_mm, min_radius_mm
        Radius of the rim, and of the excluded zone about the apex of a pointed mirror.
    """

    meridian: Array
    by_omega: Array
    depth: Array | None
    cell_mm: float
    omegas: tuple[float, float]
    middle_mm: float
    max_tangent: float
    rim_mm: float
    min_radius_mm: float

    @classmethod
    def of(cls, mirror: Mirror, pupil_distance: float) -> MirrorTables:
        """Create tables for a pupil at a distance (mm) from the vertex, infinite if telecentric."""
        rim = mirror.rim_radius_mm
        x = np.linspace(0.0, rim, 4 * CELLS + 1)
        rays = trace_chief_rays(mirror, pupil_distance, x)
        omegas = float(rays.omega[0]), float(rays.omega[-1])
        even = np.interp(np.linspace(*omegas, CELLS + 1), rays.omega, x)
        depth, max_tangent = None, 0.0
        if np.isfinite(pupil_distance):
            max_tangent = float(x[-1] / rays.w[-1])
            depth = _depths(
                mirror, pupil_distance, np.linspace(0.0, max_tangent, CELLS + 1), x, rays.w
            )
        return cls(
            meridian_table(mirror),
            cubic_pieces(even, np.gradient(even)),
            depth,
            rim / CELLS,
            omegas,
            float(rays.z[2 * CELLS] + rays.viewpoint_offset()[2 * CELLS]),
            max_tangent,
            rim,
            TIP * rim if mirror.is_pointed else 0.0,
        )

    def surface(self, pupil: tuple[float, ...], telecentric: bool) -> tuple[Any, ...]:
        """Return kernel arguments of the surface, including the lens position."""
        return (self.meridian, self.cell_mm, self.rim_mm, self.min_radius_mm, *pupil, telecentric)


def radii(mirror: Mirror, cells: int = CELLS) -> Array:
    """Return the nodes (n,), mm, of the tables, one of them at the rim."""
    beyond = cells * CELLS_BEYOND_RIM // CELLS
    return np.linspace(0.0, (cells + beyond) / cells * mirror.rim_radius_mm, cells + beyond + 1)


def meridian_table(mirror: Mirror, cells: int = CELLS) -> Array:
    """Return cubic pieces (n, 8) of sag and slope, four coefficients each, between the nodes.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> table = meridian_table(Sphere(50.0, 40.0))
    >>> table.shape, table[768, [0, 4]]  # at 30 mm: sag 10 mm, slope 0.75
    ((1280, 8), array([10.  ,  0.75]))
    """
    sag, slope, curvature = continued_profile(mirror, radii(mirror, cells))
    step = mirror.rim_radius_mm / cells
    return np.concatenate(
        [cubic_pieces(sag, slope * step), cubic_pieces(slope, curvature * step)], axis=1
    )


def cubic_pieces(values: Array, rates: Array) -> Array:
    """Return the coefficients (n, 4) of cubic Hermite pieces between n + 1 nodes.

    >>> cubic_pieces(np.array([0.0, 1.0, 8.0]), np.array([0.0, 3.0, 12.0]))[1]  # t^3 about 1
    array([1., 3., 3., 1.])
    """
    rise = np.diff(values)
    low, high = rates[:-1], rates[1:]
    return np.stack([values[:-1], low, 3 * rise - 2 * low - high, low + high - 2 * rise], axis=1)


def _depths(
    mirror: Mirror, distance: float, tangents: np.ndarray, x: np.ndarray, w: np.ndarray
) -> np.ndarray:
    """Return pieces (n, 4) of the mirror's depth from the lens, by tangents."""
    r = np.interp(tangents, x / w, x)
    for _ in range(4):
        sag, slope, _ = mirror.profile(r)
        r = np.clip(
            r - (r - (distance + sag) * tangents) / (1 - slope * tangents),
            0.0,
            mirror.rim_radius_mm,
        )
    sag, slope, _ = mirror.profile(r)
    growth = slope * (distance + sag) / (1 - slope * tangents)
    return cubic_pieces(distance + sag, growth * (tangents[1] - tangents[0]))


# -- Initial values from compiled kernels ----------------------------------------------------------
#
# They are accurate to the table's interpolation error: one or two Newton steps on the actual surface
# complete the solution.

SETTLED = 1e-7  # relative to the rim radius: convergence is quadratic from here
VISIBLE, NOT_CONVERGED = 1, 2  # states returned by the kernel
STEPS, FIRST_STEPS = 24, 6
FIRST_CLOSE = 3e-5  # relative to the rim radius: limit of the first search
REACH = (CELLS + CELLS_BEYOND_RIM) / CELLS
MIN_PAIRS = 200  # pairs below which the tables do not pay off
MIN_LENS_DISTANCE = 1e-3  # minimum lens distance from the vertex, relative to the rim radius


class Search(NamedTuple):
    """Limits of a kernel search: Newton steps in space and in the meridian, tolerances, extent."""

    steps: int
    first_steps: int
    first_close: float
    reach: float

    def until(self, close: float, aside: float = 0.0) -> tuple[float, ...]:
        """Return kernel arguments, with a tolerance limited by the decentring."""
        return (
            self.steps,
            self.first_steps,
            close,
            max(self.first_close, aside),
            MAX_STEP_LENGTH,
            self.reach,
            RIM_SLACK,
        )


SEARCH = Search(STEPS, FIRST_STEPS, FIRST_CLOSE, REACH)


def compiled_reflection_points(
    mirror: Mirror, form: MirrorForm, pupils: RayEndpoints, targets: RayEndpoints
) -> Array | None:
    """Return the points (n, 2), mm, of a convex mirror that image targets in one pupil.

    NaN without convergence; None if kernels do not apply.
    """
    xyz = pupils.xyz
    if (
        len(xyz) < MIN_PAIRS
        or not backend.is_compiled
        or not form.is_empty
        or (xyz != xyz[0]).any()
    ):
        return None
    x, y, z = (float(part) for part in xyz[0])
    tables = _tables(
        mirror, np.inf if pupils.distant else max(-z, MIN_LENS_DISTANCE * mirror.rim_radius_mm)
    )
    if tables is None or z == 0:
        return None
    count = len(targets.xyz)
    coordinates, rows, states = (
        kernel_array(targets.xyz.T),
        np.empty((8, count)),
        np.empty(count, np.uint8),
    )
    backend.kernels.find_reflections(
        tables.surface((x, y, z), pupils.distant),
        SEARCH.until(SETTLED, float(np.hypot(x, y)) / abs(z)),
        tables.by_omega,
        tables.omegas,
        tables.middle_mm,
        targets.distant,
        coordinates,
        rows,
        states,
    )
    a, b, c = rows[5:]
    is_shortest = (states != NOT_CONVERGED) & (a > 0) & (a * c > b * b)
    positions: Array = np.where(is_shortest, rows[:2], np.nan).T.copy()
    return positions


@lru_cache(maxsize=32)
def _tables(mirror: Mirror, distance: float) -> MirrorTables | None:
    """Return the tables of a smooth convex mirror with increasing field angle."""
    if mirror.is_pointed or hollowness(mirror) > 0:
        return None
    tables = MirrorTables.of(mirror, distance)
    rises = np.isfinite(tables.by_omega).all() and tables.omegas[1] > tables.omegas[0]
    return tables if rises and (tables.by_omega[:, 1] >= 0).all() else None


# -- Reflection point by Fermat's principle --------------------------------------------------------
#
# The optical path length from the object over the mirror to the pupil is stationary. On a convex
# mirror seen from its front, every stationary path is a strict minimum: the Hessian over the surface
# is the sum of two non-negative terms of the distances and of the surface curvature times
# ``2 cos(gamma)``. A damped Newton method therefore minimises the path length. The result is
# verified: the law of reflection holds, both ends are in front of the surface, the point is within
# the rim, and a concave zone of the mirror does not block the path.
#
# All coordinates are in the mirror frame. An end is a point, or the direction of a distant point.

Shape = tuple[Mirror, MirrorForm]

CHUNK = 1 << 13  # pairs per chunk: their arrays fit in the cache
PATH_ROUNDING = 1e-12  # relative increase of the path attributed to rounding
GUESS_NODES = 129
RESTARTS = 8  # around the apex of a pointed mirror


def specular_points(
    mirror: Mirror,
    pupils: RayEndpoints,
    targets: RayEndpoints,
    start: Array | None = None,
    form: MirrorForm = NO_FORM,
) -> ReflectionPoints:
    """Return the mirror points that image targets in pupils.

    Parameters
    ----------
    pupils, targets : Ends of n, or of 1
        Entrance-pupil points, and targets.
    start : (n, 2) mm, optional
        Initial points (x, y) on the mirror; by default the solution for a pupil on the axis.
    form
        Form error of the mirror.

    Examples
    --------
    Alhazen's problem, section 10: a ball of 50 mm, pupil and object symmetric about a line at 45
    deg:

    >>> from omnimirror.optics.mirrors import Sphere
    >>> pupils, targets = RayEndpoints.of([0.0, 0.0, -100.0]), RayEndpoints.of([150.0, 0.0, 50.0])
    >>> found = specular_points(Sphere(50.0, 44.0), pupils, targets)
    >>> found.points.round(6) + 0.0, found.valid  # 50 sin 45, 50 - 50 cos 45
    (array([[35.355339,  0.      , 14.644661]]), array([ True]))
    """
    (count,) = np.broadcast_shapes((len(pupils.xyz),), (len(targets.xyz),))
    pupils, targets = pupils.spread(count), targets.spread(count)
    xy = np.empty((count, 2))
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
        first = (
            _first((mirror, form), pupils, targets)
            if start is None
            else np.broadcast_to(start, (count, 2))
        )
        for row in range(0, count, CHUNK):
            part = slice(row, row + CHUNK)
            xy[part] = _shortest((mirror, form), pupils[part], targets[part], first[part])
        if mirror.is_pointed:
            _restart_from_tip((mirror, form), pupils, targets, xy)
        return _verified((mirror, form), pupils, targets, xy)


def _first(shape: Shape, pupils: RayEndpoints, targets: RayEndpoints) -> Array:
    """Return initial points (n, 2), mm: from compiled kernels if available, otherwise estimates."""
    positions = compiled_reflection_points(*shape, pupils, targets)
    if positions is None:
        return guess(shape[0], pupils, targets)
    unsolved = np.flatnonzero(np.isnan(positions[:, 0]))
    positions[unsolved] = guess(shape[0], pupils[unsolved], targets[unsolved])
    return positions


def guess(mirror: Mirror, pupils: RayEndpoints, targets: RayEndpoints) -> Array:
    """Return the mirror points (n, 2), mm, of the targets' directions for a pupil on the axis at
    the same distance."""
    if not len(pupils.xyz):
        return np.empty((0, 2))
    m = (
        np.inf
        if pupils.distant
        else max(-float(np.median(pupils.xyz[:, 2])), 1e-3 * mirror.rim_radius_mm)
    )
    table = trace_chief_rays(mirror, m, np.linspace(0.0, mirror.rim_radius_mm, GUESS_NODES))
    midpoint = table.z[GUESS_NODES // 2] + table.viewpoint_offset()[GUESS_NODES // 2]
    towards = targets.xyz if targets.distant else targets.xyz - [0.0, 0.0, midpoint]
    across = np.hypot(towards[:, 0], towards[:, 1])
    x = np.interp(np.arctan2(across, -towards[:, 2]), table.omega, table.x)
    if mirror.is_pointed:
        x = np.maximum(x, 1e-3 * mirror.rim_radius_mm)
    azimuth = np.arctan2(towards[:, 1], towards[:, 0])
    return np.stack([x * np.cos(azimuth), x * np.sin(azimuth)], axis=-1)


def footprint(
    mirror: Mirror,
    pupils: RayEndpoints,
    targets: RayEndpoints,
    reflections: ReflectionPoints,
    motion: Array,
    form: MirrorForm = NO_FORM,
) -> Array:
    """Return the footprint (n,), mm^2 on the plane z = 0, per unit of pupil motion.

    Parameters
    ----------
    mirror
        Mirror.
    pupils, targets
        Ends of the light paths.
    reflections
        Result of :func:`specular_points` for the same ends.
    motion : (2, 3) or (n, 2, 3)
        Derivatives of an entrance pupil's ``xyz`` by its two coordinates.
    form
        Form error of the mirror.

    Notes
    -----
    The gradient of the path stays 0 while the pupil moves; the point therefore moves by the inverse
    of the path's Hessian times the mixed derivative.
    """
    count = len(reflections.points)
    pupils, targets = pupils.spread(count), targets.spread(count)
    with np.errstate(all="ignore"):
        surface = MirrorSurface(mirror, reflections.points[:, :2], form)
        _, _, (a, b, c) = _path(surface, pupils, targets)
        motion = direction_derivatives(pupils, reflections.points, motion)
        mixed = np.linalg.det(motion @ surface.tangents.transpose(0, 2, 1))
        area: Array = np.abs(mixed / (a * c - b * b))
    return area


def direction_derivatives(pupils: RayEndpoints, points: Array, motion: Array) -> Array:
    """Return the derivatives (n, 2, 3) of the directions from points (n, 3) to moving pupils.

    The direction u from a pupil at distance d turns by the part of the motion across it:
    (motion - (motion u) u) / d. Motions of a distant pupil are those of its direction already.
    """
    motion = np.broadcast_to(motion, (len(points), 2, 3))
    if pupils.distant:
        return motion
    step = points - pupils.xyz
    distance = np.linalg.norm(step, axis=1)[:, None, None]
    u = step[:, :, None] / distance
    derivatives: Array = (motion - (motion @ u) * u.transpose(0, 2, 1)) / distance
    return derivatives


def _path(
    surface: MirrorSurface, pupils: RayEndpoints, targets: RayEndpoints
) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return path length (n,), gradient (n, 2) and second derivatives (xx, xy, yy)."""
    length = np.zeros(len(surface.points))
    pull = np.zeros_like(surface.points)
    sx, sy = surface.slopes.T
    xx, xy, yy = (np.zeros_like(length) for _ in range(3))
    for end in (pupils, targets):
        if end.distant:
            length -= np.einsum("ni,ni->n", end.xyz, surface.points)
            pull -= end.xyz
            continue
        step = surface.points - end.xyz
        distance = np.sqrt(np.einsum("ni,ni->n", step, step))
        u = step / distance[:, None]
        length += distance
        pull += u
        ux, uy = u[:, 0] + sx * u[:, 2], u[:, 1] + sy * u[:, 2]
        # Hessian of |p - e| over the surface: (t_i . t_j - (u . t_i)(u . t_j)) / |p - e| + u_z z_ij
        xx += (1 + sx * sx - ux * ux) / distance
        xy += (sx * sy - ux * uy) / distance
        yy += (1 + sy * sy - uy * uy) / distance
    gradient = pull[:, :2] + surface.slopes * pull[:, 2:]
    a, b, c = surface.second
    return length, gradient, (xx + pull[:, 2] * a, xy + pull[:, 2] * b, yy + pull[:, 2] * c)


def _shortest(shape: Shape, pupils: RayEndpoints, targets: RayEndpoints, start: Array) -> Array:
    """Return (x, y) (n, 2) of the shortest paths, by descent from initial points."""
    rim, pointed = shape[0].rim_radius_mm, shape[0].is_pointed
    best_path = np.array(start)
    trial, step, length = (
        best_path.copy(),
        np.zeros_like(best_path),
        np.full(len(best_path), np.inf),
    )
    active = np.arange(len(best_path))
    for _ in range(MAX_STEPS):
        pupil, target = pupils[active], targets[active]
        new_length, gradient, second = _path(
            MirrorSurface(shape[0], trial[active], shape[1]), pupil, target
        )
        down = new_length <= length[active] * (1 + PATH_ROUNDING) + PATH_ROUNDING * rim
        is_shorter = active[down]
        best_path[is_shorter], length[is_shorter] = trial[is_shorter], new_length[down]
        max_step = MAX_STEP_LENGTH * (np.hypot(*best_path[is_shorter].T) if pointed else rim)
        step[is_shorter] = _downhill(gradient[down], tuple(s[down] for s in second), max_step)
        step[active[~down]] /= 4
        trial[active] = best_path[active] + step[active]
        size = np.hypot(*step[active].T)
        arrived = down & (size <= NEWTON_TOLERANCE * rim)
        best_path[active[arrived]] = trial[active[arrived]]
        active = active[~arrived & np.isfinite(size)]
        if not active.size:
            break
    return best_path


def _restart_from_tip(shape: Shape, pupils: RayEndpoints, targets: RayEndpoints, xy: Array) -> None:
    """Restart around the apex if the descent ended at the apex, which does not reflect."""
    for azimuth in np.arange(RESTARTS) * 2 * np.pi / RESTARTS:
        at_tip = np.flatnonzero(~_verified(shape, pupils, targets, xy).reflects)
        if not at_tip.size:
            return
        start = shape[0].rim_radius_mm / 2 * np.array([np.cos(azimuth), np.sin(azimuth)])
        xy[at_tip] = _shortest(
            shape, pupils[at_tip], targets[at_tip], np.broadcast_to(start, (at_tip.size, 2))
        )


def _downhill(gradient: Array, second: tuple[Array, ...], max_step: Array | float) -> Array:
    """Return Newton or gradient steps (n, 2), limited to ``reach``."""
    a, b, c = second
    gx, gy = gradient.T
    det = a * c - b * b
    newton = np.stack([b * gy - c * gx, b * gx - a * gy], axis=-1) / det[:, None]
    slope = np.hypot(gx, gy)
    steepest = -gradient * (max_step / np.where(slope > 0, slope, 1.0))[:, None]
    step = np.where(((det > 0) & (a > 0))[:, None], newton, steepest)
    size = np.hypot(*step.T)
    limited: Array = step * np.where(size > max_step, max_step / size, 1.0)[:, None]
    return limited


def _verified(
    shape: Shape, pupils: RayEndpoints, targets: RayEndpoints, xy: Array
) -> ReflectionPoints:
    """Verify mirror points and return their rays."""
    mirror, surface = shape[0], MirrorSurface(shape[0], xy, shape[1])
    length, gradient, _ = _path(surface, pupils, targets)
    points, slopes, normals = surface.points, surface.slopes, surface.normals
    to_pupils, to_targets = (
        end.xyz if end.distant else _unit(end.xyz - points) for end in (pupils, targets)
    )
    faces_both = (np.einsum("ni,ni->n", to_pupils, normals) > 0) & (
        np.einsum("ni,ni->n", to_targets, normals) > 0
    )
    miss = np.hypot(*gradient.T) / np.sqrt(1 + np.einsum("ni,ni->n", slopes, slopes))
    reflects = faces_both & (miss <= REFLECTION_TOLERANCE)
    valid = reflects & (np.hypot(*xy.T) <= mirror.rim_radius_mm * (1 + RIM_SLACK))
    if hollowness(mirror) > 0 and valid.any():
        for end, towards in ((pupils, to_pupils), (targets, to_targets)):
            lifted = points[valid] + LIFT * mirror.rim_radius_mm * towards[valid]
            hit = intersect(mirror, lifted, towards[valid]).distance
            away = np.inf if end.distant else np.linalg.norm(end.xyz[valid] - lifted, axis=1)
            valid[valid] = ~(hit < away)
    blank = np.where(reflects, 1.0, np.nan)
    return ReflectionPoints(
        points,
        normals * blank[:, None],
        to_pupils * blank[:, None],
        to_targets * blank[:, None],
        length * blank,
        reflects,
        valid,
        points,
    )


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
