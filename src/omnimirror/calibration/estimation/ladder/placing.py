"""Linear pose estimation from bearings, without an initial value."""

from __future__ import annotations

import numpy as np

from ....base.typing import Array
from ..bundle.observations import Motion, Sighting

LEAST_POINTS, LEAST_DIRECTIONS = 6, 3  # minimum numbers of points and of directions of a target
FLAT = 1e-3  # relative to its extent; a target with smaller depth is treated as planar


def placed(sighting: Sighting, bearings: Array) -> Motion | None:
    """Return the pose of a target observed at bearings (n, 3) in the camera frame.

    None if there are too few points, they are collinear or coincide in direction, or they are
    mirrored.
    """
    if not sighting.is_surveyed:
        return board_motion(bearings, sighting.points) if len(sighting) >= LEAST_POINTS else None
    far = sighting.distant
    tried = []
    if far.sum() >= LEAST_DIRECTIONS:
        tried.append(_among_directions(sighting, bearings))
    if (~far).sum() >= LEAST_POINTS:
        tried.append(_among_points(bearings[~far], sighting.points[~far]))
    found = [motion for motion in tried if motion is not None]
    return min(found, key=lambda motion: _off(sighting, motion, bearings), default=None)


def _off(sighting: Sighting, motion: Motion, bearings: Array) -> float:
    """Return the median sine of the angular residuals."""
    seen = sighting.before(motion)
    seen = seen / np.linalg.norm(seen, axis=1)[:, None]
    return float(np.median(np.linalg.norm(seen - bearings, axis=1)))


def _among_directions(sighting: Sighting, bearings: Array) -> Motion | None:
    """Return the rotation by Kabsch's method, and the translation that fits the points."""
    far = sighting.distant
    ways = sighting.points[far] / np.linalg.norm(sighting.points[far], axis=1)[:, None]
    u, size, vt = np.linalg.svd(bearings[far].T @ ways)
    if not size[1] > 1e-6 * size[0]:
        return None
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    if far.all():
        return Motion(rotation, np.zeros(3))
    across = np.eye(3) - bearings[~far][:, :, None] * bearings[~far][:, None, :]  # (I - b b^T)(R p + t) = 0
    turned = sighting.points[~far] @ rotation.T
    shift = -np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, turned), rcond=None)[0]
    return Motion(rotation, shift)


def _among_points(bearings: Array, points_mm: Array) -> Motion | None:
    """Return the pose of points in space from ``b x (P p) = 0``, or from a homography if coplanar."""
    middle = points_mm.mean(axis=0)
    _, extents, axes = np.linalg.svd(points_mm - middle, full_matrices=False)
    if not extents[2] > FLAT * extents[0]:
        frame = np.stack([axes[0], axes[1], np.cross(axes[0], axes[1])])
        flat = board_motion(bearings, (points_mm - middle) @ frame.T)
        return None if flat is None else Motion(flat.rotation @ frame, flat.shift_mm - flat.rotation @ frame @ middle)
    size = float(extents[0]) / np.sqrt(len(points_mm))
    p = np.column_stack([(points_mm - middle) / size, np.ones(len(points_mm))])
    solution = _linear(bearings, p)
    if solution is None or np.linalg.det(solution[:, :3]) <= 0:
        return None
    u, scales, vt = np.linalg.svd(solution[:, :3])
    rotation = u @ vt
    return Motion(rotation, solution[:, 3] * size / scales.mean() - rotation @ middle)


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
    found = vectors[-1].reshape(3, -1)
    return np.asarray(-found if np.median(np.sum(bearings * (p @ found.T), axis=1)) < 0 else found)


def board_motion(bearings: Array, points_mm: Array) -> Motion | None:
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
    Motion or None
        None if the points are collinear, or coincide in direction.
    """
    flat = points_mm[:, :2]
    middle, size = flat.mean(axis=0), float(np.abs(flat - flat.mean(axis=0)).max())
    if not size > 0:
        return None
    h = _linear(bearings, np.column_stack([(flat - middle) / size, np.ones(len(flat))]))
    if h is None:
        return None
    a, b = np.linalg.norm(h[:, 0]), np.linalg.norm(h[:, 1])
    if not min(a, b) > 0:
        return None
    u, _, vt = np.linalg.svd(np.column_stack([h[:, 0] / a, h[:, 1] / b]), full_matrices=False)
    axes = u @ vt
    rotation = np.column_stack([axes, np.cross(axes[:, 0], axes[:, 1])])
    place = h[:, 2] * size * 2 / (a + b)
    return Motion(rotation, place - rotation[:, :2] @ middle)
