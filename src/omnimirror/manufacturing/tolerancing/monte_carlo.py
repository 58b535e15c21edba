"""Monte Carlo simulation of manufacturing: yield, quantiles and their statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from ...base.errors import InvalidParameter
from ...base.results import Columns, Result, table_of
from ...base.typing import Array
from .compensation import merit_names
from .evaluator import TrialEvaluator, check_limit, is_lower_limit, is_requirement_merit
from .tolerances import BLOCK, Tolerances

Progress = Callable[[int, int], None]

CONFIDENCE = 0.95
MAX_TRIALS = 10**10
MIN_BIN, MAX_BIN, BINS = 1e-9, 1e9, 36 * 256
"""Range of the logarithmic histogram and number of bins; quantiles are accurate to 0.23 %.

Merits that limits require are counted by their distance from the limit on either side, because many
vary by less than that."""


class YieldEstimate(NamedTuple):
    """Fraction of trials with a 95 % confidence interval (Clopper and Pearson, 1934)."""

    value: float
    low: float
    high: float


def clopper_pearson(passed: int, trials: int) -> YieldEstimate:
    """Estimate a proportion with its confidence interval.

    >>> [round(v, 3) for v in clopper_pearson(95, 100)]
    [0.95, 0.887, 0.984]
    """
    tail = (1 - CONFIDENCE) / 2
    low = 0.0 if passed == 0 else float(betaincinv(passed, trials - passed + 1, tail))
    high = 1.0 if passed == trials else float(betaincinv(passed + 1, trials - passed, 1 - tail))
    return YieldEstimate(passed / trials, low, high)


def check_limits(limits: Mapping[str, float]) -> None:
    """Raise an error for limits of unknown merits and for limits that cannot be satisfied.

    Parameters
    ----------
    limits
        Upper limits by merit name, and lower limits of merits with the prefix ``min``.

    Raises
    ------
    InvalidParameter
        With the valid names or values.
    """
    for name, limit in limits.items():
        check_limit(name, limit)


def satisfies_limit(merits: Array, name: str, limit: float) -> NDArray[np.bool_]:
    """Return which merits (...) satisfy a limit; NaN does not.

    >>> satisfies_limit(np.array([1.0, 3.0, np.nan]), "min aspect", 2.0)
    array([False,  True, False])
    """
    is_satisfied: NDArray[np.bool_] = merits >= limit if is_lower_limit(name) else merits <= limit
    return is_satisfied


def format_limit(name: str, limit: float) -> str:
    """Format a limit.

    >>> format_limit("min field_to_deg", 120.0), format_limit("motion_px after pose", 0.5)
    ('min field_to_deg ≥ 120', 'motion_px after pose ≤ 0.5')
    """
    return f"{name} {'≥' if is_lower_limit(name) else '≤'} {limit:g}"


MIN_MOTION_PX = 5e-4
"""Motions below this value are displayed as "< 0.001", px."""


def format_motion(px: float) -> str:
    """Format an image motion.

    >>> format_motion(0.4251), format_motion(1.8e-13)
    ('0.425', '< 0.001')
    """
    return "< 0.001" if px < MIN_MOTION_PX else f"{px:.3g}"


def check_trials(trials: int) -> None:
    """Raise an error for an invalid number of trials."""
    if not 1 <= trials <= MAX_TRIALS:
        raise InvalidParameter(f"trials must be between 1 and {MAX_TRIALS}; got {trials}")


@dataclass
class YieldStatistics(Result):
    """Accumulated statistics of trials, independent of their order.

    Attributes
    ----------
    limits
        Upper or lower limits by merit name.
    names
        Names of the merits.
    trials, lost, passed
        Number of trials, of trials that lose rays, and of trials within all limits.
    passed_each
        Number of trials within each limit.
    sums : (m,)
        Sums of merits of trials without lost rays.
    counts : (m, 2 bins)
        Histogram of distances below and above the origin of each merit, in logarithmic bins.
    """

    limits: Mapping[str, float]
    names: tuple[str, ...] = field(default_factory=merit_names)
    trials: int = 0
    lost: int = 0
    passed: int = 0
    passed_each: dict[str, int] = field(default_factory=dict)
    sums: Array = field(init=False)
    counts: NDArray[np.int64] = field(init=False)

    def _table(self) -> Columns:
        return table_of(
            {"merit": name, "limit": limit, "passed": self.passed_each.get(name)}
            for name, limit in self.limits.items()
        )

    def __post_init__(self) -> None:
        self.sums = np.zeros(len(self.names))
        self.counts = np.zeros((len(self.names), 2 * BINS), dtype=np.int64)

    def _origin(self, merit: str) -> float:
        """Return the origin of the histogram of a merit."""
        return self.limits.get(merit, 0.0) if is_requirement_merit(merit) else 0.0

    def add(self, merits: Array) -> None:
        """Add trials by their merits (t, m), rounded to single precision as in shards."""
        merits = merits.astype(np.float32).astype(float)
        whole = merits[:, -1] == 0
        good = np.asarray(whole)
        for name, limit in self.limits.items():
            is_satisfied = whole & satisfies_limit(merits[:, self.names.index(name)], name, limit)
            self.passed_each[name] = self.passed_each.get(name, 0) + int(is_satisfied.sum())
            good = good & is_satisfied
        self.trials += len(merits)
        self.lost += int((~whole).sum())
        self.passed += int(good.sum())
        of_whole = merits[whole]
        self.sums += of_whole.sum(axis=0)
        scale = BINS / np.log(MAX_BIN / MIN_BIN)
        away = of_whole - np.array([self._origin(name) for name in self.names])
        bins = (np.log(np.clip(np.abs(away), MIN_BIN, MAX_BIN * 0.999) / MIN_BIN) * scale).astype(
            np.intp
        )
        bins = np.where(away < 0, BINS - 1 - bins, BINS + bins)
        for row, bins_of_merit in zip(self.counts, bins.T, strict=True):
            row += np.bincount(bins_of_merit, minlength=2 * BINS)

    @property
    def yields(self) -> YieldEstimate:
        """Fraction of trials within all limits."""
        return clopper_pearson(self.passed, self.trials)

    def quantile(self, merit: str, share: float) -> float:
        """Return the value that a fraction of all trials does not exceed; infinite if more lose rays.

        For merits with a lower limit, return the value that a fraction reaches; 0 if more lose rays.
        """
        counts = np.cumsum(self.counts[self.names.index(merit)])
        target = share * self.trials
        if target > counts[-1]:
            return 0.0 if is_lower_limit(merit) else np.inf
        if is_lower_limit(merit):
            target = counts[-1] - target
        bin_index = int(np.searchsorted(counts, target))
        return float(self._values(merit, np.array([bin_index]), 0.5).item())

    def _values(self, merit: str, bins: NDArray[np.intp], share: float) -> Array:
        """Return values (n,) within bins at a given fraction; values in the innermost bins are 0."""
        above = bins >= BINS
        steps = np.where(above, bins - BINS + share, BINS - bins - share)
        away = np.where(
            np.isin(bins, (BINS - 1, BINS)), 0.0, MIN_BIN * (MAX_BIN / MIN_BIN) ** (steps / BINS)
        )
        values: Array = self._origin(merit) + np.where(above, away, -away)
        return values

    def curve(self, merit: str) -> tuple[Array, Array]:
        """Return the cumulative distribution: values, and the fraction of all trials below each."""
        counts = np.cumsum(self.counts[self.names.index(merit)])
        used = np.flatnonzero(np.diff(counts, prepend=0))
        if not used.size:
            return np.zeros(0), np.zeros(0)
        some = np.arange(used[0], used[-1] + 1)
        return self._values(merit, some, 1.0), counts[some] / self.trials

    def mean(self, merit: str) -> float:
        """Return the mean of trials without lost rays."""
        valid = self.trials - self.lost
        return float(self.sums[self.names.index(merit)] / valid) if valid else np.nan


def simulate_trials(
    evaluator: TrialEvaluator,
    tolerances: Tolerances,
    limits: Mapping[str, float],
    *,
    trials: int = 10_000,
    seed: int = 0,
    on_progress: Progress | None = None,
) -> YieldStatistics:
    """Simulate sensors with random errors.

    Parameters
    ----------
    evaluator
        Evaluator of the sensor.
    tolerances
        Tolerances of its errors.
    limits
        Limits of a good sensor, by merit name.
    trials
        Number of trials.
    seed
        Random seed; results are reproducible.
    on_progress
        Callback with completed and total trials.

    Returns
    -------
    YieldStatistics
        Statistics of the trials.

    Raises
    ------
    InvalidParameter
        If the number of trials or a limit is invalid.
    """
    check_limits(limits)
    check_trials(trials)
    statistics = YieldStatistics(dict(limits), evaluator.names)
    for block in range(-(-trials // BLOCK)):
        count = min(BLOCK, trials - block * BLOCK)
        statistics.add(evaluator.evaluate(tolerances.drawn(seed, block, count)))
        if on_progress:
            on_progress(statistics.trials, trials)
    return statistics
