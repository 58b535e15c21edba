"""Round trip: the error of a single viewpoint agrees with Eq. 23, and that of the true reflection
is zero."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.simulation.round_trip import measure_round_trip


@pytest.mark.full
def test_round_trip_matches_eq_23():
    found = measure_round_trip(om.load_sensor("paper-spherical"), samples=1, texel_mm=10.0)
    assert np.abs(found.predicted_px).max() > 1.4
    np.testing.assert_allclose(found.single_px, found.predicted_px, atol=0.2)
    assert np.abs(found.exact_px).max() < 0.15
    assert found.exact_db > found.single_db + 8
    assert found.finer_db > found.exact_db + 2  # the residual is the sampling error
    assert found.blurred_db < found.exact_db
