"""Board geometry as defined by OpenCV and Kalibr, and error messages."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import omnimirror as om


def test_corners_of_a_charuco_board_are_opencvs():
    board = om.Board("charuco", 6, 5, 40.0, marker_mm=30.0)
    reference = cv2.aruco.CharucoBoard(
        (6, 5), 40.0, 30.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)
    )
    corners = np.array(reference.getChessboardCorners())
    np.testing.assert_allclose(board.points_mm, corners - corners[0], atol=1e-4)


def test_corners_of_an_april_grid_are_kalibrs():
    """Rows from the bottom; tags of 88 mm with gaps of 0.3 of the tag size, as in Kalibr's own
    board."""
    points = om.Board("aprilgrid", 6, 6, 88.0).points_mm
    assert points.shape == (144, 3)
    np.testing.assert_allclose(
        points[[1, 2, 12, 24], :2], [[88, 0], [114.4, 0], [0, 88], [0, 114.4]]
    )


@pytest.mark.parametrize(
    ("board", "message"),
    [
        ({"kind": "chess"}, "kind must be one of chessboard, charuco, aprilgrid; got 'chess'"),
        ({"columns": 1}, "columns must be an integer between 2 and 200; got 1"),
        ({"square_mm": 0}, "square_mm must be greater than 0 mm and finite; got 0"),
        ({"kind": "charuco", "marker_mm": 31.0}, "marker_mm must be below square_mm = 30"),
        ({"marker_mm": 10.0}, "marker_mm requires kind = 'charuco'"),
        (
            {"kind": "charuco", "family": "4X4_50", "rows": 20},
            "at least 110 markers for a board of 11 x 20 squares; 4X4_50 has 50",
        ),
        ({"columns": 2, "rows": 2}, "at least 3 x 2 corners"),
    ],
)
def test_invalid_boards_raise(board, message):
    with pytest.raises(om.base.errors.InvalidParameter, match=message):
        om.Board(**board)
