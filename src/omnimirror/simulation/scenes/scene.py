"""Scenes: radiance along rays, pose of a sensor, textured surfaces and boxes.

:class:`Scene` is the interface of all scenes. Most of them consist of :class:`Surfaces`,
parallelograms and triangles with textures, and of boxes, both intersected with rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import check_fields, finite, vectors
from ...base.caching import cached_property
from ...base.colour import Light, hex_colour
from ...base.errors import InvalidParameter
from ...base.native import CompiledSurfaces, backend, kernel_array
from ...base.parameters import Parameter
from ...base.typing import Array
from ...cameras.camera import pan_tilt_rotation, rotate_vectors

# -- Scene interface and pose ----------------------------------------------------------------------


@runtime_checkable
class Scene(Protocol):
    """Scene in the world frame (x forward, y left, z up, origin at the mirror vertex).

    Results must not depend on the grouping of rays: images are rendered in tiles by several
    threads.
    """

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3), white at 1 and lamps above, of rays from origins (n, 3) mm in
        directions (n, 3).
        """
        ...


@runtime_checkable
class MeasurableScene(Protocol):
    """Scene with distances, for ground truth."""

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return distances (n,) of rays from origins (n, 3) mm in directions (n, 3) of any length;
        infinite without a surface.
        """
        ...


def rays_from(origins_mm: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Return validated rays for scenes: origins (n, 3) and directions (n, 3).

    >>> rays_from([[0, 0, 0]], [[0, 0, -2]])
    (array([[0., 0., 0.]]), array([[ 0.,  0., -2.]]))

    Raises
    ------
    InvalidParameter
        If the arguments are not vectors, differ in number, or a direction is zero or not finite.
    """
    origins = vectors("origins_mm", origins_mm, 3, is_list=True)
    towards = vectors("directions", directions, 3, is_list=True)
    if len(origins) != len(towards):
        raise InvalidParameter(
            f"origins_mm must have one origin per direction; got {len(origins)} for {len(towards)} directions"
        )
    usable = ~np.isnan(towards).any(axis=1) & towards.any(axis=1)
    if not usable.all():
        invalid = np.asarray(directions, float)[~usable][0].tolist()
        raise InvalidParameter(f"directions must be finite and nonzero; got {invalid}")
    return origins, towards


def distances_mm(scene: Scene, origins_mm: Array, directions: Array) -> Array:
    """Return distances (n,) of rays in a scene.

    Raises
    ------
    InvalidParameter
        If the scene provides no distances.
    """
    if not isinstance(scene, MeasurableScene):
        raise InvalidParameter(
            f"the scene must have the method distance_mm() for depth; got a {type(scene).__name__}"
        )
    return scene.distance_mm(origins_mm, directions)


@dataclass(frozen=True)
class DistantScene:
    """Scene moved to infinity: every ray has the radiance at the world origin in its direction.

    Images of it have no parallax, independent of the viewpoints of the mirror.

    >>> from omnimirror import Room
    >>> room = DistantScene(Room(texel_mm=40.0))
    >>> towards = np.array([[1.0, 0.2, 0.1]])
    >>> bool(np.all(room.radiance(np.full((1, 3), 999.0), towards) == room.radiance(np.zeros((1, 3)), towards)))
    True
    """

    scene: Scene

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) in directions (n, 3), independent of the origins."""
        return self.scene.radiance(np.zeros_like(origins_mm), directions)

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return infinite distances (n,)."""
        return np.full(len(directions), np.inf)


# -- Pose of the sensor ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Pose:
    """Position of the mirror vertex in a scene, and orientation of the sensor world.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Mirror vertex in the scene frame: x forward, y left, z up.
    pan_deg, tilt_deg, roll_deg
        Forward direction of the sensor: pan to the right, tilt up, and then clockwise roll about
        it.

    Raises
    ------
    InvalidParameter
        If a number is out of range.

    Examples
    --------
    >>> pose = Pose(1000.0, 0.0, 0.0, pan_deg=90.0)
    >>> pose.to_scene([[200.0, 0.0, 50.0]])  # ahead of the sensor is right in the scene, -y
    array([[1000., -200.,   50.]])
    """

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "x_mm": Parameter("mm", -1e7, 1e7, "position, forward"),
        "y_mm": Parameter("mm", -1e7, 1e7, "position, left"),
        "z_mm": Parameter("mm", -1e7, 1e7, "position, up"),
        "pan_deg": Parameter("deg", -1e4, 1e4, "pan of the forward axis, right"),
        "tilt_deg": Parameter("deg", -90.0, 90.0, "tilt of the forward axis, up"),
        "roll_deg": Parameter("deg", -1e4, 1e4, "roll about the forward axis, clockwise"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))

    @property
    def shift_mm(self) -> Array:
        """Mirror vertex (3,) in the scene frame."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    def rotation(self) -> Array:
        """Return the rotation (3, 3) from the sensor world to the scene frame.

        Returns
        -------
        (3, 3) array
            Rotation of directions from the sensor world to the scene.
        """
        return pan_tilt_rotation(self.pan_deg, self.tilt_deg, self.roll_deg)

    def to_scene(self, points_mm: Array) -> Array:
        """Convert points (n, 3) of the sensor world to the scene frame.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in the sensor world, mm.

        Returns
        -------
        (n, 3) array
            Points in the scene, mm.
        """
        return rotate_vectors(points_mm, self.rotation().T) + self.shift_mm

    def to_sensor(self, points_mm: Array) -> Array:
        """Convert points (n, 3) of the scene frame to the sensor world.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in the scene, mm.

        Returns
        -------
        (n, 3) array
            Points in the sensor world, mm.
        """
        points: Array = rotate_vectors(
            np.asarray(points_mm, dtype=float) - self.shift_mm, self.rotation()
        )
        return points


POSE_NAMES = tuple(f.name for f in fields(Pose))


@dataclass(frozen=True)
class PosedScene:
    """Scene in the frame of a sensor with a pose.

    Parameters
    ----------
    scene
        Scene to be rendered.
    pose
        Pose of the sensor in the scene.

    Examples
    --------
    >>> from omnimirror import Room
    >>> room, pose = Room(texel_mm=40.0), Pose(500.0, 0.0, 0.0, pan_deg=30.0)
    >>> wall = np.array([[3400.0, 0.0, 0.0]])
    >>> towards = pose.to_sensor(wall)
    >>> PosedScene(room, pose).distance_mm(np.zeros((1, 3)), towards)
    array([2900.])
    """

    scene: Scene
    pose: Pose

    def __post_init__(self) -> None:
        check_fields(self)

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) of rays of the sensor world.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.
        """
        return self.scene.radiance(*self._in_scene(origins_mm, directions))

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return distances (n,) of rays of the sensor world.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n,) array
            Distances, mm; infinite without a surface.
        """
        return distances_mm(self.scene, *self._in_scene(origins_mm, directions))

    def _in_scene(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        turn = self.pose.rotation().T
        return self.pose.to_scene(origins), rotate_vectors(directions, turn)


# -- Textured surfaces and boxes -------------------------------------------------------------------
#
# A face has the number 2 axis + side: 0 and 1 are the low and the high x face, up to 5. Each face is
# an image with right and up directions as seen by a viewer facing it.

Index = NDArray[np.int32]
Point = tuple[float, float, float]

FACES = range(6)
TINY = 1e-300  # replaces zero in directions: 1/0 is infinite, and 0 * (1/0) is NaN


@dataclass(frozen=True)
class Box:
    """Box between two corners, mm in the world frame."""

    low: Point
    high: Point

    def contains(self, low_mm: Array, high_mm: Array) -> bool:
        """Return whether the box between two corners (3,), mm, is inside."""
        return bool((self.low <= low_mm).all() and (self.high >= high_mm).all())


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
    return Face(
        corner + 0.0,
        right + 0.0,
        up + 0.0,
        normal,
        float(extent @ np.abs(right)),
        float(extent @ np.abs(up)),
    )


def intersect_boxes(
    room: Box, solids: Sequence[Box], origins_mm: Array, directions: Array
) -> BoxHits:
    """Return the first faces of solids or of the room that rays (n, 3) from inside the room meet.

    A ray is inside a box between the last of the three entries and the first of the three exits
    through its pairs of planes (slab method). A ray that starts inside a solid meets it at distance
    0.
    """
    if backend.is_compiled:
        distance, face = np.empty(len(origins_mm)), np.empty(len(origins_mm), np.int32)
        backend.kernels.intersect_boxes(
            _corners((room, *solids)), *_rows(origins_mm, directions), distance, face
        )
        return BoxHits(distance, face)
    return intersect_boxes_numpy(room, solids, origins_mm, directions)


def intersect_boxes_numpy(
    room: Box, solids: Sequence[Box], origins_mm: Array, directions: Array
) -> BoxHits:
    """Compute :func:`intersect_boxes` without the compiled module."""
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


def rays_inside(
    box: Box, what: str, origins_mm: ArrayLike, directions: ArrayLike
) -> tuple[Array, Array]:
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
            f"ray origins must be inside {what}, from {list(box.low)} to {list(box.high)} mm; "
            f"got {origins[~inside][0].tolist()} mm"
        )
    return origins, towards


def corners(low_mm: Array, high_mm: Array) -> tuple[Array, Array]:
    """Validate two corners (3,), mm, of a box.

    Raises
    ------
    InvalidParameter
        If the corners are not points.
    """
    return finite("low_mm", low_mm, last=3), finite("high_mm", high_mm, last=3)


def are_blocked(solids: Sequence[Box], origins_mm: Array, segments: Array) -> NDArray[np.bool_]:
    """Return the mask of segments (n, 3), starting at the origins, that intersect a solid."""
    if backend.is_compiled:
        through = np.empty(len(origins_mm), np.bool_)
        backend.kernels.are_blocked(
            _corners(solids), *_rows(origins_mm, segments), through.view(np.uint8)
        )
        return through
    return are_blocked_numpy(solids, origins_mm, segments)


def are_blocked_numpy(
    solids: Sequence[Box], origins_mm: Array, segments: Array
) -> NDArray[np.bool_]:
    """Compute :func:`are_blocked` without the compiled module."""
    origins, inverse = _by_axes(origins_mm, 1 / _without_zeros(segments))
    through = np.zeros(len(origins_mm), dtype=bool)
    for solid in solids:
        near, far = _passage(solid, origins, inverse)
        through |= np.maximum(near, 0) < np.minimum(far, 1)
    return through


def _corners(boxes: Sequence[Box]) -> Array:
    """Return low and high corners (2, n, 3)."""
    return np.array([[box.low for box in boxes], [box.high for box in boxes]], float).reshape(
        2, len(boxes), 3
    )


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


# -- Textured parallelograms and triangles ---------------------------------------------------------

EDGE_MARGIN = 1e-6  # relative to a side: no gaps between surfaces that share an edge
RAYS_AT_ONCE = 1 << 22  # rays times surfaces, in NumPy


class Texture(NamedTuple):
    """Texture of surfaces."""

    texels: Light
    """Texels (h, w, 4): linear red, green, blue, and the transmitted fraction of the background."""
    repeats: bool = False
    """True for a periodic texture; otherwise its edge is repeated."""


class SurfaceHits(NamedTuple):
    """First intersections of rays (n,)."""

    light: Light
    """Light (n, 3), 0 without intersection."""
    clear: NDArray[np.float32]
    """Transmitted fraction (n,) of the background, 0 without intersection."""
    distance: NDArray[np.float32]
    """Distances (n,) in lengths of the direction, infinite without intersection."""


RECORD = np.dtype(
    [
        ("corner", "<f4", 3),
        ("sides", "<f4", (2, 3)),
        ("texel", "<f4", 2),
        ("texel_sides", "<f4", (2, 2)),
        ("kind", "<i4"),
    ]
)
"""Surface record of the compiled kernels: corner and sides in mm, column and row of the corner in
its texture and the increments along the sides; and the texture index, or -1 minus the index for a
triangle (the half of the parallelogram at the corner).
"""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Two-sided surfaces, each a corner and two sides.

    Parameters
    ----------
    records : (n,) array of :data:`RECORD`
        Records in any order; compilation reorders them in place to the order of their tree, because
        there may be millions.
    textures

    Examples
    --------
    >>> white = Texture(np.array([[[1, 1, 1, 0]]], np.float32))
    >>> wall = np.array([[[5.0, 1, -1], [0, -2, 0], [0, 0, 2]]])
    >>> scene = Surfaces.of(wall, np.zeros((1, 3, 2)), np.zeros(1, int), np.zeros(1, bool), (white,))
    >>> seen = scene.first_hits(np.zeros((2, 3)), np.array([[1.0, 0, 0], [1.0, 1.0, 0]]))
    >>> seen.distance
    array([ 5., inf], dtype=float32)
    """

    records: NDArray[np.void]
    textures: tuple[Texture, ...]

    @classmethod
    def of(
        cls,
        positions: Array,
        texture_coordinates: NDArray[np.floating],
        texture_of: NDArray[np.integer] | int,
        is_triangle: NDArray[np.bool_] | bool,
        textures: tuple[Texture, ...],
    ) -> Surfaces:
        """Create surfaces from their parts.

        Parameters
        ----------
        positions : (n, 3, 3) array, mm
            Corner and both sides, in the world frame.
        texture_coordinates : (n, 3, 2) array, texels
            Column and row of the corner in its texture, and the increments along the sides.
        texture_of : (n,) array, or of all
            Texture index of each surface.
        is_triangle : (n,) array, or of all
            True for the half of the parallelogram at the corner.
        textures
        """
        records = np.empty(len(positions), RECORD)
        records["corner"], records["sides"] = positions[:, 0], positions[:, 1:]
        records["texel"], records["texel_sides"] = (
            texture_coordinates[:, 0],
            texture_coordinates[:, 1:],
        )
        records["kind"] = np.where(is_triangle, -1 - np.asarray(texture_of), texture_of)
        return cls(records, textures)

    def first_hits(self, origins_mm: Array, directions: Array) -> SurfaceHits:
        """Return the first intersections of rays from origins (n, 3) mm in directions (n, 3)."""
        if not backend.is_compiled:
            return self._hits_in_parts(origins_mm, directions)
        count = len(origins_mm)
        light, distance = np.empty((count, 4), np.float32), np.empty(count, np.float32)
        origins, towards = (kernel_array(a, np.float32) for a in (origins_mm, directions))
        self.native.radiance(origins, towards, light, distance)
        return SurfaceHits(light[:, :3], light[:, 3], distance)

    @cached_property
    def native(self) -> CompiledSurfaces:
        """Compiled surfaces."""
        texels = [t.texels.reshape(-1, 4) for t in self.textures]
        sizes = [(t.texels.shape[1], t.texels.shape[0], t.repeats) for t in self.textures]
        compiled = backend.kernels.Surfaces(
            np.ascontiguousarray(self.records)
            .view(np.float32)
            .reshape(len(self.records), RECORD.itemsize // 4),
            np.array(sizes, np.int32).reshape(-1, 3),
            np.ascontiguousarray(
                texels[0] if len(texels) == 1 else np.concatenate(texels), np.float32
            ),
        )
        object.__setattr__(self, "records", compiled.records.view(RECORD)[:, 0])
        return compiled

    # -- NumPy implementation ----------------------------------------------------------------------

    def _hits_in_parts(self, origins: Array, directions: Array) -> SurfaceHits:
        """Intersect every ray with every surface; same results, slowly."""
        step = max(1, RAYS_AT_ONCE // max(1, len(self.records)))
        parts = [
            self._hits_numpy(origins[i : i + step], directions[i : i + step])
            for i in range(0, len(origins), step)
        ]
        if not parts:
            return SurfaceHits(
                np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32)
            )
        return SurfaceHits(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _hits_numpy(self, origins: Array, directions: Array) -> SurfaceHits:
        distance, a, b = self._meet(origins, directions)
        first = distance.argmin(axis=1)
        rays = np.arange(len(origins))
        nearest = distance[rays, first]
        hit = np.isfinite(nearest)
        light = np.zeros((len(origins), 4), np.float32)
        records = self.records[first]
        texture_of = np.where(records["kind"] < 0, -1 - records["kind"], records["kind"])
        for number, texture in enumerate(self.textures):
            on = np.flatnonzero(hit & (texture_of == number))
            along_a, along_b = np.moveaxis(records["texel_sides"][on], 1, 0)
            texel = (
                records["texel"][on]
                + a[on, first[on], None] * along_a
                + b[on, first[on], None] * along_b
            )
            light[on] = _look_up(texture, texel)
        return SurfaceHits(light[:, :3], light[:, 3], nearest.astype(np.float32))

    def _meet(self, origins: Array, directions: Array) -> tuple[Array, Array, Array]:
        """Return distances (n, surfaces), infinite without intersection, and positions on the sides
        (Moeller and Trumbore, 1997).
        """
        corner, sides = (self.records[name].astype(float) for name in ("corner", "sides"))
        side, other = np.moveaxis(sides, 1, 0)
        p = np.cross(directions[:, None], other)
        start = origins[:, None] - corner
        q = np.cross(start, side)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / np.einsum("sj,nsj->ns", side, p)
            a = np.einsum("nsj,nsj->ns", start, p) * inverse
            b = np.einsum("nj,nsj->ns", directions, q) * inverse
            t = np.einsum("sj,nsj->ns", other, q) * inverse
            end = np.where(self.records["kind"] < 0, a + b, np.maximum(a, b))
            on = (np.minimum(a, b) >= -EDGE_MARGIN) & (end <= 1 + EDGE_MARGIN) & (t > 0)
        return np.where(on, t, np.inf), a, b


def merge_surfaces(one: Surfaces, other: Surfaces) -> Surfaces:
    """Combine surfaces in a canonical order.

    Rays meet the same one of two coincident surfaces, independent of the order of compiled
    surfaces.
    """
    other_records = other.records.copy()
    other_records["kind"] += np.where(
        other_records["kind"] < 0, -len(one.textures), len(one.textures)
    ).astype(np.int32)
    records = np.concatenate([one.records, other_records])
    return Surfaces(
        records[np.argsort(records.view(f"V{RECORD.itemsize}"))], one.textures + other.textures
    )


def _look_up(texture: Texture, texel: Array) -> Light:
    """Return texels (n, 4), interpolated bilinearly, at columns and rows (n, 2)."""
    size = np.array(texture.texels.shape[1::-1])
    if not texture.repeats:
        texel = np.clip(texel, 0, size - 1)
    first = np.floor(texel).astype(int)
    share = (texel - first).astype(np.float32)
    (left, top), (right, bottom) = (
        (np.mod(i, size) if texture.repeats else np.minimum(i, size - 1)).T
        for i in (first, first + 1)
    )
    fx, fy = share[:, :1], share[:, 1:]
    upper = texture.texels[top, left] * (1 - fx) + texture.texels[top, right] * fx
    lower = texture.texels[bottom, left] * (1 - fx) + texture.texels[bottom, right] * fx
    mixed: Light = upper * (1 - fy) + lower * fy
    return mixed


# -- Coloured triangles and tree crowns ------------------------------------------------------------


def facets(triangles: Array, colours: Light) -> Surfaces:
    """Return triangles (n, 3, 3), mm, with interpolated linear RGB (n, 3, 3) of their vertices.

    Each has four texels; the last one continues the plane of the others, for exact interpolation.

    >>> red_to_blue = facets(np.array([[[9.0, 3, -3], [9, -3, -3], [9, 3, 3]]]), np.eye(3)[None].astype(np.float32))
    >>> red_to_blue.first_hits(np.zeros((1, 3)), np.array([[9.0, 1.0, -1.0]])).light.round(3)
    array([[0.333, 0.333, 0.333]], dtype=float32)
    """
    count = len(triangles)
    columns = max(1, int(np.ceil(np.sqrt(count))))
    blocks = np.zeros((-(-count // columns), columns, 2, 2, 4), np.float32)
    row, column = np.divmod(np.arange(count), columns)
    a, b, c = np.moveaxis(np.asarray(colours, np.float32), 1, 0)
    for (i, j), light in {(0, 0): a, (0, 1): b, (1, 0): c, (1, 1): b + c - a}.items():
        blocks[row, column, i, j, :3] = light
    texels = blocks.transpose(0, 2, 1, 3, 4).reshape(2 * blocks.shape[0], 2 * columns, 4)
    at = np.empty((count, 3, 2), np.float32)
    at[:, 0], at[:, 1:] = 2 * np.stack([column, row], axis=-1), np.eye(2)
    return textured_triangles(triangles, at, Texture(texels))


def textured_triangles(triangles: Array, at: NDArray[np.floating], texture: Texture) -> Surfaces:
    """Return triangles (n, 3, 3), mm, with the texture position of the first vertex and the
    increments along both sides (n, 3, 2).
    """
    vectors = np.concatenate([triangles[:, :1], triangles[:, 1:] - triangles[:, :1]], axis=1)
    return Surfaces.of(vectors, at, 0, True, (texture,))


def combine_surfaces(parts: Sequence[Surfaces]) -> Surfaces:
    """Combine several sets of surfaces."""
    records = np.concatenate([part.records for part in parts])
    firsts = np.cumsum([0, *(len(part.textures) for part in parts[:-1])])
    shifts = np.repeat(firsts, [len(part.records) for part in parts])
    records["kind"] += np.where(records["kind"] < 0, -shifts, shifts).astype(np.int32)
    return Surfaces(records, tuple(texture for part in parts for texture in part.textures))


RINGS, SPOKES = 7, 14


def tree_crown(box: Box, colour: str, sun: Array) -> Surfaces:
    """Return the crown of a tree: an irregular ball that fills a box, lit by the sun."""
    low, high = np.array(box.low), np.array(box.high)
    chance = np.random.default_rng(int(abs(low).sum()))
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi, RINGS), 2 * np.pi * np.arange(SPOKES) / SPOKES, indexing="ij"
    )
    bumps = 1 + 0.14 * chance.standard_normal(polar.shape)
    bumps[[0, -1]] = 1.0
    ball = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    )
    points = (low + high) / 2 + (high - low) / 2 * bumps[..., None] * ball
    sunny, tone = np.clip(ball @ sun, 0, 1), 1 + 0.12 * chance.standard_normal(polar.shape)
    light = (0.25 + 0.2 * (ball[..., 2] + 1) / 2 + 0.8 * sunny) * tone
    colours = light[..., None] * hex_colour(colour)
    corners = (points, colours)
    quads = [[np.roll(a, shift, axis=1)[rows] for rows, shift in _QUAD] for a in corners]
    triangles, shades = (
        np.concatenate(
            [
                np.stack([q[i] for i in order], axis=-2).reshape(-1, 3, 3)
                for order in ((0, 1, 2), (0, 2, 3))
            ]
        )
        for q in quads
    )
    return facets(triangles, shades.astype(np.float32))


_QUAD = ((slice(None, -1), 0), (slice(1, None), 0), (slice(1, None), -1), (slice(None, -1), -1))
"""Row and azimuth indices of the four vertices of the faces between two rings."""
