"""Conversion of board detections between messages and the calibration engine."""

from __future__ import annotations

import math

import numpy as np

from ....base.errors import InvalidParameter
from ....calibration.estimation.advice import ENOUGH, Coverage, advised, coverage
from ....calibration.estimation.bundle.observations import Sighting
from ....calibration.targets import Board, Detection
from ....calibration.targets.choosing import why_not_new
from ....calibration.targets.finding import compared
from .board_process import board_of
from .messages import BoardSeen, CoverageShown, Together, TogetherAsk


def taken(seen: BoardSeen, board: Board) -> Detection:
    """Convert the message of one image to a detection, if usable.

    Raises
    ------
    InvalidParameter
        Corners outside the board or outside the image.
    """
    ids, corners = np.asarray(seen.ids, dtype=int), np.asarray(seen.corners_px, dtype=float).reshape(-1, 2)
    sigma = None if seen.sigma_px is None else np.asarray(seen.sigma_px, dtype=float)
    size = np.array(seen.image_size)
    good = len(ids) == len(corners) == len(set(seen.ids)) and (sigma is None or len(sigma) == len(ids))
    good = good and bool(np.all((ids >= 0) & (ids < board.corner_count)))
    if not (good and np.all((corners >= -0.5) & (corners <= size - 0.5))):
        raise InvalidParameter(
            f"what is told of {seen.name} cannot be: its corners are not those of a board of {board}"
        )
    blur = math.nan if seen.blur_px is None else seen.blur_px
    return Detection(
        seen.name, seen.image_size, ids, corners, seen.reason, sigma, blur, seen.is_reversed, seen.begins_white,
        seen.is_part, seen.time_s,
    )  # fmt: skip


def together(ask: TogetherAsk) -> Together:
    """Analyse images of one camera together: consistency, field coverage and the recommended next
    image.

    Raises
    ------
    InvalidParameter
        Invalid board, or a board that does not match the detections.
    """
    board = board_of(ask.board)
    detections = compared([taken(seen, board) for seen in ask.pictures], board)
    used = [d for d in detections if d.used]
    spread = _coverage(used, ask) if used else None
    return Together(
        reasons=tuple(d.reason for d in detections),
        coverage=coverage_shown(spread) if spread else None,
        advice=advised(spread, len(used)) if spread else (),
        not_new=None if ask.candidate is None else why_not_new(taken(ask.candidate, board), used, board),
    )


def _coverage(used: list[Detection], ask: TogetherAsk) -> Coverage:
    width, height = used[0].image_size
    centre = ((width - 1) / 2, (height - 1) / 2) if ask.centre_px is None else ask.centre_px
    sightings = [Sighting(d.name, d.corners_px, np.zeros((len(d.ids), 3))) for d in used]
    return coverage(sightings, centre, ask.radius_px)


def coverage_shown(spread: Coverage) -> CoverageShown:
    """Convert a coverage to a message."""
    return CoverageShown(
        centre_px=(float(spread.centre_px[0]), float(spread.centre_px[1])),
        radii_px=tuple(float(r) for r in spread.radii_px),
        counts=tuple(tuple(int(c) for c in ring) for ring in spread.counts),
        enough=ENOUGH,
    )
