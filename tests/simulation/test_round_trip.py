"""Round trip: the error of a single viewpoint agrees with Eq. 23, and that of the true reflection
is zero."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.simulation.round_trip import measure_round_trip


@pytest.mark.full
def test_round_trip_matches_eq_23():
    result = measure_round_trip(om.load_sensor("paper-spherical"), samples=1, texel_mm=10.0)
    assert np.abs(result.predicted_px).max() > 1.4
    np.testing.assert_allclose(result.single_px, result.predicted_px, atol=0.2)
    assert np.abs(result.exact_px).max() < 0.15
    assert result.exact_db > result.single_db + 8
    assert result.finer_db > result.exact_db + 2  # the residual is the sampling error
    assert result.blurred_db < result.exact_db
