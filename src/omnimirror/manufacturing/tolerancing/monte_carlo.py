"""How many of the sensors built will be good: Monte Carlo trials, and what is kept of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from ...errors import InvalidParameter
from .compensation import merit_names
from .evaluator import Judge
from .requirement_merits import check_limit, is_least, is_required
from .tolerances import BLOCK, Tolerances

Array = NDArray[np.float64]

Progress = Callable[[int, int], None]

CONFIDENCE = 0.95
MOST_TRIALS = 10**10
LOWEST, HIGHEST, BINS = 1e-9, 1e9, 36 * 256
"""Range of merits in which they are counted by size, and into how many bins: quantiles are right to .23 %.

Merits that are worked out because limits ask for them are counted by how far they are from their limits, on either
side: many of them vary by less than that.
"""


class Share(NamedTuple):
    """A share of trials, and where that of all sensors lies with a confidence of .95 (Clopper and Pearson, 1934)."""

    value: float
    low: float
    high: float


def share_of(passed: int, trials: int) -> Share:
    """Of trials that passed.

    >>> [round(v, 3) for v in share_of(95, 100)]
    [0.95, 0.887, 0.984]
    """
    tail = (1 - CONFIDENCE) / 2
    low = 0.0 if passed == 0 else float(betaincinv(passed, trials - passed + 1, tail))
    high = 1.0 if passed == trials else float(betaincinv(passed + 1, trials - passed, 1 - tail))
    return Share(passed / trials, low, high)


def check_limits(limits: Mapping[str, float]) -> None:
    """Refuse limits of what is no merit of trials, and those that nothing meets.

    Parameters
    ----------
    limits
        Largest values by names of merits, and least ones of those whose names begin with ``least``.

    Raises
    ------
    InvalidParameter
        With what would be valid.
    """
    for name, limit in limits.items():
        check_limit(name, limit)


def within(merits: Array, name: str, limit: float) -> NDArray[np.bool_]:
    """Which merits (..) keep a limit; what is not a number keeps none.

    >>> within(np.array([1.0, 3.0, np.nan]), "least aspect", 2.0)
    array([False,  True, False])
    """
    kept: NDArray[np.bool_] = merits >= limit if is_least(name) else merits <= limit
    return kept


def told(name: str, limit: float) -> str:
    """A limit as people read it.

    >>> told("least field_to_deg", 120.0), told("motion_px after pose", 0.5)
    ('least field_to_deg ≥ 120', 'motion_px after pose ≤ 0.5')
    """
    return f"{name} {'≥' if is_least(name) else '≤'} {limit:g}"


NOTHING = 5e-4
"""Of a motion, px: what is less is rounding, or matters to nobody."""


def motion_words(px: float) -> str:
    """A motion as far as it matters.

    >>> motion_words(0.4251), motion_words(1.8e-13)
    ('0.425', '< 0.001')
    """
    return "< 0.001" if px < NOTHING else f"{px:.3g}"


def check_trials(trials: int) -> None:
    """Refuse a number of trials that is none."""
    if not 1 <= trials <= MOST_TRIALS:
        raise InvalidParameter(f"{trials} trials are not valid; valid are 1 to {MOST_TRIALS}")


@dataclass
class Tally:
    """What is kept of any number of trials: sums and counts, which add up in any order.

    Attributes
    ----------
    limits
        Largest, or least, values by names of merits.
    names
        Of the merits.
    trials, lost, passed
        How many there were, how many lost rays, how many are within all limits.
    passed_each
        How many are within each limit.
    sums : (m,)
        Of merits of those that lost no ray.
    counts : (m, 2 bins)
        How many of those are how far below and above what they are counted from, bins growing by a constant factor.
    """

    limits: Mapping[str, float]
    names: tuple[str, ...] = field(default_factory=merit_names)
    trials: int = 0
    lost: int = 0
    passed: int = 0
    passed_each: dict[str, int] = field(default_factory=dict)
    sums: Array = field(init=False)
    counts: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.sums = np.zeros(len(self.names))
        self.counts = np.zeros((len(self.names), 2 * BINS), dtype=np.int64)

    def _origin(self, merit: str) -> float:
        """What a merit is counted from."""
        return self.limits.get(merit, 0.0) if is_required(merit) else 0.0

    def add(self, merits: Array) -> None:
        """Count trials by their merits (t, m), in single precision, as shards keep them."""
        merits = merits.astype(np.float32).astype(float)
        whole = merits[:, -1] == 0
        good = np.asarray(whole)
        for name, limit in self.limits.items():
            kept = whole & within(merits[:, self.names.index(name)], name, limit)
            self.passed_each[name] = self.passed_each.get(name, 0) + int(kept.sum())
            good = good & kept
        self.trials += len(merits)
        self.lost += int((~whole).sum())
        self.passed += int(good.sum())
        of_whole = merits[whole]
        self.sums += of_whole.sum(axis=0)
        scale = BINS / np.log(HIGHEST / LOWEST)
        away = of_whole - np.array([self._origin(name) for name in self.names])
        place = (np.log(np.clip(np.abs(away), LOWEST, HIGHEST * 0.999) / LOWEST) * scale).astype(np.intp)
        place = np.where(away < 0, BINS - 1 - place, BINS + place)
        for row, places in zip(self.counts, place.T, strict=True):
            row += np.bincount(places, minlength=2 * BINS)

    @property
    def yields(self) -> Share:
        """Of trials within all limits."""
        return share_of(self.passed, self.trials)

    def quantile(self, merit: str, share: float) -> float:
        """The value under which a share of all trials stays; infinite where more lose rays.

        Of merits that are to be large, the value over which a share stays; 0 where more lose rays.
        """
        counts = np.cumsum(self.counts[self.names.index(merit)])
        wanted = share * self.trials
        if wanted > counts[-1]:
            return 0.0 if is_least(merit) else np.inf
        if is_least(merit):
            wanted = counts[-1] - wanted
        place = int(np.searchsorted(counts, wanted))
        return float(self._values(merit, np.array([place]), 0.5)[0])

    def _values(self, merit: str, places: NDArray[np.intp], share: float) -> Array:
        """Values (n,) in bins, at a share of each from its lower end; those that are next to nothing are nothing."""
        above = places >= BINS
        steps = np.where(above, places - BINS + share, BINS - places - share)
        away = np.where(np.isin(places, (BINS - 1, BINS)), 0.0, LOWEST * (HIGHEST / LOWEST) ** (steps / BINS))
        values: Array = self._origin(merit) + np.where(above, away, -away)
        return values

    def curve(self, merit: str) -> tuple[Array, Array]:
        """Values, and the share of all trials that stay under each."""
        counts = np.cumsum(self.counts[self.names.index(merit)])
        used = np.flatnonzero(np.diff(counts, prepend=0))
        if not used.size:
            return np.zeros(0), np.zeros(0)
        some = np.arange(used[0], used[-1] + 1)
        return self._values(merit, some, 1.0), counts[some] / self.trials

    def mean(self, merit: str) -> float:
        """Of trials that lost no ray."""
        kept = self.trials - self.lost
        return float(self.sums[self.names.index(merit)] / kept) if kept else np.nan


def monte_carlo(
    judge: Judge,
    tolerances: Tolerances,
    limits: Mapping[str, float],
    *,
    trials: int = 10_000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Tally:
    """Build a sensor many times, with errors drawn from its tolerances.

    Parameters
    ----------
    judge
        Of the sensor.
    tolerances
        Of its errors.
    limits
        What a good sensor stays within, by names of merits.
    trials
        How many.
    seed
        Of the random numbers: the same seed, the same trials.
    progress
        Called with the trials done and all of them.

    Returns
    -------
    Tally
        What became of them.

    Raises
    ------
    InvalidParameter
        A number of trials that is none, or limits that are none.
    """
    check_limits(limits)
    check_trials(trials)
    tally = Tally(dict(limits), judge.names)
    for block in range(-(-trials // BLOCK)):
        count = min(BLOCK, trials - block * BLOCK)
        tally.add(judge.judged(tolerances.drawn(seed, block, count)))
        if progress:
            progress(tally.trials, trials)
    return tally
