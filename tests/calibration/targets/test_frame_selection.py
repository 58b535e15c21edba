"""Selection of sharp and distinct frames from a video of a board."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.calibration.targets.frame_selection import redundancy_reason

BOARD = om.Board("chessboard", 5, 4, 20.0)
SIZE = (320, 240)


def frame(
    left: float, top: float, size: float, turn_deg: float = 0.0, blur: float = 0.6
) -> np.ndarray:
    """Return a chessboard of given square size, position and rotation."""
    board_image = om.draw_board(BOARD, px_per_mm=1.0)
    scale = size / 20
    turn = cv2.getRotationMatrix2D((70.0, 60.0), turn_deg, scale)
    turn[:, 2] += [left, top]
    warped = cv2.warpAffine(board_image, turn, SIZE, flags=cv2.INTER_AREA, borderValue=255)
    return np.repeat(
        np.clip(cv2.GaussianBlur(warped, (0, 0), blur) * 0.7 + 30, 0, 255).astype(np.uint8)[
            ..., None
        ],
        3,
        2,
    )


POSITIONS = [(0, 0, 16), (170, 0, 16), (0, 110, 16), (170, 110, 16), (80, 50, 28), (90, 60, 16, 40)]


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A video with each view for 1 s at 8 frames/s: first in motion, then sharp twice, finally
    low-contrast."""
    from omnimirror.simulation.simulated_video import encode

    path = tmp_path_factory.mktemp("video") / "board.mp4"
    frames = []
    for position in POSITIONS:
        frames += (
            [frame(*position, blur=4.0)] * 2
            + [frame(*position)] * 4
            + [frame(*position, blur=2.5)] * 2
        )
    encode(path, SIZE, 8.0, iter(frames))
    return path


def test_each_view_is_selected_once_and_sharp(video):
    detections = om.select_frames(video, BOARD)
    used = [d for d in detections if d.used]
    assert len(detections) == 2 * len(POSITIONS)
    assert sorted(int(d.time_s) for d in used) == list(range(len(POSITIONS)))
    assert all(0.25 <= d.time_s % 1 < 0.75 for d in used)
    others = [d.reason for d in detections if not d.used]
    assert all("is similar to board.mp4 at" in reason or "blurred" in reason for reason in others)


@pytest.mark.full
def test_most_different_frames_come_first(video):
    used = [d for d in om.select_frames(video, BOARD, count=3) if d.used]
    middles = np.array([d.corners_px.mean(axis=0) for d in used])
    assert len(used) == 3
    assert min(np.linalg.norm(a - b) for i, a in enumerate(middles) for b in middles[:i]) > 60


def test_interrupt_selects_from_partial_results(video):
    def stop(done: int, total: int | None) -> None:
        assert total == 2 * len(POSITIONS)
        if done == 4:
            raise KeyboardInterrupt

    detections = om.select_frames(video, BOARD, on_progress=stop)
    assert len(detections) == 4
    assert sum(d.used for d in detections) == 2


def test_automatic_capture_requires_sharp_new_view():
    """The same views are selected from a video; the fast detection agrees with the thorough one."""
    captured = [
        om.find_board(frame(*position), BOARD, name=f"{position}") for position in POSITIONS[:3]
    ]
    quick = om.find_board(frame(*POSITIONS[3]), BOARD, quick=True)
    np.testing.assert_array_equal(
        quick.corners_px, om.find_board(frame(*POSITIONS[3]), BOARD).corners_px
    )
    assert redundancy_reason(quick, captured, BOARD) is None
    nearly = om.find_board(frame(2, 1, 16), BOARD)
    assert (
        redundancy_reason(nearly, captured, BOARD)
        == f"its view of the board is similar to {POSITIONS[0]}"
    )
    blurred = om.find_board(frame(*POSITIONS[4], blur=3.5), BOARD)
    assert "blurred" in redundancy_reason(blurred, captured, BOARD)
    blank = om.find_board(np.full((240, 320), 90, np.uint8), BOARD, quick=True)
    assert redundancy_reason(blank, captured, BOARD) == "the image is blank"
