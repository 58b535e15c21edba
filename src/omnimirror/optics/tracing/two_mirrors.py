"""Two mirrors: chief rays, skew rays, and obscuration by the secondary mirror and the camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.caching import cached_property
from ...base.errors import NotOneToOne, SelfObstruction
from ...base.numerics import NEWTON_TOLERANCE, increasing_root, sign_change
from ...base.typing import Array
from ..lenses.lens import IN_REFERENCE_POINT, EntrancePupil
from ..mirrors import Mirror, Secondary
from . import reflection
from .meridian import NODES, ChiefRays, Meridian, checked
from .reflection import (
    MAX_STEP_LENGTH,
    MAX_STEPS,
    REFLECTION_TOLERANCE,
    RIM_SLACK,
    MirrorSurface,
    RayEndpoints,
    ReflectionPoints,
    Reflections,
    circle_clearance,
    direction_derivatives,
)

# -- Chief rays over two mirrors -------------------------------------------------------------------
#
# The secondary has chief rays of its own; the point of the primary on which a ray ends is an object
# at a finite distance for it. All lengths are in mm, angles in radians. The secondary's frame has its
# vertex as origin and its z axis away from the lens, downwards from the primary.

PROFILE = 129  # points of the secondary's profile tested for clearance
CLEARANCE_CHUNK = 1 << 12
NEAR_EDGE = 0.5  # relative to the radius of the secondary: rays farther away are not compared with its profile


def clearances(
    mirror: Mirror,
    secondary: Secondary,
    mirror_distance_mm: float,
    from_lens: Array,
    second: Array,
    first: Array,
    outgoing: Array,
    slack: float = RIM_SLACK,
) -> dict[str, Array]:
    """Return the clearance (n,), mm, of rays at both mirrors, bore and camera, and past the
    secondary.

    Parameters
    ----------
    mirror, secondary
        The primary, and the mirror in which the lens sees it.
    mirror_distance_mm
        Path from the lens to the primary over the secondary.
    from_lens, second, first, outgoing : (n, 3) arrays
        Directions from the lens, points of the secondary and of the primary, mm, and directions
        into the world, all in the frame of the primary.
    slack
        Relative tolerance of every edge, for grazing rays.
    """
    bore, lens = secondary.bore_radius_mm, secondary.lens_height(mirror_distance_mm)
    share = (np.minimum(first[:, 2], lens) - second[:, 2]) / (first[:, 2] - second[:, 2])
    at_camera = (second + share[:, None] * (first - second))[:, :2]
    values = {
        "mirror": -circle_clearance(first[:, :2], mirror.rim_radius_mm * (1 + slack)),
        "secondary mirror": -circle_clearance(
            second[:, :2], secondary.mirror.rim_radius_mm * (1 + slack)
        ),
        "bore or camera": circle_clearance(at_camera, bore * (1 - slack)),
        "secondary": _past_secondary(secondary, first, outgoing, slack),
    }
    edge = float(mirror.sag(min(bore, mirror.rim_radius_mm)))
    if lens > edge:
        at_bore = (second + ((edge - second[:, 2]) / from_lens[:, 2])[:, None] * from_lens)[:, :2]
        values["bore"] = (
            -circle_clearance(at_bore, bore * (1 + slack)) if bore else -np.hypot(*at_bore.T)
        )
    return values


def _past_secondary(secondary: Secondary, points: Array, outgoing: Array, slack: float) -> Array:
    """Return the clearance (n,), mm, of rays from the primary into the world at the secondary.

    Far from the secondary, the distance from its cylinder is returned; near it, the minimum over
    its profile.
    """
    x = np.linspace(0.0, secondary.mirror.rim_radius_mm, PROFILE)
    heights = secondary.height(x)
    p, d = points[:, :2], outgoing[:, :2]
    low, high = ((h - points[:, 2]) / outgoing[:, 2] for h in (heights.min(), heights.max()))
    closest = np.clip(
        -(p * d).sum(axis=1) / (d * d).sum(axis=1), np.minimum(low, high), np.maximum(low, high)
    )
    clearance: Array = np.hypot(*(p + closest[:, None] * d).T) - x[-1]
    clearance[(low <= 0) & (high <= 0)] = np.inf
    close = np.flatnonzero(~(clearance > NEAR_EDGE * x[-1]))
    for start in range(0, len(close), CLEARANCE_CHUNK):
        part = close[start : start + CLEARANCE_CHUNK]
        along = (heights - points[part, 2:]) / outgoing[part, 2:]
        radius = np.hypot(
            *(p[part, :, None] + along[:, None] * d[part, :, None]).transpose(1, 0, 2)
        )
        clearance[part] = np.where(along <= 0, np.inf, radius - x * (1 - slack)).min(axis=1)
    return clearance


@dataclass(frozen=True)
class TwoMirrorMeridian(Meridian):
    """Mirror seen by the lens in a second mirror; ``m`` is the path from lens to vertex over both.

    A ray of viewing angle theta leaves the secondary at ``theta' = theta + 2 beta_2`` from the axis
    (beta_2: its slope angle on the lens side) and meets the primary; ``Omega = 2 beta_1 + theta'``.

    >>> from omnimirror.optics.mirrors import Flat, Sphere
    >>> sphere = Sphere(50.0, 44.0)
    >>> folded = TwoMirrorMeridian(sphere, 180.0, secondary=Secondary(Flat(25.0), 90.0, 5.0))
    >>> bool(np.isclose(folded.omega_max, Meridian(sphere, 180.0).omega_max, rtol=1e-14))
    True
    """

    secondary: Secondary = field(kw_only=True)

    @cached_property
    def secondary_meridian(self) -> Meridian:
        """Meridian of the secondary as seen by the lens."""
        return Meridian(self.secondary.mirror, self.m - self.secondary.distance_mm, self.pupil)

    def _check_between_nodes(self) -> None:
        self._check_finer_table()

    def _rays(self, x: Array) -> ChiefRays:
        z, slope, curvature = self.mirror.profile(x)
        below = -self.secondary.distance_mm - z  # the mirror point in the secondary's frame
        second = self.secondary_meridian._rays(self.secondary_meridian.x_from_point(x, below))
        beta, theta = np.arctan(slope), second.omega
        gamma = beta + theta
        path = np.hypot(x - second.x, below - second.z)
        rays = ChiefRays(
            x,
            z,
            slope,
            curvature,
            self.m,
            self.m + z,
            beta,
            theta,
            gamma,
            beta + gamma,
            path,
            secondary_rays=second,
        )
        return self._through_cover(rays)

    def x_from_first(self, x_mm: ArrayLike) -> Array:
        second = self.secondary_meridian.trace(x_mm)
        sin, cos = np.sin(second.omega), np.cos(second.omega)
        height = -self.secondary.distance_mm - second.z

        def difference(x: Array) -> tuple[Array, Array]:
            z, slope, _ = self.mirror.profile(x)
            return (x - second.x) * cos - (z - height) * sin, cos - slope * sin

        rim = self.mirror.rim_radius_mm
        zero = np.zeros_like(second.x)
        guess = second.x - height * np.tan(second.omega)  # for a flat mirror
        return increasing_root(difference, zero, zero + rim, guess, rim)

    def x_from_tan_theta(self, tan_theta: ArrayLike) -> Array:
        return self.x_from_first(self.secondary_meridian.x_from_tan_theta(tan_theta))

    # -- obscuration -------------------------------------------------------------------------------

    @cached_property
    def x_min(self) -> float:
        """First mirror point whose rays pass bore, camera and secondary."""
        self._check_secondary()
        rim = self.mirror.rim_radius_mm
        x = np.linspace(float(self.x_from_first([0.0])[0]), rim, NODES)
        rays = self._rays(x)
        self._check_visible_rim(rays)
        checked(rays)
        self._check_bore(rays)
        start = self._first_past_mirrors(x)
        if start >= rim:
            raise SelfObstruction(
                "secondary and camera must not obscure the whole mirror, rim_radius_mm = "
                f"{rim:g}; reduce the secondary's rim_radius_mm or bore_radius_mm, or increase "
                "distance_mm"
            )
        return self._first_outside(start)

    def _first_past_mirrors(self, x: Array) -> float:
        """Return the first mirror point (n,), mm, whose rays pass bore, camera and secondary."""
        return max(self._first_clear(x, part) for part in ("bore or camera", "secondary"))

    @property
    def centre_obscured_by(self) -> str:
        x = np.linspace(float(self.x_from_first([0.0])[0]), self.mirror.rim_radius_mm, NODES)
        mirrors_alone = self.cover is None or self.x_min <= self._first_past_mirrors(x)
        return "secondary, bore" if mirrors_alone else super().centre_obscured_by

    def _first_clear(self, x: Array, part: str) -> float:
        """Return the smallest mirror point with all rays beyond it past a part."""

        def clearance(x: Array) -> Array:
            return np.clip(self._clearances(self._rays(x))[part], -1e9, 1e9)

        blocked_nodes = np.flatnonzero(clearance(x) < 0)
        if not blocked_nodes.size:
            return float(x[0])
        last = int(blocked_nodes[-1])
        if last == len(x) - 1:
            return float(x[-1])
        return sign_change(
            lambda x: float(clearance(np.array([x]))[0]), float(x[last]), float(x[last + 1]), 1e-12
        )

    def _clearances(self, rays: ChiefRays) -> dict[str, Array]:
        """Return the clearance (n,), mm, of chief rays; see :func:`clearances`."""
        second = rays.first

        def flat(across: Array, along: Array) -> Array:
            return np.stack([across, np.zeros_like(across), along], axis=-1)

        points, facing_points = (
            flat(rays.x, rays.z),
            flat(second.x, -self.secondary.distance_mm - second.z),
        )
        from_lens = flat(np.sin(second.theta), -np.cos(second.theta))
        outwards = flat(np.sin(rays.reflected), -np.cos(rays.reflected))
        with np.errstate(all="ignore"):
            return clearances(
                self.mirror, self.secondary, self.m, from_lens, facing_points, points, outwards, 0.0
            )

    # -- validity checks ---------------------------------------------------------------------------

    def _check_secondary(self) -> None:
        self.secondary.check_before(self.mirror, self.m)
        try:
            self.secondary_meridian.omega_max  # noqa: B018 - proves that it can be used
        except SelfObstruction as e:
            raise SelfObstruction(f"secondary: {e}") from None
        except NotOneToOne:
            if np.isinf(self.m):
                raise NotOneToOne(
                    "a telecentric lens requires a convex secondary, because other secondaries do not widen the beam"
                ) from None
            raise NotOneToOne(
                "the secondary must be convex, flat, or concave with its focus behind the "
                f"lens; the lens is {self.secondary_meridian.m:g} mm from it, beyond its focus, and its "
                "rays cross the axis"
            ) from None

    def _check_visible_rim(self, rays: ChiefRays) -> None:
        missing = ~np.isfinite(rays.omega)
        if missing.any():
            visible_x = float(rays.x[np.argmax(missing) - 1])
            raise SelfObstruction(
                f"the secondary must image the mirror up to its rim at x = {rays.x[-1]:g} mm; "
                f"it ends at x = {visible_x:.4g} mm; increase the secondary's rim_radius_mm or "
                "reduce the mirror's"
            )

    def _check_bore(self, rays: ChiefRays) -> None:
        """Check that the bore is large enough for the camera's chief rays."""
        second, bore = rays.first, self.secondary.bore_radius_mm
        lens = self.secondary.lens_height(self.m)
        max_radius = float(second.x[-1])
        if np.isinf(lens):
            needed = max_radius
        elif lens <= 0:
            return
        else:
            tangent = max_radius / float(second.w[-1])

            def margin(radius: float) -> float:
                return radius - max(lens - float(self.mirror.sag(radius)), 0.0) * tangent

            rim = self.mirror.rim_radius_mm
            if margin(rim) < 0:
                raise SelfObstruction(
                    "the view of the camera behind the mirror must be narrower than the mirror, "
                    f"rim_radius_mm = {rim:g}; reduce the secondary's rim_radius_mm or move the lens"
                )
            if margin(bore) >= 0:  # the margin increases with the radius
                return
            needed = sign_change(margin, 0.0, rim, 1e-12)
        if bore < needed:
            raise SelfObstruction(
                f"bore_radius_mm must be greater than {needed:.4g} mm, the view of the camera "
                f"behind the mirror; got {bore:g}"
            )


# -- Skew rays over two mirrors --------------------------------------------------------------------
#
# The lens side is described in the unfolded frame: z points from the lens through the secondary to
# the image of the primary in an ideal window; the lens is at -m, the secondary's vertex at -s. The
# world side has the primary's vertex as origin and z from the secondary to the primary. With a flat
# secondary, the path equals that of a single mirror.

SECONDARY_TO_WORLD = np.array([1.0, 1.0, -1.0])  # conversion between secondary and world frames
RAY_CHUNK = 1 << 12


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
        return TwoMirrorMeridian(
            self.mirror, self.mirror_distance_mm, self.pupil, secondary=self.secondary
        )

    @property
    def _vertex(self) -> Array:
        """Vertex (3,) of the secondary."""
        return np.array([0.0, 0.0, -self.secondary.distance_mm])

    def trace(self, origins: Array, directions: Array) -> Reflections:
        """Reflect lens-side rays (n, 3), (n, 3) at both mirrors."""
        reflections, facing_points = (
            self.unobstructed(origins, directions),
            self.facing_points(origins, directions),
        )
        with np.errstate(all="ignore"):
            to_pupils = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
            edges = self.clearances(
                facing_points, reflections.points, to_pupils, reflections.directions
            )
        valid = np.logical_and.reduce([reflections.valid, *(edge >= 0 for edge in edges.values())])
        points, outgoing, normals = (
            np.where(valid[:, None], a, np.nan)
            for a in (reflections.points, reflections.directions, reflections.normals)
        )
        return Reflections(points, outgoing, normals, valid)

    def unobstructed(self, origins: Array, directions: Array) -> Reflections:
        """Reflect rays (n, 3), (n, 3) at both mirrors, ignoring bore, camera and secondary."""
        return reflection.trace(self.mirror, *self.off_secondary(origins, directions))

    def facing_points(self, origins: Array, directions: Array) -> Array:
        """Return the intersections (n, 3) of lens-side rays with the secondary."""
        return self.over(self.off_secondary(origins, directions)[0])

    def off_secondary(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        """Reflect lens-side rays (n, 3), (n, 3) at the secondary, to the world frame."""
        first = reflection.trace(self.secondary.mirror, origins - self._vertex, directions)
        return (
            first.points * SECONDARY_TO_WORLD + self._vertex,
            first.directions * SECONDARY_TO_WORLD,
        )

    def over(self, points: Array) -> Array:
        """Convert points (n, 3) between the unfolded and the world frame."""
        there: Array = (points - self._vertex) * SECONDARY_TO_WORLD + self._vertex
        return there

    def clearances(
        self, facing_points: Array, points: Array, to_pupils: Array, to_targets: Array
    ) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at mirrors, bore and secondary.

        Parameters
        ----------
        facing_points, to_pupils : (n, 3) arrays
            Points of the secondary, and directions from these to the lens, both in the unfolded
            frame.
        points, to_targets : (n, 3) arrays
            Points of the primary, and directions from these to the object.
        """
        second, from_lens = self.over(facing_points), -to_pupils * SECONDARY_TO_WORLD
        return clearances(
            self.mirror,
            self.secondary,
            self.mirror_distance_mm,
            from_lens,
            second,
            points,
            to_targets,
        )

    # -- reflection points of a target -------------------------------------------------------------

    def specular(
        self, pupils: RayEndpoints, targets: RayEndpoints, start: Array | None = None
    ) -> ReflectionPoints:
        """Return the points (n, 3) on both mirrors that image targets in pupils.

        The optical path is stationary over two points, one on each mirror: Newton's method in four
        dimensions, from the solution for the pupil centre. ``start`` is not used.
        """
        (count,) = np.broadcast_shapes((len(pupils.xyz),), (len(targets.xyz),))
        position = np.empty((count, 4))
        with np.errstate(all="ignore"):  # non-finite results are marked invalid
            first = np.broadcast_to(self._guess(targets), (count, 4))
            pupils, targets = self._seen(pupils).spread(count), targets.spread(count)
            for start_row in range(0, count, RAY_CHUNK):
                part = slice(start_row, start_row + RAY_CHUNK)
                position[part] = self._stationary(pupils[part], targets[part], first[part])
            return self._verified(pupils, targets, position)

    def _seen(self, pupils: RayEndpoints) -> RayEndpoints:
        """Return entrance-pupil points in the secondary's frame."""
        return pupils if pupils.distant else RayEndpoints(pupils.xyz - self._vertex)

    def _guess(self, targets: RayEndpoints) -> Array:
        """Return initial points (n, 4) on both mirrors, for the pupil centre."""
        xyz, low, high = targets.xyz, self.meridian.omega_min, self.meridian.omega_max
        across, azimuth = np.hypot(xyz[:, 0], xyz[:, 1]), np.arctan2(xyz[:, 1], xyz[:, 0])
        omega = np.clip(
            np.where(np.isfinite(across), np.arctan2(across, -xyz[:, 2]), low), low, high
        )
        x = self.meridian.x_from_omega(omega)
        if not targets.distant:
            near_x = self.meridian.x_from_point(across, xyz[:, 2])
            x = np.where(np.isfinite(near_x), near_x, x)
        secondary_x = self.meridian.trace(x).first.x
        cos, sin = np.cos(azimuth), np.sin(azimuth)
        return np.stack([secondary_x * cos, secondary_x * sin, x * cos, x * sin], axis=-1)

    def _stationary(self, pupils: RayEndpoints, targets: RayEndpoints, start: Array) -> Array:
        rims = np.repeat([self.secondary.mirror.rim_radius_mm, self.mirror.rim_radius_mm], 2)
        position, active = np.array(start), np.arange(len(start))
        for _ in range(MAX_STEPS):
            path = self._path(pupils[active], targets[active], position[active])
            solvable = np.isfinite(path.second).all(axis=(1, 2)) & (np.linalg.det(path.second) != 0)
            position[active[~solvable]] = np.nan
            active = active[solvable]
            step = (
                -np.linalg.solve(path.second[solvable], path.gradient[solvable][..., None])[..., 0]
                / rims
            )
            size = np.abs(step).max(axis=1)
            position[active] += step * np.minimum(1.0, MAX_STEP_LENGTH / size)[:, None] * rims
            active = active[size > NEWTON_TOLERANCE]
            if not active.size:
                break
        return position

    def _surfaces(self, position: Array) -> tuple[MirrorSurface, MirrorSurface]:
        return MirrorSurface(self.secondary.mirror, position[:, :2]), MirrorSurface(
            self.mirror, position[:, 2:]
        )

    def _path(self, pupils: RayEndpoints, targets: RayEndpoints, position: Array) -> _Path:
        second, first = self._surfaces(position)
        length, gradient, hessian = (
            np.zeros(len(position)),
            np.zeros((len(position), 4)),
            np.zeros((len(position), 4, 4)),
        )
        for end, surface, part in ((pupils, second, slice(0, 2)), (targets, first, slice(2, 4))):
            far, pull, bend = _leg(end, surface)
            length += far
            gradient[:, part] += pull
            hessian[:, part, part] += bend
        # path between the mirrors, in the world frame; the secondary's heights point downwards
        t2, t1 = second.tangents * SECONDARY_TO_WORLD, first.tangents
        step = first.points - (second.points * SECONDARY_TO_WORLD + self._vertex)
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

    def _verified(
        self, pupils: RayEndpoints, targets: RayEndpoints, position: Array
    ) -> ReflectionPoints:
        second, first = self._surfaces(position)
        path = self._path(pupils, targets, position)
        facing_points, intersections = (
            second.points * SECONDARY_TO_WORLD + self._vertex,
            first.points,
        )
        to_pupils = pupils.xyz if pupils.distant else _unit(pupils.xyz - second.points)
        to_targets = targets.xyz if targets.distant else _unit(targets.xyz - first.points)
        between = _unit(intersections - facing_points)
        faces_both = [
            np.einsum("ni,ni->n", a, b) > 0
            for a, b in (
                (to_pupils, second.normals),
                (between * SECONDARY_TO_WORLD, second.normals),
                (-between, first.normals),
                (to_targets, first.normals),
            )
        ]
        steepness = [
            np.sqrt(1 + np.einsum("ni,ni->n", s.slopes, s.slopes)) for s in (second, first)
        ]
        misses = [np.hypot(*path.gradient[:, k : k + 2].T) / steepness[k // 2] for k in (0, 2)]
        reflects = np.logical_and.reduce(
            [*faces_both, *(miss <= REFLECTION_TOLERANCE for miss in misses)]
        )
        edges = self.clearances(second.points + self._vertex, intersections, to_pupils, to_targets)
        valid = np.logical_and.reduce([reflects, *(edge >= 0 for edge in edges.values())])
        blank = np.where(reflects, 1.0, np.nan)
        return ReflectionPoints(
            intersections,
            first.normals * blank[:, None],
            to_pupils * blank[:, None],
            to_targets * blank[:, None],
            path.length * blank - self._count_from(pupils, to_pupils),
            reflects,
            valid,
            second.points + self._vertex,
        )

    def _count_from(self, pupils: RayEndpoints, to_pupils: Array) -> Array:
        """Return the path offset of distant pupils measured from the secondary's vertex."""
        return to_pupils @ self._vertex if pupils.distant else np.zeros(len(to_pupils))

    def beam(
        self,
        pupils: RayEndpoints,
        targets: RayEndpoints,
        reflections: ReflectionPoints,
        motion: Array,
    ) -> Array:
        """Return the light (n,) per unit of pupil motion (2, 3) or (n, 2, 3).

        Cross-section (mm^2) of the beam from a distant target, or solid angle (sr) for a near one.
        The path stays stationary while the pupil moves; both points move by the inverse of its
        Hessian.
        """
        count = len(reflections.points)
        pupils, targets = self._seen(pupils).spread(count), targets.spread(count)
        position = np.concatenate(
            [reflections.facing_points[:, :2], reflections.points[:, :2]], axis=1
        )
        with np.errstate(all="ignore"):
            second, _ = self._surfaces(position)
            motion = direction_derivatives(pupils, second.points, motion)
            mixed = np.zeros((count, 4, 2))
            mixed[:, :2] = np.einsum("nai,nbi->nab", second.tangents, motion)
            moved = np.linalg.solve(self._path(pupils, targets, position).second, mixed)[:, 2:]
            cos_incidence = np.einsum("ni,ni->n", reflections.normals, reflections.to_targets)
            section: Array = (
                np.abs(np.linalg.det(moved)) * cos_incidence / np.abs(reflections.normals[:, 2])
            )
            if not targets.distant:
                section /= np.einsum(
                    "ni,ni->n", targets.xyz - reflections.points, targets.xyz - reflections.points
                )
        return section

    def exit_points(self, reflections: ReflectionPoints) -> Array:
        """Return the points (n, 3) at which rays leave the primary."""
        return reflections.points

    def objects_at(self, reflections: ReflectionPoints, distances: Array) -> Array:
        """Return objects (n, 3) at distances (n,), mm, from the primary."""
        objects: Array = reflections.points + distances[:, None] * reflections.to_targets
        return objects


def _leg(end: RayEndpoints, surface: MirrorSurface) -> tuple[Array, Array, Array]:
    """Return the path length to an end, its gradient and Hessian (n, 2, 2)."""
    if end.distant:
        far = -np.einsum("ni,ni->n", end.xyz, surface.points)
        return (
            far,
            -np.einsum("nai,ni->na", surface.tangents, end.xyz),
            -end.xyz[:, 2, None, None] * surface.bend,
        )
    step = surface.points - end.xyz
    distance = np.linalg.norm(step, axis=1)
    u = step / distance[:, None]
    along = np.einsum("nai,ni->na", surface.tangents, u)
    inner = (
        np.einsum("nai,nbi->nab", surface.tangents, surface.tangents)
        - along[:, :, None] * along[:, None, :]
    )
    return distance, along, inner / distance[:, None, None] + u[:, 2, None, None] * surface.bend


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
