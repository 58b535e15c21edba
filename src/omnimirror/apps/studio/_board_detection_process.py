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
from ._uploads import picture_in
from .calibration_messages import BoardDetection, BoardDetectionRequest, BoardSpec
from .messages import Problem

PLACES = 4
"""Transferred decimals of a pixel, 0.01 of the corner uncertainty."""


def board_of(asked: BoardSpec) -> Board:
    """Return the board of a request.

    Raises
    ------
    InvalidParameter
        Invalid board parameters.
    """
    a = asked
    return Board(a.kind, a.columns, a.rows, a.square_mm, a.marker_mm, a.spacing, a.family, a.legacy)


def told(found: Detection) -> BoardDetection:
    """Convert a detection to a message."""
    return BoardDetection(
        name=found.name,
        image_size=found.image_size,
        ids=tuple(int(i) for i in found.ids),
        corners_px=tuple((float(u), float(v)) for u, v in np.round(found.corners_px, PLACES)),
        sigma_px=None
        if found.sigma_px is None
        else tuple(float(s) for s in np.round(found.sigma_px, PLACES)),
        reason=found.reason,
        blur_px=found.blur_px if math.isfinite(found.blur_px) else None,
        is_reversed=found.is_reversed,
        begins_white=found.begins_white,
        is_part=found.is_part,
        time_s=found.time_s,
    )


def look(ask: BoardDetectionRequest, data: bytes) -> BoardDetection | Problem:
    """Detect the board in an image; return the detection or a problem."""
    try:
        return told(
            find_board(picture_in(data, ask.name), board_of(ask), name=ask.name, quick=ask.quick)
        )
    except OmnimirrorError as e:
        return Problem(detail=str(e))
    except MemoryError:
        return Problem(detail=f"{ask.name} requires more memory than the server has")


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
