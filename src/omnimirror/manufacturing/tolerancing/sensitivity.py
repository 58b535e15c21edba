"""What each error does alone, and how large it may be alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .derivatives import Rates, merit_rates
from .tolerances import Tolerances
from .trials.judge import Judge
from .trials.required.names import is_least
from .yields import within

Array = NDArray[np.float64]

STEP = 0.05  # of the tolerance, of the differences that derivatives are made of
LADDER = 48
"""Rungs between which the largest tolerance is looked for; each halves what is left of the search."""
RUNGS_AT_ONCE = 8
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
    rates : dict
        First and second derivatives of each merit by the error, as it grows from 0 to plus.
    alone : dict
        By the name of each limit, the tolerance at which this error alone comes to it.
    """

    name: str
    tolerance: float
    merits: Mapping[str, float]
    rates: Mapping[str, Rates]
    alone: Mapping[str, float]


def sensitivities(judge: Judge, tolerances: Tolerances, limits: Mapping[str, float]) -> list[ErrorEffect]:
    """Of all errors, one by one.

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
    rows = []
    for name, bound in tolerances.errors.items():
        size = bound.value
        at_ends = judge.judged(tolerances.spelt_out({name: np.array([size, -size])}))
        worst = {merit: _worst(merit, values) for merit, values in zip(judge.names, at_ends.T, strict=True)}
        rows.append(
            ErrorEffect(
                name,
                size,
                worst,
                _rates(judge, name, STEP * size, tolerances) if size else {},
                {merit: _alone(judge, tolerances, name, merit, limit) for merit, limit in limits.items()},
            )
        )
    return rows


def _rates(judge: Judge, name: str, step: float, tolerances: Tolerances) -> dict[str, Rates]:
    with np.errstate(all="ignore"):  # a step beyond the mirror loses every ray: NaN
        return merit_rates(judge, name, step, tolerances)


def _worst(merit: str, values: Array) -> float:
    """Of a merit's values; where rays are lost, infinite, or 0 of what is to be large."""
    if np.isnan(values).any():
        return 0.0 if is_least(merit) else np.inf
    return float(values.min() if is_least(merit) else values.max())


def _alone(judge: Judge, tolerances: Tolerances, name: str, merit: str, limit: float) -> float:
    """The largest tolerance of an error alone; infinite where any will do, 0 where none does."""
    size = tolerances.errors[name].value
    if size == 0:
        return np.nan
    sizes = size * np.geomspace(1 / REACH, REACH, LADDER)
    low, high = 0.0, np.inf
    for _ in range(2):  # a ladder, and one between two of its rungs
        bad = _first_bad(judge, tolerances, name, merit, limit, sizes)
        if bad is None:
            return float(high)
        high = float(sizes[bad])
        low = float(sizes[bad - 1]) if bad else low
        if not low:
            return 0.0
        sizes = np.linspace(low, high, LADDER)
    return low


def _first_bad(judge: Judge, tolerances: Tolerances, name: str, merit: str, limit: float, sizes: Array) -> int | None:
    """The first of rising sizes of an error that breaks a limit; those far beyond it are not asked for."""
    place = judge.names.index(merit)
    for start in range(0, len(sizes), RUNGS_AT_ONCE):
        some = sizes[start : start + RUNGS_AT_ONCE]
        values = tolerances.spelt_out({name: np.concatenate([some, -some])})
        good = within(judge.judged(values)[:, place], merit, limit).reshape(2, -1).all(axis=0)
        bad = np.flatnonzero(~good)
        if bad.size:
            return start + int(bad[0])
    return None
