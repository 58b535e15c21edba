"""Calibration checkerboards with exactly known positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....base.typing import Array
from ....cameras.frames import pan_tilt_direction, view_axes
from ..boxes import Face
from ..canvas import Canvas, Paint

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
    turn_deg: float = 0.0
    lean_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def face(self) -> Face:
        """Face of the whole board."""
        middle = self.distance_mm * pan_tilt_direction(np.radians(self.pan_deg), np.radians(self.tilt_deg))
        forward, right, down = view_axes(self.pan_deg + self.turn_deg, self.tilt_deg + self.lean_deg, self.roll_deg)
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
        canvas = Canvas(face.width_mm, face.height_mm, SQUARE_MM / max(1, round(SQUARE_MM / texel_mm)), WHITE)
        for row in range(rows):
            for column in range(row % 2, columns, 2):
                left, top = MARGIN_MM + column * SQUARE_MM, face.height_mm - MARGIN_MM - row * SQUARE_MM
                canvas.rectangle(left, top - SQUARE_MM, left + SQUARE_MM, top, BLACK)
        canvas.text(self.name, face.width_mm / 2, MARGIN_MM / 2, 0.5 * MARGIN_MM, LABEL)
        return canvas
