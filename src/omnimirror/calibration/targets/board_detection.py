"""Detection of boards in images, with the reason for each failure."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import instance, validate_arguments
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.worker_processes import WorkerPool
from ...cameras.camera import Camera
from ._chessboards import (
    LatticePart,
    coloured,
    completed,
    find_chessboard,
    find_chessboards,
    goes_on,
    grown,
    is_whole,
    ordered,
    placed,
    trimmed,
)
from ._corner_refinement import maps_about, refine_corners
from ._image_preparation import Grey, LocalView, edge_blur_px, grey, local_views
from ._markers import find_by_markers, layout_difference, read_markers
from .boards import Board, Detection

ImageArray = NDArray[Any]

BLURRED_PX = 2.5
"""Edge blur above which an image without a board is reported as blurred."""
TINY_PX = 4.0
MIN_PART = 12
"""Minimum number of corners of a part of a board."""
MIN_OF_MARKED = 4
WHOLE_SHARE = 0.8
"""Minimum fraction of a chessboard's corners after refinement."""
NO_BOARD = "no board was found"
TILES = "the squares continue beyond {board}, as in tiles, a chequered cloth or a larger board"
LONG_S = 2.0  # minimum remaining time for which worker processes are started
STOPPED = "the search was stopped before this image"


@validate_arguments
def find_board(
    image: ImageArray,
    board: Board,
    *,
    name: str = "",
    camera: Camera | None = None,
    quick: bool = False,
) -> Detection:
    """Detect the corners of a board in an image distorted by a mirror or a fisheye.

    Corners of four squares are detected in the whole image. From nine that form a grid, the lattice
    is grown neighbour by neighbour. If this fails, OpenCV's detectors provide a part to grow from,
    as do dewarped views if a camera is given. Markers are also read in the mirror image.

    Parameters
    ----------
    image : (height, width) or (height, width, 3)
        RGB or greyscale image of any depth.
    board
        Calibration board.
    name
        Name of the image, for tables and messages.
    camera
        Approximate camera, such as a calibration from other images.
    quick
        Search at one image size only and without OpenCV's detectors, which are slow on images
        without a board; for live images.

    Returns
    -------
    Detection
        Corners (k, 2) with an accuracy of a few 0.01 px, or the reason for the failure. The corners
        of a partially visible chessboard are numbered as if they were its centre, and the reason
        states it.

    Raises
    ------
    InvalidParameter
        If the image or the board is invalid, or the image size of the camera differs.

    Examples
    --------
    >>> v, u = np.mgrid[:120, :150]
    >>> picture = np.where((u // 25 + v // 25) % 2, 200, 40).astype(np.uint8)
    >>> find_board(picture, Board("chessboard", 5, 4)).corners_px[:2].round(1).tolist()
    [[24.5, 24.5], [49.5, 24.5]]
    >>> find_board(picture, Board("chessboard", 8, 6)).reason
    'a board of 5 x 4 corners was detected instead of 8 x 6 corners'
    """
    instance("board", board, Board, "a board")
    values = grey(image)
    size = (values.shape[1], values.shape[0])
    if camera is not None and tuple(camera.image_size) != size:
        raise InvalidParameter(
            f"the image must have the size of the camera, {camera.image_size[0]} x "
            f"{camera.image_size[1]} px; got {size[0]} x {size[1]} px"
        )
    detect = _detect_markers if board.has_markers else _detect_squares
    detection = detect(values, board, name, is_quick=quick)
    if camera is not None and not detection.used:
        for view in local_views(values, camera):
            view_detection = detect(view.image, board, "", is_quick=True)
            if (
                view_detection.used
                and (image_detection := _in_full_image(values, view_detection, view, board, name))
                is not None
            ):
                detection = image_detection
                break
    return _refined(values, detection, board)


def _in_full_image(
    values: Grey, view_detection: Detection, view: LocalView, board: Board, name: str
) -> Detection | None:
    """Return a detection in a dewarped view as a detection in the image, which may be mirrored."""
    size = (values.shape[1], values.shape[0])
    pixels = view.back(view_detection.corners_px)
    is_finite = np.isfinite(pixels).all(axis=1)
    ids, pixels = view_detection.ids[is_finite], pixels[is_finite]
    if board.has_markers:  # including parts of the board outside the view
        ids, pixels = completed(values, board, ids, pixels)
        return Detection(name, size, ids, pixels, is_reversed=_is_mirrored(board, ids, pixels))
    part = trimmed(grown(values, coloured(values, board.lattice[ids], pixels)))
    is_board = is_whole(part, board) and not goes_on(values, part)
    return _complete_detection(part, board, name, size) if is_board else None


@validate_arguments
def find_boards(
    images: Iterable[ImageArray | str | Path],
    board: Board,
    *,
    names: Sequence[str] | None = None,
    camera: Camera | None = None,
    several: bool = False,
    stored_orientation: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Detection]:
    """Detect the board in each of several images of one sensor, and check their consistency.

    Parameters
    ----------
    images
        Image files, or images (height, width, 3) or (height, width).
    board
        Calibration board.
    names
        Names of the images; by default the file names, or ``image 1``, ...
    camera
        As for :func:`find_board`.
    several
        Whether an image may contain several such chessboards. Each becomes a detection: the first
        with the name of the image, the others with a number appended.
    stored_orientation
        Use the pixels of files as stored, without the orientation in their EXIF data.
    on_progress
        Callback with the number of processed images and the total.

    Returns
    -------
    list[Detection]
        One per image, in order, unless ``several``. The :attr:`~Detection.reason` reports images
        that cannot be read, have a different size, or are reversed unlike the others. Ctrl-C ends
        the search and keeps the results so far.

    Raises
    ------
    InvalidParameter
        If there are no images, or the number of names differs.

    Examples
    --------
    >>> v, u = np.mgrid[:120, :150]
    >>> picture = np.where((u // 25 + v // 25) % 2, 200, 40).astype(np.uint8)
    >>> found = find_boards([picture, np.full((120, 150), 99, np.uint8), picture[:100]], Board("chessboard", 5, 4))
    >>> [(d.name, d.used) for d in found]
    [('image 1', True), ('image 2', False), ('image 3', False)]
    """
    sources = list(images)
    if not sources:
        raise InvalidParameter("images must contain at least one image; got none")
    names = _names(sources) if names is None else list(names)
    if len(names) != len(sources):
        raise InvalidParameter(
            f"names must have one entry per image; got {len(names)} names for {len(sources)} images"
        )
    jobs = [
        (image, board, name, camera, several, stored_orientation)
        for name, image in zip(names, sources, strict=True)
    ]
    detections = {
        number: [Detection(name, (0, 0), reason=STOPPED)] for number, name in enumerate(names)
    }
    try:
        for count_done, (number, boards) in enumerate(_search_images(jobs), 1):
            detections[number] = boards
            if on_progress is not None:
                on_progress(count_done, len(sources))
    except KeyboardInterrupt:
        pass  # keep the results so far
    return compared([detection for boards in detections.values() for detection in boards], board)


def _search_images(jobs: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, list[Detection]]]:
    """Yield the boards of each image, with worker processes for long searches."""
    for number, job in enumerate(jobs):
        started = time.perf_counter()
        yield number, _boards_in(*job)
        remaining = jobs[number + 1 :]
        if (time.perf_counter() - started) * len(remaining) > LONG_S:
            with WorkerPool() as pool:
                for offset, boards in pool.each(_boards_in, remaining):
                    yield number + 1 + offset, boards
            return


def _boards_in(
    source: ImageArray | str | Path,
    board: Board,
    name: str,
    camera: Camera | None,
    several: bool,
    stored_orientation: bool,
) -> list[Detection]:
    """Return the boards of an image or file, or a detection with the reason for the failure."""
    from ...io import read_image

    try:
        pixels = (
            read_image(source, stored_orientation=stored_orientation)
            if isinstance(source, str | Path)
            else source
        )
        boards = _all_boards(pixels, board, name) if several and not board.has_markers else []
        return boards or [find_board(pixels, board, name=name, camera=camera)]
    except OmnimirrorError as e:
        return [Detection(name, (0, 0), reason=str(e))]


def compared(detections: Sequence[Detection], board: Board) -> list[Detection]:
    """Return detections of one sensor with reasons against inconsistent ones."""
    result = list(detections)
    sizes = Counter(d.image_size for d in result if d.used) or Counter(
        d.image_size for d in result if d.found
    )
    usual_size = sizes.most_common(1)[0][0] if sizes else (0, 0)
    orientations = Counter(
        d.is_reversed
        for d in result
        if d.used and d.image_size == usual_size and d.is_reversed is not None
    )
    usual_orientation = orientations.most_common(1)[0][0] if orientations else None
    is_orientation_visible = board.is_symmetric and board.columns != board.rows
    colours = Counter(
        d.begins_white
        for d in result
        if d.used and d.image_size == usual_size and d.begins_white is not None
    )
    usual_colour = colours.most_common(1)[0][0] if colours and is_orientation_visible else None
    is_right_board = any(d.used and not d.is_part for d in result)
    for i, detection in enumerate(result):
        if detection.found and detection.image_size != usual_size:
            reason = "its size of {} x {} px differs from that of the others, {} x {} px".format(
                *detection.image_size, *usual_size
            )
            result[i] = replace(detection, reason=reason)
        elif (
            detection.used
            and usual_orientation is not None
            and detection.is_reversed not in (None, usual_orientation)
        ):
            difference = (
                "is a mirror image, unlike the others"
                if detection.is_reversed
                else "is not a mirror image, unlike the others"
            )
            result[i] = replace(detection, reason=f"it {difference}: it was flipped")
        elif (
            detection.used
            and usual_colour is not None
            and detection.begins_white not in (None, usual_colour)
        ):
            reason = "its board is the mirror image of that in the others: it was flipped"
            result[i] = replace(detection, reason=reason)
        elif detection.found and detection.is_part and is_right_board:
            result[i] = replace(detection, reason=None)  # other images confirm the board
    return result


def _names(images: Sequence[Any]) -> list[str]:
    names = [
        Path(p).name if isinstance(p, str | Path) else f"image {i}" for i, p in enumerate(images, 1)
    ]
    if len(set(names)) < len(names):  # files with the same name in several folders
        names = [
            str(p) if isinstance(p, str | Path) else name
            for p, name in zip(images, names, strict=True)
        ]
    return names


def _all_boards(image: ImageArray, board: Board, name: str) -> list[Detection]:
    """Return all complete boards in an image."""
    values = grey(image)
    size = (values.shape[1], values.shape[0])
    names = (name if k == 1 else f"{name} ({k})" for k in count(1))
    parts = find_chessboards(values, board)
    return [
        _refined(values, _complete_detection(part, board, next(names), size), board)
        for part in parts
    ]


def _complete_detection(
    part: LatticePart, board: Board, name: str, size: tuple[int, int]
) -> Detection:
    ids, pixels, begins_white = ordered(part, board)
    return Detection(name, size, ids, pixels, begins_white=begins_white)


def _detect_squares(values: Grey, board: Board, name: str, *, is_quick: bool = False) -> Detection:
    size = (values.shape[1], values.shape[0])
    part = find_chessboard(values, board, is_quick=is_quick)
    if part is not None and is_whole(part, board):
        if goes_on(values, part):
            return Detection(
                name, size, reason=TILES.format(board=board), blur_px=edge_blur_px(values)
            )
        return _complete_detection(part, board, name, size)
    if part is None or len(part.places) < MIN_PART:
        return Detection(name, size, reason=_failure_reason(values), blur_px=edge_blur_px(values))
    reason = _size_reason(part, board, values)
    if (inside := placed(part, board)) is None:
        return Detection(name, size, reason=reason, blur_px=edge_blur_px(values))
    return Detection(name, size, *inside, reason=reason, is_part=True)


def _detect_markers(values: Grey, board: Board, name: str, *, is_quick: bool = False) -> Detection:
    size = (values.shape[1], values.shape[0])
    markers = read_markers(values, board, is_quick=is_quick)
    if (
        board.kind == "aprilgrid"
        and (difference := layout_difference(values, board, markers, is_quick=is_quick)) is not None
    ):
        return Detection(name, size, reason=difference, blur_px=edge_blur_px(values))
    ids, pixels = find_by_markers(values, board, markers)
    if len(ids) >= MIN_OF_MARKED:
        return Detection(name, size, ids, pixels, is_reversed=markers.is_reversed)
    if len(markers.ids):
        marker_count = "1 marker" if len(markers.ids) == 1 else f"{len(markers.ids)} markers"
        reason = f"only {marker_count} of {board.marker_count} and {len(ids)} corners of the board were detected"
    else:
        reason = _failure_reason(values)
        if reason == NO_BOARD:
            reason = f"no marker of the family {board.marker_family} was detected in the image or its mirror image"
    return Detection(name, size, reason=reason, blur_px=edge_blur_px(values))


def _failure_reason(values: Grey) -> str:
    if np.ptp(np.percentile(values[::4, ::4], [1, 99])) < 8:
        return "the image is blank"
    blur = edge_blur_px(values)
    if blur > BLURRED_PX:
        return f"no board was found; the image is blurred (edge blur {blur:.1f} px)"
    return NO_BOARD


def _size_reason(part: LatticePart, board: Board, values: Grey) -> str:
    blur = edge_blur_px(values)
    blurred = f"; the image is blurred (edge blur {blur:.1f} px)" if blur > BLURRED_PX else ""
    columns, rows = sorted(part.size, reverse=True)
    expected_size = sorted(board.lattice_size, reverse=True)
    if [columns, rows] == expected_size:
        return f"only {len(part.places)} of {board.corner_count} corners of the board were detected"
    if [columns + 1, rows + 1] == expected_size:
        return (
            f"a board of {columns} x {rows} corners was detected instead of {board}; specify "
            f"the number of inner corners, not of squares{blurred}"
        )
    return f"a board of {columns} x {rows} corners was detected instead of {board}{blurred}"


def _refined(values: Grey, detection: Detection, board: Board) -> Detection:
    """Return the detection with refined corners, rejected if these are too few or too small."""
    if not detection.found:
        return detection
    refined = refine_corners(values / np.float32(255), detection, board)
    min_corners = (
        WHOLE_SHARE * board.corner_count
        if not (board.has_markers or detection.is_part)
        else MIN_OF_MARKED
    )
    if refined.used and len(refined.ids) < min_corners:
        reason = (
            f"only {len(refined.ids)} of {board.corner_count} corners of the board could be refined"
        )
        if refined.blur_px > BLURRED_PX:
            reason += f"; the image is blurred (edge blur {refined.blur_px:.1f} px)"
        refined = replace(refined, reason=reason)
    if refined.used:
        positions = board.points_mm[refined.ids, :2] / board.square_mm
        side = float(np.median(maps_about(positions, refined.corners_px, positions).spacing()))
        if side < TINY_PX:
            refined = replace(
                refined,
                reason=f"the board is too small in the image: its squares are {side:.1f} px wide",
            )
    return refined


def _is_mirrored(board: Board, ids: NDArray[np.int_], pixels: NDArray[np.float64]) -> bool:
    """Return whether a board is mirrored in an image."""
    positions = board.points_mm[ids, :2] / board.square_mm
    is_finite = np.isfinite(pixels).all(axis=1)
    determinant = float(
        np.median(
            np.linalg.det(
                maps_about(positions[is_finite], pixels[is_finite], positions[is_finite]).first
            )
        )
    )
    return (determinant < 0) != (board.kind == "aprilgrid")  # Y of an April grid points up
