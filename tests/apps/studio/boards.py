"""Small rendered photographs of a board all around a mirror."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

import omnimirror as om
from omnimirror.cameras.models import Unified
from tests.calibration.targets.rendering import Photograph, photographed, pose

BOARD = om.Board("chessboard", 7, 5, 40.0)
BOARD_REQUEST = {"kind": "chessboard", "columns": 7, "rows": 5, "square_mm": 40.0}
CAMERA = Unified(xi=0.95, focal_px=(118.0, 118.0), centre_px=(243.0, 238.0), image_size=(480, 480))
"""Camera of the photographs, with an eccentric principal point."""
BOARD_POSES = (
    (0, 5, 360, 15, 0, 0), (70, -8, 330, 0, 22, 10), (140, 12, 380, -18, 10, 0), (205, 0, 340, 12, -20, -8),
    (260, -12, 400, 0, 15, 30), (310, 8, 350, -15, -12, 0), (30, 25, 380, 10, 18, -15),
)  # fmt: skip
COMPLETE_COUNT = 6
"""Number of initial photographs that contain the whole board; the last lacks a few corners, and
takes long to detect."""


@cache
def photograph(number: int) -> Photograph:
    """Return a photograph with its true corners."""
    return photographed(CAMERA, BOARD, pose(BOARD, *BOARD_POSES[number]), seed=number)


@cache
def png(number: int) -> bytes:
    """Return a photograph as a file."""
    return cv2.imencode(".png", photograph(number).image)[1].tobytes()


BLANK = cv2.imencode(".png", np.full((480, 480), 90, np.uint8))[1].tobytes()
