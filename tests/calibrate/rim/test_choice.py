"""How sure a committee is, against probabilities by hand."""

import numpy as np
import pytest

from omnimirror.calibrate.rim.choice import confidence

SAME = np.array([True, True, False])


def by_hand(odds: list[float]) -> float:
    """The same rings' share of all probability, less the larger one of the other ring and of none."""
    first, second, other, none = np.exp([*odds, 0.0]) / np.exp([*odds, 0.0]).sum()
    return max(0.0, first + second - max(other, none))


@pytest.mark.parametrize("odds", [[2.0, 1.0, 0.5], [2.0, 1.0, -3.0], [-1.0, -2.0, -3.0], [1.0, 0.0, 6.0]])
def test_of_one_member_it_is_by_how_much_its_answer_is_more_probable(odds):
    assert confidence(np.array([odds]), SAME) == pytest.approx(by_hand(odds), abs=1e-12)


def test_the_least_sure_member_is_believed():
    sure, doubtful = [6.0, 5.0, 0.0], [2.0, 1.0, 1.8]
    assert by_hand(doubtful) < by_hand(sure)
    assert confidence(np.array([sure, doubtful, sure]), SAME) == pytest.approx(by_hand(doubtful), abs=1e-12)
