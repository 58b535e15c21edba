"""Where a target stands, from the directions in which its points are seen: linear equations, without any guess."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..bundle.observations import Motion, Sighting

Array = NDArray[np.float64]

LEAST_POINTS, LEAST_DIRECTIONS = 6, 3  # of a target, below which it is not placed
FLAT = 1e-3  # of its extent: a target that leaves its plane by less has none of depth to be placed by


def placed(sighting: Sighting, bearings: Array) -> Motion | None:
    """Where a target stands whose points and directions are seen in directions (n, 3) of the camera frame.

    None where there are too few, where they lie on a line or in one direction, or where they are a mirror image of what
    they should be.
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
    """How far directions are off, the median of sines."""
    seen = sighting.before(motion)
    seen = seen / np.linalg.norm(seen, axis=1)[:, None]
    return float(np.median(np.linalg.norm(seen - bearings, axis=1)))


def _among_directions(sighting: Sighting, bearings: Array) -> Motion | None:
    """The rotation that takes directions onto those seen, by Kabsch's method, and the shift for which points follow."""
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
    """Where points in space stand: ``b x (P p) = 0``, or a homography where they lie in a plane."""
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
    """The matrix (3, k) that takes p (n, k) into the directions (n, 3) in which they are seen, up to its size.

    Unlike with pinholes the directions may be more than a right angle off the axis: the matrix's sign is the one for
    which points lie in the directions in which they are seen.
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
    """Where a flat board stands, from directions (n, 3) to its points (n, 3) with z = 0, by a linear homography.

    ``b x (H p) = 0`` for all points; columns of H are two axes of the board and its place, up to one factor.

    Parameters
    ----------
    bearings : (n, 3)
        Unit vectors in the camera frame.
    points_mm : (n, 3)
        On the board.

    Returns
    -------
    Motion or None
        None where the points lie on a line, or all in one direction.
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
