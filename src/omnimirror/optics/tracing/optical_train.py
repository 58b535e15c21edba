"""Skew ray trace of as-built mirrors, covers and lens, from image to world and from world to lens.

All coordinates are in the camera frame, in mm: z points from the lens to the mirror; the origin is
the nominal vertex of the mirror. Pixels are handled by the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.caching import cached_property
from ...base.native import backend, kernel_array
from ...base.typing import Array, Mask
from ..housing import Shell, Tube
from ..lenses import Lens
from ..lenses.lens import IN_REFERENCE_POINT, EntrancePupil
from ..mirrors import Mirror, Secondary
from ..mirrors.mirror import NO_FORM, MirrorForm, MirrorPose
from . import reflection
from .meridian import Cover, Meridian
from .obscuration import Obstructions
from .reflection import (
    MAX_STEP_LENGTH,
    REFLECTION_TOLERANCE,
    RIM_SLACK,
    TIP,
    MirrorSurface,
    RayEndpoints,
    ReflectionPoints,
    Reflections,
    circle_clearance,
    meridian_table,
    reflect,
    trace,
)
from .shell_transmission import pose_of, shell_exit, shell_kernel_arguments
from .two_mirrors import FoldedMirror

# -- As-built mirror with form error and pose ------------------------------------------------------

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
        """Reflect rays (n, 3), (n, 3); see :func:`omnimirror.optics.tracing.reflection.trace`."""
        inside_directions = self.pose.rotate_to_mirror(directions)
        reflections = trace_formed(
            self.mirror, self.form, self.pose.to_mirror(origins), inside_directions
        )
        turn = self.pose.rotate_to_camera
        return Reflections(
            self.pose.to_camera(reflections.points),
            turn(reflections.directions),
            turn(reflections.normals),
            reflections.valid,
        )

    def specular(
        self, pupils: RayEndpoints, targets: RayEndpoints, start: Array | None = None
    ) -> ReflectionPoints:
        """Return the mirror points (n, 3) that image targets; see :mod:`.reflection`.

        ``start`` are initial points (n, 3), mm. Paths of distant ends are measured from the camera
        frame's origin.
        """
        start_xy = None if start is None else self.pose.to_mirror(start)[..., :2]
        reflection_points = reflection.specular_points(
            self.mirror, self.inside(pupils), self.inside(targets), start_xy, self.form
        )
        turn = self.pose.rotate_to_camera
        path = reflection_points.path
        for end in (pupils, targets):
            if end.distant:
                path = path - end.xyz @ self.pose.shift
        points = self.pose.to_camera(reflection_points.points)
        return reflection_points._replace(
            points=points,
            facing_points=points,
            normals=turn(reflection_points.normals),
            to_pupils=turn(reflection_points.to_pupils),
            to_targets=turn(reflection_points.to_targets),
            path=path,
        )

    def beam(
        self,
        pupils: RayEndpoints,
        targets: RayEndpoints,
        reflections: ReflectionPoints,
        motion: Array,
    ) -> Array:
        """Return the light (n,) per unit of pupil motion (2, 3) or (n, 2, 3).

        Cross-section (mm^2) of the beam from a distant target, or solid angle (sr) for a near one.
        """
        inside = reflections._replace(points=self.pose.to_mirror(reflections.points))
        area = reflection.footprint(
            self.mirror,
            self.inside(pupils),
            self.inside(targets),
            inside,
            self.pose.rotate_to_mirror(motion),
            self.form,
        )
        axial_cosine = np.abs(self.pose.rotate_to_mirror(reflections.normals)[:, 2])
        cos_incidence = np.einsum("ni,ni->n", reflections.normals, reflections.to_targets)
        section: Array = area * cos_incidence / axial_cosine
        if not targets.distant:
            section /= np.einsum(
                "ni,ni->n", targets.xyz - reflections.points, targets.xyz - reflections.points
            )
        return section

    def exit_points(self, reflections: ReflectionPoints) -> Array:
        """Return the points (n, 3) at which rays leave the mirror."""
        return reflections.points

    def objects_at(self, reflections: ReflectionPoints, distances: Array) -> Array:
        """Return objects (n, 3) at distances (n,), mm, from their mirror points, on their rays."""
        objects: Array = reflections.points + distances[:, None] * reflections.to_targets
        return objects

    def clearances(
        self, facing_points: Array, points: Array, to_pupils: Array, to_targets: Array
    ) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays through points (n, 3) at the rim."""
        inside = self.pose.to_mirror(points)
        return {
            "mirror": -circle_clearance(inside[:, :2], self.mirror.rim_radius_mm * (1 + RIM_SLACK))
        }

    def inside(self, ends: RayEndpoints) -> RayEndpoints:
        """Convert ends from the camera frame to the mirror frame."""
        turn = self.pose.rotate_to_mirror if ends.distant else self.pose.to_mirror
        return RayEndpoints(turn(ends.xyz), ends.distant)


def trace_formed(
    mirror: Mirror, form: MirrorForm, origins: Array, directions: Array
) -> Reflections:
    """Reflect rays (n, 3), (n, 3) on a mirror with a form error; see :func:`.reflection.trace`.

    Form errors are of the order of micrometres: a few steps of Newton's method along the ray lead
    from the nominal to the actual surface. Rays that miss the nominal mirror are invalid; the
    nominal meridian defines the rim.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> higher = MirrorForm((1,), (2.0,))  # by 2 um, everywhere
    >>> formed = trace_formed(Sphere(50.0, 44.0), higher, np.array([[30.0, 0.0, -100.0]]), np.array([[0.0, 0.0, 1.0]]))
    >>> formed.points
    array([[30.   ,  0.   , 10.002]])
    """
    nominal = trace(mirror, origins, directions)
    if form.is_empty:
        return nominal
    valid = nominal.valid.copy()
    points, outgoing, normals = (
        nominal.points.copy(),
        nominal.directions.copy(),
        nominal.normals.copy(),
    )
    incident = np.broadcast_to(directions, points.shape)[valid]
    incident = incident / np.linalg.norm(incident, axis=1, keepdims=True)
    hits, surface, arrived = _form_intersection(mirror, form, points[valid], incident)
    points[valid], normals[valid], outgoing[valid] = (
        hits,
        surface.normals,
        reflect(incident, surface.normals),
    )
    valid[valid] = arrived
    points[~valid] = normals[~valid] = outgoing[~valid] = np.nan
    return Reflections(points, outgoing, normals, valid)


def _form_intersection(
    mirror: Mirror, form: MirrorForm, points: Array, directions: Array
) -> tuple[Array, MirrorSurface, NDArray[np.bool_]]:
    """Return ray intersections (n, 3), the surface there, and convergence flags."""
    close = FORM_CLOSE * mirror.rim_radius_mm
    surface = MirrorSurface(mirror, points[:, :2], form)
    for _ in range(FORM_STEPS):
        over = points[:, 2] - surface.points[:, 2]
        if not (np.abs(over) > close).any():
            break
        rate = directions[:, 2] - (surface.slopes * directions[:, :2]).sum(axis=1)
        points = points - (over / rate)[:, None] * directions
        surface = MirrorSurface(mirror, points[:, :2], form)
    return points, surface, np.abs(points[:, 2] - surface.points[:, 2]) <= 10 * close


# -- Mirror behind a tube or dome ------------------------------------------------------------------
#
# A ray is traced from a pupil point to a mirror point and out through both surfaces of the wall. The
# mirror point that images a target is the one whose ray reaches the target; Newton's method finds it
# from the single-viewpoint solution. All coordinates are in the camera frame, whose origin is the
# nominal position of the mirror vertex.

CHUNK = 1 << 13  # rays per chunk: their arrays fit in the cache
MAX_STEPS = 40
DIFFERENCE = 1e-6  # finite-difference step, relative to the rim radius
DISTANT_GUESS = 1e9  # distance of the initial guess of distant targets, in rim radii
MAX_MISS_RATIO = 1e-2  # derivatives are recomputed if a step leaves more of the previous miss
MISS_TOLERANCE = 1e-12  # radians: angular miss at which a ray has converged
SETTLED = 1e-7  # relative to the rim radius: kernel step after which convergence is quadratic
CELLS = 4096  # cubic pieces of the meridian: rays of a smooth mirror are accurate to 1e-13 rad


class _Paths(NamedTuple):
    """Rays (n,) from the pupil over the mirror to the outer surface of the cover, camera frame."""

    points: Array
    normals: Array
    to_pupils: Array
    reflected: Array
    exit_points: Array
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
    >>> from omnimirror.optics.mirrors.mirror import MirrorPose
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
        reflections = self.mirror.trace(origins, directions)
        valid = reflections.valid.copy()
        points, outwards = reflections.points.copy(), reflections.directions.copy()
        points[valid], outwards[valid], _, _, passes = self._exit_rays(
            points[valid], outwards[valid]
        )
        valid[valid] = passes
        points[~valid] = outwards[~valid] = np.nan
        return Reflections(points, outwards, reflections.normals, valid)

    def specular(
        self, pupils: RayEndpoints, targets: RayEndpoints, start: Array | None = None
    ) -> ReflectionPoints:
        """Return the mirror points (n, 3) of targets, from initial points (n, 3), mm."""
        (count,) = np.broadcast_shapes((len(pupils.xyz),), (len(targets.xyz),))
        pupils, targets = pupils.spread(count), targets.spread(count)
        with np.errstate(all="ignore"):  # non-finite results are marked invalid
            start_xy = (
                self._guess(targets)
                if start is None
                else self.mirror.pose.to_mirror(start)[..., :2]
            )
            start_xy = np.broadcast_to(start_xy, (count, 2))
            parts = [slice(first, first + CHUNK) for first in range(0, max(count, 1), CHUNK)]
            chunks = [self._solve(pupils[part], targets[part], start_xy[part]) for part in parts]
        return ReflectionPoints(*(np.concatenate(arrays) for arrays in zip(*chunks, strict=True)))

    def beam(
        self,
        pupils: RayEndpoints,
        targets: RayEndpoints,
        reflections: ReflectionPoints,
        motion: Array,
    ) -> Array:
        """Return the light (n,) from mirror points to moving pupils; see :meth:`PosedMirror.beam`.

        While the pupil moves, the mirror point follows to keep the ray on its target. Finite
        differences give the derivatives of the miss and the transverse motion of the outer ray.
        """
        count = len(reflections.points)
        pupils, targets = pupils.spread(count), targets.spread(count)
        xy = self.mirror.pose.to_mirror(reflections.points)[:, :2]
        motion = np.broadcast_to(motion, (count, 2, 3))
        step = DIFFERENCE * self.mirror.mirror.rim_radius_mm
        with np.errstate(all="ignore"):
            paths = self._paths(pupils, xy)
            e1, e2 = _across(paths.outwards)

            def flat(vectors: Array) -> Array:
                return np.stack([np.einsum("ni,ni->n", vectors, e) for e in (e1, e2)], axis=-1)

            def change(there: _Paths, h: float) -> tuple[Array, Array]:
                miss = self._miss(there, targets) - self._miss(paths, targets)
                return flat(miss) / h, flat(there.exit_points - paths.exit_points) / h

            by_position = [change(self._paths(pupils, xy + step * e), step) for e in np.eye(2)]
            h = step if not pupils.distant else DIFFERENCE
            by_pupil = [
                change(
                    self._paths(RayEndpoints(pupils.xyz + h * motion[:, k], pupils.distant), xy), h
                )
                for k in (0, 1)
            ]
            (m_x, s_x), (m_e, s_e) = (
                (
                    np.stack([a for a, _ in derivatives], axis=-1),
                    np.stack([b for _, b in derivatives], axis=-1),
                )
                for derivatives in (by_position, by_pupil)
            )
            moved = s_e - s_x @ np.linalg.solve(m_x, m_e)
            section: Array = np.abs(np.linalg.det(moved))
            if not targets.distant:
                section /= np.einsum(
                    "ni,ni->n", targets.xyz - paths.exit_points, targets.xyz - paths.exit_points
                )
        return section

    def exit_points(self, reflections: ReflectionPoints) -> Array:
        """Return the points (n, 3), mm, on the outer surface of the cover."""
        return self._exit_rays(reflections.points, reflections.to_targets)[0]

    def objects_at(self, reflections: ReflectionPoints, distances: Array) -> Array:
        """Return objects (n, 3) at optical distances (n,), mm, from their mirror points."""
        exit_points, outwards, _, inside, _ = self._exit_rays(
            reflections.points, reflections.to_targets
        )
        objects: Array = exit_points + (distances - inside)[:, None] * outwards
        return objects

    def outside_of(self, points: Array, through: Array) -> tuple[Array, Array]:
        """Return exit points and directions (n, 3) of rays from inner points through others."""
        direction = through - points
        exit_points, outwards, *_ = self._exit_rays(
            points, direction / np.linalg.norm(direction, axis=1, keepdims=True)
        )
        return exit_points, outwards

    def clearances(
        self, facing_points: Array, points: Array, to_pupils: Array, to_targets: Array
    ) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at the rim; see :meth:`PosedMirror.clearances`."""
        return self.mirror.clearances(facing_points, points, to_pupils, to_targets)

    # -- refraction through the wall ---------------------------------------------------------------

    def _exit_rays(
        self, points: Array, directions: Array
    ) -> tuple[Array, Array, Array, Array, Mask]:
        """Return exit points and directions (n, 3), optical and geometric path (n,), and validity.

        Rays that meet an end of a tube in air continue unchanged: they do not reach the wall.
        """
        transit = shell_exit(self.shell, points, directions)
        exit_points, outwards, passes, (first, second) = (
            transit.points,
            transit.directions,
            transit.passes,
            transit.lengths,
        )
        if isinstance(self.shell, Tube):
            height = (
                transit.met if self.shell.is_axial else pose_of(self.shell).to_mirror(transit.met)
            )[:, 2]
            low, high = self.ends_mm
            meets = (height > low) & (height < high) & transit.meets
            if self.shell.outer_index != 1.0:
                passes = passes & meets
            elif not meets.all():
                exit_points, outwards = (
                    np.where(meets[:, None], new, old)
                    for new, old in ((exit_points, points), (outwards, transit.incident))
                )
                first, second, passes = first * meets, second * meets, passes | ~meets
        return exit_points, outwards, first + self.shell.index * second, first + second, passes

    def _paths(self, pupils: RayEndpoints, xy: Array) -> _Paths:
        surface = MirrorSurface(self.mirror.mirror, xy, self.mirror.form)
        pose = self.mirror.pose
        points, normals = pose.to_camera(surface.points), pose.rotate_to_camera(surface.normals)
        if pupils.distant:
            to_pupils = pupils.xyz / _lengths(pupils.xyz)[:, None]
            before = -np.einsum("ni,ni->n", to_pupils, points)
        else:
            to_pupil = pupils.xyz - points
            before = _lengths(to_pupil)
            to_pupils = to_pupil / before[:, None]
        reflected = reflect(-to_pupils, normals)
        exit_points, outwards, time, inside, passes = self._exit_rays(points, reflected)
        return _Paths(
            points,
            normals,
            to_pupils,
            reflected,
            exit_points,
            outwards,
            before + time,
            inside,
            passes,
        )

    def _miss(self, paths: _Paths, targets: RayEndpoints) -> Array:
        """Return the miss (n, 3), as an angle or relative to the target distance.

        The distance is measured from the mirror; it remains positive for targets close to the
        cover.
        """
        if targets.distant:
            return paths.outwards - targets.xyz
        to_target = targets.xyz - paths.exit_points
        along = np.einsum("ni,ni->n", to_target, paths.outwards)
        distance = _lengths(targets.xyz - paths.points)
        miss: Array = (along[:, None] * paths.outwards - to_target) / distance[:, None]
        return miss

    @staticmethod
    def _target_directions(paths: _Paths, targets: RayEndpoints) -> Array:
        if targets.distant:
            return targets.xyz
        to_target = targets.xyz - paths.exit_points
        direction: Array = to_target / _lengths(to_target)[:, None]
        return direction

    # -- mirror point of a target ------------------------------------------------------------------

    @cached_property
    def _meridian(self) -> Meridian:
        """Meridian of the aligned mirror and cover."""
        shift = float(self.mirror.pose.shift[2])
        cover = Cover(self.shell.centred(), *self.ends_mm).moved(shift)
        return Meridian(
            self.mirror.mirror, self.mirror_distance_mm + shift, self.pupil, cover=cover
        )

    def _guess(self, targets: RayEndpoints) -> Array:
        """Return single-viewpoint estimates (n, 2), mm, of the mirror points of targets."""
        pose, rim = self.mirror.pose, self.mirror.mirror.rim_radius_mm
        inside = (
            pose.rotate_to_mirror(targets.xyz) * (DISTANT_GUESS * rim)
            if targets.distant
            else pose.to_mirror(targets.xyz)
        )
        across, azimuth = (
            np.hypot(inside[:, 0], inside[:, 1]),
            np.arctan2(inside[:, 1], inside[:, 0]),
        )
        x = self._meridian.first_guess(across, inside[:, 2])
        if self.mirror.mirror.is_pointed:
            x = np.maximum(x, TIP * rim)
        return np.stack([x * np.cos(azimuth), x * np.sin(azimuth)], axis=-1)

    def _solve(self, pupils: RayEndpoints, targets: RayEndpoints, start: Array) -> ReflectionPoints:
        """Solve for the mirror points from initial points (n, 2), mm; see :meth:`specular`."""
        if not self._is_compiled:
            xy = self._newton_solution(pupils, targets, start)
            return self._verified(targets, xy, self._paths(pupils, xy))
        xy, settled = self._compiled_solution(pupils, targets, start)
        paths = self._paths(pupils, xy)
        unsettled = np.flatnonzero(
            settled & (_lengths(self._miss(paths, targets)) > MISS_TOLERANCE)
        )  # table limits
        if unsettled.size:
            xy[unsettled] = self._newton_solution(
                pupils[unsettled], targets[unsettled], xy[unsettled]
            )
            paths = self._paths(pupils, xy)
        return self._verified(targets, xy, paths)

    @property
    def _is_compiled(self) -> bool:
        """True if a kernel is available: kernels do not support form errors."""
        return backend.is_compiled and self.mirror.form.is_empty

    def _compiled_solution(
        self, pupils: RayEndpoints, targets: RayEndpoints, start: Array
    ) -> tuple[Array, Mask]:
        """Return mirror points (n, 2), mm, from a compiled kernel with a table of the meridian, and
        convergence flags (n,)."""
        xy, settled = np.array(start), np.empty(len(start), np.bool_)
        shell, mirror = pose_of(self.shell), self.mirror.mirror
        turn = shell.rotation().T @ self.mirror.pose.rotation()
        shift = shell.rotate_to_mirror(self.mirror.pose.shift - shell.shift)
        pupils, targets = (
            RayEndpoints(
                shell.rotate_to_mirror(end.xyz) if end.distant else shell.to_mirror(end.xyz),
                end.distant,
            )
            for end in (pupils, targets)
        )
        backend.kernels.find_reflections_through_shell(
            (self._meridian_table, mirror.rim_radius_mm / CELLS, mirror.rim_radius_mm, turn, shift),
            shell_kernel_arguments(self.shell),
            self.ends_mm,
            (MAX_STEPS, MAX_STEP_LENGTH, SETTLED),
            (kernel_array(pupils.xyz), pupils.distant),
            (kernel_array(targets.xyz), targets.distant),
            xy,
            settled.view(np.uint8),
        )
        return xy, settled

    @cached_property
    def _meridian_table(self) -> Array:
        return meridian_table(self.mirror.mirror, CELLS)

    def _newton_solution(self, pupils: RayEndpoints, targets: RayEndpoints, start: Array) -> Array:
        """Solve for mirror points (n, 2), mm, whose rays reach the targets, by Newton's method.

        Derivatives cost two more rays each: they are reused while each step reduces the miss to 1
        %.
        """
        rim = self.mirror.mirror.rim_radius_mm
        step, max_step = DIFFERENCE * rim, MAX_STEP_LENGTH * rim
        xy, active = np.array(start), np.arange(len(start))
        rates, before = np.zeros((2, len(start), 3)), np.zeros(len(start))
        for _ in range(MAX_STEPS):
            pupil, target, position = pupils[active], targets[active], xy[active]
            paths = self._paths(pupil, position)
            here = self._miss(paths, target)
            miss_size = _lengths(here)
            again = np.flatnonzero(
                (miss_size > MISS_TOLERANCE) & ~(miss_size < MAX_MISS_RATIO * before[active])
            )
            for k, e in enumerate(np.eye(2)):
                there = self._miss(
                    self._paths(pupil[again], position[again] + step * e), target[again]
                )
                rates[k, active[again]] = (there - here[again]) / step
            before[active] = miss_size
            move = _step(rates[:, active], here, paths.outwards)
            size = np.hypot(*move.T)
            move *= np.minimum(1.0, max_step / np.where(size > 0, size, 1.0))[:, None]
            xy[active] += move
            active = active[(miss_size > MISS_TOLERANCE) & np.isfinite(size) & (size > 1e-14 * rim)]
            if not active.size:
                break
        return xy

    def _verified(self, targets: RayEndpoints, xy: Array, paths: _Paths) -> ReflectionPoints:
        faces = [
            np.einsum("ni,ni->n", direction, paths.normals) > 0
            for direction in (paths.to_pupils, paths.reflected)
        ]
        leads = (
            _lengths(paths.outwards - self._target_directions(paths, targets))
            <= REFLECTION_TOLERANCE
        )
        reflects = np.logical_and.reduce([*faces, leads, paths.passes])
        valid = reflects & (np.hypot(*xy.T) <= self.mirror.mirror.rim_radius_mm * (1 + RIM_SLACK))
        if targets.distant:
            behind = -np.einsum("ni,ni->n", targets.xyz, paths.exit_points)
        else:
            behind = _lengths(targets.xyz - paths.exit_points)
        path = paths.path + self.shell.outer_index * behind
        blank = np.where(reflects, 1.0, np.nan)
        column = blank[:, None]
        return ReflectionPoints(
            paths.points,
            paths.normals * column,
            paths.to_pupils * column,
            paths.reflected * column,
            path * blank,
            reflects,
            valid,
            paths.points,
        )


def _step(rates: Array, miss: Array, towards: Array) -> Array:
    """Return steps (n, 2) that cancel misses (n, 3) across directions (n, 3), given rates (2, n,
    3); 0 for non-finite rates."""
    across = _across(towards)
    (a, b), (c, d) = ([np.einsum("ni,ni->n", rate, e) for rate in rates] for e in across)
    u, v = (np.einsum("ni,ni->n", miss, e) for e in across)
    det = a * d - b * c
    is_known = rates.any(axis=(0, 2))
    move: Array = (
        np.stack([b * v - d * u, c * u - a * v], axis=-1) / np.where(is_known, det, 1.0)[:, None]
    )
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


# -- Optical train ---------------------------------------------------------------------------------

PUPIL_STEPS = 12  # each reduces the residual to 1 % or less
PUPIL_CLOSE = 1e-13
MIRROR_EDGES = ("mirror", "secondary mirror")


@dataclass(frozen=True)
class OpticalTrain:
    """Optical elements between world and imager.

    ``mirror_distance_mm`` and ``secondary`` are as in :class:`omnimirror.Sensor`; ``obstructions``
    is the housing, None without one.

    >>> import omnimirror as om
    >>> train = om.load_sensor("paper-spherical").optical_train
    >>> origins, directions = train.rays_of_image(np.array([[2.6, 0.0]]), np.zeros(2))  # mm right of the axis
    >>> train.posed_mirror.trace(origins, directions).points.round(2)
    array([[43.67,  0.  , 25.7 ]])
    """

    mirror: Mirror
    lens: Lens
    mirror_distance_mm: float
    pose: MirrorPose
    form: MirrorForm
    secondary: Secondary | None = None
    obstructions: Obstructions | None = None

    @cached_property
    def posed_mirror(self) -> PosedMirror | FoldedMirror:
        """Posed mirror; with a second mirror, the lens side is in the unfolded frame."""
        if self.secondary is not None:
            return FoldedMirror(
                self.mirror, self.secondary, self.mirror_distance_mm, self.lens.pupil
            )
        return PosedMirror(self.mirror, self.pose, self.form)

    @cached_property
    def effective_mirror(self) -> PosedMirror | FoldedMirror | CoveredMirror:
        """Mirror as seen from outside: through the tube or dome, if present."""
        mirror, cover = self.posed_mirror, self.obstructions
        if cover is None or cover.housing.shell is None:
            return mirror
        assert isinstance(mirror, PosedMirror)
        ends = cover.envelope.base_mm, cover.envelope.back_mm
        return CoveredMirror(
            mirror, cover.housing.shell, ends, self.mirror_distance_mm, self.lens.pupil
        )

    @property
    def lens_offset(self) -> Array:
        """Reference point (3,) of the lens."""
        second = 0.0 if self.secondary is None else self.secondary.distance_mm
        return self.lens.offset(self.mirror_distance_mm, second)

    def clearances(
        self, facing_points: Array, points: Array, to_pupils: Array, to_targets: Array
    ) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at every edge between object and imager.

        Negative clearances mean blocked rays. This is the single definition of vignetting and
        obscuration: edges of mirrors and lens, bore, barrel, camera, rod, rims, lids and window
        frame. The stop itself is the unit disc in which rays are sampled.

        Parameters
        ----------
        facing_points, to_pupils : (n, 3) arrays
            Points on the mirror facing the lens, and directions from these to the lens.
        points, to_targets : (n, 3) arrays
            Points on the primary mirror, and directions of the reflected rays into the world.
        """
        with np.errstate(all="ignore"):
            clearances_by_part = self.effective_mirror.clearances(
                facing_points, points, to_pupils, to_targets
            )
            clearances_by_part |= self.lens.clearances(facing_points - self.lens_offset, -to_pupils)
            return clearances_by_part | self._housing_clearances(
                facing_points, points, to_pupils, to_targets
            )

    def _housing_clearances(
        self, facing_points: Array, points: Array, to_pupils: Array, to_targets: Array
    ) -> dict[str, Array]:
        if self.obstructions is None:
            return {}
        mirror, towards_lens = self.posed_mirror, to_pupils
        if isinstance(mirror, FoldedMirror):
            towards_lens = mirror.over(facing_points) - points
        return self.obstructions.clearances(points, to_targets, towards_lens, self.pose)

    def obstructed(self, origins: Array, directions: Array) -> tuple[Reflections, dict[str, Array]]:
        """Reflect unobstructed lens-side rays, and return their clearances (n,).

        Obstructions are the parts of the housing and those of two mirrors, without the edges of the
        mirrors and of the lens.
        """
        mirror, mirror_clearances = self.posed_mirror, {}
        to_pupils = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        with np.errstate(all="ignore"):
            if isinstance(mirror, FoldedMirror):
                reflections, facing_points = (
                    mirror.unobstructed(origins, directions),
                    mirror.facing_points(origins, directions),
                )
                mirror_clearances = mirror.clearances(
                    facing_points, reflections.points, to_pupils, reflections.directions
                )
                mirror_clearances = {
                    part: edge
                    for part, edge in mirror_clearances.items()
                    if part not in MIRROR_EDGES
                }
            else:
                reflections = mirror.trace(origins, directions)
                facing_points = reflections.points
            return reflections, mirror_clearances | self._housing_clearances(
                facing_points, reflections.points, to_pupils, reflections.directions
            )

    def passes_lens(self, origins: Array, directions: Array) -> Mask:
        """Return which lens-side rays (n, 3), (n, 3) pass the edges of the lens."""
        with np.errstate(all="ignore"):
            edges = self.lens.clearances(origins - self.lens_offset, directions)
        passed = np.ones(len(origins), dtype=bool)
        for edge in edges.values():
            passed &= edge >= 0
        return passed

    def passes(self, origins: Array, directions: Array, reflections: Reflections) -> Mask:
        """Return which lens-side rays (n, 3), (n, 3), given their reflections, are transmitted."""
        to_pupils = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        mirror = self.posed_mirror
        facing_points = (
            mirror.facing_points(origins, directions)
            if isinstance(mirror, FoldedMirror)
            else reflections.points
        )
        edges = self.clearances(
            facing_points, reflections.points, to_pupils, reflections.directions
        )
        passed: Mask = np.logical_and.reduce(
            [reflections.valid, *(edge >= 0 for edge in edges.values())]
        )
        return passed

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> RayEndpoints:
        """Return entrance-pupil points for points (n, 2) of the unit disc of the aperture.

        ``chief`` are slopes (n, 2) of the chief rays, for a moving pupil; paraxial by default.
        """
        if self.lens.TELECENTRIC:
            return RayEndpoints(self.lens.entrance_pupil_points(pupil), distant=True)
        return RayEndpoints(self.lens.entrance_pupil_points(pupil, chief) + self.lens_offset)

    def chief_rays_to(self, targets: RayEndpoints) -> ReflectionPoints:
        """Return the mirror points that image targets (n,) in the pupil centre.

        For a pupil that moves with the viewing angle, pupil and mirror point are found by
        iteration.
        """
        mirror, centre = self.effective_mirror, np.zeros((1, 2))
        reflection_points = mirror.specular(self.entrance_pupil_points(centre), targets)
        if not self.lens.pupil.moves:
            return reflection_points
        for _ in range(PUPIL_STEPS):
            slopes = reflection_points.chief_slopes
            reflection_points = mirror.specular(
                self.entrance_pupil_points(centre, slopes), targets, reflection_points.points
            )
            with np.errstate(invalid="ignore"):
                if not (np.abs(reflection_points.chief_slopes - slopes) > PUPIL_CLOSE).any():
                    break
        return reflection_points

    def image_of(self, targets: RayEndpoints) -> Array:
        """Return images (n, 2), mm, of targets (n,) on an untilted imager; NaN if not imaged.

        Coordinates are right of and below the optical axis.
        """
        return self._image_of(self.chief_rays_to(targets))

    def image_and_start_of(self, targets: RayEndpoints) -> tuple[Array, Array]:
        """Return these images, and the origins (n, 3), mm, of the outgoing rays."""
        reflection_points = self.chief_rays_to(targets)
        return self._image_of(reflection_points), self.effective_mirror.exit_points(
            reflection_points
        )

    def _image_of(self, reflections: ReflectionPoints) -> Array:
        image = self.lens.image_of(
            reflections.facing_points - self.lens_offset, reflections.to_pupils
        )
        image[~reflections.valid] = np.nan
        return image

    def rays_of_image(self, image_mm: Array, pupil: Array) -> tuple[Array, Array]:
        """Return origins and unit directions (n, 3) of rays from image points through the aperture.

        Image points (n, 2) are in mm right of and below the optical axis, in the image before any
        flip; aperture points (n, 2), or one, are in entrance-pupil radii.
        """
        origins, directions = self.lens.rays(image_mm, np.broadcast_to(pupil, image_mm.shape))
        origins = origins + self.lens_offset
        if self.lens.TELECENTRIC:  # from the plane in focus back to below the mirror
            bound = (
                np.linalg.norm(self.pose.shift)
                + self.mirror.rim_radius_mm
                + self.mirror.bounds[1][1]
            )
            bound += 2 * np.abs(self.lens_offset[2])
            origins = origins - (bound + np.abs(origins[:, 2:])) * directions
        return origins, directions
