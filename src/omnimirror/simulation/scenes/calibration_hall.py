"""Calibration hall: checkerboards around the sensor at exactly known positions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import validate_arguments
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from ...cameras.camera import pan_tilt_direction, view_axes
from ._painting import (
    Canvas,
    Paint,
    Surroundings,
    illuminated_texels,
    light_on,
    outer_faces,
    surfaces_of_faces,
)
from .scene import Box, Face, corners, face_of, rays_inside

# -- Checkerboards ---------------------------------------------------------------------------------

SQUARES = (12, 8)
SQUARE_MM = 100.0
MARGIN_MM = 100.0
BLACK, WHITE, LABEL = Paint("#141414"), Paint("#f2f2f0"), Paint("#9aa4ab")


@dataclass(frozen=True)
class HallBoard:
    """Checkerboard with 12 x 8 squares of 100 mm and a white margin: 11 x 7 inner corners.

    Its centre has a pan, a tilt and a distance from the scene origin. It faces the origin except
    for its own rotations: turn (to the right), backward tilt and clockwise roll.
    """

    name: str
    pan_deg: float
    tilt_deg: float
    distance_mm: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def face(self) -> Face:
        """Face of the whole board."""
        middle = self.distance_mm * pan_tilt_direction(
            np.radians(self.pan_deg), np.radians(self.tilt_deg)
        )
        forward, right, down = view_axes(
            self.pan_deg + self.yaw_deg, self.tilt_deg + self.pitch_deg, self.roll_deg
        )
        width, height = (count * SQUARE_MM + 2 * MARGIN_MM for count in SQUARES)
        corner = middle - width / 2 * right + height / 2 * down
        return Face(corner, right, -down, -forward, width, height)

    def inner_corners_mm(self) -> Array:
        """Return the inner corners (7, 11, 3), mm in the scene: rows from the top, columns from the
        left, in reading direction.
        """
        face, (columns, rows) = self.face, SQUARES
        x = MARGIN_MM + SQUARE_MM * np.arange(1, columns)
        y = face.height_mm - MARGIN_MM - SQUARE_MM * np.arange(1, rows)
        return face.point(*np.meshgrid(x, y))

    def paint(self, texel_mm: float) -> Canvas:
        """Paint the board, with square edges aligned to texel edges."""
        face, (columns, rows) = self.face, SQUARES
        canvas = Canvas(
            face.width_mm, face.height_mm, SQUARE_MM / max(1, round(SQUARE_MM / texel_mm)), WHITE
        )
        for row in range(rows):
            for column in range(row % 2, columns, 2):
                left, top = (
                    MARGIN_MM + column * SQUARE_MM,
                    face.height_mm - MARGIN_MM - row * SQUARE_MM,
                )
                canvas.rectangle(left, top - SQUARE_MM, left + SQUARE_MM, top, BLACK)
        canvas.text(self.name, face.width_mm / 2, MARGIN_MM / 2, 0.5 * MARGIN_MM, LABEL)
        return canvas


# -- Hall ------------------------------------------------------------------------------------------

TEXEL = Parameter("mm", 1.0, 100.0, "texel size of the painted surfaces")
PLAIN_TEXEL_FACTOR = 4.0  # times coarser on faces without corners
HALL = Box((-5200.0, -4200.0, -1700.0), (5200.0, 4200.0, 3300.0))
CRATES = (
    Box((3900.0, 2700.0, -1700.0), (4900.0, 3700.0, -800.0)),
    Box((4100.0, 2800.0, -800.0), (4700.0, 3400.0, -200.0)),
    Box((-4900.0, -3900.0, -1700.0), (-3600.0, -3300.0, -900.0)),
    Box((3600.0, -4000.0, -1700.0), (4400.0, -3400.0, -1100.0)),
)
PILLARS = tuple(
    Box((x - 150.0, y - 150.0, -1700.0), (x + 150.0, y + 150.0, 3300.0))
    for x in (-4000.0, 4000.0)
    for y in (-3950.0, 3950.0)
)
SOLIDS = (*CRATES, *PILLARS)

BOARDS = (
    *(
        HallBoard(
            f"A{i + 1}", -180.0 + 60 * i, 3.0 + 5 * (i % 2), 2300.0 + 300 * (i % 3), 14 * (-1) ** i
        )
        for i in range(6)
    ),
    *(
        HallBoard(
            f"B{i + 1}",
            -150.0 + 60 * i,
            -42.0 - 5 * (i % 2),
            1750.0 + 120 * (i % 2),
            0,
            10 * (-1) ** i,
            8 * (-1) ** i,
        )
        for i in range(6)
    ),
    *(
        HallBoard(
            f"C{i + 1}",
            -150.0 + 60 * i,
            36.0 + 4 * (i % 2),
            2300.0 + 200 * (i % 3),
            0,
            12 * (-1) ** i,
        )
        for i in range(6)
    ),
)
"""Boards in three rings: at the height of the sensor, below it and above it."""


@dataclass(frozen=True)
class Hall:
    """Hall of 10.4 x 8.4 x 5 m with 18 checkerboards, each with 11 x 7 inner corners 100 mm apart.

    Parameters
    ----------
    texel_mm : mm
        Texel size of the boards. The hall is painted and lit on first use, once for all equal
        halls.

    Raises
    ------
    InvalidParameter
        If the texel size is out of range.

    Examples
    --------
    >>> hall = Hall(texel_mm=25.0)
    >>> corners = hall.board_corners_mm("A4")  # ahead, its left side turned nearer
    >>> corners.shape, corners[0, 0].round(1), corners[-1, -1].round(1)
    ((7, 11, 3), array([2116.1,  475. ,  617.2]), array([2439.1, -475. ,   23. ]))
    """

    texel_mm: float = 4.0

    def __post_init__(self) -> None:
        TEXEL.check("texel_mm", self.texel_mm)

    @property
    def boards(self) -> tuple[str, ...]:
        """Names of the boards, as printed on their lower margins."""
        return tuple(board.name for board in BOARDS)

    @validate_arguments
    def board_corners_mm(self, name: str) -> Array:
        """Return the inner corners (7, 11, 3) of a board, mm: rows from its top, columns from its
        left, in reading direction.

        Parameters
        ----------
        name
            Name in :attr:`boards`.

        Returns
        -------
        (7, 11, 3) array
            Corners, mm.

        Raises
        ------
        InvalidParameter
            If there is no such board.
        """
        for board in BOARDS:
            if board.name == name:
                return board.inner_corners_mm()
        raise InvalidParameter(f"the board must be one of {', '.join(self.boards)}; got {name!r}")

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any
        non-zero length.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, non-zero vectors of any length.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.

        Raises
        ------
        InvalidParameter
            If a ray starts outside the hall, or a direction is zero or not finite.
        """
        origins, towards = rays_inside(HALL, "the hall", origins_mm, directions)
        return _painted(self.texel_mm).radiance(origins, towards)

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces for rays that start in a box between two corners.

        Parameters
        ----------
        low_mm, high_mm : (3,)
            Corners of the box, mm.

        Returns
        -------
        Surroundings
            Surfaces of the hall; None if the box is not inside it.

        Raises
        ------
        InvalidParameter
            If the corners are not points.
        """
        low_mm, high_mm = corners(low_mm, high_mm)
        return _painted(self.texel_mm) if HALL.contains(low_mm, high_mm) else None

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, non-zero vectors of any length.

        Returns
        -------
        (n,) array
            Distances, mm; infinite without a surface.

        Raises
        ------
        InvalidParameter
            If a ray starts outside the hall, or a direction is zero or not finite.
        """
        origins, towards = rays_inside(HALL, "the hall", origins_mm, directions)
        return _painted(self.texel_mm).distance_mm(origins, towards)


@lru_cache(maxsize=2)
def _painted(texel_mm: float) -> Surroundings:
    coarse = PLAIN_TEXEL_FACTOR * texel_mm
    walls = [face_of(HALL, i, inside=True) for i in range(6)]
    painted: list[tuple[Face, Canvas]] = [
        (face, _wall(i, face, coarse)) for i, face in enumerate(walls)
    ]
    for number, face in enumerate(outer_faces(SOLIDS)):
        painted.append(
            (face, _crate(face, coarse) if number < 6 * len(CRATES) else _pillar(face, coarse))
        )
    painted += [(board.face, board.paint(texel_mm)) for board in BOARDS]
    backs = [_back(board.face) for board in BOARDS]
    painted += [
        (face, Canvas(face.width_mm, face.height_mm, 50.0, Paint("#5b6670"))) for face in backs
    ]
    lights = light_on(painted, HALL, SOLIDS)
    images = [
        illuminated_texels(canvas, light)
        for (_, canvas), light in zip(painted, lights, strict=True)
    ]
    return Surroundings(surfaces_of_faces([face for face, _ in painted], images))


THICKNESS_MM = 6.0


def _back(face: Face) -> Face:
    """Return the reverse side of a board."""
    corner = face.corner + face.width_mm * face.right - THICKNESS_MM * face.normal
    return Face(corner, -face.right, face.up, -face.normal, face.width_mm, face.height_mm)


# -- Painted faces ---------------------------------------------------------------------------------

CONCRETE, STRIPE, DARK = Paint("#a9a69e"), Paint("#e0b13c"), Paint("#3c444b")
LAMP = Paint("#fff6e6", glow=1.6)


def _wall(number: int, face: Face, texel_mm: float) -> Canvas:
    if number == 4:
        return _floor(face, texel_mm)
    if number == 5:
        return _ceiling(face, texel_mm)
    canvas = Canvas(
        face.width_mm,
        face.height_mm,
        texel_mm,
        Paint(("#c9cdc8", "#bfc8cd", "#cfc8bd", "#c6c4cf")[number]),
    )
    canvas.rectangle(
        0, 0, face.width_mm, 1250, Paint(("#6f8577", "#5f7a8c", "#93775f", "#77708c")[number])
    )
    canvas.rectangle(0, 1250, face.width_mm, 1310, Paint("#e9e6df"))
    for middle in np.arange(650.0, face.width_mm, 1300.0):  # panels
        canvas.rectangle(middle - 648, 1310, middle - 640, face.height_mm, Paint("#a8aaa6"))
        canvas.rectangle(middle - 400, 3500, middle + 400, 4350, Paint("#8fb0c9"))
        canvas.frame(middle - 440, 3460, middle + 440, 4390, 40, Paint("#e9e6df"))
        canvas.rectangle(middle - 15, 3500, middle + 15, 4350, Paint("#e9e6df"))
    canvas.text(("SOUTH", "NORTH", "EAST", "WEST")[number], face.width_mm / 2, 2700, 520, DARK)
    return canvas


def _floor(face: Face, texel_mm: float) -> Canvas:
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, CONCRETE)
    for x in np.arange(face.width_mm / 2 % 1000, face.width_mm, 1000.0):
        canvas.rectangle(x - 6, 0, x + 6, face.height_mm, Paint("#8d8a83"))
    for y in np.arange(face.height_mm / 2 % 1000, face.height_mm, 1000.0):
        canvas.rectangle(0, y - 6, face.width_mm, y + 6, Paint("#8d8a83"))
    canvas.frame(500, 500, face.width_mm - 500, face.height_mm - 500, 90, STRIPE)
    x, y = face.width_mm / 2, face.height_mm / 2
    for radius, paint in ((520.0, STRIPE), (470.0, CONCRETE), (60.0, DARK)):
        canvas.disc(x, y, radius, paint)
    for letter, right, up in (("N", 0, 1), ("E", 1, 0), ("S", 0, -1), ("W", -1, 0)):
        canvas.text(letter, x + 290 * right, y + 290 * up, 190.0, DARK)
    return canvas


def _ceiling(face: Face, texel_mm: float) -> Canvas:
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, Paint("#dcdcd8"))
    for y in np.arange(1000.0, face.height_mm, 2100.0):
        for x in np.arange(1300.0, face.width_mm, 2100.0):
            canvas.rectangle(x - 560, y - 160, x + 560, y + 160, DARK)
            canvas.rectangle(x - 520, y - 120, x + 520, y + 120, LAMP)
    return canvas


def _crate(face: Face, texel_mm: float) -> Canvas:
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, Paint("#b08a5e"))
    for y in np.arange(0.0, face.height_mm, 150.0):
        canvas.rectangle(0, y, face.width_mm, y + 12, Paint("#7a5c3a"))
    canvas.frame(0, 0, face.width_mm, face.height_mm, 70, Paint("#94704a"))
    return canvas


def _pillar(face: Face, texel_mm: float) -> Canvas:
    canvas = Canvas(face.width_mm, face.height_mm, texel_mm, Paint("#d3d1c9"))
    for y in np.arange(0.0, 1600.0, 400.0):
        canvas.rectangle(0, y, face.width_mm, y + 200, STRIPE)
        canvas.rectangle(0, y + 200, face.width_mm, y + 400, DARK)
    return canvas
