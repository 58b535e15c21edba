"""As-built mirror with form error and pose, traced in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ..mirrors import Mirror
from ..mirrors.form import NO_FORM, MirrorForm
from ..mirrors.pose import MirrorPose
from . import reflection
from .edges import past_circle
from .reflection import RIM_SLACK, Ends, Specular, Surface
from .space import Reflections, reflect, trace

FORM_STEPS = 12
FORM_CLOSE = 1e-12  # rounding tolerance of heights, relative to the rim radius


@dataclass(frozen=True)
class PosedMirror:
    """Mirror with form error and pose; the origin of the camera frame is its nominal vertex.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> posed = PosedMirror(Sphere(50.0, 44.0), MirrorPose(decentre_x_mm=1.0))
    >>> posed.trace(np.array([[1.0, 0.0, -100.0]]), np.array([[0.0, 0.0, 1.0]])).points + 0.0  # the vertex
    array([[1., 0., 0.]])
    """

    mirror: Mirror
    pose: MirrorPose
    form: MirrorForm = NO_FORM

    def trace(self, origins: Array, directions: Array) -> Reflections:
        """Reflect rays (n, 3), (n, 3); see :func:`omnimirror.optics.tracing.space.trace`."""
        turned = self.pose.turned_to_mirror(directions)
        found = trace_formed(self.mirror, self.form, self.pose.to_mirror(origins), turned)
        turn = self.pose.turned_to_camera
        return Reflections(self.pose.to_camera(found.points), turn(found.directions), turn(found.normals), found.valid)

    def specular(self, pupils: Ends, targets: Ends, start: Array | None = None) -> Specular:
        """Return the mirror points (n, 3) that image targets; see :mod:`.reflection`.

        ``start`` are initial points (n, 3), mm. Paths of distant ends are measured from the camera
        frame's origin.
        """
        begin = None if start is None else self.pose.to_mirror(start)[..., :2]
        found = reflection.specular_points(self.mirror, self.inside(pupils), self.inside(targets), begin, self.form)
        turn = self.pose.turned_to_camera
        path = found.path
        for end in (pupils, targets):
            if end.distant:
                path = path - end.xyz @ self.pose.shift
        points = self.pose.to_camera(found.points)
        return found._replace(
            points=points,
            seen_at=points,
            normals=turn(found.normals),
            to_pupils=turn(found.to_pupils),
            to_targets=turn(found.to_targets),
            path=path,
        )

    def beam(self, pupils: Ends, targets: Ends, found: Specular, motion: Array) -> Array:
        """Return the light (n,) per unit of pupil motion (2, 3) or (n, 2, 3).

        Cross-section (mm^2) of the beam from a distant target, or solid angle (sr) for a near one.
        """
        inside = found._replace(points=self.pose.to_mirror(found.points))
        area = reflection.footprint(
            self.mirror,
            self.inside(pupils),
            self.inside(targets),
            inside,
            self.pose.turned_to_mirror(motion),
            self.form,
        )
        upright = np.abs(self.pose.turned_to_mirror(found.normals)[:, 2])
        cos_incidence = np.einsum("ni,ni->n", found.normals, found.to_targets)
        section: Array = area * cos_incidence / upright
        if not targets.distant:
            section /= np.einsum("ni,ni->n", targets.xyz - found.points, targets.xyz - found.points)
        return section

    def left_at(self, found: Specular) -> Array:
        """Return the points (n, 3) at which rays leave the mirror."""
        return found.points

    def objects_at(self, found: Specular, distances: Array) -> Array:
        """Return objects (n, 3) at distances (n,), mm, from their mirror points, on their rays."""
        objects: Array = found.points + distances[:, None] * found.to_targets
        return objects

    def clearances(self, seen_at: Array, points: Array, to_pupils: Array, to_targets: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays through points (n, 3) at the rim."""
        inside = self.pose.to_mirror(points)
        return {"mirror": -past_circle(inside[:, :2], self.mirror.rim_radius_mm * (1 + RIM_SLACK))}

    def inside(self, ends: Ends) -> Ends:
        """Convert ends from the camera frame to the mirror frame."""
        turn = self.pose.turned_to_mirror if ends.distant else self.pose.to_mirror
        return Ends(turn(ends.xyz), ends.distant)


def trace_formed(mirror: Mirror, form: MirrorForm, origins: Array, directions: Array) -> Reflections:
    """Reflect rays (n, 3), (n, 3) on a mirror with a form error; see :func:`.space.trace`.

    Form errors are of the order of micrometres: a few steps of Newton's method along the ray lead
    from the nominal to the actual surface. Rays that miss the nominal mirror are invalid; the
    nominal meridian defines the rim.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> higher = MirrorForm((1,), (2.0,))  # by 2 um, everywhere
    >>> formed = trace_formed(Sphere(50.0, 44.0), higher, np.array([[30.0, 0.0, -100.0]]), np.array([[0.0, 0.0, 1.0]]))
    >>> formed.points
    array([[30.   ,  0.   , 10.002]])
    """
    found = trace(mirror, origins, directions)
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
    """Return ray intersections (n, 3), the surface there, and convergence flags."""
    close = FORM_CLOSE * mirror.rim_radius_mm
    surface = Surface(mirror, points[:, :2], form)
    for _ in range(FORM_STEPS):
        over = points[:, 2] - surface.points[:, 2]
        if not (np.abs(over) > close).any():
            break
        rate = way[:, 2] - (surface.slopes * way[:, :2]).sum(axis=1)
        points = points - (over / rate)[:, None] * way
        surface = Surface(mirror, points[:, :2], form)
    return points, surface, np.abs(points[:, 2] - surface.points[:, 2]) <= 10 * close
