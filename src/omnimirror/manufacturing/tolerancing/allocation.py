"""Tolerance allocation: tolerances of minimum cost for a target yield.

The cost of a tolerance t is a / t. At minimum cost, the ratio of relative cost to relative yield
change is equal for all tolerances. Both are evaluated with traced trials with common random numbers;
limits are softened by a few per cent to obtain a differentiable yield. No merit model is fitted:
linear models of merits after calibration would overestimate the yield.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import InvalidParameter
from ...base.results import Columns, Result
from ...base.typing import Array
from ...optics.sensor import Sensor
from .evaluator import TrialEvaluator, is_lower_limit
from .monte_carlo import YieldEstimate, check_limits, format_limit, simulate_trials
from .tolerances import BLOCK, GRADES, Tolerances, error_sources

DRAWS = 4096  # trials per step
STEP = 0.1  # step of the logarithm of a tolerance
SOFT = 0.08  # softening width, relative to a limit
DAMPING = 1 / 3  # effects typically grow with the square of the tolerance
ROUNDS = 8
MIN_PREFIX = 1e-3  # noise level, relative to the largest effect
MAXIMUM_FRACTION = 0.95
"""Fraction of the maximum from which a tolerance counts as being at its maximum."""
HALVINGS = 12
MAX_FACTOR = 1e6


@dataclass(frozen=True)
class Allocation(Result):
    """Allocated tolerances.

    Attributes
    ----------
    tolerances
        Tolerances by error source.
    cost
        Sum of a / t; each initial tolerance has cost 1 unless specified.
    uniform_cost
        Cost of uniformly scaled tolerances with the same yield.
    confirmed_yield
        Yield of independent trials.
    trials
        Number of these trials.
    at_maximum
        Error sources whose tolerances are (nearly) at their maximum.
    """

    tolerances: Mapping[str, float]
    cost: float
    uniform_cost: float
    confirmed_yield: YieldEstimate
    trials: int
    at_maximum: tuple[str, ...] = ()

    def _table(self) -> Columns:
        return {"name": list(self.tolerances), "tolerance": list(self.tolerances.values())}


def allocate(
    evaluator: TrialEvaluator,
    tolerances: Tolerances,
    limits: Mapping[str, float],
    target_yield: float,
    *,
    costs: Mapping[str, float] | None = None,
    max_tolerances: Mapping[str, float] | None = None,
    seed: int = 0,
    trials: int = 20_000,
) -> Allocation:
    """Find the tolerances of minimum cost for a target yield.

    Parameters
    ----------
    evaluator
        Evaluator of the sensor.
    tolerances
        Initial tolerances; distributions are kept, tolerances of 0 are excluded.
    limits
        Limits of a good sensor.
    target_yield
        Yield between 0 and 1.
    costs
        Cost of each initial tolerance, 1 by default.
    max_tolerances
        Maximum of each tolerance; by default that of the coarse grade, or the initial tolerance if
        larger, because larger tolerances do not reduce the cost.
    seed
        Random seed.
    trials
        Number of independent trials for confirmation.

    Returns
    -------
    Allocation
        Tolerances and their confirmed yield.

    Raises
    ------
    InvalidParameter
        If the yield is invalid or the nominal sensor violates a limit.
    """
    check_target_yield(target_yield, limits)
    names = [name for name, bound in tolerances.errors.items() if bound.value > 0]
    requested = np.array([tolerances.errors[name].value for name in names])
    maximum = np.array(
        [
            (max_tolerances or {}).get(name)
            or default_max_tolerance(evaluator.field.sensor, name, a)
            for name, a in zip(names, requested, strict=True)
        ]
    )
    case = _Case(evaluator, tolerances, limits, seed, names, maximum)
    cost = np.array([(costs or {}).get(name, 1.0) for name in case.names])
    if not np.isfinite(case.excess(1e-6 * requested)).all() or case.good(1e-6 * requested) < 1:
        raise InvalidParameter(
            "the nominal sensor must satisfy the limits "
            f"{' and '.join(format_limit(n, v) for n, v in limits.items())}; relax them or change the design"
        )
    equal = case.scaled(requested, target_yield)
    sizes = equal
    for _ in range(ROUNDS):
        effect = case.effects(sizes)
        effect = np.maximum(effect, MIN_PREFIX * effect.max())
        ratio = cost * requested / sizes / effect
        sizes = np.minimum(sizes * (ratio / np.exp(np.log(ratio).mean())) ** DAMPING, maximum)
        sizes = case.scaled(sizes, target_yield)
    if (cost * requested / sizes).sum() > (cost * requested / equal).sum():
        sizes = equal
    sizes = replace(case, seed=seed + 1, draws=BLOCK).scaled(
        sizes, target_yield
    )  # independent trials
    chosen = dict(zip(case.names, (float(v) for v in sizes), strict=True))
    confirmed = simulate_trials(
        evaluator, case.with_sizes(sizes), limits, trials=trials, seed=seed + 2
    )
    return Allocation(
        chosen,
        float((cost * requested / sizes).sum()),
        float((cost * requested / equal).sum()),
        confirmed.yields,
        confirmed.trials,
        tuple(
            name
            for name, size, end in zip(names, sizes, maximum, strict=True)
            if size >= MAXIMUM_FRACTION * end
        ),
    )


def check_target_yield(target_yield: float, limits: Mapping[str, float]) -> None:
    """Raise an error for an invalid target yield or missing limits."""
    check_limits(limits)
    if not 0 < target_yield < 1:
        raise InvalidParameter(f"target_yield must be between 0 and 1; got {target_yield:g}")
    if not limits:
        raise InvalidParameter("limits must contain at least one limit; got none")


def default_max_tolerance(sensor: Sensor, name: str, requested: float) -> float:
    """Return the default maximum of a tolerance: that of the coarse grade, at least the initial one.

    >>> import omnimirror as om
    >>> default_max_tolerance(om.load_sensor("paper-spherical"), "mirror.decentre_x_mm", 0.01)
    0.2
    """
    source = error_sources(sensor).get(name)
    return max(requested, source.typical_tolerances[GRADES[0]] if source else requested)


@dataclass(frozen=True)
class _Case:
    """Trials with common random numbers for any tolerances."""

    evaluator: TrialEvaluator
    tolerances: Tolerances
    limits: Mapping[str, float]
    seed: int
    names: list[str]
    max_tolerances: Array
    """Maximum tolerances (n,)."""
    draws: int = DRAWS

    def with_sizes(self, sizes: Array) -> Tolerances:
        new = dict(zip(self.names, sizes, strict=True))
        errors = {
            name: replace(bound, value=float(new.get(name, 0.0)))
            for name, bound in self.tolerances.errors.items()
        }
        return replace(self.tolerances, errors=errors)

    def excess(self, sizes: Array) -> Array:
        """Return the maximum (t,) of merits over limits; infinite if rays are lost."""
        merits = self.evaluator.evaluate(self.with_sizes(sizes).drawn(self.seed, 0, self.draws))
        columns = {name: merits[:, self.evaluator.names.index(name)] for name in self.limits}
        shares = [
            limit / columns[name] if is_lower_limit(name) else columns[name] / limit
            for name, limit in self.limits.items()
        ]
        worst = np.max(shares, axis=0)
        return np.where(np.isnan(worst), np.inf, worst)

    def good(self, sizes: Array) -> float:
        return float((self.excess(sizes) <= 1).mean())

    def effects(self, sizes: Array) -> Array:
        """Return the derivatives (n,) of the softened yield with respect to the logarithm of each
        tolerance.
        """
        effect = np.empty(len(sizes))
        for i in range(len(sizes)):
            step = np.ones(len(sizes))
            step[i] = np.exp(STEP)
            soft = [_softened(self.excess(s)) for s in (sizes / step, sizes * step)]
            effect[i] = (soft[0] - soft[1]) / (2 * STEP)
        return effect

    def scaled(self, sizes: Array, target_yield: float) -> Array:
        """Scale tolerances to the target yield, limited to their maxima."""
        low, high, end = 1.0, 1.0, max(float((self.max_tolerances / sizes).max()), 1.0)

        def at(times: float) -> Array:
            return np.minimum(times * sizes, self.max_tolerances)

        while low < end and self.good(at(high)) >= target_yield:
            low, high = high, 2 * high
        while self.good(at(low)) < target_yield and low > 1 / MAX_FACTOR:
            low, high = low / 2, low
        for _ in range(HALVINGS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.good(at(middle)) >= target_yield else (low, middle)
        return at(low)


def _softened(excess: Array) -> float:
    """Return the softened fraction of trials within the limits."""
    with np.errstate(over="ignore"):
        return float((1 / (1 + np.exp((excess - 1) / SOFT))).mean())
