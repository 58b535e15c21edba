"""Selection of calibration frames from a video."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import file_name, instance, integer, number, validate_arguments
from ...base.errors import MediaError
from ...base.logs import OnProgress
from ...base.typing import Array
from ...cameras.camera import Camera
from ._corner_refinement import maps_about
from ._image_preparation import edge_blur_px, grey, scaled
from .board_detection import BLURRED_PX, compared, find_board
from .boards import Board, Detection

CELLS = 16
"""Number of cells along the longer image side in the count of covered cells."""
SCALES = (0.12, 0.25, 0.25)
"""Scales of a new view: motion relative to the longer image side, relative size, tilt and rotation.
"""
MIN_NEW_FRACTION = 0.5
"""Minimum gain of a frame: 0.5 new views, or ten new cells."""
CELL_GAIN = 0.05
BLUR_LOSS = 0.5
BLURRED = 2.0  # multiple of the median blur
QUICK_PX = 500  # longer side of the reduced image for the comparison of sharpness


@validate_arguments
def select_frames(
    video: str | Path,
    board: Board,
    *,
    count: int = 30,
    every_s: float = 0.5,
    start_s: float = 0.0,
    duration_s: float | None = None,
    camera: Camera | None = None,
    stored_orientation: bool = False,
    on_progress: OnProgress | None = None,
) -> list[Detection]:
    """Select calibration frames from a video.

    The board is detected in the sharpest frame of each interval (0.5 s by default). Frames are then
    selected one after the other, each with the largest difference from the previous ones in
    position, size, tilt and rotation of the board, until no frame adds a new view. The selection is
    deterministic.

    Parameters
    ----------
    video
        Video file, or numbered images such as ``f%04d.png``.
    board
        Calibration board.
    count
        Maximum number of selected frames.
    every_s
        Interval from which one frame is analysed.
    start_s, duration_s
        Part of the video.
    camera
        As for :func:`find_board`.
    stored_orientation
        Use frames as stored, without the rotation in the display matrix of the video.
    on_progress
        Callback with the number of analysed frames, and the total if known.

    Returns
    -------
    list[Detection]
        Detections of all analysed frames in order, with their times. The selected ones are
        :attr:`~Detection.used`; the others contain the reason. Ctrl-C ends the analysis and selects
        among the frames analysed so far.

    Raises
    ------
    InvalidParameter
        If the part is outside the video.
    MediaError
        If the video does not exist or cannot be read.

    Examples
    --------
    >>> select_frames("missing.mp4", Board())
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.MediaError: cannot read the video missing.mp4: the file does not exist
    """
    from ...io.video_reader import VideoReader

    path = file_name("video", video)
    instance("board", board, Board, "a board")
    integer("count", count, 1)
    number("every_s", every_s, above=0, unit="s")
    detections: list[Detection] = []
    with VideoReader(
        path, start_s, duration_s, with_audio=False, stored_orientation=stored_orientation
    ) as reader:
        expected = reader.expected_frames
        total = (
            None
            if expected is None
            else max(1, round(expected / float(reader.frame_rate) / every_s))
        )
        try:
            for time_s, image in _sharpest(reader, every_s):
                name = f"{path.name} at {start_s + time_s:.2f} s"
                detections.append(
                    replace(
                        find_board(image, board, name=name, camera=camera), time_s=start_s + time_s
                    )
                )
                if on_progress is not None:
                    on_progress(len(detections), total)
        except KeyboardInterrupt:
            pass
        except MediaError as e:
            if not detections:
                raise
            detections.append(Detection(path.name, (0, 0), reason=str(e)))
    return select_distinct_frames(compared(detections, board), board, count=count)


def select_distinct_frames(
    detections: Sequence[Detection], board: Board, *, count: int = 30
) -> list[Detection]:
    """Return the detections, with a reason against the use of those that add no new view.

    Parameters
    ----------
    detections
        Detections of one sensor.
    board
        Calibration board.
    count
        Maximum number of used detections.

    Examples
    --------
    >>> board = Board("chessboard", 3, 3)
    >>> places = 10.0 * board.lattice + 20
    >>> again = [Detection(name, (200, 100), np.arange(9), places, blur_px=1.0) for name in "ab"]
    >>> [d.reason for d in select_distinct_frames(again, board)]
    [None, 'its view of the board is similar to a']
    """
    result = list(detections)
    usable = [i for i, d in enumerate(result) if d.used]
    if not usable:
        return result
    usual_blur = float(np.median([result[i].blur_px for i in usable]))
    for i in [i for i in usable if result[i].blur_px > BLURRED * usual_blur]:
        blur = result[i].blur_px
        result[i] = replace(
            result[i],
            reason=f"it is blurred: edge blur {blur:.1f} px, median of all frames {usual_blur:.1f} px",
        )
    usable = [i for i in usable if result[i].used]
    views = np.array([_view(result[i], board) for i in usable])
    cells = [_cells(result[i]) for i in usable]
    sharpness = -BLUR_LOSS * np.array([result[i].blur_px / usual_blur - 1 for i in usable])
    selected, covered = [int(np.argmax([len(c) for c in cells] + sharpness))], set()
    covered |= cells[selected[0]]
    while len(selected) < min(count, len(usable)):
        distances = np.linalg.norm(views[:, None] - views[selected], axis=2).min(axis=1)
        gain = np.minimum(distances, 2.0) + CELL_GAIN * np.array([len(c - covered) for c in cells])
        gain[selected] = -np.inf
        best = int(np.argmax(gain + sharpness))
        if gain[best] < MIN_NEW_FRACTION:
            break
        selected.append(best)
        covered |= cells[best]
    for k, i in enumerate(usable):
        if k not in selected:
            similar = usable[
                selected[int(np.argmin(np.linalg.norm(views[selected] - views[k], axis=1)))]
            ]
            result[i] = replace(
                result[i], reason=f"its view of the board is similar to {result[similar].name}"
            )
    return result


def redundancy_reason(
    candidate: Detection, selected: Sequence[Detection], board: Board
) -> str | None:
    """Return the reason why an image adds no new view, None if it does.

    Parameters
    ----------
    candidate
        Detection in the current image.
    selected
        Earlier detections of the same camera; only those that are :attr:`~Detection.used` count.
    board
        Calibration board.

    Examples
    --------
    >>> board = Board("chessboard", 3, 3)
    >>> here = Detection("here", (200, 100), np.arange(9), 10.0 * board.lattice + 20, blur_px=1.0)
    >>> there = Detection("there", (200, 100), np.arange(9), 10.0 * board.lattice + [120, 30], blur_px=1.0)
    >>> redundancy_reason(here, [here, there], board), redundancy_reason(here, [there], board)
    ('its view of the board is similar to here', None)
    """
    if not candidate.used:
        return candidate.reason
    earlier = [d for d in selected if d.used and d.image_size == candidate.image_size]
    if candidate.blur_px > BLURRED_PX:
        return f"it is blurred: edge blur {candidate.blur_px:.1f} px"
    if not earlier:
        return None
    distances = np.linalg.norm([_view(d, board) for d in earlier] - _view(candidate, board), axis=1)
    covered: set[tuple[int, int]] = set().union(*map(_cells, earlier))
    if (
        min(float(distances.min()), 2.0) + CELL_GAIN * len(_cells(candidate) - covered)
        >= MIN_NEW_FRACTION
    ):
        return None
    return f"its view of the board is similar to {earlier[int(np.argmin(distances))].name}"


def _sharpest(reader: Any, every_s: float) -> Iterator[tuple[float, NDArray[Any]]]:
    """Yield the sharpest frame of each interval of the video, with its time in s."""
    from ...io.video_frames import image_of_frame

    interval, best = 0, None
    for frame in reader.frames():
        time_s = float(frame.time or 0.0)
        if best is not None and int(time_s / every_s) > interval:
            yield best[1:]
            best = None
        interval = int(time_s / every_s)
        image = image_of_frame(frame)
        values = grey(image)
        blur = edge_blur_px(scaled(values, min(1.0, QUICK_PX / max(values.shape))))
        if best is None or blur < best[0]:
            best = blur, time_s, image
    if best is not None:
        yield best[1:]


def _view(detection: Detection, board: Board) -> Array:
    """Return position, size, tilt and rotation of the board in units of the scales of a new view."""
    positions = board.points_mm[detection.ids, :2] / board.square_mm
    centre = positions.mean(axis=0, keepdims=True)
    shape = maps_about(
        positions, detection.corners_px, centre, reach=float(np.ptp(positions, axis=0).max())
    )
    size = np.sqrt(np.abs(np.linalg.det(shape.first[0]))) + 1e-6
    position = shape.pixels[0] / max(detection.image_size)
    orientation = (shape.first[0] / size).ravel()
    return np.concatenate(
        [position / SCALES[0], [np.log(size) / SCALES[1]], orientation / 2 / SCALES[2]]
    )


def _cells(detection: Detection) -> set[tuple[int, int]]:
    """Return the image cells that contain a corner of the board."""
    side = max(detection.image_size) / CELLS
    return set(map(tuple, np.floor(detection.corners_px / side).astype(int).tolist()))
