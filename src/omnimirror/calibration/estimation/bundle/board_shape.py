"""The shape of a board that is not quite flat and not quite square, estimated with everything else.

A printed board is stretched a little, and bends and twists by a millimetre or two: on pictures whose corners are
known to a tenth of a pixel that is what limits a calibration, not the camera. Five numbers describe it, all even under
half a turn, so that they mean the same whichever of its two ends a detector takes for the first. They are regularised:
where pictures say nothing of them, the board is flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

STRETCH_SIGMA = 0.003  # how much a print is usually wider or more skewed than it should be, relative
BEND_SIGMA = 0.01  # how far a board's corners usually leave its plane, of half its diagonal
NAMES = ("board_aspect", "board_shear", "board_bend_xx", "board_twist_xy", "board_bend_yy")
UNITS = ("1", "1", "mm", "mm", "mm")


@dataclass(frozen=True)
class BoardShape:
    """How a board differs from a flat one with square fields.

    Parameters
    ----------
    centre_mm : (2,)
        The middle of its corners.
    half_diagonal_mm
        From there to the farthest corner.
    values : (5,)
        Aspect (how much wider than high, relative), shear (radians), and how far the board leaves its plane at a
        distance of half its diagonal from the middle, mm: along x and y squared and, for twist, x times y.

    Examples
    --------
    >>> corners = np.array([[x, y, 0.0] for x in (-40.0, 40.0) for y in (-30.0, 30.0)])
    >>> shape = BoardShape.flat(corners).with_values([0.0, 0.0, 0.0, 2.0, 0.0])
    >>> shape.applied(corners)[:, 2].round(2)  # twisted: two corners before the plane, two behind it
    array([ 1.92, -1.92, -1.92,  1.92])
    """

    centre_mm: tuple[float, float]
    half_diagonal_mm: float
    values: tuple[float, ...] = (0.0,) * 5

    @classmethod
    def flat(cls, points_mm: ArrayLike) -> BoardShape:
        """Of a board with corners (n, 3), as it should be."""
        points = np.asarray(points_mm, dtype=float)[:, :2]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (low + high) / 2
        return cls((float(x), float(y)), float(np.hypot(*(high - low)) / 2))

    def with_values(self, values: ArrayLike) -> BoardShape:
        """The same board with other numbers (5,)."""
        return BoardShape(self.centre_mm, self.half_diagonal_mm, tuple(float(v) for v in np.asarray(values)))

    def is_flat_within(self, sigmas: Array) -> bool:
        """Whether all numbers are 0 to three standard deviations (5,)."""
        return bool(np.all(np.abs(self.values) <= 3 * sigmas))

    @property
    def sigmas(self) -> Array:
        """How large the numbers usually are (5,): the prior with which they are estimated."""
        bend = BEND_SIGMA * self.half_diagonal_mm
        return np.array([STRETCH_SIGMA, STRETCH_SIGMA, bend, bend, bend])

    def changes(self, points_mm: Array) -> Array:
        """How points (n, 3) of the flat board move with each number: (n, 3, 5)."""
        x, y = (points_mm[:, :2] - self.centre_mm).T
        u, v = x / self.half_diagonal_mm, y / self.half_diagonal_mm
        change = np.zeros((len(points_mm), 3, 5))
        change[:, 0, 0], change[:, 1, 0] = x / 2, -y / 2
        change[:, 0, 1], change[:, 1, 1] = y / 2, x / 2
        change[:, 2, 2], change[:, 2, 3], change[:, 2, 4] = u * u, 2 * u * v, v * v
        return change

    def applied(self, points_mm: Array) -> Array:
        """Where points (n, 3) of the flat board really are."""
        moved: Array = points_mm + self.changes(points_mm) @ np.array(self.values)
        return moved
