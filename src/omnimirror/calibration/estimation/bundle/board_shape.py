"""Shape of a board that is not exactly flat and square, estimated in the bundle adjustment.

A printed board is stretched slightly and bends and twists by 1 to 2 mm. With corners accurate to
0.1 px, this limits the calibration rather than the camera. Five parameters describe the shape.
All are even under rotation by 180 deg, and therefore independent of the end at which a detector
starts numbering. They are regularised: without evidence in the images, the board is flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ....base.typing import Array

STRETCH_SIGMA = 0.003  # typical relative stretch and shear of a print
BEND_SIGMA = 0.01  # typical deviation of corners from the plane, relative to 0.5 times the diagonal
NAMES = ("board_aspect", "board_shear", "board_bend_xx", "board_twist_xy", "board_bend_yy")
UNITS = ("1", "1", "mm", "mm", "mm")


@dataclass(frozen=True)
class BoardShape:
    """Deviation of a board from a flat one with square fields.

    Parameters
    ----------
    centre_mm : (2,)
        Centre of its corners.
    half_diagonal_mm
        Distance from the centre to the farthest corner.
    values : (5,)
        Aspect (relative excess of width over height), shear (radians), and deviations from the
        plane in mm at a distance of 0.5 times the diagonal from the centre: terms in x^2, x y
        (twist) and y^2.

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
        """Return the nominal shape of a board with corners (n, 3)."""
        points = np.asarray(points_mm, dtype=float)[:, :2]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (low + high) / 2
        return cls((float(x), float(y)), float(np.hypot(*(high - low)) / 2))

    def with_values(self, values: ArrayLike) -> BoardShape:
        """Return the same board with other shape values (5,)."""
        return BoardShape(self.centre_mm, self.half_diagonal_mm, tuple(float(v) for v in np.asarray(values)))

    def is_flat_within(self, sigmas: Array) -> bool:
        """Return whether all values are zero within three standard deviations (5,)."""
        return bool(np.all(np.abs(self.values) <= 3 * sigmas))

    @property
    def sigmas(self) -> Array:
        """Typical sizes of the values (5,): standard deviations of their prior."""
        bend = BEND_SIGMA * self.half_diagonal_mm
        return np.array([STRETCH_SIGMA, STRETCH_SIGMA, bend, bend, bend])

    def changes(self, points_mm: Array) -> Array:
        """Return derivatives (n, 3, 5) of board points (n, 3) with respect to the values."""
        x, y = (points_mm[:, :2] - self.centre_mm).T
        u, v = x / self.half_diagonal_mm, y / self.half_diagonal_mm
        change = np.zeros((len(points_mm), 3, 5))
        change[:, 0, 0], change[:, 1, 0] = x / 2, -y / 2
        change[:, 0, 1], change[:, 1, 1] = y / 2, x / 2
        change[:, 2, 2], change[:, 2, 3], change[:, 2, 4] = u * u, 2 * u * v, v * v
        return change

    def applied(self, points_mm: Array) -> Array:
        """Return the deformed positions of points (n, 3) of the flat board."""
        moved: Array = points_mm + self.changes(points_mm) @ np.array(self.values)
        return moved
