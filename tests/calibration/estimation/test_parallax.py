"""Error of a single-viewpoint model at distances without boards, against the true mirror."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om

from .cases import BOARD

MIRROR = om.load_sensor("paper-spherical")


def error_far_away_deg(calibration: om.Calibration) -> float:
    """Return the RMS direction error at the pixels of corners; board poses, with known truth, align
    the frames."""
    fit = calibration.adjustment
    pixels = np.concatenate([s.pixels for s in fit.observations])
    rays, estimate = MIRROR.backproject(pixels), fit.model.backproject(pixels)
    both = rays.valid & estimate.valid
    corners = np.concatenate([s.pose(s.points) for s in fit.observations])[both]
    world = MIRROR.mount.rotation()
    starts, directions, estimate = (
        a[both] @ world for a in (rays.origins, rays.directions, estimate.directions)
    )
    shift = np.zeros(3)
    for _ in range(20):  # corners are on the true rays, at any distance
        along = np.sum((corners - shift - starts) * directions, axis=1)
        shift = (corners - starts - along[:, None] * directions).mean(axis=0)
    return float(np.degrees(np.sqrt(np.mean(np.sum((estimate - directions) ** 2, axis=1)))))


def test_parallax_error_is_noted():
    observations = om.simulate_detections(MIRROR, BOARD, 10, noise_px=0.1, seed=1)
    calibration = om.calibrate_camera(
        observations, BOARD, model="kannala-brandt", board_shape=False
    )
    (note,) = [n for n in calibration.notes if "has a single viewpoint" in n]
    assert "use the model sensor or viewpoint-spline" in note
    reported_deg = float(note.split("px (")[1].split(" deg")[0])
    assert reported_deg == pytest.approx(error_far_away_deg(calibration), rel=0.35)
    assert reported_deg > 0.5


@pytest.mark.full
def test_central_camera_has_no_parallax_note():
    truth = om.load_sensor("paraboloid-telecentric")
    observations = om.simulate_detections(truth, BOARD, 8, noise_px=0.1, seed=1)
    calibration = om.calibrate_camera(observations, BOARD, model="unified", board_shape=False)
    assert not [n for n in calibration.notes if "viewpoint" in n]
