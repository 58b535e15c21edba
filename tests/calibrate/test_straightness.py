"""What is straight in the world is straight in a perspective view of a calibrated camera: the lines of boards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.mirrors.pose import MirrorPose
from tests.conftest import SHARED

BOARD = om.Board("chessboard", 11, 7, 30.0)
PHOTOGRAPHS = sorted((SHARED / "kaidan_omni").glob("*.jpg"))


def straightened(camera, corners_px):
    """Corners (n, 2) px of a board in a perspective view that looks at its middle, as fine as the picture is there."""
    rays = camera.backproject(corners_px).directions
    ahead = rays.mean(axis=0)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(ahead, right), ahead])
    x, y, z = axes @ rays.T
    view = np.stack([x / z, y / z], axis=1)
    focal_px = np.linalg.norm(corners_px - corners_px.mean(axis=0)) / np.linalg.norm(view - view.mean(axis=0))
    return focal_px * view


def off_straight_px(camera, detection):
    """How far (k,) px each corner lies from the line that fits its row best, and so for its column."""
    view = straightened(camera, detection.corners_px)
    rows, columns = np.divmod(np.asarray(detection.ids), BOARD.columns)
    off = []
    for line in [view[rows == i] for i in range(BOARD.rows)] + [view[columns == i] for i in range(BOARD.columns)]:
        if len(line) > 2:
            from_middle = line - line.mean(axis=0)
            off.append(np.abs(from_middle @ np.linalg.svd(from_middle)[2][1]))
    return np.concatenate(off)


@pytest.mark.long
def test_lines_of_boards_are_straight_for_a_misaligned_mirror():
    """Calibrated from corners with noise; the boards that are looked at are others, without. As it was drawn, the
    sensor bends them four times as much."""
    drawn = om.load_sensor("paper-spherical")
    built = replace(drawn, mirror_pose=MirrorPose(0.8, -0.5, 0.0, 0.6, 0.0))
    seen = om.simulate_detections(built, BOARD, 8, noise_px=0.1, seed=1)
    others = om.simulate_detections(built, BOARD, 8, noise_px=0.0, seed=2)
    camera = om.calibrate_camera(seen, BOARD, model=drawn).camera
    off, off_as_drawn = (np.concatenate([off_straight_px(c, d) for d in others]).max() for c in (camera, drawn))
    assert off < 0.25 * off_as_drawn
    assert off < 1.0


@pytest.mark.long
@pytest.mark.skipif(not PHOTOGRAPHS, reason=f"the photographs are not in {SHARED}")
def test_lines_of_photographed_boards_are_straight():
    """Boards that took no part in the calibration too."""
    detections = om.find_boards(PHOTOGRAPHS[::2], BOARD)
    camera = om.calibrate_camera(detections[::2] + detections[1:4:2], BOARD, model="radial-spline").camera
    off = [off_straight_px(camera, d).max() for d in detections]
    assert max(off) < 1.0
