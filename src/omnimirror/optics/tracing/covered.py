"""Mirror behind a tube or dome, traced in space for any pose of mirror and cover.

A ray is traced from a pupil point to a mirror point and out through both surfaces of the wall. The
mirror point that images a target is the one whose ray reaches the target; Newton's method finds it
from the single-viewpoint solution. All coordinates are in the camera frame, whose origin is the
nominal position of the mirror vertex.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.native import backend, kernel_array
from ...base.numerics.lazy import cached_property
from ...base.typing import Array, Mask
from ..housing import Shell, Tube
from ..lenses.pupil import IN_REFERENCE_POINT, EntrancePupil
from .covers import Cover
from .meridian import Meridian
from .posed import PosedMirror
from .reflection import LONGEST_STEP, REFLECTS, RIM_SLACK, TIP, Ends, Specular, Surface, meridian_table
from .space import Reflections, reflect
from .walls import pose_of, said_to_kernels, way_out

CHUNK = 1 << 13  # rays per chunk: their arrays fit in the cache
MAX_STEPS = 40
DIFFERENCE = 1e-6  # finite-difference step, relative to the rim radius
FAR = 1e9  # distance of the initial guess of distant targets, in rim radii
KEPT = 1e-2  # derivatives are recomputed if a step leaves more of the previous miss
ARRIVED = 1e-12  # radians: angular miss at which a ray has converged
SETTLED = 1e-7  # relative to the rim radius: kernel step after which convergence is quadratic
CELLS = 4096  # cubic pieces of the meridian: rays of a smooth mirror are accurate to 1e-13 rad


class _Ways(NamedTuple):
    """Rays (n,) from the pupil over the mirror to the outer surface of the cover, camera frame."""

    points: Array
    normals: Array
    to_pupils: Array
    reflected: Array
    left_at: Array
    outwards: Array
    path: Array
    """Optical path length (n,), mm, from the pupil, or from the origin's plane if it is distant."""
    inside: Array
    """Path length (n,), mm, from the mirror."""
    passes: Mask


@dataclass(frozen=True)
class CoveredMirror:
    """Posed mirror behind a cover of known size, with the interface of `PosedMirror`.

    ``ends_mm`` are the heights of the tube's ends; rays that meet an end do not pass the wall.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> from omnimirror.optics.mirrors.pose import MirrorPose
    >>> mirror = PosedMirror(Sphere(50.0, 44.0), MirrorPose())
    >>> covered = CoveredMirror(mirror, Tube(120.0, medium="water"), (-180.0, 20.0), 180.0)
    >>> found = covered.trace(np.array([[0.0, 0.0, -180.0]]), np.array([[30.0, 0.0, 190.0]]))
    >>> round(float(np.hypot(*found.points[0, :2])), 9)  # from the outer side
    60.0
    """

    mirror: PosedMirror
    shell: Shell
    ends_mm: tuple[float, float]
    mirror_distance_mm: float
    pupil: EntrancePupil = IN_REFERENCE_POINT

    def trace(self, origins: Array, directions: Array) -> Reflections:
        """Reflect rays (n, 3), (n, 3) and refract them through the cover."""
        found = self.mirror.trace(origins, directions)
        valid = found.valid.copy()
        points, outwards = found.points.copy(), found.directions.copy()
        points[valid], outwards[valid], _, _, passes = self._let_out(points[valid], outwards[valid])
        valid[valid] = passes
        points[~valid] = outwards[~valid] = np.nan
        return Reflections(points, outwards, found.normals, valid)

    def specular(self, pupils: Ends, targets: Ends, start: Array | None = None) -> Specular:
        """Return the mirror points (n, 3) of targets, from initial points (n, 3), mm."""
        (count,) = np.broadcast_shapes((len(pupils.xyz),), (len(targets.xyz),))
        pupils, targets = pupils.spread(count), targets.spread(count)
        with np.errstate(all="ignore"):  # non-finite results are marked invalid
            begin = self._guess(targets) if start is None else self.mirror.pose.to_mirror(start)[..., :2]
            begin = np.broadcast_to(begin, (count, 2))
            parts = [slice(first, first + CHUNK) for first in range(0, max(count, 1), CHUNK)]
            found = [self._found(pupils[part], targets[part], begin[part]) for part in parts]
        return Specular(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))

    def beam(self, pupils: Ends, targets: Ends, found: Specular, motion: Array) -> Array:
        """Return the light (n,) from mirror points to moving pupils; see :meth:`PosedMirror.beam`.

        While the pupil moves, the mirror point follows to keep the ray on its target. Finite
        differences give the derivatives of the miss and the transverse motion of the outer ray.
        """
        count = len(found.points)
        pupils, targets = pupils.spread(count), targets.spread(count)
        xy = self.mirror.pose.to_mirror(found.points)[:, :2]
        motion = np.broadcast_to(motion, (count, 2, 3))
        step = DIFFERENCE * self.mirror.mirror.rim_radius_mm
        with np.errstate(all="ignore"):
            ways = self._ways(pupils, xy)
            e1, e2 = _across(ways.outwards)

            def flat(vectors: Array) -> Array:
                return np.stack([np.einsum("ni,ni->n", vectors, e) for e in (e1, e2)], axis=-1)

            def change(there: _Ways, h: float) -> tuple[Array, Array]:
                miss = self._miss(there, targets) - self._miss(ways, targets)
                return flat(miss) / h, flat(there.left_at - ways.left_at) / h

            by_place = [change(self._ways(pupils, xy + step * e), step) for e in np.eye(2)]
            h = step if not pupils.distant else DIFFERENCE
            by_pupil = [change(self._ways(Ends(pupils.xyz + h * motion[:, k], pupils.distant), xy), h) for k in (0, 1)]
            (m_x, s_x), (m_e, s_e) = (
                (np.stack([a for a, _ in both], axis=-1), np.stack([b for _, b in both], axis=-1))
                for both in (by_place, by_pupil)
            )
            moved = s_e - s_x @ np.linalg.solve(m_x, m_e)
            section: Array = np.abs(np.linalg.det(moved))
            if not targets.distant:
                section /= np.einsum("ni,ni->n", targets.xyz - ways.left_at, targets.xyz - ways.left_at)
        return section

    def left_at(self, found: Specular) -> Array:
        """Return the points (n, 3), mm, on the outer surface of the cover."""
        return self._let_out(found.points, found.to_targets)[0]

    def objects_at(self, found: Specular, distances: Array) -> Array:
        """Return objects (n, 3) at optical distances (n,), mm, from their mirror points."""
        left_at, outwards, _, inside, _ = self._let_out(found.points, found.to_targets)
        objects: Array = left_at + (distances - inside)[:, None] * outwards
        return objects

    def outside_of(self, points: Array, through: Array) -> tuple[Array, Array]:
        """Return exit points and directions (n, 3) of rays from inner points through others."""
        way = through - points
        left_at, outwards, *_ = self._let_out(points, way / np.linalg.norm(way, axis=1, keepdims=True))
        return left_at, outwards

    def clearances(self, seen_at: Array, points: Array, to_pupils: Array, to_targets: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at the rim; see :meth:`PosedMirror.clearances`."""
        return self.mirror.clearances(seen_at, points, to_pupils, to_targets)

    # -- refraction through the wall ---------------------------------------------------------------

    def _let_out(self, points: Array, directions: Array) -> tuple[Array, Array, Array, Array, Mask]:
        """Return exit points and directions (n, 3), optical and geometric path (n,), and validity.

        Rays that meet an end of a tube in air continue unchanged: they do not reach the wall.
        """
        way = way_out(self.shell, points, directions)
        left_at, outwards, passes, (first, second) = way.points, way.directions, way.passes, way.lengths
        if isinstance(self.shell, Tube):
            height = (way.met if self.shell.is_axial else pose_of(self.shell).to_mirror(way.met))[:, 2]
            low, high = self.ends_mm
            meets = (height > low) & (height < high) & way.meets
            if self.shell.outer_index != 1.0:
                passes = passes & meets
            elif not meets.all():
                left_at, outwards = (
                    np.where(meets[:, None], new, old) for new, old in ((left_at, points), (outwards, way.incident))
                )
                first, second, passes = first * meets, second * meets, passes | ~meets
        return left_at, outwards, first + self.shell.index * second, first + second, passes

    def _ways(self, pupils: Ends, xy: Array) -> _Ways:
        surface = Surface(self.mirror.mirror, xy, self.mirror.form)
        pose = self.mirror.pose
        points, normals = pose.to_camera(surface.points), pose.turned_to_camera(surface.normals)
        if pupils.distant:
            to_pupils = pupils.xyz / _lengths(pupils.xyz)[:, None]
            before = -np.einsum("ni,ni->n", to_pupils, points)
        else:
            way = pupils.xyz - points
            before = _lengths(way)
            to_pupils = way / before[:, None]
        reflected = reflect(-to_pupils, normals)
        left_at, outwards, time, inside, passes = self._let_out(points, reflected)
        return _Ways(points, normals, to_pupils, reflected, left_at, outwards, before + time, inside, passes)

    def _miss(self, ways: _Ways, targets: Ends) -> Array:
        """Return the miss (n, 3), as an angle or relative to the target distance.

        The distance is measured from the mirror; it remains positive for targets close to the
        cover.
        """
        if targets.distant:
            return ways.outwards - targets.xyz
        way = targets.xyz - ways.left_at
        along = np.einsum("ni,ni->n", way, ways.outwards)
        distance = _lengths(targets.xyz - ways.points)
        miss: Array = (along[:, None] * ways.outwards - way) / distance[:, None]
        return miss

    @staticmethod
    def _wanted(ways: _Ways, targets: Ends) -> Array:
        if targets.distant:
            return targets.xyz
        way = targets.xyz - ways.left_at
        wanted: Array = way / _lengths(way)[:, None]
        return wanted

    # -- mirror point of a target ------------------------------------------------------------------

    @cached_property
    def _meridian(self) -> Meridian:
        """Meridian of the aligned mirror and cover."""
        shift = float(self.mirror.pose.shift[2])
        cover = Cover(self.shell.centred(), *self.ends_mm).moved(shift)
        return Meridian(self.mirror.mirror, self.mirror_distance_mm + shift, self.pupil, cover=cover)

    def _guess(self, targets: Ends) -> Array:
        """Return single-viewpoint estimates (n, 2), mm, of the mirror points of targets."""
        pose, rim = self.mirror.pose, self.mirror.mirror.rim_radius_mm
        inside = pose.turned_to_mirror(targets.xyz) * (FAR * rim) if targets.distant else pose.to_mirror(targets.xyz)
        across, azimuth = np.hypot(inside[:, 0], inside[:, 1]), np.arctan2(inside[:, 1], inside[:, 0])
        x = self._meridian.first_guess(across, inside[:, 2])
        if self.mirror.mirror.is_pointed:
            x = np.maximum(x, TIP * rim)
        return np.stack([x * np.cos(azimuth), x * np.sin(azimuth)], axis=-1)

    def _found(self, pupils: Ends, targets: Ends, start: Array) -> Specular:
        """Solve for the mirror points from initial points (n, 2), mm; see :meth:`specular`."""
        if not self._is_compiled:
            xy = self._aimed(pupils, targets, start)
            return self._proven(targets, xy, self._ways(pupils, xy))
        xy, settled = self._settled(pupils, targets, start)
        ways = self._ways(pupils, xy)
        near = np.flatnonzero(settled & (_lengths(self._miss(ways, targets)) > ARRIVED))  # table limits
        if near.size:
            xy[near] = self._aimed(pupils[near], targets[near], xy[near])
            ways = self._ways(pupils, xy)
        return self._proven(targets, xy, ways)

    @property
    def _is_compiled(self) -> bool:
        """True if a kernel is available: kernels do not support form errors."""
        return backend.is_compiled and self.mirror.form.is_empty

    def _settled(self, pupils: Ends, targets: Ends, start: Array) -> tuple[Array, Mask]:
        """Return mirror points (n, 2), mm, from a compiled kernel with a table of the meridian, and
        convergence flags (n,)."""
        xy, settled = np.array(start), np.empty(len(start), np.bool_)
        shell, mirror = pose_of(self.shell), self.mirror.mirror
        turn = shell.rotation().T @ self.mirror.pose.rotation()
        shift = shell.turned_to_mirror(self.mirror.pose.shift - shell.shift)
        pupils, targets = (
            Ends(shell.turned_to_mirror(end.xyz) if end.distant else shell.to_mirror(end.xyz), end.distant)
            for end in (pupils, targets)
        )
        backend.kernels.find_covered(
            (self._meridian_table, mirror.rim_radius_mm / CELLS, mirror.rim_radius_mm, turn, shift),
            said_to_kernels(self.shell), self.ends_mm, (MAX_STEPS, LONGEST_STEP, SETTLED),
            (kernel_array(pupils.xyz), pupils.distant), (kernel_array(targets.xyz), targets.distant),
            xy, settled.view(np.uint8),
        )  # fmt: skip
        return xy, settled

    @cached_property
    def _meridian_table(self) -> Array:
        return meridian_table(self.mirror.mirror, CELLS)

    def _aimed(self, pupils: Ends, targets: Ends, start: Array) -> Array:
        """Solve for mirror points (n, 2), mm, whose rays reach the targets, by Newton's method.

        Derivatives cost two more rays each: they are reused while each step reduces the miss to 1
        %.
        """
        rim = self.mirror.mirror.rim_radius_mm
        step, reach = DIFFERENCE * rim, LONGEST_STEP * rim
        xy, active = np.array(start), np.arange(len(start))
        rates, before = np.zeros((2, len(start), 3)), np.zeros(len(start))
        for _ in range(MAX_STEPS):
            pupil, target, at = pupils[active], targets[active], xy[active]
            ways = self._ways(pupil, at)
            here = self._miss(ways, target)
            missed = _lengths(here)
            again = np.flatnonzero((missed > ARRIVED) & ~(missed < KEPT * before[active]))
            for k, e in enumerate(np.eye(2)):
                there = self._miss(self._ways(pupil[again], at[again] + step * e), target[again])
                rates[k, active[again]] = (there - here[again]) / step
            before[active] = missed
            move = _solved(rates[:, active], here, ways.outwards)
            size = np.hypot(*move.T)
            move *= np.minimum(1.0, reach / np.where(size > 0, size, 1.0))[:, None]
            xy[active] += move
            active = active[(missed > ARRIVED) & np.isfinite(size) & (size > 1e-14 * rim)]
            if not active.size:
                break
        return xy

    def _proven(self, targets: Ends, xy: Array, ways: _Ways) -> Specular:
        faces = [np.einsum("ni,ni->n", way, ways.normals) > 0 for way in (ways.to_pupils, ways.reflected)]
        leads = _lengths(ways.outwards - self._wanted(ways, targets)) <= REFLECTS
        reflects = np.logical_and.reduce([*faces, leads, ways.passes])
        valid = reflects & (np.hypot(*xy.T) <= self.mirror.mirror.rim_radius_mm * (1 + RIM_SLACK))
        if targets.distant:
            behind = -np.einsum("ni,ni->n", targets.xyz, ways.left_at)
        else:
            behind = _lengths(targets.xyz - ways.left_at)
        path = ways.path + self.shell.outer_index * behind
        blank = np.where(reflects, 1.0, np.nan)
        column = blank[:, None]
        return Specular(
            ways.points,
            ways.normals * column,
            ways.to_pupils * column,
            ways.reflected * column,
            path * blank,
            reflects,
            valid,
            ways.points,
        )


def _solved(rates: Array, miss: Array, towards: Array) -> Array:
    """Return steps (n, 2) that cancel misses (n, 3) across directions (n, 3), given rates (2, n,
    3); 0 for non-finite rates."""
    across = _across(towards)
    (a, b), (c, d) = ([np.einsum("ni,ni->n", rate, e) for rate in rates] for e in across)
    u, v = (np.einsum("ni,ni->n", miss, e) for e in across)
    det = a * d - b * c
    is_known = rates.any(axis=(0, 2))
    move: Array = np.stack([b * v - d * u, c * u - a * v], axis=-1) / np.where(is_known, det, 1.0)[:, None]
    return move


def _lengths(vectors: Array) -> Array:
    lengths: Array = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    return lengths


def _across(directions: Array) -> tuple[Array, Array]:
    """Return two unit vectors (n, 3) orthogonal to unit vectors (n, 3) (Duff et al., 2017)."""
    x, y, z = directions.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    e1 = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return e1, np.stack([b, sign + y * y * a, -y], axis=-1)
