"""Skew rays over two mirrors, in the camera and world frames.

The lens side is described in the unfolded frame: z points from the lens through the secondary to
the image of the primary in an ideal window; the lens is at -m, the secondary's vertex at -s. The
world side has the primary's vertex as origin and z from the secondary to the primary. With a flat
secondary, the path equals that of a single mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.numerics.lazy import cached_property
from ...base.numerics.roots import NEWTON_CLOSE
from ...base.typing import Array
from ..lenses.pupil import IN_REFERENCE_POINT, EntrancePupil
from ..mirrors import Mirror, Secondary
from . import space
from .reflection import LONGEST_STEP, MAX_STEPS, REFLECTS, Ends, Specular, Surface
from .space import Reflections
from .two_mirrors import TwoMirrorMeridian, clearances

OVER = np.array([1.0, 1.0, -1.0])  # conversion between secondary and world frames
CHUNK = 1 << 12


class _Path(NamedTuple):
    """Optical path length (n,) over both mirrors, its gradient (n, 4) and Hessian (n, 4, 4)."""

    length: Array
    gradient: Array
    second: Array


@dataclass(frozen=True)
class FoldedMirror:
    """Mirror seen by the lens in a second mirror, with the interface of `PosedMirror`.

    >>> from omnimirror.optics.mirrors import Flat, Sphere
    >>> folded = FoldedMirror(Sphere(50.0, 44.0), Secondary(Flat(25.0), 90.0, 5.0), 180.0)
    >>> rays = folded.trace(np.array([[0.0, 0.0, -180.0]]), np.array([[30.0, 0.0, 190.0]]))
    >>> rays.points.round(6)  # as if there were no fold
    array([[30.,  0., 10.]])
    """

    mirror: Mirror
    secondary: Secondary
    mirror_distance_mm: float
    pupil: EntrancePupil = IN_REFERENCE_POINT

    @cached_property
    def meridian(self) -> TwoMirrorMeridian:
        return TwoMirrorMeridian(self.mirror, self.mirror_distance_mm, self.pupil, secondary=self.secondary)

    @property
    def _vertex(self) -> Array:
        """Vertex (3,) of the secondary."""
        return np.array([0.0, 0.0, -self.secondary.distance_mm])

    def trace(self, origins: Array, directions: Array) -> Reflections:
        """Reflect lens-side rays (n, 3), (n, 3) at both mirrors."""
        found, seen_at = self.unobstructed(origins, directions), self.seen_at(origins, directions)
        with np.errstate(all="ignore"):
            to_pupils = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
            edges = self.clearances(seen_at, found.points, to_pupils, found.directions)
        valid = np.logical_and.reduce([found.valid, *(edge >= 0 for edge in edges.values())])
        points, outgoing, normals = (
            np.where(valid[:, None], a, np.nan) for a in (found.points, found.directions, found.normals)
        )
        return Reflections(points, outgoing, normals, valid)

    def unobstructed(self, origins: Array, directions: Array) -> Reflections:
        """Reflect rays (n, 3), (n, 3) at both mirrors, ignoring bore, camera and secondary."""
        return space.trace(self.mirror, *self.off_secondary(origins, directions))

    def seen_at(self, origins: Array, directions: Array) -> Array:
        """Return the intersections (n, 3) of lens-side rays with the secondary."""
        return self.over(self.off_secondary(origins, directions)[0])

    def off_secondary(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        """Reflect lens-side rays (n, 3), (n, 3) at the secondary, to the world frame."""
        first = space.trace(self.secondary.mirror, origins - self._vertex, directions)
        return first.points * OVER + self._vertex, first.directions * OVER

    def over(self, points: Array) -> Array:
        """Convert points (n, 3) between the unfolded and the world frame."""
        there: Array = (points - self._vertex) * OVER + self._vertex
        return there

    def clearances(self, seen_at: Array, points: Array, to_pupils: Array, to_targets: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at mirrors, bore and secondary.

        Parameters
        ----------
        seen_at, to_pupils : (n, 3) arrays
            Points of the secondary, and directions from these to the lens, both in the unfolded
            frame.
        points, to_targets : (n, 3) arrays
            Points of the primary, and directions from these to the object.
        """
        second, from_lens = self.over(seen_at), -to_pupils * OVER
        return clearances(self.mirror, self.secondary, self.mirror_distance_mm, from_lens, second, points, to_targets)

    # -- reflection points of a target -------------------------------------------------------------

    def specular(self, pupils: Ends, targets: Ends, start: Array | None = None) -> Specular:
        """Return the points (n, 3) on both mirrors that image targets in pupils.

        The optical path is stationary over two points, one on each mirror: Newton's method in four
        dimensions, from the solution for the pupil centre. ``start`` is not used.
        """
        (count,) = np.broadcast_shapes((len(pupils.xyz),), (len(targets.xyz),))
        place = np.empty((count, 4))
        with np.errstate(all="ignore"):  # non-finite results are marked invalid
            first = np.broadcast_to(self._guess(targets), (count, 4))
            pupils, targets = self._seen(pupils).spread(count), targets.spread(count)
            for begin in range(0, count, CHUNK):
                part = slice(begin, begin + CHUNK)
                place[part] = self._stationary(pupils[part], targets[part], first[part])
            return self._proven(pupils, targets, place)

    def _seen(self, pupils: Ends) -> Ends:
        """Return entrance-pupil points in the secondary's frame."""
        return pupils if pupils.distant else Ends(pupils.xyz - self._vertex)

    def _guess(self, targets: Ends) -> Array:
        """Return initial points (n, 4) on both mirrors, for the pupil centre."""
        xyz, low, high = targets.xyz, self.meridian.omega_min, self.meridian.omega_max
        across, azimuth = np.hypot(xyz[:, 0], xyz[:, 1]), np.arctan2(xyz[:, 1], xyz[:, 0])
        omega = np.clip(np.where(np.isfinite(across), np.arctan2(across, -xyz[:, 2]), low), low, high)
        x = self.meridian.x_from_omega(omega)
        if not targets.distant:
            near = self.meridian.x_from_point(across, xyz[:, 2])
            x = np.where(np.isfinite(near), near, x)
        seen = self.meridian.trace(x).first.x
        cos, sin = np.cos(azimuth), np.sin(azimuth)
        return np.stack([seen * cos, seen * sin, x * cos, x * sin], axis=-1)

    def _stationary(self, pupils: Ends, targets: Ends, start: Array) -> Array:
        rims = np.repeat([self.secondary.mirror.rim_radius_mm, self.mirror.rim_radius_mm], 2)
        place, active = np.array(start), np.arange(len(start))
        for _ in range(MAX_STEPS):
            path = self._path(pupils[active], targets[active], place[active])
            solvable = np.isfinite(path.second).all(axis=(1, 2)) & (np.linalg.det(path.second) != 0)
            place[active[~solvable]] = np.nan
            active = active[solvable]
            step = -np.linalg.solve(path.second[solvable], path.gradient[solvable][..., None])[..., 0] / rims
            size = np.abs(step).max(axis=1)
            place[active] += step * np.minimum(1.0, LONGEST_STEP / size)[:, None] * rims
            active = active[size > NEWTON_CLOSE]
            if not active.size:
                break
        return place

    def _surfaces(self, place: Array) -> tuple[Surface, Surface]:
        return Surface(self.secondary.mirror, place[:, :2]), Surface(self.mirror, place[:, 2:])

    def _path(self, pupils: Ends, targets: Ends, place: Array) -> _Path:
        second, first = self._surfaces(place)
        length, gradient, hessian = np.zeros(len(place)), np.zeros((len(place), 4)), np.zeros((len(place), 4, 4))
        for end, surface, part in ((pupils, second, slice(0, 2)), (targets, first, slice(2, 4))):
            far, pull, bend = _leg(end, surface)
            length += far
            gradient[:, part] += pull
            hessian[:, part, part] += bend
        # path between the mirrors, in the world frame; the secondary's heights point downwards
        t2, t1 = second.tangents * OVER, first.tangents
        step = first.points - (second.points * OVER + self._vertex)
        distance = np.linalg.norm(step, axis=1)
        u = step / distance[:, None]
        t = np.concatenate([-t2, t1], axis=1)
        along = np.einsum("nai,ni->na", t, u)
        length += distance
        gradient += along
        inner = np.einsum("nai,nbi->nab", t, t) - along[:, :, None] * along[:, None, :]
        hessian += inner / distance[:, None, None]
        for surface, part in ((second, slice(0, 2)), (first, slice(2, 4))):
            hessian[:, part, part] += u[:, 2, None, None] * surface.bend
        return _Path(length, gradient, hessian)

    def _proven(self, pupils: Ends, targets: Ends, place: Array) -> Specular:
        second, first = self._surfaces(place)
        path = self._path(pupils, targets, place)
        seen_at, met = second.points * OVER + self._vertex, first.points
        to_pupils = pupils.xyz if pupils.distant else _unit(pupils.xyz - second.points)
        to_targets = targets.xyz if targets.distant else _unit(targets.xyz - first.points)
        between = _unit(met - seen_at)
        faces_both = [
            np.einsum("ni,ni->n", a, b) > 0
            for a, b in (
                (to_pupils, second.normals),
                (between * OVER, second.normals),
                (-between, first.normals),
                (to_targets, first.normals),
            )
        ]
        steepness = [np.sqrt(1 + np.einsum("ni,ni->n", s.slopes, s.slopes)) for s in (second, first)]
        misses = [np.hypot(*path.gradient[:, k : k + 2].T) / steepness[k // 2] for k in (0, 2)]
        reflects = np.logical_and.reduce([*faces_both, *(miss <= REFLECTS for miss in misses)])
        edges = self.clearances(second.points + self._vertex, met, to_pupils, to_targets)
        valid = np.logical_and.reduce([reflects, *(edge >= 0 for edge in edges.values())])
        blank = np.where(reflects, 1.0, np.nan)
        return Specular(
            met, first.normals * blank[:, None], to_pupils * blank[:, None], to_targets * blank[:, None],
            path.length * blank - self._count_from(pupils, to_pupils), reflects, valid, second.points + self._vertex,
        )  # fmt: skip

    def _count_from(self, pupils: Ends, to_pupils: Array) -> Array:
        """Return the path offset of distant pupils measured from the secondary's vertex."""
        return to_pupils @ self._vertex if pupils.distant else np.zeros(len(to_pupils))

    def beam(self, pupils: Ends, targets: Ends, found: Specular, motion: Array) -> Array:
        """Return the light (n,) per unit of pupil motion (2, 3) or (n, 2, 3).

        Cross-section (mm^2) of the beam from a distant target, or solid angle (sr) for a near one.
        The path stays stationary while the pupil moves; both points move by the inverse of its
        Hessian.
        """
        count = len(found.points)
        pupils, targets = self._seen(pupils).spread(count), targets.spread(count)
        place = np.concatenate([found.seen_at[:, :2], found.points[:, :2]], axis=1)
        with np.errstate(all="ignore"):
            second, _ = self._surfaces(place)
            motion = np.broadcast_to(motion, (count, 2, 3))
            if not pupils.distant:
                step = second.points - pupils.xyz
                distance = np.linalg.norm(step, axis=1)[:, None, None]
                u = step[:, :, None] / distance
                motion = (motion - (motion @ u) * u.transpose(0, 2, 1)) / distance
            mixed = np.zeros((count, 4, 2))
            mixed[:, :2] = np.einsum("nai,nbi->nab", second.tangents, motion)
            moved = np.linalg.solve(self._path(pupils, targets, place).second, mixed)[:, 2:]
            cos_incidence = np.einsum("ni,ni->n", found.normals, found.to_targets)
            section: Array = np.abs(np.linalg.det(moved)) * cos_incidence / np.abs(found.normals[:, 2])
            if not targets.distant:
                section /= np.einsum("ni,ni->n", targets.xyz - found.points, targets.xyz - found.points)
        return section

    def left_at(self, found: Specular) -> Array:
        """Return the points (n, 3) at which rays leave the primary."""
        return found.points

    def objects_at(self, found: Specular, distances: Array) -> Array:
        """Return objects (n, 3) at distances (n,), mm, from the primary."""
        objects: Array = found.points + distances[:, None] * found.to_targets
        return objects


def _leg(end: Ends, surface: Surface) -> tuple[Array, Array, Array]:
    """Return the path length to an end, its gradient and Hessian (n, 2, 2)."""
    if end.distant:
        far = -np.einsum("ni,ni->n", end.xyz, surface.points)
        return far, -np.einsum("nai,ni->na", surface.tangents, end.xyz), -end.xyz[:, 2, None, None] * surface.bend
    step = surface.points - end.xyz
    distance = np.linalg.norm(step, axis=1)
    u = step / distance[:, None]
    along = np.einsum("nai,ni->na", surface.tangents, u)
    inner = np.einsum("nai,nbi->nab", surface.tangents, surface.tangents) - along[:, :, None] * along[:, None, :]
    return distance, along, inner / distance[:, None, None] + u[:, 2, None, None] * surface.bend


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
