"""Initial values without a prior: linear pose estimation, and the stereographic start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...base.typing import Array
from .observations import Observation, RigidTransform

# -- Linear pose estimation ------------------------------------------------------------------------

MIN_POINTS, MIN_DIRECTIONS = 6, 3  # minimum numbers of points and of directions of a target
PLANAR_DEPTH = 1e-3  # relative to its extent; a target with smaller depth is treated as planar


def linear_pose(observation: Observation, bearings: Array) -> RigidTransform | None:
    """Return the pose of a target observed at bearings (n, 3) in the camera frame.

    None if there are too few points, they are collinear or coincide in direction, or they are
    mirrored.
    """
    if not observation.is_surveyed:
        return board_pose(bearings, observation.points) if len(observation) >= MIN_POINTS else None
    is_distant = observation.distant
    candidates = []
    if is_distant.sum() >= MIN_DIRECTIONS:
        candidates.append(_among_directions(observation, bearings))
    if (~is_distant).sum() >= MIN_POINTS:
        candidates.append(_among_points(bearings[~is_distant], observation.points[~is_distant]))
    poses = [pose for pose in candidates if pose is not None]
    return min(poses, key=lambda pose: _median_error(observation, pose, bearings), default=None)


def _median_error(observation: Observation, pose: RigidTransform, bearings: Array) -> float:
    """Return the median sine of the angular residuals."""
    directions = observation.in_camera_frame(pose)
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    return float(np.median(np.linalg.norm(directions - bearings, axis=1)))


def _among_directions(observation: Observation, bearings: Array) -> RigidTransform | None:
    """Return the rotation by Kabsch's method, and the translation that fits the points."""
    is_distant = observation.distant
    directions = (
        observation.points[is_distant]
        / np.linalg.norm(observation.points[is_distant], axis=1)[:, None]
    )
    u, size, vt = np.linalg.svd(bearings[is_distant].T @ directions)
    if not size[1] > 1e-6 * size[0]:
        return None
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    if is_distant.all():
        return RigidTransform(rotation, np.zeros(3))
    projectors = (
        np.eye(3) - bearings[~is_distant][:, :, None] * bearings[~is_distant][:, None, :]
    )  # (I - b b^T)(R p + t) = 0
    rotated = observation.points[~is_distant] @ rotation.T
    translation = -np.linalg.lstsq(
        projectors.sum(axis=0), np.einsum("nij,nj->i", projectors, rotated), rcond=None
    )[0]
    return RigidTransform(rotation, translation)


def _among_points(bearings: Array, points_mm: Array) -> RigidTransform | None:
    """Return the pose of points in space from ``b x (P p) = 0``, or from a homography if coplanar."""
    centroid = points_mm.mean(axis=0)
    _, extents, axes = np.linalg.svd(points_mm - centroid, full_matrices=False)
    if not extents[2] > PLANAR_DEPTH * extents[0]:
        frame = np.stack([axes[0], axes[1], np.cross(axes[0], axes[1])])
        board = board_pose(bearings, (points_mm - centroid) @ frame.T)
        return (
            None
            if board is None
            else RigidTransform(
                board.rotation @ frame, board.translation_mm - board.rotation @ frame @ centroid
            )
        )
    size = float(extents[0]) / np.sqrt(len(points_mm))
    p = np.column_stack([(points_mm - centroid) / size, np.ones(len(points_mm))])
    solution = _linear(bearings, p)
    if solution is None or np.linalg.det(solution[:, :3]) <= 0:
        return None
    u, scales, vt = np.linalg.svd(solution[:, :3])
    rotation = u @ vt
    return RigidTransform(rotation, solution[:, 3] * size / scales.mean() - rotation @ centroid)


def _linear(bearings: Array, p: Array) -> Array | None:
    """Return the matrix (3, k) that maps p (n, k) to bearings (n, 3), up to scale.

    Unlike for pinhole cameras, bearings may exceed 90 deg from the axis: the sign is the one for
    which the mapped points agree with the bearings.
    """
    zero = np.zeros_like(p)
    bx, by, bz = bearings.T[:, :, None]
    rows = np.concatenate(
        [
            np.concatenate([zero, -bz * p, by * p], axis=1),
            np.concatenate([bz * p, zero, -bx * p], axis=1),
            np.concatenate([-by * p, bx * p, zero], axis=1),
        ]
    )
    _, values, vectors = np.linalg.svd(rows.T @ rows)
    if not values[-2] > 1e-12 * values[0]:
        return None
    matrix = vectors[-1].reshape(3, -1)
    return np.asarray(
        -matrix if np.median(np.sum(bearings * (p @ matrix.T), axis=1)) < 0 else matrix
    )


def board_pose(bearings: Array, points_mm: Array) -> RigidTransform | None:
    """Estimate the pose of a flat board from bearings (n, 3) by a linear homography.

    ``b x (H p) = 0`` for all points. The columns of H are two axes of the board and its position,
    up to a common factor.

    Parameters
    ----------
    bearings : (n, 3)
        Unit vectors in the camera frame.
    points_mm : (n, 3)
        Points of the board with z = 0.

    Returns
    -------
    RigidTransform or None
        None if the points are collinear, or coincide in direction.
    """
    flat = points_mm[:, :2]
    centroid, size = flat.mean(axis=0), float(np.abs(flat - flat.mean(axis=0)).max())
    if not size > 0:
        return None
    h = _linear(bearings, np.column_stack([(flat - centroid) / size, np.ones(len(flat))]))
    if h is None:
        return None
    # h = (r1, r2, t) up to scale; the nearest orthonormal pair r1, r2 by SVD
    a, b = np.linalg.norm(h[:, 0]), np.linalg.norm(h[:, 1])
    if not min(a, b) > 0:
        return None
    u, _, vt = np.linalg.svd(np.column_stack([h[:, 0] / a, h[:, 1] / b]), full_matrices=False)
    axes = u @ vt
    rotation = np.column_stack([axes, np.cross(axes[:, 0], axes[:, 1])])
    translation = h[:, 2] * size * 2 / (a + b)
    return RigidTransform(rotation, translation - rotation[:, :2] @ centroid)


# -- Stereographic initial camera ------------------------------------------------------------------
#
# With xi = 1 the unified model is the stereographic projection ``r = f tan(Omega / 2)``, which
# approximates every mirror and fisheye sufficiently. For each of a series of focal lengths, corners
# are back-projected to the unit sphere, each target is placed by linear equations, and the median
# residuals in pixels are compared. (Angular residuals are unsuitable: they vanish for focal lengths
# so short that all corners coincide.)

FOCALS = 25
FOCAL_RANGE = (0.08, 1.6)  # relative to the larger image side


class StereographicStart(NamedTuple):
    """Stereographic camera with board poses."""

    focal_px: float
    centre_px: tuple[float, float]
    poses: tuple[RigidTransform | None, ...]
    """Poses; None for boards that could not be placed."""
    median_px: float
    """Median residual."""


def stereographic_start(
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    centre_px: tuple[float, float],
    signs: Array,
) -> StereographicStart:
    """Return the focal length and the board poses with the smallest median residual.

    ``signs`` (3,) are the signs of right, down and the viewing direction at the image centre along
    X, Y and Z of the camera.
    """
    larger = max(image_size)
    focals = np.geomspace(FOCAL_RANGE[0] * larger, FOCAL_RANGE[1] * larger, FOCALS)
    starts = [_start_at(float(f), observations, centre_px, signs) for f in focals]
    return min(starts, key=lambda s: s.median_px)


def _start_at(
    focal_px: float,
    observations: Sequence[Observation],
    centre_px: tuple[float, float],
    signs: Array,
) -> StereographicStart:
    poses: list[RigidTransform | None] = []
    lengths = []
    for observation in observations:
        bearings = stereographic_bearings(observation.pixels, focal_px, centre_px, signs)
        pose = linear_pose(observation, bearings)
        poses.append(pose)
        if pose is not None:
            pixels = stereographic_pixels(
                observation.in_camera_frame(pose), focal_px, centre_px, signs
            )
            lengths.append(np.hypot(*(pixels - observation.pixels).T))
    median = float(np.median(np.concatenate(lengths))) if lengths else np.inf
    return StereographicStart(focal_px, centre_px, tuple(poses), median)


def stereographic_bearings(
    pixels: Array, focal_px: float, centre_px: tuple[float, float], signs: Array
) -> Array:
    """Return unit directions (n, 3) in the camera frame of pixels (n, 2) of a stereographic camera.

    >>> stereographic_bearings(np.array([[200.0, 100.0]]), 100.0, (100.0, 100.0), np.array([1, 1, -1])).round(12) + 0.0
    array([[1., 0., 0.]])
    """
    x, y = (pixels - centre_px).T / focal_px
    s = x * x + y * y
    return np.asarray(
        np.stack([2 * x / (1 + s), 2 * y / (1 + s), (1 - s) / (1 + s)], axis=1) * signs
    )


def stereographic_pixels(
    points: Array, focal_px: float, centre_px: tuple[float, float], signs: Array
) -> Array:
    """Return pixels (n, 2) of points (n, 3) in a stereographic camera."""
    right, down, forward = (points * signs).T
    denominator = np.maximum(np.linalg.norm(points, axis=1) + forward, 1e-9)
    return np.asarray(centre_px + focal_px * np.stack([right, down], axis=1) / denominator[:, None])
