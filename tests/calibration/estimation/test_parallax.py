"""Error of a single-viewpoint model at distances without boards, against the true mirror."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om

from .cases import BOARD

MIRROR = om.load_sensor("paper-spherical")


def error_far_away_deg(found: om.Calibration) -> float:
    """Return the RMS direction error at the pixels of corners; board poses, with known truth, align
    the frames."""
    fit = found.adjustment
    pixels = np.concatenate([s.pixels for s in fit.observations])
    rays, looks = MIRROR.backproject(pixels), fit.model.backproject(pixels)
    both = rays.valid & looks.valid
    corners = np.concatenate([s.pose(s.points) for s in fit.observations])[both]
    world = MIRROR.mount.rotation()
    starts, ways, looks = (
        a[both] @ world for a in (rays.origins, rays.directions, looks.directions)
    )
    shift = np.zeros(3)
    for _ in range(20):  # corners are on the true rays, at any distance
        along = np.sum((corners - shift - starts) * ways, axis=1)
        shift = (corners - starts - along[:, None] * ways).mean(axis=0)
    return float(np.degrees(np.sqrt(np.mean(np.sum((looks - ways) ** 2, axis=1)))))


def test_parallax_error_is_noted():
    seen = om.simulate_detections(MIRROR, BOARD, 10, noise_px=0.1, seed=1)
    found = om.calibrate_camera(seen, BOARD, model="kannala-brandt", board_shape=False)
    (note,) = [n for n in found.notes if "has a single viewpoint" in n]
    assert "use the model sensor or viewpoint-spline" in note
    told = float(note.split("px (")[1].split(" deg")[0])
    assert told == pytest.approx(error_far_away_deg(found), rel=0.35)
    assert told > 0.5


@pytest.mark.full
def test_central_camera_has_no_parallax_note():
    truth = om.load_sensor("paraboloid-telecentric")
    seen = om.simulate_detections(truth, BOARD, 8, noise_px=0.1, seed=1)
    found = om.calibrate_camera(seen, BOARD, model="unified", board_shape=False)
    assert not [n for n in found.notes if "viewpoint" in n]
