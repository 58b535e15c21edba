"""Subpixel refinement of a circle next to other edges."""

import numpy as np
import pytest

from omnimirror.calibration.rim._ellipses import Ellipse, refine_ring


@pytest.mark.parametrize("ratio", [1.02, 1.03, 0.98])
def test_stronger_neighbouring_edge_does_not_shift_rim(ratio):
    """A disc of known position in a thin frame, with a step of less than half of that of the frame."""
    v, u = np.mgrid[:480, :640]
    distance = np.hypot(u - 330.3, v - 215.6)
    rim, frame = (np.clip(radius - distance + 0.5, 0, 1) for radius in (180.0, 180.0 * ratio))
    levels = (20 + 60 * rim + 150 * frame)[..., None].astype(np.uint8)
    ring, _ = refine_ring(levels, Ellipse((330.9, 215.2), 180.3), 1.33)
    assert ring.radius == pytest.approx(180.0, abs=0.5)
    assert ring.centre == (pytest.approx(330.3, abs=0.5), pytest.approx(215.6, abs=0.5))
