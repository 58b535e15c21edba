"""Fits of all kinds of models, without initial values, to images of a camera of their own kind."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om

from .cases import BOARD, NOISE_PX

SIZE = (1024, 1024)
CENTRE = (512.0, 510.0)
TRUTHS = [  # each close to a ball observed by a camera, as far as its model permits
    om.DoubleSphere(
        xi=0.826, alpha=0.98, focal_px=(510.0, 510.0), centre_px=CENTRE, image_size=SIZE
    ),
    om.EnhancedUnified(
        alpha=0.609,
        beta=1.472,
        focal_px=(284.0, 282.0),
        centre_px=CENTRE,
        image_size=SIZE,
        skew_px=-0.2,
    ),
    om.OCam(
        polynomial=(-445.8, 0.0, 0.010187, -4.1234e-05, 5.3696e-08),
        centre_px=CENTRE,
        image_size=SIZE,
        affine=(0.9975, -0.008, 0.0),
    ),
    om.KannalaBrandt(
        focal_px=(279.0, 279.4),
        centre_px=CENTRE,
        image_size=SIZE,
        k1=-0.035,
        k2=-0.00266,
        k3=0.000317,
        k4=-1.2e-05,
        optics="mirror",
    ),
    om.ViewpointSpline(
        radii_px=(82.5, 167.5, 246.4, 318.3, 381.3, 434.0, 475.3, 504.4),
        viewpoints_mm=(3.9, -5.0, -5.8, -3.8, 0.0, 5.8, 15.4, 31.2),
        field_deg=275.0,
        centre_px=CENTRE,
        image_size=SIZE,
        p1=6e-7,
    ),
]


EVERY_DAY = ("enhanced-unified",)  # the one with skew


@pytest.mark.parametrize(
    "truth",
    [
        pytest.param(t, id=t.KIND, marks=() if t.KIND in EVERY_DAY else pytest.mark.full)
        for t in TRUTHS
    ],
)
def test_model_sequence_ends_at_true_model(truth):
    """Parameters are inside their bounds and are not blocked by different magnitudes."""
    observations = om.simulate_detections(truth, BOARD, 8, noise_px=NOISE_PX, seed=2)
    calibration = om.calibrate_camera(observations, BOARD, model=truth.KIND, board_shape=False)
    assert calibration.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.06)


def test_points_beyond_field_are_projected_continuously():
    """A fit can therefore converge from an initial field that is too small."""
    camera = TRUTHS[0]
    end = camera.model_end
    inside, outside = ([[np.sin(end + d), 0.0, -np.cos(end + d)]] for d in (-1e-6, 0.2))
    assert not camera.image(outside).valid.any()
    projection = camera.image_clamped(outside)
    assert projection.pixels[0] == pytest.approx(camera.image(inside).pixels[0], abs=1e-3)
    assert projection.d_points[0, 0, 2] == 0.0  # constant farther out
