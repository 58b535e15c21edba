"""Board detection process; imports the required modules only, because uploads wait for its start.

Run as ``python -m omnimirror.apps.studio._board_detection_process``, it reads requests from standard
input, each a line of JSON, a line with the length of the image, and the image; it answers each with
a line.
"""

from __future__ import annotations

import math
import sys
from typing import BinaryIO

import numpy as np

from ...base.errors import OmnimirrorError
from ...calibration.targets import Board, Detection, find_board
from ._uploads import image_in
from .calibration_messages import BoardDetection, BoardDetectionRequest, BoardSpec
from .messages import Problem

PLACES = 4
"""Transferred decimals of a pixel, 0.01 of the corner uncertainty."""


def board_of(requested: BoardSpec) -> Board:
    """Return the board of a request.

    Raises
    ------
    InvalidParameter
        If the board parameters are invalid.
    """
    a = requested
    return Board(a.kind, a.columns, a.rows, a.square_mm, a.marker_mm, a.spacing, a.family, a.legacy)


def detection_message(detection: Detection) -> BoardDetection:
    """Convert a detection to a message."""
    return BoardDetection(
        name=detection.name,
        image_size=detection.image_size,
        ids=tuple(int(i) for i in detection.ids),
        corners_px=tuple((float(u), float(v)) for u, v in np.round(detection.corners_px, PLACES)),
        sigma_px=None
        if detection.sigma_px is None
        else tuple(float(s) for s in np.round(detection.sigma_px, PLACES)),
        reason=detection.reason,
        blur_px=detection.blur_px if math.isfinite(detection.blur_px) else None,
        is_reversed=detection.is_reversed,
        begins_white=detection.begins_white,
        is_part=detection.is_part,
        time_s=detection.time_s,
    )


def look(message: BoardDetectionRequest, data: bytes) -> BoardDetection | Problem:
    """Detect the board in an image; return the detection or a problem."""
    try:
        return detection_message(
            find_board(
                image_in(data, message.name),
                board_of(message),
                name=message.name,
                quick=message.fast,
            )
        )
    except OmnimirrorError as e:
        return Problem(detail=str(e))
    except MemoryError:
        return Problem(detail=f"{message.name} requires more memory than the server has")


def answer_all(questions: BinaryIO) -> None:
    """Answer requests until the end of input."""
    while line := questions.readline():
        data = questions.read(int(questions.readline()))
        print(
            look(BoardDetectionRequest.model_validate_json(line), data).model_dump_json(),
            flush=True,
        )


if __name__ == "__main__":
    answer_all(sys.stdin.buffer)
