"""The cheapest tolerances that reach a yield.

The price of a tolerance t is taken as a / t: half of it costs twice as much. At the cheapest set, what a per cent of
each tolerance costs is in one proportion to what it does to the yield. Both sides are measured on traced trials that
share their random numbers, with limits softened by a few per cent so that the yield has a slope; no model of a merit is
fitted, since straight lines through merits that calibration leaves promise yields that are not there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from ...sensor import Sensor
from .evaluator import Judge
from .monte_carlo import Share, check_limits, monte_carlo, told
from .perturbation import GRADES, errors_of
from .requirement_merits import is_least
from .tolerances import BLOCK, Tolerances

Array = NDArray[np.float64]

DRAWS = 4096  # trials of each step
STEP = 0.1  # of the logarithm of a tolerance
SOFT = 0.08  # of a limit, over which the yield is smeared
DAMPING = 1 / 3  # what errors do grows with the square of their tolerance, as a rule
ROUNDS = 8
LEAST = 1e-3  # of the largest effect, below which an effect is noise
NEAR = 0.95
"""Of how wide a tolerance may be, from which it is said to be as wide as that."""
HALVINGS = 12
MOST = 1e6


@dataclass(frozen=True)
class Allocation:
    """Tolerances for a yield.

    Attributes
    ----------
    tolerances
        By the names of errors.
    price
        Sum of a / t, where the tolerances that were asked cost 1 each, or what was said.
    price_of_equal
        Of tolerances that are all scaled alike for the same yield.
    reached
        Yield of traced trials that were not used on the way.
    trials
        How many those were.
    at_widest
        Names of errors whose tolerances are as wide as they may be, or nearly.
    """

    tolerances: Mapping[str, float]
    price: float
    price_of_equal: float
    reached: Share
    trials: int
    at_widest: tuple[str, ...] = ()


def allocate(
    judge: Judge,
    tolerances: Tolerances,
    limits: Mapping[str, float],
    wanted: float,
    *,
    prices: Mapping[str, float] | None = None,
    widest: Mapping[str, float] | None = None,
    seed: int = 0,
    trials: int = 20_000,
) -> Allocation:
    """The cheapest tolerances of which a share of all sensors is good.

    Parameters
    ----------
    judge
        Of the sensor.
    tolerances
        To begin with; their distributions are kept, errors of 0 stay out.
    limits
        What a good sensor stays within.
    wanted
        The yield, between 0 and 1.
    prices
        What each tolerance costs as it was asked; 1 by default.
    widest
        How wide each may become; by default as a coarse shop holds it unasked, or as it was asked where that is wider:
        wider ones would save nothing.
    seed
        Of the trials.
    trials
        That confirm it.

    Returns
    -------
    Allocation
        The tolerances, and the yield that was traced with them.

    Raises
    ------
    InvalidParameter
        A yield that is none, or limits that a sensor without errors misses.
    """
    check_wanted(wanted, limits)
    names = [name for name, bound in tolerances.errors.items() if bound.value > 0]
    asked = np.array([tolerances.errors[name].value for name in names])
    most = np.array(
        [
            (widest or {}).get(name) or widest_of(judge.field.sensor, name, a)
            for name, a in zip(names, asked, strict=True)
        ]
    )
    case = _Case(judge, tolerances, limits, seed, names, most)
    price = np.array([(prices or {}).get(name, 1.0) for name in case.names])
    if not np.isfinite(case.excess(1e-6 * asked)).all() or case.good(1e-6 * asked) < 1:
        raise InvalidParameter(
            f"a sensor without errors misses the limits {' and '.join(told(n, v) for n, v in limits.items())}; ease "
            "them, or design another"
        )
    equal = case.scaled(asked, wanted)
    sizes = equal
    for _ in range(ROUNDS):
        effect = case.effects(sizes)
        effect = np.maximum(effect, LEAST * effect.max())
        ratio = price * asked / sizes / effect
        sizes = np.minimum(sizes * (ratio / np.exp(np.log(ratio).mean())) ** DAMPING, most)
        sizes = case.scaled(sizes, wanted)
    if (price * asked / sizes).sum() > (price * asked / equal).sum():
        sizes = equal
    sizes = replace(case, seed=seed + 1, draws=BLOCK).scaled(sizes, wanted)  # those trials were chosen by
    chosen = dict(zip(case.names, (float(v) for v in sizes), strict=True))
    confirmed = monte_carlo(judge, case.with_sizes(sizes), limits, trials=trials, seed=seed + 2)
    return Allocation(
        chosen,
        float((price * asked / sizes).sum()),
        float((price * asked / equal).sum()),
        confirmed.yields,
        confirmed.trials,
        tuple(name for name, size, end in zip(names, sizes, most, strict=True) if size >= NEAR * end),
    )


def check_wanted(wanted: float, limits: Mapping[str, float]) -> None:
    """Refuse a yield that is none, and limits that it cannot be of."""
    check_limits(limits)
    if not 0 < wanted < 1:
        raise InvalidParameter(f"a yield of {wanted:g} is valid between 0 and 1")
    if not limits:
        raise InvalidParameter("there is no limit that a good sensor stays within; name one at least")


def widest_of(sensor: Sensor, name: str, asked: float) -> float:
    """How wide a tolerance may become where nothing is said: as a coarse shop holds it, but no less than was asked.

    >>> import omnimirror as om
    >>> widest_of(om.load_sensor("paper-spherical"), "mirror.decentre_x_mm", 0.01)
    0.2
    """
    known = errors_of(sensor).get(name)
    return max(asked, known.usual[GRADES[0]] if known else asked)


@dataclass(frozen=True)
class _Case:
    """Trials with the same random numbers, whatever their tolerances."""

    judge: Judge
    tolerances: Tolerances
    limits: Mapping[str, float]
    seed: int
    names: list[str]
    most: Array
    """(n,) of each tolerance."""
    draws: int = DRAWS

    def with_sizes(self, sizes: Array) -> Tolerances:
        new = dict(zip(self.names, sizes, strict=True))
        errors = {
            name: replace(bound, value=float(new.get(name, 0.0))) for name, bound in self.tolerances.errors.items()
        }
        return replace(self.tolerances, errors=errors)

    def excess(self, sizes: Array) -> Array:
        """The largest (t,) of all merits in units of their limits; infinite where rays are lost."""
        merits = self.judge.judged(self.with_sizes(sizes).drawn(self.seed, 0, self.draws))
        columns = {name: merits[:, self.judge.names.index(name)] for name in self.limits}
        shares = [
            limit / columns[name] if is_least(name) else columns[name] / limit for name, limit in self.limits.items()
        ]
        worst = np.max(shares, axis=0)
        return np.where(np.isnan(worst), np.inf, worst)

    def good(self, sizes: Array) -> float:
        return float((self.excess(sizes) <= 1).mean())

    def effects(self, sizes: Array) -> Array:
        """How much (n,) of the softened yield goes with each logarithm of a tolerance."""
        effect = np.empty(len(sizes))
        for i in range(len(sizes)):
            step = np.ones(len(sizes))
            step[i] = np.exp(STEP)
            soft = [_softened(self.excess(s)) for s in (sizes / step, sizes * step)]
            effect[i] = (soft[0] - soft[1]) / (2 * STEP)
        return effect

    def scaled(self, sizes: Array, wanted: float) -> Array:
        """The same proportions, as large as the yield allows, and as each may be."""
        low, high, end = 1.0, 1.0, max(float((self.most / sizes).max()), 1.0)

        def at(times: float) -> Array:
            return np.minimum(times * sizes, self.most)

        while low < end and self.good(at(high)) >= wanted:
            low, high = high, 2 * high
        while self.good(at(low)) < wanted and low > 1 / MOST:
            low, high = low / 2, low
        for _ in range(HALVINGS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.good(at(middle)) >= wanted else (low, middle)
        return at(low)


def _softened(excess: Array) -> float:
    """Share of trials within their limits, smeared."""
    with np.errstate(over="ignore"):
        return float((1 / (1 + np.exp((excess - 1) / SOFT))).mean())
