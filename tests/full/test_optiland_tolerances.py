"""Tolerance trials against Optiland: chief rays of a perturbed sensor leave its mirror towards the
objects."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.manufacturing.tolerancing.compensation import POSE
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator

pytestmark = pytest.mark.full
CLOSE_RAD = 1e-12


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("field_deg", [(0.0, 90.0), (0.0, 130.0)])
def test_misaligned_sensor_agrees_with_optiland(field_deg, beside):
    pytest.importorskip("optiland", reason="Optiland is installed by `make test-full` only")
    from tolerance_comparison import largest_angle_rad

    sensor = om.load_sensor("paper-spherical")
    evaluator, rng = TrialEvaluator.of(sensor, field_deg=field_deg), np.random.default_rng(5)
    errors = [dict.fromkeys(POSE, 0.0) | {name: 0.1} for name in POSE]
    errors += [{name: float(rng.normal() * 0.3) for name in POSE} for _ in range(5)]
    off = max(largest_angle_rad(sensor, evaluator, values) for values in errors)
    beside("Optiland", "rays of sensors with misaligned mirrors", off, CLOSE_RAD, "rad")
