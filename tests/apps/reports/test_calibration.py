"""Calibration report: self-contained, with all images and corners that it refers to."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.plot import direction_sigmas
from omnimirror.apps.reports.calibration import calibration_figures, calibration_html

BOARD = om.Board("chessboard", 11, 7, 30.0)
TRUTH = om.Unified(
    xi=0.95, focal_px=(158.0, 158.0), centre_px=(326.0, 236.0), image_size=(640, 480)
)


@pytest.fixture(scope="module")
def calibration() -> om.Calibration:
    detections = om.simulate_detections(TRUTH, BOARD, 6, noise_px=0.1)
    detections[2].corners_px[7] += 3.0
    detections.append(om.Detection("<dark>.png", (640, 480), reason="no board was found"))
    return om.calibrate_camera(
        detections, BOARD, model="unified", fixed=("k1", "k2", "k3"), board_shape=False
    )


def test_page_is_complete_and_self_contained(calibration):
    page = calibration_html(calibration, "omnimirror calibrate a&b.png")
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert "$" not in re.sub(r"base64,[^\"]*", "", page)
    assert f"{calibration.rms_px:.3f} px" in page
    assert f"{calibration.held_out_rms_px:.3f} px" in page
    assert "&lt;dark&gt;.png" in page
    assert "no board was found" in page
    assert "omnimirror calibrate a&amp;b.png" in page
    (outlier,) = calibration.outliers
    assert f"<td>{outlier.corner}</td><td>{outlier.residual_px:.2f}</td>" in page
    assert all(p.name in page for p in calibration.parameters)
    assert page.count("data:image/svg+xml") == 5


@pytest.mark.full
def test_figures_are_written(calibration, tmp_path):
    paths = om.write_calibration_figures(calibration, tmp_path)
    assert [p.stem for p in paths] == list(calibration_figures(calibration))
    for path in paths:
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


@pytest.mark.full
def test_direction_uncertainty_equals_scatter_of_repetitions(calibration):
    """Ten cameras from other noise samples scatter about the truth as predicted by the first,
    within a factor of two."""
    directions = np.array([[1.0, 0.2, -0.3], [-0.5, 0.9, 0.1], [0.1, -1.0, -0.8]])
    pixels = TRUTH.image(directions, distant=True).pixels
    rays = []
    for seed in range(10):
        detections = om.simulate_detections(TRUTH, BOARD, 6, noise_px=0.1)
        random = np.random.default_rng(seed)
        for detection in detections:
            detection.corners_px[:] += random.normal(0, 0.1, detection.corners_px.shape)
        repetition = om.calibrate_camera(
            detections, BOARD, model="unified", fixed=("k1", "k2", "k3"), board_shape=False
        )
        rays.append(repetition.model.backproject(pixels).directions)
    scatter = np.degrees(np.sqrt(np.sum(np.var(rays, axis=0), axis=1)))
    predicted = calibration.direction_sigma_deg(directions)
    assert (scatter < 3 * predicted).all()
    assert (scatter > predicted / 3).all()
    plotted = direction_sigmas(calibration)
    assert np.nanmax(plotted) > predicted.min()
