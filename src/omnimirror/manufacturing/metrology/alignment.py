"""Alignment of measured points with the nominal mirror by a rigid motion.

Distances along the normal are minimised by least squares with outlier rejection. Rotationally
symmetric departures are estimated simultaneously, so that a radius error causes neither tilt nor
shift. A sphere has no axis: its rotation is that of the machine or follows the outline of the
points, and its radius is estimated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...base.typing import Array, Mask
from ...optics.mirrors import Mirror
from ...optics.mirrors.measured import MAD_TO_SIGMA

ROUNDS = 60
MIN_WIDTH = 0.2  # minimum extent, in rim radii
CENTRINGS = 3  # iterations of centring by the outline
DONE = 1e-10  # convergence limit, in rim radii
UNDETERMINED = 1e-4  # singular values below this ratio are undetermined motions
ROBUST_SCALE = 3.0  # scale of the robust weights, in standard deviations
OUTLIER = 6.0  # outlier limit, in standard deviations
UNLIKE = 0.02  # maximum median distance, in rim radii
SPHERICAL = 1e-7  # maximum relative departure of a sphere
SAME_RADIUS = 0.05  # maximum relative radius error
INSIDE = 0.15  # weight of hull corners inside the circle
CERTAIN = 4.0  # significance of a decentred outline, in standard deviations
STRAIGHT = 1e-4  # maximum relative width of a profile
BOTH_SIDES = 0.05  # minimum coverage of a profile on both sides, in rim radii
UNITS = {1e3: "um", 1e-3: "m", 1 / 25.4: "inch"}  # units by size ratio
UNIT_SLACK = 0.35  # tolerance of the size ratio, for partial coverage
FOOT_POINTS = 4001  # samples of the probe-centre table


@dataclass(frozen=True)
class Alignment:
    """Points in the frame of the mirror, and the motion to this frame.

    Attributes
    ----------
    points : (n, 3)
        Points in mm, vertex at the origin, z away from the lens.
    distance_mm : (n,)
        Distance from the mirror along its normal, positive away from the lens; NaN beyond the rim.
    is_inverted
        Whether the machine's z points towards the tool; its axes were rotated by 180 deg about x.
    vertex_mm : (3,)
        Vertex in the machine frame (rotated if ``is_inverted``).
    tilt_deg : (2,)
        Tilt of the mirror axis about x and y of this frame.
    free : (k, 5)
        Motions that the points do not determine, such as the rotation of a sphere about its centre.
    radius_mm, radius_sigma_mm
        Radius of the best-fit sphere and its standard uncertainty; None for aspheres.
    is_profile
        Whether the points are in one plane through the axis.
    is_centred_by_outline
        Whether the outline of the points determines the axis, because distances do not.
    """

    points: Array = field(repr=False)
    distance_mm: Array = field(repr=False)
    is_inverted: bool
    vertex_mm: Array
    tilt_deg: Array
    free: Array = field(repr=False)
    radius_mm: float | None = None
    radius_sigma_mm: float | None = None
    is_profile: bool = False
    is_centred_by_outline: bool = False


def aligned(
    mirror: Mirror, points: Array, source: str = "the cloud", probe_radius_mm: float = 0.0
) -> Alignment:
    """Align points (n, 3) in mm with a mirror by robust least squares.

    For points in one plane through the axis (a profile), only motions in that plane are estimated.

    Parameters
    ----------
    mirror
        Nominal mirror.
    points : (n, 3)
        Points in the machine frame; centres of the probe ball if it has a radius.
    source
        Name of the points in messages.
    probe_radius_mm
        Radius of the probe ball, which touches the mirror from the side of the lens.

    Raises
    ------
    OmnimirrorError
        If the points do not match the mirror; the message states the cause.
    """
    rim = mirror.rim_radius_mm
    line = _Line.through(points)
    if line is not None:
        points = line.flattened(points)
    _check_extent(mirror, points, source, is_profile=line is not None)
    middle = np.median(points, axis=0)
    p, is_inverted, start = _upright(mirror, points - middle, source)
    upright = p + middle * ([1.0, -1.0, -1.0] if is_inverted else 1.0)
    vertex = start + middle * ([1.0, -1.0, -1.0] if is_inverted else 1.0)
    allowed = [0, 2, 4] if line is not None else [0, 1, 2, 3, 4]
    fit = _Sphere if _is_spherical(mirror) else _General
    pose, result = fit.aligned(
        mirror, _Pose(upright - vertex, np.eye(3), vertex), allowed, source, probe_radius_mm
    )
    for _ in range(CENTRINGS if probe_radius_mm else 0):
        centres = (upright - pose.vertex) @ pose.turn.T
        contact_points = fit.contact_points(mirror, centres, probe_radius_mm, result)
        pose, result = fit.aligned(mirror, pose._replace(points=contact_points), allowed, source)
    p = pose.points
    distance, _, visible = distances(mirror, p)
    _check_likeness(mirror, points, distance, visible, source, is_profile=line is not None)
    if line is not None and not (
        p[:, 0].min() < -BOTH_SIDES * rim and p[:, 0].max() > BOTH_SIDES * rim
    ):
        raise OmnimirrorError(
            f"{source} must cover both sides of the axis; got a profile from {p[:, 0].min():.4g} to "
            f"{p[:, 0].max():.4g} mm"
        )
    axis = pose.turn.T @ [0.0, 0.0, 1.0]  # mirror axis in the machine frame
    tilt = np.degrees([-np.arctan2(axis[1], axis[2]), np.arctan2(axis[0], axis[2])])
    vertex = pose.vertex
    if line is not None:
        vertex, tilt = line.unflattened(vertex, tilt, is_inverted)
    return Alignment(
        p,
        np.where(visible, distance, np.nan),
        is_inverted,
        vertex,
        tilt,
        result.free,
        result.radius,
        result.sigma,
        line is not None,
        result.by_outline,
    )


def is_line(points: Array) -> bool:
    """Return whether points (n, 3) were measured along a line of the x-y plane: a profile."""
    return _Line.through(points) is not None


class _Line(NamedTuple):
    """Line of a profile in the machine's x-y plane: a point and a unit vector (2,)."""

    origin: Array
    along: Array

    @classmethod
    def through(cls, points: Array) -> _Line | None:
        """Return the line of a profile, or None for points all over a surface."""
        middle = np.median(points[:, :2], axis=0)
        _, size, v = np.linalg.svd(points[:, :2] - middle, full_matrices=False)
        if not size[1] <= STRAIGHT * size[0]:
            return None
        along = v[0] if v[0][np.argmax(np.abs(v[0]))] > 0 else -v[0]
        return cls(middle - along * (middle @ along), along)

    def flattened(self, points: Array) -> Array:
        """Return points (n, 3) with x along the profile and y = 0."""
        x = points[:, :2] @ self.along
        return np.column_stack([x, np.zeros(len(x)), points[:, 2]])

    def unflattened(self, vertex: Array, tilt_deg: Array, is_inverted: bool) -> tuple[Array, Array]:
        """Return vertex (3,) and tilt (2,) in the machine frame, rotated by 180 deg about x if
        ``is_inverted``.
        """
        flip = np.array([1.0, -1.0 if is_inverted else 1.0])
        (ux, uy), position = self.along * flip, (self.origin + vertex[0] * self.along) * flip
        return np.append(position, vertex[2]), tilt_deg[1] * np.array([-uy, ux])


class _Pose(NamedTuple):
    """Points (n, 3) in the current pose, rotation from the machine frame, and vertex in that frame."""

    points: Array
    turn: Array
    vertex: Array

    def moved(self, step: Array, rim: float) -> _Pose:
        """Apply a step (6,) in mm at the rim: rotate about x, y, z by its last three components,
        then shift.
        """
        return self.turned(_rotation(step[3:] / rim)).shifted(step[:3])

    def turned(self, about: Array) -> _Pose:
        """Rotate about the origin by a matrix (3, 3)."""
        return _Pose(self.points @ about.T, about @ self.turn, self.vertex)

    def shifted(self, by: Array) -> _Pose:
        """Shift by a vector (3,) in mm."""
        return _Pose(self.points + by, self.turn, self.vertex - self.turn.T @ by)


class _Found(NamedTuple):
    """Result of an alignment except the pose."""

    free: Array
    radius: float | None = None
    sigma: float | None = None
    by_outline: bool = False


class _General:
    """Alignment of mirrors with a defined axis, and of plane mirrors."""

    @staticmethod
    def aligned(
        mirror: Mirror, pose: _Pose, allowed: list[int], source: str, probe_radius_mm: float = 0.0
    ) -> tuple[_Pose, _Found]:
        """Align by distances, and by the outline for motions that distances do not determine."""
        rim = mirror.rim_radius_mm
        pose, free = _settled(mirror, pose, allowed)
        for _ in range(CENTRINGS if len(free) and len(allowed) == 5 else 0):
            pose = pose.moved(_centring(_inliers(mirror, pose.points), free, rim), rim)
            pose, free = _settled(mirror, pose, allowed)
        return pose, _Found(free, by_outline=bool(len(free)) and len(allowed) == 5)

    @staticmethod
    def contact_points(mirror: Mirror, centres: Array, radius: float, result: _Found) -> Array:
        """Convert centres (n, 3) of a probe ball to points of contact on the side of the lens.

        The normal is that of the nominal mirror at the foot of the centre. An angular error e of the normal
        changes the result by ``radius e^2 / 2`` along the normal.
        """
        x = np.linspace(0.0, mirror.rim_radius_mm, FOOT_POINTS)
        _, slope, _ = mirror.profile(x)
        out = x + radius * slope / np.sqrt(1 + slope**2)
        if not np.all(np.diff(out) > 0):
            raise OmnimirrorError(
                f"probe_radius_mm must be less than the smallest concave radius of the mirror; got {radius:g}"
            )
        r = np.hypot(centres[:, 0], centres[:, 1])
        foot = np.interp(r, out, x)
        _, slope, _ = mirror.profile(foot)
        up = 1 / np.sqrt(1 + slope**2)
        outwards = centres[:, :2] / np.maximum(r, 1e-300)[:, None]
        return centres + radius * np.concatenate(
            [-(slope * up)[:, None] * outwards, up[:, None]], axis=1
        )


class _Sphere:
    """Alignment of a sphere: the radius is estimated, the rotation is undetermined."""

    @staticmethod
    def aligned(
        mirror: Mirror, pose: _Pose, allowed: list[int], source: str, probe_radius_mm: float = 0.0
    ) -> tuple[_Pose, _Found]:
        """Move the vertex of the best-fit sphere to the origin; keep the axes unless the outline is
        decentred.
        """
        nominal = (
            float(mirror.radius_t(0.0)) + probe_radius_mm
        )  # radius of the sphere of probe centres
        centre, radius, sigma, near = _fitted_sphere(pose.points, nominal)
        if abs(radius / nominal - 1) > SAME_RADIUS and abs(radius - nominal) > CERTAIN * sigma:
            raise OmnimirrorError(
                f"{source} has a best-fit sphere of radius {radius:.5g} mm, and the mirror has {nominal:.5g} mm; "
                f"{_unit_advice(radius / nominal) or 'check that the points belong to this mirror'}"
            )
        pose = pose.shifted(-(centre - [0.0, 0.0, radius]))
        by_outline = False
        for i in range(CENTRINGS):
            if len(allowed) < 5:
                break
            about = _axis_turn(pose.points[near], radius, is_first=i == 0)
            if about is None:
                break
            by_outline, middle = True, np.array([0.0, 0.0, radius])
            pose = pose.shifted(-middle).turned(about).shifted(middle)
        free = np.array(
            [[-radius, 0, 0, 0, mirror.rim_radius_mm], [0, radius, 0, mirror.rim_radius_mm, 0]]
        )
        free = free / np.linalg.norm(free, axis=1)[:, None]
        return pose, _Found(free, radius, sigma, by_outline)

    @staticmethod
    def contact_points(mirror: Mirror, centres: Array, radius: float, result: _Found) -> Array:
        """Convert centres (n, 3) of a probe ball to points of contact, towards the centre of the
        sphere.
        """
        centre, *_ = _fitted_sphere(centres, float(mirror.radius_t(0.0)) + radius)
        inwards = centre - centres
        return np.asarray(centres + radius * inwards / np.linalg.norm(inwards, axis=1)[:, None])


def _is_spherical(mirror: Mirror) -> bool:
    """Return whether a mirror is a convex or concave sphere up to rounding."""
    radius = float(mirror.radius_t(0.0)) if not mirror.is_pointed else np.inf
    if not np.isfinite(radius) or abs(radius) <= mirror.rim_radius_mm:
        return False
    x = np.linspace(0.0, mirror.rim_radius_mm, 65)
    sphere = x**2 / (radius * (1 + np.sqrt(1 - (x / radius) ** 2)))
    return bool(np.abs(mirror.sag(x) - sphere).max() < SPHERICAL * abs(radius))


def _fitted_sphere(points: Array, nominal: float) -> tuple[Array, float, float, Mask]:
    """Fit a sphere to points (n, 3) by iteratively reweighted least squares of distances.

    Returns
    -------
    tuple
        Centre (3,), radius with the sign of the nominal one, its standard deviation, and a mask of
        inliers.
    """
    sign = np.sign(nominal)
    middle = np.median(points, axis=0)
    p = points - middle
    centre = np.array([0.0, 0.0, abs(nominal)]) * sign + [
        0,
        0,
        np.quantile(sign * p[:, 2], 0.02) * sign,
    ]
    radius, away, size = abs(nominal), np.zeros(len(p)), 1.0
    weight = np.ones(len(p))
    for _ in range(ROUNDS):
        to = p - centre
        size = np.linalg.norm(to, axis=1)
        rows = np.column_stack([-to / size[:, None], -np.ones(len(p))])
        away = size - radius
        step = np.linalg.lstsq(weight[:, None] * rows, -weight * away, rcond=1e-10)[0]
        centre, radius = centre + step[:3], radius + step[3]
        away = np.linalg.norm(p - centre, axis=1) - radius
        weight = _weights(away, 1e-12 * abs(nominal))
        if np.abs(step).max() < DONE * abs(nominal):
            break
    scatter = max(_scatter(away), 1e-12 * abs(nominal))
    near = np.abs(away) < OUTLIER * scatter
    rows = rows[near]
    covariance = np.linalg.pinv(rows.T @ rows, rcond=1e-14)
    return centre + middle, float(sign * radius), float(scatter * np.sqrt(covariance[3, 3])), near


def _axis_turn(points: Array, radius: float, is_first: bool) -> Array | None:
    """Return the rotation (3, 3) about the centre of a sphere that centres the outline of points (n, 3).

    None if the outline is centred within its uncertainty; the machine axis is then more accurate.
    """
    edge = points[_edge(points)]
    x, y = outline_centre(points)
    distance = np.hypot(edge[:, 0] - x, edge[:, 1] - y)
    sigma = float(distance.std()) * np.sqrt(2 / len(edge))
    if is_first and np.hypot(x, y) < max(CERTAIN * sigma, 1e-9 * abs(radius)):
        return None
    height = float(edge[:, 2].mean()) - radius
    length = float(np.sqrt(x * x + y * y + height * height))
    angle = np.arctan2(np.hypot(x, y), abs(height))
    turn = np.cross([x, y, height], [0.0, 0.0, np.sign(height) * length])
    return _rotation(turn / max(float(np.linalg.norm(turn)), 1e-300) * angle)


def _scatter(residuals: Array) -> float:
    """Return the robust standard deviation of residuals (n,)."""
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals - np.median(residuals))))


def _weights(residuals: Array, minimum: float) -> Array:
    """Return square roots of weights (n,) that decrease with the distance of outliers."""
    return 1 / np.sqrt(1 + (residuals / (ROBUST_SCALE * max(_scatter(residuals), minimum))) ** 2)


def _settled(mirror: Mirror, pose: _Pose, allowed: list[int]) -> tuple[_Pose, Array]:
    """Return the pose with minimum distances, and the motions (k, 5) that they do not determine."""
    rim, free = mirror.rim_radius_mm, np.zeros((0, 5))
    weight = np.ones(len(pose.points))
    for _ in range(ROUNDS):
        distance, normal, visible = distances(mirror, pose.points)
        if not visible.any():
            break
        on_mirror = pose.points - (distance / normal[:, 2])[:, None] * [0.0, 0.0, 1.0]
        step, free, weight[visible] = _step(
            on_mirror[visible],
            distance[visible],
            normal[visible],
            weight[visible],
            rim,
            allowed,
            mirror.is_pointed,
        )
        pose = pose.moved(step, rim)
        if np.abs(step).max() < DONE * rim:
            break
    return pose, free


def _inliers(mirror: Mirror, points: Array) -> Array:
    """Return points (m, 3) near the mirror, including points beyond its rim."""
    distance, _, visible = distances(mirror, points)
    away = np.abs(distance - np.median(distance[visible]))
    return points[
        away < OUTLIER * max(_scatter(distance[visible]), 1e-9 * mirror.rim_radius_mm) + 1e-3
    ]


def _centring(points: Array, free: Array, rim: float) -> Array:
    """Return the undetermined motion (6,) that centres the outline of the points about the axis."""
    z = float(points[_edge(points), 2].mean()) / rim
    shifts = np.stack(
        [free[:, 0] + z * free[:, 4], free[:, 1] - z * free[:, 3]]
    )  # shifts of the edge by each motion
    step = np.zeros(6)
    step[:5] = -np.linalg.lstsq(shifts, outline_centre(points), rcond=None)[0] @ free
    return step


def outline_centre(points: Array) -> Array:
    """Return the centre (2,) of the circle around the outline of points (n, 3) in the x-y plane.

    Measured points end somewhere inside the rim: corners of the convex hull outside the circle have a
    larger weight than those inside.
    """
    edge = points[_edge(points), :2]
    a = np.column_stack([2 * edge, np.ones(len(edge))])
    weight = np.ones(len(edge))
    for _ in range(ROUNDS):
        x, y, power = np.linalg.lstsq(
            weight[:, None] * a, weight * (edge**2).sum(axis=1), rcond=None
        )[0]
        outside = np.hypot(*(edge - [x, y]).T) > np.sqrt(max(power + x * x + y * y, 0.0))
        weight = np.where(outside, 1.0, INSIDE)
    return np.array([x, y])


def _edge(points: Array) -> NDArray[np.intp]:
    """Return the indices of the convex hull in the x-y plane."""
    from scipy.spatial import ConvexHull

    return np.asarray(ConvexHull(points[:, :2]).vertices)


def distances(mirror: Mirror, points: Array) -> tuple[Array, Array, Mask]:
    """Compute first-order signed normal distances (n,) in mm, normals (n, 3), and a mask within the
    rim.
    """
    r = np.hypot(points[:, 0], points[:, 1])
    visible = r <= mirror.rim_radius_mm
    sag, slope, _ = mirror.profile(np.minimum(r, mirror.rim_radius_mm))
    up = 1 / np.sqrt(1 + slope**2)
    outwards = points[:, :2] / np.maximum(r, 1e-300)[:, None]
    normal = np.concatenate([-(slope * up)[:, None] * outwards, up[:, None]], axis=1)
    return (points[:, 2] - sag) * up, normal, visible


def tangents(points: Array, normal: Array, rim: float) -> Array:
    """Return derivatives of distances (n,) with respect to shifts x, y, z and rotations x, y per mm
    at the rim.
    """
    return np.concatenate([normal, np.cross(points, normal)[:, :2] / rim], axis=1)


def _step(
    p: Array,
    distance: Array,
    normal: Array,
    weight: Array,
    rim: float,
    allowed: list[int],
    is_pointed: bool,
) -> tuple[Array, Array, Array]:
    """Return the motion (x, y, z, rotations) in mm that reduces distances, undetermined motions, and weights.

    Rotationally symmetric departures in low powers of r, orthogonal to an axial shift, are estimated
    simultaneously. The step equals that of ordinary least squares, but weights and uneven coverage are
    not biased by such departures.
    """
    rho = np.hypot(p[:, 0], p[:, 1]) / rim
    powers = (1, 2, 3, 4) if is_pointed else (2, 4, 6)
    along = weight * normal[:, 2]
    columns = along[:, None] * rho[:, None] ** np.array(powers)
    columns = columns - np.outer(along, along @ columns / (along @ along))
    symmetric, _ = np.linalg.qr(columns)

    def without(values: Array) -> Array:
        return values - symmetric @ (symmetric.T @ values)

    weighted, basis = (
        without(weight * distance),
        without(weight[:, None] * tangents(p, normal, rim)[:, allowed]),
    )
    u, size, v = np.linalg.svd(basis, full_matrices=False)
    is_determined = size > UNDETERMINED * size[0]
    amount = v[is_determined].T @ ((u[:, is_determined].T @ weighted) / size[is_determined])
    step, free = np.zeros(6), np.zeros((int((~is_determined).sum()), 5))
    step[allowed] = -amount
    free[:, allowed] = v[~is_determined]
    return step, free, _weights((weighted - basis @ amount) / weight, 1e-12 * rim)


def _rotation(vector: Array) -> Array:
    """Return the matrix of a rotation vector in rad."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _upright(mirror: Mirror, points: Array, source: str) -> tuple[Array, bool, Array]:
    """Return points with z away from the lens, whether they were rotated, and an initial vertex.

    The initial values follow from a paraboloid (a plane for plane mirrors), fitted by iteratively
    reweighted least squares.
    """
    rim = mirror.rim_radius_mm
    deep = float(mirror.sag(rim))
    a = np.column_stack([np.ones(len(points)), points[:, :2], (points[:, :2] ** 2).sum(axis=1)])
    a = a if deep else a[:, :3]
    weight = np.ones(len(points))
    for _ in range(ROUNDS // 4):
        bowl = np.linalg.lstsq(weight[:, None] * a, weight * points[:, 2], rcond=None)[0]
        residual = points[:, 2] - a @ bowl
        weight = _weights(residual, 1e-12 * rim)
    if not deep:
        return points, False, np.array([0.0, 0.0, float(bowl[0])])
    is_inverted = bool(bowl[3] * np.sign(deep) < 0)
    if is_inverted:
        points, bowl = points * [1.0, -1.0, -1.0], bowl * [-1.0, -1.0, 1.0, -1.0]
    if not abs(bowl[3]) > 1e-9 * abs(deep) / rim**2 + 3 * _scatter(residual) / (
        np.sqrt(len(points)) * rim**2
    ):
        raise OmnimirrorError(
            f"{source} is flat, and the mirror is {abs(deep):.4g} mm deep; check the column of heights"
        )
    x, y = np.clip(-bowl[1:3] / (2 * bowl[3]), -rim, rim)
    away = np.hypot(points[:, 0] - x, points[:, 1] - y)
    near = away < max(
        0.1 * rim, float(np.partition(away, min(9, len(away) - 1))[min(9, len(away) - 1)])
    )
    return points, is_inverted, np.array([x, y, float(np.median(points[near, 2]))])


def _check_extent(mirror: Mirror, points: Array, source: str, is_profile: bool) -> None:
    """Raise an error if the extent of the points suggests a wrong unit or insufficient coverage."""
    size = np.ptp(points[:, :2], axis=0)
    if not np.ptp(points, axis=0).any():
        raise OmnimirrorError(
            f"{source} must contain points all over the mirror; got one single point"
        )
    low, high = (np.quantile(points[:, :2], q, axis=0) for q in (0.01, 0.99))
    width, deepness = float((high - low).max()), float(abs(mirror.sag(mirror.rim_radius_mm)))
    sizes = (
        f"{source} is {width:.4g} mm wide and {float(np.ptp(np.quantile(points[:, 2], (0.01, 0.99)))):.4g} mm deep, "
        f"and the mirror {2 * mirror.rim_radius_mm:.4g} and {deepness:.4g} mm"
    )
    if advice := _unit_advice(width / (2 * mirror.rim_radius_mm)):
        raise OmnimirrorError(f"{sizes}: {advice}")
    if size[0 if is_profile else slice(None)].min() <= MIN_WIDTH * mirror.rim_radius_mm:
        raise OmnimirrorError(
            f"{sizes}: the points must cover at least {MIN_WIDTH * mirror.rim_radius_mm:.3g} mm in both directions"
        )


def _unit_advice(ratio: float) -> str:
    """Suggest the likely unit for a size ratio of points to mirror; empty if mm is plausible."""
    for factor, unit in UNITS.items():
        if factor * (1 - UNIT_SLACK) < ratio < factor * (1 + UNIT_SLACK):
            return f"the unit seems to be {unit}; specify the unit of the points (--unit {unit})"
    return ""


def _check_likeness(
    mirror: Mirror, points: Array, distance: Array, visible: Mask, source: str, is_profile: bool
) -> None:
    """Raise an error if the points do not follow the mirror, or most are beyond its rim."""
    rim = mirror.rim_radius_mm
    width = float(np.ptp(points[:, :2], axis=0).max())
    if visible.sum() < len(points) / 2:
        raise OmnimirrorError(
            f"{source} does not match the mirror: {100 * (1 - visible.mean()):.0f} % of its points are beyond the rim; "
            f"it is {width:.4g} mm wide, the mirror {2 * rim:.4g} mm; check unit and sensor"
        )
    away = float(np.sqrt(np.median(distance[visible] ** 2)))
    if not away < UNLIKE * rim:
        raise OmnimirrorError(
            f"{source} does not match the mirror: after alignment, the median distance is {away:.3g} mm and must be "
            f"less than {UNLIKE * rim:.3g} mm; check sensor, unit and order of the columns"
        )
