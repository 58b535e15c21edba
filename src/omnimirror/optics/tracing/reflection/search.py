"""Reflection point between an entrance pupil and an object, for any positions (Fermat's principle).

The optical path length from the object over the mirror to the pupil is stationary. On a convex
mirror seen from its front, every stationary path is a strict minimum: the Hessian over the surface
is the sum of two non-negative terms of the distances and of the surface curvature times
``2 cos(gamma)``. A damped Newton method therefore minimises the path length. The result is
verified: the law of reflection holds, both ends are in front of the surface, the point is within
the rim, and a concave zone of the mirror does not block the path.

All coordinates are in the mirror frame. An end is a point, or the direction of a distant point.
"""

from __future__ import annotations

import numpy as np

from ....base.numerics.roots import NEWTON_CLOSE
from ....base.typing import Array
from ...mirrors import Mirror
from ...mirrors.form import NO_FORM, MirrorForm
from ..meridian import trace_chief_rays
from ..space import LIFT, hollowness, intersect
from .beginning import compiled_places
from .ends import Ends, Specular
from .limits import LONGEST_STEP, MAX_STEPS, REFLECTS, RIM_SLACK
from .surface import Surface

Shape = tuple[Mirror, MirrorForm]

CHUNK = 1 << 13  # pairs per chunk: their arrays fit in the cache
UPHILL = 1e-12  # relative increase of the path attributed to rounding
GUESS_NODES = 129
RESTARTS = 8  # around the apex of a pointed mirror


def specular_points(
    mirror: Mirror, pupils: Ends, targets: Ends, start: Array | None = None, form: MirrorForm = NO_FORM
) -> Specular:
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
    >>> pupils, targets = Ends.of([0.0, 0.0, -100.0]), Ends.of([150.0, 0.0, 50.0])
    >>> found = specular_points(Sphere(50.0, 44.0), pupils, targets)
    >>> found.points.round(6) + 0.0, found.valid  # 50 sin 45, 50 - 50 cos 45
    (array([[35.355339,  0.      , 14.644661]]), array([ True]))
    """
    (count,) = np.broadcast_shapes((len(pupils.xyz),), (len(targets.xyz),))
    pupils, targets = pupils.spread(count), targets.spread(count)
    xy = np.empty((count, 2))
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
        first = _first((mirror, form), pupils, targets) if start is None else np.broadcast_to(start, (count, 2))
        for begin in range(0, count, CHUNK):
            part = slice(begin, begin + CHUNK)
            xy[part] = _shortest((mirror, form), pupils[part], targets[part], first[part])
        if mirror.is_pointed:
            _leave_the_tip((mirror, form), pupils, targets, xy)
        return _proven((mirror, form), pupils, targets, xy)


def _first(shape: Shape, pupils: Ends, targets: Ends) -> Array:
    """Return initial points (n, 2), mm: from compiled kernels if available, otherwise estimates."""
    places = compiled_places(*shape, pupils, targets)
    if places is None:
        return guess(shape[0], pupils, targets)
    lost = np.flatnonzero(np.isnan(places[:, 0]))
    places[lost] = guess(shape[0], pupils[lost], targets[lost])
    return places


def guess(mirror: Mirror, pupils: Ends, targets: Ends) -> Array:
    """Return the mirror points (n, 2), mm, of the targets' directions for a pupil on the axis at
    the same distance."""
    if not len(pupils.xyz):
        return np.empty((0, 2))
    m = np.inf if pupils.distant else max(-float(np.median(pupils.xyz[:, 2])), 1e-3 * mirror.rim_radius_mm)
    table = trace_chief_rays(mirror, m, np.linspace(0.0, mirror.rim_radius_mm, GUESS_NODES))
    middle = table.z[GUESS_NODES // 2] + table.viewpoint_offset()[GUESS_NODES // 2]
    towards = targets.xyz if targets.distant else targets.xyz - [0.0, 0.0, middle]
    across = np.hypot(towards[:, 0], towards[:, 1])
    x = np.interp(np.arctan2(across, -towards[:, 2]), table.omega, table.x)
    if mirror.is_pointed:
        x = np.maximum(x, 1e-3 * mirror.rim_radius_mm)
    azimuth = np.arctan2(towards[:, 1], towards[:, 0])
    return np.stack([x * np.cos(azimuth), x * np.sin(azimuth)], axis=-1)


def footprint(
    mirror: Mirror, pupils: Ends, targets: Ends, found: Specular, motion: Array, form: MirrorForm = NO_FORM
) -> Array:
    """Return the footprint (n,), mm^2 on the plane z = 0, per unit of pupil motion.

    Parameters
    ----------
    found
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
    count = len(found.points)
    pupils, targets = pupils.spread(count), targets.spread(count)
    with np.errstate(all="ignore"):
        surface = Surface(mirror, found.points[:, :2], form)
        _, _, (a, b, c) = _path(surface, pupils, targets)
        motion = np.broadcast_to(motion, (count, 2, 3))
        if not pupils.distant:
            step = found.points - pupils.xyz
            distance = np.linalg.norm(step, axis=1)[:, None, None]
            u = step[:, :, None] / distance
            motion = (motion - (motion @ u) * u.transpose(0, 2, 1)) / distance
        mixed = np.linalg.det(motion @ surface.tangents.transpose(0, 2, 1))
        area: Array = np.abs(mixed / (a * c - b * b))
    return area


def _path(surface: Surface, pupils: Ends, targets: Ends) -> tuple[Array, Array, tuple[Array, Array, Array]]:
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


def _shortest(shape: Shape, pupils: Ends, targets: Ends, start: Array) -> Array:
    """Return (x, y) (n, 2) of the shortest paths, by descent from initial points."""
    rim, pointed = shape[0].rim_radius_mm, shape[0].is_pointed
    best = np.array(start)
    trial, step, length = best.copy(), np.zeros_like(best), np.full(len(best), np.inf)
    active = np.arange(len(best))
    for _ in range(MAX_STEPS):
        pupil, target = pupils[active], targets[active]
        new_length, gradient, second = _path(Surface(shape[0], trial[active], shape[1]), pupil, target)
        down = new_length <= length[active] * (1 + UPHILL) + UPHILL * rim
        taken = active[down]
        best[taken], length[taken] = trial[taken], new_length[down]
        reach = LONGEST_STEP * (np.hypot(*best[taken].T) if pointed else rim)
        step[taken] = _downhill(gradient[down], tuple(s[down] for s in second), reach)
        step[active[~down]] /= 4
        trial[active] = best[active] + step[active]
        size = np.hypot(*step[active].T)
        arrived = down & (size <= NEWTON_CLOSE * rim)
        best[active[arrived]] = trial[active[arrived]]
        active = active[~arrived & np.isfinite(size)]
        if not active.size:
            break
    return best


def _leave_the_tip(shape: Shape, pupils: Ends, targets: Ends, xy: Array) -> None:
    """Restart around the apex if the descent ended at the apex, which does not reflect."""
    for azimuth in np.arange(RESTARTS) * 2 * np.pi / RESTARTS:
        lost = np.flatnonzero(~_proven(shape, pupils, targets, xy).reflects)
        if not lost.size:
            return
        start = shape[0].rim_radius_mm / 2 * np.array([np.cos(azimuth), np.sin(azimuth)])
        xy[lost] = _shortest(shape, pupils[lost], targets[lost], np.broadcast_to(start, (lost.size, 2)))


def _downhill(gradient: Array, second: tuple[Array, ...], reach: Array | float) -> Array:
    """Return Newton or gradient steps (n, 2), limited to ``reach``."""
    a, b, c = second
    gx, gy = gradient.T
    det = a * c - b * b
    newton = np.stack([b * gy - c * gx, b * gx - a * gy], axis=-1) / det[:, None]
    slope = np.hypot(gx, gy)
    steepest = -gradient * (reach / np.where(slope > 0, slope, 1.0))[:, None]
    step = np.where(((det > 0) & (a > 0))[:, None], newton, steepest)
    size = np.hypot(*step.T)
    limited: Array = step * np.where(size > reach, reach / size, 1.0)[:, None]
    return limited


def _proven(shape: Shape, pupils: Ends, targets: Ends, xy: Array) -> Specular:
    """Verify mirror points and return their rays."""
    mirror, surface = shape[0], Surface(shape[0], xy, shape[1])
    length, gradient, _ = _path(surface, pupils, targets)
    points, slopes, normals = surface.points, surface.slopes, surface.normals
    to_pupils, to_targets = (end.xyz if end.distant else _unit(end.xyz - points) for end in (pupils, targets))
    faces_both = (np.einsum("ni,ni->n", to_pupils, normals) > 0) & (np.einsum("ni,ni->n", to_targets, normals) > 0)
    miss = np.hypot(*gradient.T) / np.sqrt(1 + np.einsum("ni,ni->n", slopes, slopes))
    reflects = faces_both & (miss <= REFLECTS)
    valid = reflects & (np.hypot(*xy.T) <= mirror.rim_radius_mm * (1 + RIM_SLACK))
    if hollowness(mirror) > 0 and valid.any():
        for end, towards in ((pupils, to_pupils), (targets, to_targets)):
            lifted = points[valid] + LIFT * mirror.rim_radius_mm * towards[valid]
            hit = intersect(mirror, lifted, towards[valid]).distance
            away = np.inf if end.distant else np.linalg.norm(end.xyz[valid] - lifted, axis=1)
            valid[valid] = ~(hit < away)
    blank = np.where(reflects, 1.0, np.nan)
    return Specular(
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
