"""Boards with markers: marker detection and prediction of the corners."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ._chessboards import completed, predicted, without_strays
from ._image_preparation import Grey, bytes_of, scaled, scales, unscaled_px
from .boards import Board, dictionary

Ids = NDArray[np.int_]

MIN_MARKERS = 2
SUFFICIENT_FRACTION = 0.6
"""Fraction of a board's markers above which larger image sizes are skipped."""
KALIBR_CORNERS = ((1, 0), (0, 0), (0, 1), (1, 1))
"""Column and row, on an April grid tag, of OpenCV's four corners; Kalibr rotates tags by 180 deg.
"""


KALIBR_RIGHT = -1
"""Difference of tag numbers between an upright tag and its right neighbour.

For the tag below, the difference is the number of columns.
"""
MAX_LATERAL_OFFSET, MAX_DISTANCE, MIN_NEIGHBOUR_PAIRS = 0.3, 2.2, 3
"""Criteria for neighbouring tags.

They are the maximum lateral offset relative to the distance, the maximum distance in tag sides,
and the minimum number of pairs that determine the layout.
"""
FRAME = "{} of its tags have a frame of 1 bit, as in AprilTag and OpenCV; tags of Kalibr's April grid have 2 bits"
MAX_SPACING_ERROR = 0.25
"""Deviation of the gaps between tags, in tag sides, above which the spacing is reported as wrong.
"""


class Markers(NamedTuple):
    """Markers detected in an image."""

    ids: Ids
    """Marker numbers (k,)."""
    corners_px: Array
    """Corners (k, 4, 2): clockwise from the upper left of the marker as drawn."""
    is_reversed: bool
    """True if they were detected in the mirror image."""


def read_markers(image: Grey, board: Board, *, is_quick: bool = False) -> Markers:
    """Detect the board's markers in the image and its mirror image; return the larger set.

    The mirror image is skipped if most markers are detected in the image, since false detections of
    a family in mirror images are rare.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    board
        Board with markers.
    is_quick
        Search at one image size only.
    """
    detector = _detector(board)
    width = image.shape[1]
    marker_sets: list[dict[int, Array]] = [{}, {}]
    for scale in [1.0] if is_quick else scales(image.shape)[:3]:
        values = bytes_of(scaled(image, scale))
        for is_reversed, markers in enumerate(marker_sets):
            corners, ids, _ = detector.detectMarkers(
                np.ascontiguousarray(values[:, ::-1]) if is_reversed else values
            )
            for number, quad in zip([] if ids is None else ids.ravel(), corners, strict=True):
                pixels = quad.reshape(4, 2).astype(float)
                if is_reversed:
                    pixels[:, 0] = values.shape[1] - 1 - pixels[:, 0]
                if number < board.marker_count:
                    markers[int(number)] = unscaled_px(pixels, scale)
            if len(markers) > SUFFICIENT_FRACTION * board.marker_count:
                break
        if max(map(len, marker_sets)) > SUFFICIENT_FRACTION * board.marker_count:
            break
    markers = max(marker_sets, key=len)
    ids = np.array(sorted(markers), dtype=int)
    pixels = np.array([markers[i] for i in ids]).reshape(-1, 4, 2)
    return Markers(
        ids, np.clip(pixels, 0, [width - 1, image.shape[0] - 1]), markers is marker_sets[1]
    )


def find_by_markers(image: Grey, board: Board, markers: Markers) -> tuple[Ids, Array]:
    """Return ids (k,) and pixels (k, 2) of the board's corners predicted from its markers.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    board
        Board with markers.
    markers
        Result of :func:`read_markers`.
    """
    if len(markers.ids) < MIN_MARKERS:
        return np.empty(0, dtype=int), np.empty((0, 2))
    if board.kind == "aprilgrid":
        ids, pixels = _tag_corners(board, markers)
    else:
        ids, pixels = predicted(
            image, board, marker_corners_mm(board, markers.ids), markers.corners_px.reshape(-1, 2)
        )
    ids, pixels = without_strays(board, ids, pixels)
    if len(ids) >= 4:
        ids, pixels = completed(image, board, ids, pixels)
    return ids, pixels


def layout_difference(
    image: Grey, board: Board, markers: Markers, *, is_quick: bool = False
) -> str | None:
    """Return a description of the layout of an April grid if it differs from Kalibr's of this size.

    Parameters
    ----------
    image : (height, width)
        Greyscale image.
    board
        April grid.
    markers
        Result of :func:`read_markers`.
    is_quick
        Skip the search for tags with another frame if few tags of the board are detected.
    """
    if len(markers.ids) <= MIN_MARKERS:
        if is_quick:
            return None
        count = max(
            len(_detector(board, 1).detectMarkers(bytes_of(p))[0]) for p in (image, image[:, ::-1])
        )
        return FRAME.format(count) if count > 2 * MIN_MARKERS else None
    first, second, third, fourth = markers.corners_px.transpose(1, 0, 2)
    axes = np.stack([second - first + third - fourth, fourth - first + third - second], axis=2) / 2
    centres = markers.corners_px.mean(axis=1)
    relative_positions = (np.linalg.pinv(axes)[:, None] @ (centres - centres[:, None])[..., None])[
        ..., 0
    ]
    right, below = (
        _typical_neighbour(markers.ids, relative_positions, offset)
        for offset in ((1.0, 0.0), (0.0, 1.0))
    )
    if right is None or below is None:
        return None
    expected = KALIBR_RIGHT, board.columns
    if (right[0], below[0]) != expected:
        return (
            f"the order of its tags is not that of an April grid of {board}: right of tag N is "
            f"N{right[0]:+d} and below it N{below[0]:+d}; Kalibr's order is N{expected[0]:+d} and N{expected[1]:+d}"
        )
    spacing = (right[1] + below[1]) / 2 - 1
    if abs(spacing - board.spacing) > MAX_SPACING_ERROR:
        return (
            f"the gaps between its tags are {spacing:.2f} times the tag side; "
            f"got spacing = {board.spacing:g}"
        )
    return None


def _typical_neighbour(
    ids: Ids, relative_positions: Array, direction: tuple[float, float]
) -> tuple[int, float] | None:
    """Return the differences in number and distance (tag sides) to the next tag in a direction.

    None if there are too few pairs.
    """
    distances = relative_positions @ direction
    lateral = np.abs(relative_positions @ direction[::-1])
    distances = np.where(
        (distances > 0.5) & (distances < MAX_DISTANCE) & (lateral < MAX_LATERAL_OFFSET * distances),
        distances,
        np.inf,
    )
    neighbours = np.argmin(distances, axis=1)
    nearest = distances[np.arange(len(ids)), neighbours]
    has_neighbour = np.isfinite(nearest)
    steps, counts = np.unique((ids[neighbours] - ids)[has_neighbour], return_counts=True)
    if not len(steps) or counts.max() < max(MIN_NEIGHBOUR_PAIRS, has_neighbour.sum() / 2):
        return None
    return int(steps[np.argmax(counts)]), float(np.median(nearest[has_neighbour]))


def marker_corners_mm(board: Board, ids: Ids) -> Array:
    """Return the corners (4 k, 2) of a ChArUco board's markers, mm, as in OpenCV."""
    drawn = opencv_board(board)
    corners = {
        int(i): np.array(quad)[:, :2]
        for i, quad in zip(drawn.getIds(), drawn.getObjPoints(), strict=True)
    }
    return np.concatenate([corners[int(i)] for i in ids]) - board.square_mm


def opencv_board(board: Board) -> Any:
    """Return a ChArUco board as an OpenCV object."""
    import cv2

    size, side, marker = (board.columns, board.rows), board.square_mm, board.marker_side_mm
    board_object = cv2.aruco.CharucoBoard(size, side, marker, dictionary(board.marker_family))
    board_object.setLegacyPattern(board.legacy)
    return board_object


def _tag_corners(board: Board, markers: Markers) -> tuple[Ids, Array]:
    column, row = markers.ids % board.columns, markers.ids // board.columns
    ids = np.stack(
        [(2 * row + y) * 2 * board.columns + 2 * column + x for x, y in KALIBR_CORNERS], axis=1
    )
    return ids.ravel(), markers.corners_px.reshape(-1, 2)


def _detector(board: Board, border_bits: int | None = None) -> Any:
    """Return a detector with wider limits for small quadrilaterals with curved sides."""
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border_bits or board.border_bits
    parameters.polygonalApproxAccuracyRate = 0.06
    parameters.minMarkerPerimeterRate = 0.012
    parameters.adaptiveThreshWinSizeMax = 43
    parameters.perspectiveRemovePixelPerCell = 6
    return cv2.aruco.ArucoDetector(dictionary(board.marker_family), parameters)
