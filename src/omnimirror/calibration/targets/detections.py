"""What was found of a board in a picture, or why nothing was."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ids = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Detection:
    """The corners of a board in one picture.

    Parameters
    ----------
    name
        Of the picture, for messages and tables.
    image_size
        Width and height of the picture, px.
    ids : (k,)
        Which corners of the board, as in :attr:`Board.points_mm`; none where the board was not found.
    corners_px : (k, 2)
        Where they are in the picture as delivered.
    reason
        Why the board was not found, or why the picture is not used: one phrase. None where it is used.
    sigma_px : (k,) or None
        Standard deviation of a coordinate of each corner, from the image's noise and the scatter of the corners about a
        smooth mapping; None before they are refined.
    blur_px
        Standard deviation over which edges are spread; of the board's edges where it was found.
    is_reversed
        Whether the picture is a mirror image, as markers show it; None where nothing shows it.
    begins_white
        Whether the square before a chessboard's first corner is white: of pictures of one board that looks the same
        after half a turn and is longer than it is high, those that differ in it are mirror images of each other.
    is_part
        Whether it is a part of a chessboard, numbered as if it were the middle of it.
    time_s
        Of the frame in its video.

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
        """Whether corners were found."""
        return len(self.ids) > 0

    @property
    def used(self) -> bool:
        """Whether they are good for a calibration: found, and nothing speaks against them."""
        return self.found and self.reason is None

    @property
    def sharpness(self) -> float:
        """One over :attr:`blur_px`: the larger, the sharper."""
        return 1.0 / self.blur_px
