"""Everything that is asked of a sensor's tolerances, at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arguments import checked, instance, whole
from ...design.criteria.limits import Limit
from ...errors import InvalidParameter
from ...sensor import Sensor
from .allocation import Allocation, allocate, check_wanted
from .evaluator import Judge
from .monte_carlo import Progress, Tally, check_limits, check_trials, monte_carlo
from .perturbation import perturbed
from .requirement_merits import is_least, names_of, required_of
from .sensitivity import ErrorEffect, VarianceShares, sensitivities, variance_shares
from .sweep import Sweep, SweepPlan, run_sweep
from .tolerance_file import TolerancePlan
from .tolerances import BLOCK, Tolerances

RANKED_BY = ("motion_px",)
QUANTILES = (0.05, 0.5, 0.95, 0.99)


@dataclass(frozen=True)
class ToleranceReport:
    """What tolerances do to a sensor.

    Attributes
    ----------
    sensor
        What is meant.
    plan
        Its tolerances and limits.
    seed
        Of the trials.
    tally
        What became of them.
    sensitivities
        What each error does alone.
    allocation
        The cheapest tolerances for a yield, if one was asked for.
    variance
        What each error has of the variance of the limited merits, if it was asked for.
    seconds
        That it took.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> found = om.tolerance(sensor, om.Tolerances(sensor, {"lens.k1": om.ErrorBound(0.01)}), trials=100)
    >>> found.to_dict()["trials"]
    100
    """

    sensor: Sensor
    plan: TolerancePlan
    seed: int
    tally: Tally
    sensitivities: list[ErrorEffect]
    allocation: Allocation | None
    variance: VarianceShares | None
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """As a file holds it.

        Returns
        -------
        dict
            ``trials``, ``yield``, ``yield_low``, ``yield_high``, ``merits`` with their quantiles, ``sensitivities``,
            ``allocation``, ``variance`` and ``seconds``.
        """
        tally, found = self.tally, self.allocation
        merits = {
            name: {"mean": tally.mean(name)} | {f"q{round(100 * q):02}": tally.quantile(name, q) for q in QUANTILES}
            for name in tally.names[:-1]
        }
        cheapest = None if found is None else {
            "tolerances": dict(found.tolerances), "price": found.price, "price_of_equal": found.price_of_equal,
            "yield": found.reached.value, "yield_low": found.reached.low, "yield_high": found.reached.high,
            "trials": found.trials, "at_widest": list(found.at_widest),
        }  # fmt: skip
        return {
            "sensor": self.sensor.name,
            "trials": tally.trials,
            "seed": self.seed,
            "yield": tally.yields.value,
            "yield_low": tally.yields.low,
            "yield_high": tally.yields.high,
            "lost": tally.lost,
            "limits": [
                {"merit": name, _side(name): limit, "passed": tally.passed_each[name] / tally.trials}
                for name, limit in self.plan.limits.items()
            ],
            "merits": merits,
            "sensitivities": [
                {
                    "name": row.name,
                    "tolerance": row.tolerance,
                    "derivatives": {merit: list(rates) for merit, rates in row.rates.items()},
                    "merits": dict(row.merits),
                    "alone": dict(row.alone),
                }
                for row in self.sensitivities
            ],
            "allocation": cheapest,
            "variance": None if self.variance is None else _variance_table(self.variance),
            "seconds": self.seconds,
        }


@checked
def tolerance(
    sensor: Sensor,
    plan: TolerancePlan | Tolerances,
    *,
    limits: Mapping[str, float] | Sequence[Limit] | None = None,
    trials: int = 10_000,
    seed: int = 0,
    wanted_yield: float | None = None,
    shares: bool = False,
    sweep: Sweep | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> ToleranceReport:
    """Say how well a sensor must be built, and how many of those built will be good.

    Parameters
    ----------
    sensor
        What is meant: one mirror on the axis of a perspective lens.
    plan
        From :func:`omnimirror.load_tolerances`, or :class:`omnimirror.Tolerances` made in Python.
    limits
        In place of the plan's: largest values by names of merits, such as ``"motion_px after pose"``, and least ones,
        such as ``"least resolution_px_per_deg"``; or limits of requirements.
    trials
        How many sensors are built.
    seed
        Of the random numbers: the same seed, the same sensors.
    wanted_yield
        A share of good sensors, for which the cheapest tolerances are looked for.
    shares
        Whether to say what each error has of the variance of the merits with limits; of ``motion_px`` without any.
    sweep
        Keep the trials in shards in a folder, and go on with those that are there; nothing is kept by default.
    progress
        Called with the trials done and all of them.
    say
        Called with a sentence for each shard that is corrupt and made again.

    Returns
    -------
    ToleranceReport
        Yield, quantiles, what each error does alone, and the tolerances that were looked for.

    Raises
    ------
    InvalidParameter
        A sensor that cannot be traced with errors, limits or numbers that are none.
    OmnimirrorError
        The folder of the sweep holds other trials or cannot be written, or its scheduler is gone.

    Examples
    --------
    A decentre is everything to a picture that was not calibrated, and nothing to one that was:

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> errors = {f"mirror.decentre_{axis}_mm": om.ErrorBound(0.1) for axis in "xy"}
    >>> found = om.tolerance(sensor, om.Tolerances(sensor, errors), limits={"motion_px": 0.5}, trials=2000)
    >>> 0.05 < found.tally.yields.value < 0.3
    True
    >>> found = om.tolerance(sensor, om.Tolerances(sensor, errors), limits={"motion_px after pose": 0.5}, trials=2000)
    >>> found.tally.yields.value
    1.0
    """
    seed = whole("seed", seed)
    if isinstance(plan, Tolerances):
        plan = TolerancePlan(plan)
    if plan.tolerances.sensor != sensor:
        raise InvalidParameter("the tolerances are those of another sensor; make them for this one")
    if limits is not None:
        limits = limits if isinstance(limits, Mapping) else limits_of(limits)
        plan = replace(plan, limits=limits)
    if wanted_yield is not None:  # before anything is built
        check_wanted(wanted_yield, plan.limits)
    begin = time.perf_counter()
    required = required_of(plan.limits)
    judge = Judge.of(sensor, plan.refocus, required, **plan.judged)
    if sweep is None:
        tally = monte_carlo(judge, plan.tolerances, plan.limits, trials=trials, seed=seed, progress=progress)
    else:
        kept = SweepPlan(plan.tolerances, plan.refocus, plan.judged, trials, seed, sweep.shard_trials, required)
        tally = run_sweep(sweep, kept, plan.limits, progress=progress, say=say)
    alone = sensitivities(judge, plan.tolerances, plan.limits)
    allocation = None
    if wanted_yield is not None:
        allocation = allocate(
            judge, plan.tolerances, plan.limits, wanted_yield, prices=plan.prices, widest=plan.widest, seed=seed
        )
    variance = variance_shares(judge, plan.tolerances, tuple(plan.limits) or RANKED_BY, seed=seed) if shares else None
    return ToleranceReport(sensor, plan, seed, tally, alone, allocation, variance, time.perf_counter() - begin)


def limits_of(limits: Sequence[Limit]) -> dict[str, float]:
    """Limits of requirements by names of merits.

    Parameters
    ----------
    limits
        As :class:`omnimirror.Requirements` has them.

    Returns
    -------
    dict
        Largest values, and least ones of names that begin with ``least``.

    Raises
    ------
    InvalidParameter
        What is no limit.

    Examples
    --------
    >>> import omnimirror as om
    >>> limits_of([om.Limit("resolution_px_per_deg", at_least=4.0, omega_deg=(20.0, 100.0))])
    {'least resolution_px_per_deg, 20 to 100 deg': 4.0}
    """
    found: dict[str, float] = {}
    for limit in limits:
        found |= names_of(instance("limits", limit, Limit, "limits of requirements"))
    return found


def _side(name: str) -> str:
    return "at_least" if is_least(name) else "at_most"


def _variance_table(found: VarianceShares) -> dict[str, Any]:
    shares = {merit: {name: share._asdict() for name, share in of.items()} for merit, of in found.shares.items()}
    return {
        "groups": {name: list(members) for name, members in found.groups.items()},
        "shares": shares,
        "lost": found.lost,
    }


SHARES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class TypicalSensor:
    """A trial as a sensor.

    Attributes
    ----------
    share
        Of all trials that are no worse.
    trial
        Its number.
    values
        Of its errors, by name.
    sensor
        With all its errors, as its file holds them.
    merit
        Of the trial.

    Examples
    --------
    >>> import omnimirror as om
    >>> meant = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(meant, {"mirror.zernike_5_um": om.ErrorBound(1.0)}))
    >>> om.typical_sensors(meant, plan, shares=(0.5,), trials=100)[0].sensor.mirror_form.zernike
    (5,)
    """

    share: float
    trial: int
    values: Mapping[str, float]
    sensor: Sensor
    merit: float


@checked
def typical_sensors(
    sensor: Sensor,
    plan: TolerancePlan,
    merit: str = "motion_px",
    *,
    shares: tuple[float, ...] = SHARES,
    trials: int = BLOCK,
    seed: int = 0,
) -> list[TypicalSensor]:
    """Trials than which given shares of all are better, by a merit.

    Parameters
    ----------
    sensor
        What is meant.
    plan
        Its tolerances.
    merit
        By which trials are ranked; one that loses rays is the worst.
    shares
        Of trials that are no worse, between 0 and 1.
    trials, seed
        As of :func:`omnimirror.tolerance`; up to 8192 are looked at.

    Returns
    -------
    list of TypicalSensor
        One for each share.

    Raises
    ------
    InvalidParameter
        A merit, a share or a number of trials that is none, or a share at which rays are lost.

    Examples
    --------
    >>> import omnimirror as om
    >>> meant = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(meant, {"mirror.decentre_x_mm": om.ErrorBound(0.1)}))
    >>> [round(abs(s.sensor.mirror_pose.decentre_x_mm), 2) for s in om.typical_sensors(meant, plan, trials=1000)]
    [0.01, 0.05, 0.1]
    """
    check_limits({merit: 1.0})
    check_trials(trials)
    seed = whole("seed", seed)
    judge = Judge.of(sensor, plan.refocus, required_of([merit]), **plan.judged)
    drawn = plan.tolerances.drawn(seed, 0, min(trials, BLOCK))
    merits = judge.judged(drawn)[:, judge.names.index(merit)]
    ranked = np.argsort(-merits if is_least(merit) else merits)  # what is NaN comes last
    found = []
    for share in shares:
        if not 0 <= share <= 1:
            raise InvalidParameter(f"a share of {share:g} is valid from 0 to 1")
        trial = int(ranked[max(int(np.ceil(share * len(ranked))) - 1, 0)])
        if np.isnan(merits[trial]):
            raise InvalidParameter(
                f"at a share of {share:g} sensors lose rays; make the share smaller, or the tolerances"
            )
        values = {name: float(of[trial]) for name, of in drawn.items()}
        built = replace(perturbed(sensor, values), name=f"{sensor.name}-{100 * share:g}")
        found.append(TypicalSensor(share, trial, values, built, float(merits[trial])))
    return found
