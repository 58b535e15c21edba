"""What each error does alone, and how large it may be alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .tolerances import Tolerances
from .trials.compensation import CALIBRATIONS
from .trials.judge import Judge
from .trials.merits import merit_names

Array = NDArray[np.float64]

STEP = 0.05  # of the tolerance, of the differences that derivatives are made of
LADDER = 48
"""Rungs between which the largest tolerance is looked for; each halves what is left of the search."""
REACH = 1e4  # times its tolerance, beyond which an error alone is not asked for


@dataclass(frozen=True)
class ErrorEffect:
    """Of one error.

    Attributes
    ----------
    name
        Of the error.
    tolerance
        What was asked.
    merits : dict
        At the tolerance, the worse of plus and minus, by name.
    motion_rate : float
        Motion of the picture per unit of the error, px, rms over the field.
    motion_bend : float
        Second derivative of the motion, px per unit squared, rms over the field.
    left_rates : dict
        By the name of each calibration, what it leaves of that rate.
    alone : dict
        By the name of each limit, the tolerance at which this error alone comes to it.
    """

    name: str
    tolerance: float
    merits: Mapping[str, float]
    motion_rate: float
    motion_bend: float
    left_rates: Mapping[str, float]
    alone: Mapping[str, float]


def sensitivities(judge: Judge, tolerances: Tolerances, limits: Mapping[str, float]) -> list[ErrorEffect]:
    """Of all errors, one by one.

    Derivatives are central differences of fourth order of exactly traced motions.

    Parameters
    ----------
    judge
        Of the sensor.
    tolerances
        Of its errors.
    limits
        By names of merits.

    Returns
    -------
    list of ErrorEffect
        In the order of the errors.
    """
    names = merit_names()
    rows = []
    for name, bound in tolerances.errors.items():
        size = bound.value
        at_ends = judge.judged({name: np.array([size, -size])})
        worst = np.where(np.isnan(at_ends).any(axis=0), np.inf, at_ends.max(axis=0))
        rate, bend = _derivatives(judge, name, size)
        left = judge.compensators.left(rate[None])[:, 0]
        rows.append(
            ErrorEffect(
                name,
                size,
                dict(zip(names, worst.tolist(), strict=True)),
                _rms(rate),
                _rms(bend),
                {depth: _rms(v) for depth, v in zip(CALIBRATIONS, left, strict=True)},
                {merit: _alone(judge, name, size, merit, limit) for merit, limit in limits.items()},
            )
        )
    return rows


def _derivatives(judge: Judge, name: str, size: float) -> tuple[Array, Array]:
    """First and second derivatives (2 n,) of the motion by an error."""
    if size == 0:
        return np.zeros(2 * len(judge.field)), np.zeros(2 * len(judge.field))
    h = STEP * size
    _, (m2, m1, p1, p2) = judge.judged_with_motions({name: np.array([-2 * h, -h, h, 2 * h])})
    return (8 * (p1 - m1) - (p2 - m2)) / (12 * h), (16 * (p1 + m1) - (p2 + m2)) / (12 * h * h)


def _alone(judge: Judge, name: str, size: float, merit: str, limit: float) -> float:
    """The largest tolerance of an error alone; infinite where any will do, 0 where none does."""
    place = merit_names().index(merit)
    if size == 0:
        return np.nan
    sizes = size * np.geomspace(1 / REACH, REACH, LADDER)
    low, high = 0.0, np.inf
    for _ in range(2):  # a ladder, and one between two of its rungs
        merits = np.maximum(*judge.judged({name: np.concatenate([sizes, -sizes])})[:, place].reshape(2, -1))
        bad = np.flatnonzero(~(merits <= limit))
        if not bad.size:
            return float(high)
        high = float(sizes[bad[0]])
        low = float(sizes[bad[0] - 1]) if bad[0] else low
        if not low:
            return 0.0
        sizes = np.linspace(low, high, LADDER)
    return low


def _rms(vector: Array) -> float:
    """Of a motion (2 n,): of its lengths."""
    return float(np.sqrt((vector**2).sum() / (len(vector) / 2)))
