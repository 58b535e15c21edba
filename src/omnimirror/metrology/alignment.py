"""Where a measured mirror stood in the machine: the place that brings its points onto the mirror that was meant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import OmnimirrorError
from ..mirrors import Mirror
from ..mirrors.measured.smoothing import NORMAL

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 60
LEAST_WIDE = 0.2  # of the rim radius, across
CENTRINGS = 3  # of what no distance tells, by the outline
DONE = 1e-10  # of the rim radius, a step that is none
UNDETERMINED = 1e-4  # of the best determined motion: a motion that changes distances less is left alone
FAR = 3.0  # scatters from which on a point counts less
UNLIKE = 0.02  # of the rim radius, rms distance from which on the points are of something else


@dataclass(frozen=True)
class Alignment:
    """Points in the frame of the mirror, and how they got there.

    Attributes
    ----------
    points : (n, 3)
        mm, vertex at the origin, z away from the lens.
    distance_mm : (n,)
        From the mirror along its normal, positive away from the lens; NaN past the rim.
    turned_over
        Whether the machine's z grows towards the tool: its axes were turned about x.
    vertex_mm : (3,)
        In the machine's axes, or these turned over.
    tilt_deg : (2,)
        Of the mirror's axis about the same x and y.
    free : (k, 5)
        Motions that the points say nothing of, such as the turning of a sphere about its centre; they were left out.
    """

    points: Array = field(repr=False)
    distance_mm: Array = field(repr=False)
    turned_over: bool
    vertex_mm: Array
    tilt_deg: Array
    free: Array = field(repr=False)


def aligned(mirror: Mirror, points: Array, source: str = "the cloud") -> Alignment:
    """Points (n, 3) mm brought onto a mirror by least squares of their distances, deaf to single wrong ones.

    Raises
    ------
    OmnimirrorError
        Points that are not of this mirror.
    """
    rim = mirror.rim_radius_mm
    if not LEAST_WIDE * rim < np.ptp(points[:, :2], axis=0).min():
        raise OmnimirrorError(_unlike(mirror, points, source))
    middle = points.mean(axis=0)
    p, turned_over, start = _upright(points - middle, rim, source)
    pose = _Pose(p - start, np.eye(3), middle * ([1.0, -1.0, -1.0] if turned_over else 1.0) + start)
    pose, free = _settled(mirror, pose)
    for _ in range(CENTRINGS if len(free) else 0):
        pose = pose.moved(_centring(pose.points, free, rim), rim)
        pose, free = _settled(mirror, pose)
    p = pose.points
    distance, _, seen = distances(mirror, p)
    if seen.sum() < len(p) / 2 or not np.sqrt(np.median(distance[seen] ** 2)) < UNLIKE * rim:
        raise OmnimirrorError(_unlike(mirror, points, source))
    axis = pose.turn.T @ [0.0, 0.0, 1.0]  # of the mirror, as the machine sees it
    tilt = np.degrees([-np.arctan2(axis[1], axis[2]), np.arctan2(axis[0], axis[2])])
    return Alignment(p, np.where(seen, distance, np.nan), turned_over, pose.vertex, tilt, free)


class _Pose(NamedTuple):
    """Points (n, 3) as they lie now, how they were turned from the machine's axes, and where the vertex is in these."""

    points: Array
    turn: Array
    vertex: Array

    def moved(self, step: Array, rim: float) -> _Pose:
        """Turned about x, y, z by the last three of a step (6,) mm at the rim, and then shifted by the others."""
        about = _rotation(step[3:] / rim)
        turn = about @ self.turn
        return _Pose(self.points @ about.T + step[:3], turn, self.vertex - turn.T @ step[:3])


def _settled(mirror: Mirror, pose: _Pose) -> tuple[_Pose, Array]:
    """The pose that distances ask for, and the motions (k, 5) that they say nothing of."""
    rim, free = mirror.rim_radius_mm, np.zeros((0, 5))
    for _ in range(ROUNDS):
        distance, normal, seen = distances(mirror, pose.points)
        if not seen.any():
            break
        step, free = _step(pose.points[seen], distance[seen], normal[seen], rim)
        pose = pose.moved(step, rim)
        if np.abs(step).max() < DONE * rim:
            break
    return pose, free


def _centring(points: Array, free: Array, rim: float) -> Array:
    """The motion (6,) of those that distances say nothing of which brings the points' outline about the axis.

    A part of a sphere has no axis but that of its rim.
    """
    z = float(points[_edge(points), 2].mean()) / rim
    shifts = np.stack([free[:, 0] + z * free[:, 4], free[:, 1] - z * free[:, 3]])  # of the edge, by each motion
    step = np.zeros(6)
    step[:5] = -np.linalg.lstsq(shifts, outline_centre(points), rcond=None)[0] @ free
    return step


def outline_centre(points: Array) -> Array:
    """Centre (2,) of the circle through the outline of points (n, 3) as it is seen along z."""
    edge = points[_edge(points), :2]
    a = np.column_stack([2 * edge, np.ones(len(edge))])
    return np.asarray(np.linalg.lstsq(a, (edge**2).sum(axis=1), rcond=None)[0][:2])


def _edge(points: Array) -> NDArray[np.intp]:
    from scipy.spatial import ConvexHull

    return np.asarray(ConvexHull(points[:, :2]).vertices)


def distances(mirror: Mirror, points: Array) -> tuple[Array, Array, Mask]:
    """Signed distance (n,) mm along the normal, to first order; the normals (n, 3); which lie within the rim."""
    r = np.hypot(points[:, 0], points[:, 1])
    seen = r <= mirror.rim_radius_mm
    sag, slope, _ = mirror.profile(np.minimum(r, mirror.rim_radius_mm))
    up = 1 / np.sqrt(1 + slope**2)
    outwards = points[:, :2] / np.maximum(r, 1e-300)[:, None]
    normal = np.concatenate([-(slope * up)[:, None] * outwards, up[:, None]], axis=1)
    return (points[:, 2] - sag) * up, normal, seen


def tangents(points: Array, normal: Array, rim: float) -> Array:
    """How distances (n,) change with motions of the points: along x, y, z, and turns about x, y, per mm of rim."""
    return np.concatenate([normal, np.cross(points, normal)[:, :2] / rim], axis=1)


def _step(p: Array, distance: Array, normal: Array, rim: float) -> tuple[Array, Array]:
    """The motion (x, y, z, turns about x, y, z) mm that brings points nearer, and motions that change nothing."""
    moves = tangents(p, normal, rim)
    scatter = max(NORMAL * float(np.median(np.abs(distance - np.median(distance)))), 1e-12 * rim)
    weight = 1 / np.sqrt(1 + (distance / (FAR * scatter)) ** 2)
    u, size, v = np.linalg.svd(weight[:, None] * moves, full_matrices=False)
    known = size > UNDETERMINED * size[0]
    step = np.zeros(6)
    step[:5] = -(v[known].T @ ((u[:, known].T @ (weight * distance)) / size[known]))
    return step, v[~known]


def _rotation(vector: Array) -> Array:
    """The rotation by a vector, radians."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _upright(points: Array, rim: float, source: str) -> tuple[Array, bool, Array]:
    """Points turned so that z grows away from the lens, whether they were turned, and about where their vertex is."""
    a = np.column_stack([np.ones(len(points)), points[:, :2], (points[:, :2] ** 2).sum(axis=1)])
    bowl = np.linalg.lstsq(a, points[:, 2], rcond=None)[0]
    turned_over = bool(bowl[3] < 0)
    if turned_over:
        points, bowl = points * [1.0, -1.0, -1.0], bowl * [-1.0, -1.0, 1.0, -1.0]
    if not bowl[3] > 0:
        raise OmnimirrorError(f"{source} is flat; a mirror bends away from the lens")
    x, y = np.clip(-bowl[1:3] / (2 * bowl[3]), -rim, rim)
    near = np.hypot(points[:, 0] - x, points[:, 1] - y) < max(0.1 * rim, 1e-9)
    z = points[near, 2].min() if near.any() else points[:, 2].min()
    return points, turned_over, np.array([x, y, z])


def _unlike(mirror: Mirror, points: Array, source: str) -> str:
    width = float(np.ptp(points[:, :2], axis=0).max())
    depth = float(mirror.sag(mirror.rim_radius_mm))
    return (
        f"{source} is not of this mirror: it is {width:.4g} mm wide and {float(np.ptp(points[:, 2])):.4g} mm deep, the "
        f"mirror {2 * mirror.rim_radius_mm:.4g} and {depth:.4g} mm; check the unit and the sensor"
    )
