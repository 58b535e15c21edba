"""Complete tolerance analysis of a sensor, and typical as-built sensors."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arguments import instance, integer, validate_arguments
from ...base.errors import InvalidParameter
from ...base.results import Columns, Result, record_of, table_of
from ...design.limits import Limit
from ...design.requirement_check import distances_mm
from ...design.requirements import Requirements
from ...optics.sensor import Sensor
from .allocation import Allocation, allocate, check_target_yield
from .evaluator import TrialEvaluator, is_lower_limit, merit_limits, select_requirement_merits
from .monte_carlo import Progress, YieldStatistics, check_limits, check_trials, simulate_trials
from .sensitivity import ErrorSensitivity, VarianceDecomposition, sensitivities, sobol_indices
from .sweep import Sweep, SweepPlan, run_sweep
from .tolerance_file import TolerancePlan
from .tolerances import BLOCK, Tolerances, perturbed

RANKED_BY = ("motion_px",)
QUANTILES = (0.05, 0.5, 0.95, 0.99)


@dataclass(frozen=True)
class ToleranceReport(Result):
    """Result of :func:`tolerance`.

    Attributes
    ----------
    sensor
        Nominal sensor.
    plan
        Tolerances and limits.
    seed
        Random seed.
    statistics
        Statistics of the trials.
    sensitivities
        Effect of each error alone.
    allocation
        Tolerances of minimum cost for the target yield, if given.
    variance
        Sobol indices of the limited merits, if requested.
    seconds
        Run time.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> found = om.tolerance(sensor, om.Tolerances(sensor, {"lens.k1": om.Tolerance(0.01)}), trials=100)
    >>> found.to_dict()["trials"]
    100
    """

    sensor: Sensor
    plan: TolerancePlan
    seed: int
    statistics: YieldStatistics
    sensitivities: list[ErrorSensitivity]
    allocation: Allocation | None
    variance: VarianceDecomposition | None
    seconds: float

    def _table(self) -> Columns:
        return table_of(row.record() for row in self.sensitivities)

    def to_dict(self) -> dict[str, Any]:
        """Convert to a JSON-serialisable dictionary.

        Returns
        -------
        dict
            ``trials``, ``yield``, ``yield_low``, ``yield_high``, ``merits`` with quantiles,
            ``sensitivities``, ``allocation``, ``variance`` and ``seconds``.
        """
        statistics, allocation = self.statistics, self.allocation
        merits = {
            name: {"mean": statistics.mean(name)}
            | {f"q{round(100 * q):02}": statistics.quantile(name, q) for q in QUANTILES}
            for name in statistics.names[:-1]
        }
        cheapest = (
            None
            if allocation is None
            else {
                "tolerances": dict(allocation.tolerances),
                "cost": allocation.cost,
                "uniform_cost": allocation.uniform_cost,
                "yield": allocation.confirmed_yield.value,
                "yield_low": allocation.confirmed_yield.low,
                "yield_high": allocation.confirmed_yield.high,
                "trials": allocation.trials,
                "at_maximum": list(allocation.at_maximum),
            }
        )
        return {
            "sensor": self.sensor.name,
            "trials": statistics.trials,
            "seed": self.seed,
            "yield": statistics.yields.value,
            "yield_low": statistics.yields.low,
            "yield_high": statistics.yields.high,
            "lost": statistics.lost,
            "limits": [
                {
                    "merit": name,
                    _side(name): limit,
                    "passed": statistics.passed_each[name] / statistics.trials,
                }
                for name, limit in self.plan.limits.items()
            ],
            "merits": merits,
            "sensitivities": [
                {
                    "name": row.name,
                    "tolerance": row.tolerance,
                    "derivatives": {merit: list(rates) for merit, rates in row.rates.items()},
                    "merits": dict(row.merits),
                    "max_tolerance": dict(row.max_tolerance),
                }
                for row in self.sensitivities
            ],
            "allocation": cheapest,
            "variance": None if self.variance is None else _variance_table(self.variance),
            "seconds": self.seconds,
        }


@validate_arguments
def tolerance(
    sensor: Sensor,
    plan: TolerancePlan | Tolerances,
    *,
    limits: Mapping[str, float] | Sequence[Limit] | Requirements | None = None,
    trials: int = 10_000,
    seed: int = 0,
    target_yield: float | None = None,
    variance: bool = False,
    sweep: Sweep | None = None,
    on_progress: Progress | None = None,
    on_warning: Callable[[str], None] | None = None,
) -> ToleranceReport:
    """Run a tolerance analysis and predict the manufacturing yield.

    Parameters
    ----------
    sensor
        Nominal sensor.
    plan
        Plan from :func:`omnimirror.load_tolerances`, or :class:`omnimirror.Tolerances`.
    limits
        Limits instead of those of the plan: upper limits by merit name, such as
        ``"motion_px after pose"``, lower limits, such as ``"min resolution_px_per_deg"``, limits of
        requirements, or requirements, which also provide the object distance.
    trials
        Number of Monte Carlo trials.
    seed
        Random seed; results are reproducible.
    target_yield
        Yield for which tolerances of minimum cost are allocated.
    variance
        Compute Sobol indices of the limited merits, or of ``motion_px`` without limits.
    sweep
        Store the trials in shards and reuse existing ones; by default, trials are not stored.
    on_progress
        Callback with completed and total trials.
    on_warning
        Callback with a message for each corrupt shard.

    Returns
    -------
    ToleranceReport
        Yield, quantiles, sensitivities, and allocated tolerances.

    Raises
    ------
    InvalidParameter
        If the sensor is not supported, or a limit or number is invalid.
    OmnimirrorError
        If the folder of the sweep holds other trials or cannot be written, or its scheduler fails.

    Examples
    --------
    Effect of a decentre on an uncalibrated and on a calibrated sensor:

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> errors = {f"mirror.decentre_{axis}_mm": om.Tolerance(0.1) for axis in "xy"}
    >>> report = om.tolerance(sensor, om.Tolerances(sensor, errors), limits={"motion_px": 0.5}, trials=2000)
    >>> 0.05 < report.statistics.yields.value < 0.3
    True
    >>> limits = {"motion_px after pose": 0.5}
    >>> report = om.tolerance(sensor, om.Tolerances(sensor, errors), limits=limits, trials=2000)
    >>> report.statistics.yields.value
    1.0
    """
    # More than 60 lines: one call for each part of the report, with up to 7 arguments.
    seed = integer("seed", seed)
    if isinstance(plan, Tolerances):
        plan = TolerancePlan(plan)
    if plan.tolerances.sensor != sensor:
        raise InvalidParameter(
            "plan must contain tolerances of this sensor; got those of another sensor"
        )
    if isinstance(limits, Requirements):
        plan = with_requirements(plan, limits)
    elif limits is not None:
        limits = limits if isinstance(limits, Mapping) else limits_of(limits)
        plan = replace(plan, limits=limits)
    if target_yield is not None:  # before the simulation
        check_target_yield(target_yield, plan.limits)
    begin = time.perf_counter()
    required = select_requirement_merits(plan.limits)
    evaluator = TrialEvaluator.of(sensor, plan.refocus, required, **plan.objects)
    if sweep is None:
        statistics = simulate_trials(
            evaluator,
            plan.tolerances,
            plan.limits,
            trials=trials,
            seed=seed,
            on_progress=on_progress,
        )
    else:
        retained = SweepPlan(
            plan.tolerances, plan.refocus, plan.objects, trials, seed, sweep.shard_trials, required
        )
        statistics = run_sweep(
            sweep, retained, plan.limits, on_progress=on_progress, on_warning=on_warning
        )
    effects = sensitivities(evaluator, plan.tolerances, plan.limits)
    allocation = None
    if target_yield is not None:
        allocation = allocate(
            evaluator,
            plan.tolerances,
            plan.limits,
            target_yield,
            costs=plan.costs,
            max_tolerances=plan.max_tolerances,
            seed=seed,
        )
    decomposition = (
        sobol_indices(evaluator, plan.tolerances, tuple(plan.limits) or RANKED_BY, seed=seed)
        if variance
        else None
    )
    return ToleranceReport(
        sensor,
        plan,
        seed,
        statistics,
        effects,
        allocation,
        decomposition,
        time.perf_counter() - begin,
    )


def limits_of(limits: Sequence[Limit]) -> dict[str, float]:
    """Convert limits of requirements to limits by merit name.

    Examples
    --------
    >>> import omnimirror as om
    >>> limits_of([om.Limit("resolution_px_per_deg", at_least=4.0, omega_deg=(20.0, 100.0))])
    {'min resolution_px_per_deg, 20 to 100 deg': 4.0}
    """
    values: dict[str, float] = {}
    for limit in limits:
        values |= merit_limits(instance("limits", limit, Limit, "limits of requirements"))
    return values


def with_requirements(plan: TolerancePlan, requirements: Requirements) -> TolerancePlan:
    """Replace limits and object distance of a plan by those of a requirement file.

    An object distance of the plan takes precedence.

    Parameters
    ----------
    plan
        Tolerances and limits.
    requirements
        Requirements with at least one limit.

    Returns
    -------
    TolerancePlan
        Plan with the limits of the requirements.

    Raises
    ------
    InvalidParameter
        If there are no limits, or the object distance is ambiguous.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=120.0, object_distance_mm=800.0),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=40.0),
    ...     lens=om.LensRequirements(theta_max_deg=(5.0, 20.0)),
    ...     limits=[om.Limit("cylinder_mm_per_px", at_most=10.0)],
    ... )
    >>> sensor = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(sensor, {"lens.k1": om.Tolerance(0.01)}))
    >>> plan = with_requirements(plan, requirements)
    >>> plan.limits, plan.objects
    ({'cylinder_mm_per_px': 10.0}, {'object_distance_mm': 800.0})
    """
    if not requirements.limits:
        raise InvalidParameter(
            f"requirements {requirements.name!r} must contain at least one limit; got none"
        )
    objects = dict(plan.objects)
    if "object_distance_mm" not in objects:
        distances = distances_mm(requirements.field)
        if requirements.field.has_surfaces or len(distances) > 1:
            raise InvalidParameter(
                "object_distance_mm must be given in [objects] of the tolerance file if the requirements have several "
                "object distances or object surfaces"
            )
        objects["object_distance_mm"] = distances[0]
    return replace(plan, limits=limits_of(requirements.limits), objects=objects)


def _side(name: str) -> str:
    return "at_least" if is_lower_limit(name) else "at_most"


def _variance_table(decomposition: VarianceDecomposition) -> dict[str, Any]:
    indices = {
        merit: {name: index._asdict() for name, index in of.items()}
        for merit, of in decomposition.indices.items()
    }
    return {
        "groups": {name: list(members) for name, members in decomposition.groups.items()},
        "indices": indices,
        "lost": decomposition.lost,
    }


DEFAULT_QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class TypicalSensor(Result):
    """Trial at a given quantile, as a sensor.

    Attributes
    ----------
    quantile
        Fraction of trials that are not worse.
    trial
        Number of the trial.
    values
        Errors by name.
    sensor
        Sensor with all errors.
    merit
        Merit of the trial.

    Examples
    --------
    >>> import omnimirror as om
    >>> meant = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(meant, {"mirror.zernike_5_um": om.Tolerance(1.0)}))
    >>> om.typical_sensors(meant, plan, quantiles=(0.5,), trials=100)[0].sensor.mirror_form.zernike
    (5,)
    """

    quantile: float
    trial: int
    values: Mapping[str, float]
    sensor: Sensor
    merit: float

    def _table(self) -> Columns:
        return table_of([{**record_of(self), **self.values}])


@validate_arguments
def typical_sensors(
    sensor: Sensor,
    plan: TolerancePlan,
    merit: str = "motion_px",
    *,
    quantiles: tuple[float, ...] = DEFAULT_QUANTILES,
    trials: int = BLOCK,
    seed: int = 0,
) -> list[TypicalSensor]:
    """Return trials at given quantiles of a merit.

    Parameters
    ----------
    sensor
        Nominal sensor.
    plan
        Tolerances.
    merit
        Merit for ranking; trials that lose rays rank last.
    quantiles
        Fractions of trials that are not worse, between 0 and 1.
    trials, seed
        As for :func:`omnimirror.tolerance`; up to 8192 trials are evaluated.

    Returns
    -------
    list of TypicalSensor
        One sensor per quantile.

    Raises
    ------
    InvalidParameter
        If an argument is invalid or rays are lost at a quantile.

    Examples
    --------
    >>> import omnimirror as om
    >>> meant = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(meant, {"mirror.decentre_x_mm": om.Tolerance(0.1)}))
    >>> [round(abs(s.sensor.mirror_pose.decentre_x_mm), 2) for s in om.typical_sensors(meant, plan, trials=1000)]
    [0.01, 0.05, 0.1]
    """
    check_limits({merit: 1.0})
    check_trials(trials)
    seed = integer("seed", seed)
    evaluator = TrialEvaluator.of(
        sensor, plan.refocus, select_requirement_merits([merit]), **plan.objects
    )
    drawn = plan.tolerances.drawn(seed, 0, min(trials, BLOCK))
    merits = evaluator.evaluate(drawn)[:, evaluator.names.index(merit)]
    ranked = np.argsort(-merits if is_lower_limit(merit) else merits)  # NaN last
    sensors = []
    for quantile in quantiles:
        if not 0 <= quantile <= 1:
            raise InvalidParameter(f"quantiles must be between 0 and 1; got {quantile:g}")
        trial = int(ranked[max(int(np.ceil(quantile * len(ranked))) - 1, 0)])
        if np.isnan(merits[trial]):
            raise InvalidParameter(
                f"sensors at the quantile {quantile:g} lose rays; reduce the quantile or the tolerances"
            )
        values = {name: float(of[trial]) for name, of in drawn.items()}
        built = replace(perturbed(sensor, values), name=f"{sensor.name}-{100 * quantile:g}")
        sensors.append(TypicalSensor(quantile, trial, values, built, float(merits[trial])))
    return sensors
