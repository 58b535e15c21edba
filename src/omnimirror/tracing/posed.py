"""A mirror where it really sits, traced in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mirrors import Mirror
from ..mirrors.form import NO_FORM, MirrorForm
from ..mirrors.pose import MirrorPose
from . import formed, reflection
from .reflection import RIM_SLACK, Ends, Specular
from .space import Reflections

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PosedMirror:
    """A mirror, its form error and its pose; the camera frame's origin is its vertex as that was meant to sit.

    >>> from omnimirror.mirrors import Sphere
    >>> posed = PosedMirror(Sphere(50.0, 44.0), MirrorPose(decentre_x_mm=1.0))
    >>> posed.trace(np.array([[1.0, 0.0, -100.0]]), np.array([[0.0, 0.0, 1.0]])).points + 0.0  # the vertex
    array([[1., 0., 0.]])
    """

    mirror: Mirror
    pose: MirrorPose
    form: MirrorForm = NO_FORM

    def trace(self, origins: Array, directions: Array) -> Reflections:
        """Reflect rays (n, 3), (n, 3); see :func:`omnimirror.tracing.space.trace`."""
        turned = self.pose.turned_to_mirror(directions)
        found = formed.trace(self.mirror, self.form, self.pose.to_mirror(origins), turned)
        turn = self.pose.turned_to_camera
        return Reflections(self.pose.to_camera(found.points), turn(found.directions), turn(found.normals), found.valid)

    def specular(self, pupils: Ends, targets: Ends, start: Array | None = None) -> Specular:
        """The mirror points (n, 3) in which pupils see targets; see :mod:`omnimirror.tracing.reflection`.

        ``start`` are points (n, 3) mm to begin from. Paths of distant ends count from the camera frame's origin.
        """
        begin = None if start is None else self.pose.to_mirror(start)[..., :2]
        found = reflection.specular_points(self.mirror, self._ends(pupils), self._ends(targets), begin, self.form)
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
        """Light (n,) that mirror points send to moving pupils, per unit of the pupils' motion (2, 3) or (n, 2, 3).

        Cross-section (mm^2) of the beam from a distant target, solid angle (sr) of that from a near one.
        """
        inside = found._replace(points=self.pose.to_mirror(found.points))
        area = reflection.footprint(
            self.mirror, self._ends(pupils), self._ends(targets), inside, self.pose.turned_to_mirror(motion), self.form
        )
        upright = np.abs(self.pose.turned_to_mirror(found.normals)[:, 2])
        cos_incidence = np.einsum("ni,ni->n", found.normals, found.to_targets)
        section: Array = area * cos_incidence / upright
        if not targets.distant:
            section /= np.einsum("ni,ni->n", targets.xyz - found.points, targets.xyz - found.points)
        return section

    def objects_at(self, found: Specular, distances: Array) -> Array:
        """Objects (n, 3) at distances (n,) mm from their mirror points, on the rays of those found."""
        objects: Array = found.points + distances[:, None] * found.to_targets
        return objects

    def beyond_edge_mm(self, points: Array, seen_at: Array) -> Array:
        """How far (...,) points lie beyond the rim, from the mirror's own axis; below 0 within."""
        inside = self.pose.to_mirror(points)
        beyond: Array = np.hypot(inside[..., 0], inside[..., 1]) - self.mirror.rim_radius_mm * (1 + RIM_SLACK)
        return beyond

    def _ends(self, ends: Ends) -> Ends:
        turn = self.pose.turned_to_mirror if ends.distant else self.pose.to_mirror
        return Ends(turn(ends.xyz), ends.distant)
