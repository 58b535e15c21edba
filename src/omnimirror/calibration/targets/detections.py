"""Result of board detection in an image."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array

Ids = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Detection:
    """Corners of a board in one image, or the reason for a failed detection.

    Parameters
    ----------
    name
        Name of the image, for messages and tables.
    image_size
        Width and height of the image, px.
    ids : (k,)
        Corner ids, as in :attr:`Board.points_mm`; empty if the board was not found.
    corners_px : (k, 2)
        Corner positions in the image as delivered.
    reason
        Reason for a failed detection, or against the use of the image, in one phrase; None if it is
        used.
    sigma_px : (k,) or None
        Standard deviation of a coordinate of each corner, from image noise and the scatter of the
        corners around a smooth mapping; None before refinement.
    blur_px
        Standard deviation of the edge blur, measured at the board's edges if found.
    is_reversed
        Whether the image is a mirror image according to the markers; None if unknown.
    begins_white
        Whether the square before a chessboard's first corner is white. For a board that is
        symmetric under a 180 deg rotation and not square, images that differ in it are mirror
        images of each other.
    is_part
        Whether it is a part of a chessboard, numbered as if it were the centre.
    time_s
        Time of the frame in its video.

    Examples
    --------
    >>> Detection("a.png", (640, 480), reason="no board was found").found
    False
    """

    name: str
    image_size: tuple[int, int]
    ids: Ids = field(default_factory=lambda: np.empty(0, dtype=int))
    corners_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    reason: str | None = None
    sigma_px: Array | None = None
    blur_px: float = float("nan")
    is_reversed: bool | None = None
    begins_white: bool | None = None
    is_part: bool = False
    time_s: float | None = None

    @property
    def found(self) -> bool:
        """True if corners were found."""
        return len(self.ids) > 0

    @property
    def used(self) -> bool:
        """True if the detection is suitable for calibration: found, without a reason against it."""
        return self.found and self.reason is None

    @property
    def sharpness(self) -> float:
        """Inverse of :attr:`blur_px`."""
        return 1.0 / self.blur_px
