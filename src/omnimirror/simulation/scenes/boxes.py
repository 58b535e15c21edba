"""Axis-aligned boxes: intersection with rays, and the intersected faces.

A face has the number 2 axis + side: 0 and 1 are the low and the high x face, up to 5. Each face is
an image with right and up directions as seen by a viewer facing it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InvalidParameter
from ...base.native import backend, kernel_array
from ...base.typing import Array
from .contract import rays_from

Index = NDArray[np.int32]
Point = tuple[float, float, float]

FACES = range(6)
TINY = 1e-300  # replaces zero in directions: 1/0 is infinite, and 0 * (1/0) is NaN


@dataclass(frozen=True)
class Box:
    """Box between two corners, mm in the world frame."""

    low: Point
    high: Point


@dataclass(frozen=True)
class Face:
    """Rectangle with an image: its lower left corner (mm), and unit vectors as seen by a viewer."""

    corner: Array
    right: Array
    up: Array
    normal: Array
    """Normal towards the viewer."""
    width_mm: float
    height_mm: float

    def point(self, x: Array | float, y: Array | float) -> Array:
        """Return world points (..., 3) mm of positions on the image, mm from its lower left corner."""
        return self.corner + np.multiply.outer(x, self.right) + np.multiply.outer(y, self.up)


class BoxHits(NamedTuple):
    """Intersections of rays (n,)."""

    distance: Array
    """Distance in lengths of the ray direction."""
    face: Index
    """Face index, 6 box + face; the room is box 0."""


def face_of(box: Box, number: int, inside: bool) -> Face:
    """Return a face of a box, seen from inside or from outside.

    On walls, up is the up direction of the world; on horizontal faces it is forward for a viewer
    facing down and backward for a viewer facing up, with the right side on the right in both cases.

    >>> front = face_of(Box((-1, -1, -1), (3, 2, 1)), 1, inside=True)
    >>> front.corner, front.right, front.up
    (array([ 3.,  2., -1.]), array([ 0., -1.,  0.]), array([0., 0., 1.]))
    """
    axis, side = divmod(number, 2)
    low, high = np.array(box.low, dtype=float), np.array(box.high, dtype=float)
    normal = np.zeros(3)
    normal[axis] = 1.0 if (side == 1) != inside else -1.0
    up = np.array([normal[2], 0.0, 0.0]) if axis == 2 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, normal)
    on_face = np.where(np.arange(3) == axis, high if side else low, 0.0)
    corner = on_face + sum(np.where(v > 0, low, high) * np.abs(v) for v in (right, up))
    extent = high - low
    return Face(corner + 0.0, right + 0.0, up + 0.0, normal, float(extent @ np.abs(right)), float(extent @ np.abs(up)))


def meet(room: Box, solids: Sequence[Box], origins_mm: Array, directions: Array) -> BoxHits:
    """Return the first faces of solids or of the room that rays (n, 3) from inside the room meet.

    A ray is inside a box between the last of the three entries and the first of the three exits
    through its pairs of planes (slab method). A ray that starts inside a solid meets it at distance
    0.
    """
    if backend.is_compiled:
        distance, face = np.empty(len(origins_mm)), np.empty(len(origins_mm), np.int32)
        backend.kernels.meet_boxes(_corners((room, *solids)), *_rows(origins_mm, directions), distance, face)
        return BoxHits(distance, face)
    return meet_in_numpy(room, solids, origins_mm, directions)


def meet_in_numpy(room: Box, solids: Sequence[Box], origins_mm: Array, directions: Array) -> BoxHits:
    """Compute :func:`meet` without the compiled module."""
    towards = _without_zeros(directions)
    inverse = 1 / towards
    exits = _crossings(np.where(towards > 0, room.high, room.low), origins_mm, inverse)
    axis = np.argmin(exits, axis=0)
    rays = np.arange(axis.size)
    distance = exits[axis, rays]
    box = np.zeros(axis.size, dtype=np.int32)
    by_axes = _by_axes(origins_mm, inverse)
    for number, solid in enumerate(solids, start=1):
        near, far = _passage(solid, *by_axes)
        near = np.maximum(near, 0)
        first = (near < far) & (near < distance)
        distance[first], box[first] = near[first], number
    side = towards[rays, axis] > 0
    hit = np.flatnonzero(box)
    lows, highs = (np.array([getattr(s, end) for s in (room, *solids)]) for end in ("low", "high"))
    near_corner = np.where(towards[hit] > 0, lows[box[hit]], highs[box[hit]])
    axis[hit] = np.argmax(_crossings(near_corner, origins_mm[hit], inverse[hit]), axis=0)
    side[hit] = towards[hit, axis[hit]] < 0
    return BoxHits(distance, (6 * box + 2 * axis + side).astype(np.int32))


def rays_inside(box: Box, what: str, origins_mm: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Validate rays (n, 3), (n, 3) of a box scene, whose name is used in messages.

    Raises
    ------
    InvalidParameter
        If the arguments are not rays, or a ray starts outside.
    """
    origins, towards = rays_from(origins_mm, directions)
    inside = ((origins >= box.low) & (origins <= box.high)).all(axis=1)
    if not inside.all():
        raise InvalidParameter(
            f"a ray starts at {origins[~inside][0].tolist()} mm, outside {what}, which reaches from "
            f"{list(box.low)} to {list(box.high)} mm"
        )
    return origins, towards


def blocked(solids: Sequence[Box], origins_mm: Array, segments: Array) -> NDArray[np.bool_]:
    """Return the mask of segments (n, 3), starting at the origins, that intersect a solid."""
    if backend.is_compiled:
        through = np.empty(len(origins_mm), np.bool_)
        backend.kernels.lead_through_boxes(_corners(solids), *_rows(origins_mm, segments), through.view(np.uint8))
        return through
    return blocked_in_numpy(solids, origins_mm, segments)


def blocked_in_numpy(solids: Sequence[Box], origins_mm: Array, segments: Array) -> NDArray[np.bool_]:
    """Compute :func:`blocked` without the compiled module."""
    origins, inverse = _by_axes(origins_mm, 1 / _without_zeros(segments))
    through = np.zeros(len(origins_mm), dtype=bool)
    for solid in solids:
        near, far = _passage(solid, origins, inverse)
        through |= np.maximum(near, 0) < np.minimum(far, 1)
    return through


def _corners(boxes: Sequence[Box]) -> Array:
    """Return low and high corners (2, n, 3)."""
    return np.array([[box.low for box in boxes], [box.high for box in boxes]], float).reshape(2, len(boxes), 3)


def _rows(origins_mm: Array, directions: Array) -> tuple[Array, Array]:
    """Convert rays to the format of the kernels."""
    return kernel_array(origins_mm, np.float64), kernel_array(directions, np.float64)


def _without_zeros(directions: Array) -> Array:
    return np.where(directions == 0, TINY, directions)


def _by_axes(origins_mm: Array, inverse: Array) -> tuple[Array, Array]:
    """Return rays (n, 3) as contiguous rows (3, n)."""
    return np.ascontiguousarray(np.transpose(origins_mm)), np.ascontiguousarray(inverse.T)


def _crossings(corners: Array, origins: Array, inverse: Array) -> Array:
    """Return distances (3, n) to the three planes through a corner."""
    return np.ascontiguousarray(((corners - origins) * inverse).T)


def _passage(box: Box, origins: Array, inverse: Array) -> tuple[Array, Array]:
    """Return entry and exit distances of rays (3, n) for a box; a ray with exit before entry misses
    it.
    """
    near, far = np.full((2, origins.shape[1]), [[-np.inf], [np.inf]])
    for low, high, start, per_mm in zip(box.low, box.high, origins, inverse, strict=True):
        a, b = (low - start) * per_mm, (high - start) * per_mm
        np.maximum(near, np.minimum(a, b), out=near)
        np.minimum(far, np.maximum(a, b), out=far)
    return near, far
