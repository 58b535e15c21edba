"""Confidence of an outline from its agreement between working resolutions, against a manual
calculation."""

import math

import numpy as np
import pytest

from omnimirror.calibration.rim._classifier import confidence
from omnimirror.calibration.rim._rim_detection import MIN_CONFIDENCE


def by_hand(
    log_odds: list[float], rival_log_odds: list[float], parallel: float, within: float
) -> float:
    """Return agreement times lead times probability of a mirror, each a logistic function."""

    def share(value: float, middle: float, width: float) -> float:
        return 1 / (1 + math.exp(-(value - middle) / width))

    margins = [a - b for a, b in zip(log_odds, rival_log_odds, strict=True)]
    agreement = sum(share(margin, -2.0, 0.4) for margin in margins) / len(margins)
    distance = share(sum(margins) / len(margins), 1.55, 0.04)
    housing = min(max((within - 0.6) / 0.15, 0.0), 1.0)
    evidence = (1 - housing) * 30 * (min(parallel, 0.2) - 0.1) - 6 * housing
    mirror = share(sum(log_odds) / len(log_odds) + evidence, -1.85, 0.2)
    return max(0.0, 2 * agreement - 1) * distance * mirror


@pytest.mark.parametrize(
    ("log_odds", "rival_log_odds", "parallel", "within"),
    [
        ([1.0, 1.2, 2.5], [0.9, -0.1, -1.8], 0.2, 0.0),
        ([3.6, 1.1, -0.1], [-1.5, -0.6, -2.0], 0.05, 0.62),
        ([0.9, 1.5, 0.4], [0.2, -0.1, -1.0], 0.12, 0.4),
        ([5.0], [-1.0], 0.0, 0.8),
    ],
)
def test_confidence_is_product_of_three_factors(log_odds, rival_log_odds, parallel, within):
    value = confidence(np.array(log_odds), np.array(rival_log_odds), parallel, within)
    assert value == pytest.approx(by_hand(log_odds, rival_log_odds, parallel, within), abs=1e-12)


def test_a_circle_of_two_resolutions_of_three_is_rejected():
    """Regardless of its probability at those, and of its lead on average."""
    assert confidence(np.array([5.0, 5.0, 5.0]), np.array([0.0, 0.0, 0.0]), 0.2) > 0.95
    assert confidence(np.array([5.0, 5.0, -6.0]), np.array([-2.0, -2.0, 0.0]), 0.2) < MIN_CONFIDENCE


def test_a_plate_without_parallel_edges_is_rejected():
    """All resolutions agree on it, but without compression of the content towards its edge."""
    log_odds, rival_log_odds = np.array([-0.7, -1.6, 0.0]), np.array([-4.4, -4.3, -5.1])
    assert confidence(log_odds, rival_log_odds, 0.01) < 0.05
    assert confidence(log_odds, rival_log_odds, 0.2) > 0.9


def test_a_housing_is_rejected_for_the_clear_ring_within():
    """It is the best circle at all resolutions, and its parallel edges belong to the inner ring."""
    log_odds, rival_log_odds = np.array([0.3, 0.7, 1.2]), np.array([-1.6, -2.3, -3.1])
    assert confidence(log_odds, rival_log_odds, 0.22, within=0.86) < 0.05
    assert confidence(log_odds, rival_log_odds, 0.22, within=0.5) > 0.9
