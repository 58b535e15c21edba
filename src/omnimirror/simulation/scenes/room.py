"""Furnished room: the main bundled scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import validate_arguments
from ...base.caching import cached_property
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.native import backend
from ...base.parameters import Parameter
from ...base.typing import Array
from ._painting import (
    Canvas,
    Extent,
    Landscape,
    Paint,
    Surroundings,
    illuminated_texels,
    landscape_light,
    light_on,
    outer_faces,
    surfaces_of_faces,
)
from .scene import FACES, Box, Face, corners, face_of, intersect_boxes, rays_inside

# -- Decoration ------------------------------------------------------------------------------------
#
# Solids are defined in the world frame (mm, sensor at the origin); walls are painted in millimetres
# from their lower left corner, as seen by a viewer.

ROOM = Box((-2600.0, -2700.0, -1200.0), (3400.0, 2300.0, 1800.0))
"""Room of 6 x 5 x 3 m; the sensor is 1.2 m high and off-centre."""

INK, CREAM, WHITE = Paint("#26323c"), Paint("#ece6d8"), Paint("#f4f2ec")
OAK, WALNUT, STEEL = Paint("#b08a5e"), Paint("#6a4a35"), Paint("#4a5056")
LAMP, GLASS = Paint("#fff1dc", glow=1.4), Paint(clear=1.0)


class Sign(NamedTuple):
    """Word on a wall."""

    face: int
    word: str
    x: float
    y: float
    """Centre, mm on the wall."""
    cap_height: float
    paint: Paint


SIGNS = (
    Sign(1, "OMNIMIRROR", 2500.0, 1930.0, 350.0, Paint("#1f3a52")),
    Sign(3, "GARDEN", 3000.0, 2570.0, 290.0, Paint("#5b4a2a")),
    Sign(0, "LIBRARY", 3830.0, 1880.0, 290.0, Paint("#2c4734")),
    Sign(2, "EXIT", 4800.0, 2440.0, 250.0, WHITE),
)


def paint_room(
    face: int, texel_mm: float, width_mm: float, height_mm: float
) -> tuple[Canvas, dict[str, Extent]]:
    """Paint one of the six faces of the room; return the canvas and the extents of its words."""
    painters: tuple[tuple[str, Callable[[Canvas], None]], ...] = (
        ("#b3bfa8", _back_wall),
        ("#b9c7cf", _front_wall),
        ("#cdab97", _right_wall),
        ("#d9cba9", _left_wall),
        ("#c9c0b0", _floor),
        ("#f0eee8", _ceiling),
    )
    ground, paint = painters[face]
    canvas = Canvas(width_mm, height_mm, texel_mm, Paint(ground))
    paint(canvas)
    return canvas, {s.word: canvas.text(s.word, *s[2:]) for s in SIGNS if s.face == face}


# -- Faces of the room -----------------------------------------------------------------------------


def _wall(canvas: Canvas, dado: str) -> None:
    """Paint the lower part of a wall: a darker field with a rail above it and a skirting board
    below it.
    """
    canvas.rectangle(0, 0, canvas.width_mm, 820, Paint(dado))
    canvas.rectangle(0, 820, canvas.width_mm, 860, CREAM)
    canvas.rectangle(0, 0, canvas.width_mm, 110, CREAM)


def _front_wall(canvas: Canvas) -> None:
    _wall(canvas, "#7f97a6")
    canvas.rectangle(730, 1590, 4270, 1615, Paint("#1f3a52"))


def _left_wall(canvas: Canvas) -> None:
    _wall(canvas, "#b7a06f")
    for left in (700.0, 3700.0):
        _window(canvas, left, 900.0, left + 1600.0, 2260.0)


def _back_wall(canvas: Canvas) -> None:
    _wall(canvas, "#7f9277")
    _clock(canvas, 3830.0, 2440.0, 210.0)


def _right_wall(canvas: Canvas) -> None:
    _wall(canvas, "#a67a62")
    _door(canvas, 4300.0, 5300.0, 2120.0)
    canvas.rectangle(4230, 2250, 5370, 2630, Paint("#1e6b45"))
    canvas.frame(4230, 2250, 5370, 2630, 18, WHITE)
    _painting(canvas, 900.0, 1180.0)


def _floor(canvas: Canvas) -> None:
    canvas.checkerboard(canvas.width_mm / 2, canvas.height_mm / 2, 500.0, Paint("#6f6a66"))
    canvas.rectangle(1250, 1150, 3350, 4050, Paint("#8a4a41"))
    for inset, paint in ((60.0, CREAM), (130.0, Paint("#2f4858")), (300.0, CREAM)):
        canvas.frame(1250 + inset, 1150 + inset, 3350 - inset, 4050 - inset, 25, paint)
    _compass(canvas, 2300.0, 2600.0)


def _compass(canvas: Canvas, x: float, y: float) -> None:
    """Paint four letters below the sensor; north is forward."""
    for radius, paint in (
        (620.0, CREAM),
        (595.0, Paint("#2f4858")),
        (240.0, CREAM),
        (220.0, Paint("#8a4a41")),
    ):
        canvas.disc(x, y, radius, paint)
    for letter, right, up in (("N", 0, 1), ("E", 1, 0), ("S", 0, -1), ("W", -1, 0)):
        canvas.text(letter, x + 415 * right, y + 415 * up, 190.0, CREAM)


def _ceiling(canvas: Canvas) -> None:
    for middle in (
        750.0,
        2250.0,
        3750.0,
        5250.0,
    ):  # ordered from the front, as seen by a viewer facing up
        canvas.rectangle(1550, middle - 150, 3450, middle + 150, STEEL)
        canvas.rectangle(1580, middle - 120, 3420, middle + 120, LAMP)


def _window(canvas: Canvas, left: float, bottom: float, right: float, top: float) -> None:
    canvas.rectangle(left - 60, bottom - 60, right + 60, top + 60, WHITE)
    canvas.rectangle(left, bottom, right, top, GLASS)
    canvas.frame(left, bottom, right, top, 50, WHITE)
    middle, bar = (left + right) / 2, bottom + 0.66 * (top - bottom)
    canvas.rectangle(middle - 30, bottom, middle + 30, top, WHITE)
    canvas.rectangle(left, bar - 25, right, bar + 25, WHITE)
    canvas.frame(left - 60, bottom - 60, right + 60, top + 60, 8, Paint("#8f8467"))
    canvas.rectangle(left - 110, bottom - 85, right + 110, bottom - 50, OAK)


def _door(canvas: Canvas, left: float, right: float, top: float) -> None:
    canvas.rectangle(left - 90, 0, right + 90, top + 90, CREAM)
    canvas.rectangle(left, 0, right, top, WALNUT)
    for bottom, height in ((180.0, 760.0), (1060.0, 880.0)):
        for x in (left + 110, left + 540):
            canvas.rectangle(x, bottom, x + 350, bottom + height, Paint("#7d5a42"))
            canvas.frame(x, bottom, x + 350, bottom + height, 15, Paint("#4c3324"))
    canvas.disc(right - 60, 1000, 32, Paint("#d9b45a"))


def _painting(canvas: Canvas, left: float, bottom: float) -> None:
    canvas.rectangle(left, bottom, left + 1900, bottom + 1150, WALNUT)
    canvas.rectangle(left + 60, bottom + 60, left + 1840, bottom + 1090, WHITE)
    fields = (
        (170, 170, 780, 560, "#26456b"),
        (170, 590, 780, 980, "#d8b04c"),
        (810, 170, 1180, 980, "#efe7d4"),
    )
    for x0, y0, x1, y1, colour in (
        *fields,
        (1210, 480, 1730, 980, "#a8402f"),
        (1210, 170, 1730, 450, "#3d4247"),
    ):
        canvas.rectangle(left + x0, bottom + y0, left + x1, bottom + y1, Paint(colour))
    canvas.disc(left + 995, bottom + 690, 150, INK)
    canvas.disc(left + 1470, bottom + 730, 170, CREAM)


def _clock(canvas: Canvas, x: float, y: float, radius: float) -> None:
    canvas.disc(x, y, radius, INK)
    canvas.disc(x, y, radius - 22, WHITE)
    for dx, dy in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        canvas.disc(x + 155 * dx, y + 155 * dy, 13, INK)
    canvas.rectangle(x - 9, y - 10, x + 9, y + 140, INK)  # three o'clock
    canvas.rectangle(x - 10, y - 9, x + 105, y + 9, INK)


# -- Furniture -------------------------------------------------------------------------------------


class Piece(NamedTuple):
    """Solid with its object, its paint, and the content of its faces."""

    name: str
    box: Box
    paint: Paint
    decorate: dict[int, Callable[[Canvas], None]] = {}  # noqa: RUF012 - never changed


def _books(canvas: Canvas) -> None:
    """Paint four shelves of books whose sizes and colours have a long period without visible
    pattern.
    """
    colours = (
        "#7a2e2a",
        "#2f4858",
        "#d2c4a0",
        "#3f5e46",
        "#8a6a3d",
        "#54415f",
        "#b9b3a5",
        "#1f3a52",
        "#a35a3a",
    )
    for shelf in range(4):
        bottom, x = 60.0 + 490 * shelf, 60.0
        canvas.rectangle(50, bottom, canvas.width_mm - 50, bottom + 440, Paint("#2b2019"))
        for i in range(100):
            n = 37 * shelf + i
            width, height = 34.0 + 13 * (n * 7 % 5), 270.0 + 24 * (n * 5 % 7)
            if x + width > canvas.width_mm - 60:
                break
            if n % 17 != 11:  # occasional gaps
                canvas.rectangle(x, bottom, x + width, bottom + height, Paint(colours[n * 4 % 9]))
                canvas.rectangle(
                    x + 5, bottom + 0.7 * height, x + width - 5, bottom + 0.76 * height, CREAM
                )
            x += width + 4


def _cabinet_doors(canvas: Canvas) -> None:
    canvas.rectangle(0, 0, canvas.width_mm, 80, STEEL)
    for i in range(4):
        left = 20 + i * (canvas.width_mm - 40) / 4
        right = left + (canvas.width_mm - 40) / 4
        canvas.frame(left + 10, 100, right - 10, canvas.height_mm - 30, 10, WALNUT)
        canvas.disc(right - 50 if i % 2 == 0 else left + 50, 480, 18, INK)


def _ribs(canvas: Canvas) -> None:
    for i in range(int(canvas.width_mm // 70)):
        canvas.rectangle(25 + 70 * i, 30, 45 + 70 * i, canvas.height_mm - 30, Paint("#b9b6ad"))


def _legs(
    name: str, left: float, right: float, back: float, front: float, top: float, paint: Paint
) -> list[Piece]:
    """Return four legs within the corners of a table top at the height ``top`` over the sensor."""
    t, floor = 70.0, ROOM.low[2]
    corners = [(x, y) for x in (left, right - t) for y in (back, front - t)]
    return [Piece(name, Box((x, y, floor), (x + t, y + t, top)), paint) for x, y in corners]


FLOOR, CLOTH = ROOM.low[2], Paint("#4f6a6e")

PIECES: tuple[Piece, ...] = (
    *(
        Piece("beam", Box((x - 60, -2700, 1630), (x + 60, 2300, 1800)), WALNUT)
        for x in (-1100.0, 400.0, 1900.0)
    ),
    Piece("cabinet", Box((2950, -1300, FLOOR), (3400, 1300, -450)), OAK, {0: _cabinet_doors}),
    Piece("bookcase", Box((-2600, -2400, FLOOR), (-2280, 0, 820)), WALNUT, {1: _books}),
    Piece("radiator", Box((-1800, 2150, -1060), (-400, 2280, -470)), WHITE, {2: _ribs}),
    Piece("bench", Box((950, 1800, -790), (2850, 2260, -730)), OAK),
    *_legs("bench", 1000, 2800, 1830, 2240, -790, STEEL),
    Piece("table", Box((1100, -2000, -490), (2600, -1000, -440)), OAK),
    *_legs("table", 1150, 2550, -1950, -1050, -490, OAK),
    Piece("book", Box((1500, -1620, -440), (1800, -1380, -385)), Paint("#7a2e2a")),
    Piece("book", Box((1530, -1610, -385), (1780, -1420, -340)), Paint("#d2c4a0")),
    Piece("armchair", Box((-2350, 700, -1160), (-1600, 1500, -790)), CLOTH),
    Piece("armchair", Box((-2500, 590, -1160), (-2350, 1610, -330)), CLOTH),
    *(
        Piece("armchair", Box((-2350, y, -1160), (-1600, y + 110, -580)), CLOTH)
        for y in (590.0, 1500.0)
    ),
)
"""All solids in the room, in world millimetres."""


# -- Room ------------------------------------------------------------------------------------------

TEXEL = Parameter("mm", 1.0, 100.0, "texel size of the painted surfaces")
WALL_AHEAD = 1  # face of the wall ahead
PLAIN_TEXEL_MM = 25.0  # sufficient for faces with shading only
SOLIDS = tuple(piece.box for piece in PIECES)
SIDES = ("wall behind", "wall ahead", "wall right", "wall left", "floor", "ceiling")
FURNITURE = tuple(dict.fromkeys(piece.name for piece in PIECES))
LABELS = np.array(
    [
        *range(1, 1 + len(SIDES)),
        *(1 + len(SIDES) + FURNITURE.index(p.name) for p in PIECES for _ in SIDES),
    ],
    np.int64,
)
"""Label of each face, starting at 1: the sides of the room individually, then one label per
solid.
"""


@dataclass(frozen=True)
class Room:
    """Room of 6 x 5 x 3 m around the sensor, which is 1.2 m high and off-centre.

    OMNIMIRROR is written on the wall ahead, GARDEN over the windows to the left, LIBRARY behind and
    EXIT over the door to the right. The walls are at finite distances and rays are intersected
    exactly; images therefore include the parallax of the actual viewpoints of the mirror. The
    landscape outside the windows is at infinity.

    Parameters
    ----------
    texel_mm : mm
        Texel size of the walls. The room is painted and lit on first use, once for all equal
        rooms.
    other_texel_mm : mm
        Texel size of all faces except the wall ahead; ``texel_mm`` if None. At 2 mm the whole room
        takes 0.5 GB, and three times as much during painting; the wall ahead alone 1/8 of it.

    Raises
    ------
    InvalidParameter
        If the texel size is out of range.

    Examples
    --------
    >>> room = Room(texel_mm=40.0)
    >>> wall, sky = room.radiance(np.zeros((2, 3)), [[1.0, 0.0, 0.1], [1.5, 2.3, 0.8]])
    >>> bool(sky[2] > 1.2 * sky[0])
    True
    >>> room.sign_corners_mm("OMNIMIRROR").round()  # on the wall x = 3400, as one reads it
    array([[ 3400.,  1620.,   920.],
           [ 3400., -2020.,   920.],
           [ 3400., -2020.,   520.],
           [ 3400.,  1620.,   520.]])
    """

    texel_mm: float = 5.0
    other_texel_mm: float | None = None

    def __post_init__(self) -> None:
        TEXEL.check("texel_mm", self.texel_mm)
        if self.other_texel_mm is not None:
            TEXEL.check("other_texel_mm", self.other_texel_mm)

    @property
    def _faces(self) -> _Painted:
        return _painted(
            self.texel_mm, self.texel_mm if self.other_texel_mm is None else self.other_texel_mm
        )

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any
        non-zero length.

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

        Raises
        ------
        InvalidParameter
            If a ray starts outside the room, or a direction is zero or not finite.
        """
        origins, towards = rays_inside(ROOM, "the room", origins_mm, directions)
        painted = self._faces
        if backend.is_compiled:
            return painted.surroundings.radiance(origins, towards)
        hits = intersect_boxes(
            ROOM, SOLIDS, origins, towards
        )  # boxes are faster than surfaces in NumPy
        light, clear = painted.look_up(hits.face, origins + hits.distance[:, None] * towards)
        outside = np.flatnonzero(clear)
        light[outside] += clear[outside, None] * landscape_light(towards[outside])
        return light

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces for rays that start in a box between two corners.

        Parameters
        ----------
        low_mm, high_mm : (3,)
            Corners of the box, mm.

        Returns
        -------
        Surroundings
            Surfaces of the room; None if the box is not inside it.

        Raises
        ------
        InvalidParameter
            If the corners are not points.
        """
        low_mm, high_mm = corners(low_mm, high_mm)
        return self._faces.surroundings if ROOM.contains(low_mm, high_mm) else None

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays to a wall or a piece of furniture; window panes count as
        walls.

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

        Raises
        ------
        InvalidParameter
            As in :meth:`radiance`.
        """
        origins, towards = rays_inside(ROOM, "the room", origins_mm, directions)
        length: Array = np.linalg.norm(towards, axis=1)
        return intersect_boxes(ROOM, SOLIDS, origins, towards).distance * length

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the labels of :meth:`labels`, starting at 1: the sides of the room, and the
        objects in it.
        """
        return SIDES + FURNITURE

    def labels(self, origins_mm: ArrayLike, directions: ArrayLike) -> NDArray[np.int64]:
        """Return the labels of rays.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n,) array
            Indices in `label_names`, starting at 1.

        Raises
        ------
        InvalidParameter
            As in :meth:`radiance`.
        """
        origins, towards = rays_inside(ROOM, "the room", origins_mm, directions)
        labels: NDArray[np.int64] = LABELS[intersect_boxes(ROOM, SOLIDS, origins, towards).face]
        return labels

    @property
    def words(self) -> tuple[str, ...]:
        """Words on the walls."""
        return tuple(self._faces.signs)

    @validate_arguments
    def sign_corners_mm(self, word: str) -> Array:
        """Return the corners (4, 3) mm of the ink of a word: top left, top right, bottom right,
        bottom left.

        Parameters
        ----------
        word
            Word in :attr:`words`.

        Returns
        -------
        (4, 3) array
            Corners, mm.

        Raises
        ------
        InvalidParameter
            If the word is not on a wall.
        """
        signs = self._faces.signs
        if word not in signs:
            raise InvalidParameter(f"the word must be one of {', '.join(signs)}; got {word!r}")
        return signs[word].copy()


# -- Illuminated faces -----------------------------------------------------------------------------


class _Painted:
    """All faces of the room and of the solids in a single list of texels, indexed by point."""

    def __init__(self, faces: list[Face], images: list[Light], signs: dict[str, Array]) -> None:
        self.signs = signs
        self.surroundings = Surroundings(surfaces_of_faces(faces, images), Landscape())
        self._sizes = np.array([p.shape[:2] for p in images])
        self._starts = np.concatenate([[0], np.cumsum(self._sizes.prod(axis=1))])[:-1]
        self._images = images
        # Column and row of a point p are A p + b; columns count from the left, rows from the top
        scale = self._sizes[:, ::-1] / np.array([(f.width_mm, f.height_mm) for f in faces])
        axes = np.array([(f.right, -f.up) for f in faces]) * scale[..., None]
        top_left = np.array([f.point(0.0, f.height_mm) for f in faces])
        self._axes, self._shifts = axes, -np.einsum("fij,fj->fi", axes, top_left) - 0.5

    @cached_property
    def _texels(self) -> Light:
        """All texels in a row; unused with the compiled module, which would store them twice."""
        return np.concatenate([p.reshape(-1, 4) for p in self._images])

    def look_up(
        self, face: NDArray[np.int32], points_mm: Array
    ) -> tuple[Light, NDArray[np.float32]]:
        """Return light (n, 3) of points (n, 3) on faces (n,), and the transmitted fraction (n,) of
        the background.
        """
        position = np.einsum("nij,nj->ni", self._axes[face], points_mm) + self._shifts[face]
        last = self._sizes[face] - 1
        rows, columns = last.T
        column = np.clip(position[:, 0], 0, columns)
        row = np.clip(position[:, 1], 0, rows)
        left, top = column.astype(np.int64), row.astype(np.int64)
        fx = (column - left).astype(np.float32)[:, None]
        fy = (row - top).astype(np.float32)[:, None]
        first = self._starts[face] + top * (columns + 1) + left
        right = (left < columns).astype(np.int64)
        below = np.where(top < rows, columns + 1, 0)
        upper = self._mix(first, first + right, fx)
        lower = self._mix(first + below, first + below + right, fx)
        upper += fy * (lower - upper)
        return upper[:, :3], upper[:, 3]

    def _mix(self, one: NDArray[np.int64], other: NDArray[np.int64], share: Light) -> Light:
        texels = self._texels[one]
        texels += share * (self._texels[other] - texels)
        return texels


@lru_cache(maxsize=2)
def _painted(texel_mm: float, other_texel_mm: float) -> _Painted:
    """Paint and light all faces, and store both in one image per face."""
    faces = [face_of(ROOM, i, inside=True) for i in FACES]
    faces += outer_faces(SOLIDS)
    canvases: list[Canvas] = []
    signs: dict[str, Array] = {}
    for i in FACES:
        canvas, extents = paint_room(
            i,
            texel_mm if i == WALL_AHEAD else other_texel_mm,
            faces[i].width_mm,
            faces[i].height_mm,
        )
        canvases.append(canvas)
        signs |= {word: _corners(faces[i], extent) for word, extent in extents.items()}
    for number, face in enumerate(faces[6:]):
        piece = PIECES[number // 6]
        decorate = piece.decorate.get(number % 6)
        texel_size = max(other_texel_mm, PLAIN_TEXEL_MM) if decorate is None else other_texel_mm
        canvas = Canvas(face.width_mm, face.height_mm, texel_size, piece.paint)
        if decorate is not None:
            decorate(canvas)
        canvases.append(canvas)
    lights = light_on(list(zip(faces, canvases, strict=True)), ROOM, SOLIDS)
    images = []
    for canvas, light in zip(canvases, lights, strict=True):
        images.append(illuminated_texels(canvas, light))
        # A fine room takes 500 MB, and its paint twice as much
        canvas.texels = canvas.texels[:0].copy()
    return _Painted(faces, images, signs)


def _corners(face: Face, extent: Extent) -> Array:
    left, bottom, right, top = extent
    return face.point(np.array([left, right, right, left]), np.array([top, top, bottom, bottom]))
