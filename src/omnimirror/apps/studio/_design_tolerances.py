"""Tolerance panel of the Design tab: image motion of interactively set errors, and the predicted yield."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from ...base.errors import OmnimirrorError
from ...base.typing import Array
from ...manufacturing.tolerancing.compensation import CALIBRATIONS, after
from ...manufacturing.tolerancing.evaluator import (
    TrialEvaluator,
    is_lower_limit,
    select_requirement_merits,
)
from ...manufacturing.tolerancing.monte_carlo import YieldStatistics, check_limits, simulate_trials
from ...manufacturing.tolerancing.perturbed_states import is_vectorised
from ...manufacturing.tolerancing.tolerances import (
    Tolerance,
    Tolerances,
    check_error_names,
    error_sources,
    group_of,
    perturbed,
)
from ...manufacturing.tolerancing.trial_images import Refocus
from ...optics.sensor import Sensor
from ...optics.sensor_files import tables_of
from ._design_evaluation import finite
from ._design_sensors import aligned_sensor, sensor_from_tables
from ._http_messages import framed
from .design_messages import (
    AsBuiltRequest,
    AsBuiltResult,
    ErrorSourceInfo,
    ErrorSourceList,
    ErrorSourcesRequest,
    SingleErrorEffect,
    YieldRequest,
    YieldResult,
)

LAST_ZERNIKE = 11
"""Highest Zernike term with a slider; the remaining terms would add 80 sliders."""
SLOW_TRIALS = 60
"""Trials of sensors that require sequential tracing, limited to keep the response time at seconds."""
STRAIGHTNESS = tuple(after("straightness_deg", depth) for depth in CALIBRATIONS)
MAX_EVALUATORS = 8  # cached evaluators, one per sensor and set of requirements


def list_error_sources(message: ErrorSourcesRequest) -> ErrorSourceList:
    """Return the error sources of the sensor of given tables."""
    sensor = aligned_sensor(sensor_from_tables(message.tables))
    kinds = [kind for kind in error_sources(sensor).values() if _has_slider(kind.name)]
    infos = tuple(
        ErrorSourceInfo(
            name=k.name,
            unit=k.unit,
            meaning=k.meaning,
            group=group_of(k.name),
            **dict(k.typical_tolerances),
        )
        for k in kinds
    )
    return ErrorSourceList(
        errors=infos, calibrations=CALIBRATIONS, is_vectorised=is_vectorised(sensor)
    )


def _has_slider(name: str) -> bool:
    start, _, number = name.removesuffix("_um").rpartition("_")
    return start != "mirror.zernike" or int(number) <= LAST_ZERNIKE


def built(message: AsBuiltRequest) -> bytes:
    """Return the image motion of a sensor with errors and its residuals after calibrations.

    Raises
    ------
    OmnimirrorError
        If the sensor is invalid, or an error source does not apply to it.
    """
    nominal = aligned_sensor(sensor_from_tables(message.tables))
    check_error_names(nominal, message.values)
    values = {name: value for name, value in message.values.items() if value} or {
        "imager.shift_x_px": 0.0
    }
    is_vectorised_sensor = is_vectorised(nominal, values)
    evaluator = _cached_evaluator(
        _cache_key(message.tables), message.refocus, STRAIGHTNESS if is_vectorised_sensor else ()
    )
    merits, moved = evaluator.evaluate_with_motions(
        {name: np.array([0.0, value]) for name, value in values.items()}
    )
    residuals = evaluator.compensators.left(np.nan_to_num(moved[1:]))[:, 0].reshape(
        len(CALIBRATIONS), 2, -1
    )
    of = {
        name: [finite(float(v)) for v in column]
        for name, column in zip(evaluator.names, merits.T, strict=True)
    }
    straight: list[float | None] = (
        [of[name][1] for name in STRAIGHTNESS]
        if is_vectorised_sensor
        else [None] * len(CALIBRATIONS)
    )
    header = AsBuiltResult(
        objects=len(evaluator.field),
        lost=int(merits[1, -1]),
        radius_px=nominal.rim_radius_px,
        motion_px=tuple(of[after("motion_px", depth)][1] for depth in CALIBRATIONS),
        direction_error_deg=tuple(
            of[after("direction_error_deg", depth)][1] for depth in CALIBRATIONS
        ),
        straightness_deg=tuple(straight),
        blur_px=(of["blur_px"][0], of["blur_px"][1]),
        focus_mm=(of["focus_distance_mm"][0], of["focus_distance_mm"][1]),
        tables=_tables_of_built(nominal, message.values),
    )
    return framed(header, evaluator.reference_px.T, residuals)


def _tables_of_built(nominal: Sensor, values: Mapping[str, float]) -> dict[str, Any] | None:
    try:
        return tables_of(perturbed(nominal, values))
    except OmnimirrorError:  # infeasible combination of values
        return None


def predict_yield(message: YieldRequest) -> YieldResult:
    """Return the effect of each error and the predicted yield.

    Raises
    ------
    OmnimirrorError
        If the sensor or a limit is invalid, or an error source does not apply.
    """
    check_limits({message.merit: message.limit})
    sensor = aligned_sensor(sensor_from_tables(message.tables))
    errors = {error.name: Tolerance(error.tolerance) for error in message.errors}
    tolerances = Tolerances(sensor, errors)
    evaluator = _cached_evaluator(
        _cache_key(message.tables), message.refocus, select_requirement_merits([message.merit])
    )
    trials = message.trials if is_vectorised(sensor, errors) else min(message.trials, SLOW_TRIALS)
    statistics = simulate_trials(
        evaluator, tolerances, {message.merit: message.limit}, trials=trials, seed=message.seed
    )
    return _yield_result(
        statistics, message.merit, _single_error_effects(evaluator, tolerances, message.merit)
    )


def _single_error_effects(
    evaluator: TrialEvaluator, tolerances: Tolerances, merit: str
) -> tuple[SingleErrorEffect, ...]:
    """Return the effects of all errors, each evaluated at plus and minus its tolerance."""
    sizes = {name: bound.value for name, bound in tolerances.errors.items() if bound.value > 0}
    if not sizes:
        return ()
    ends = np.kron(np.eye(len(sizes)), [1.0, -1.0])
    merits = evaluator.evaluate(
        {name: size * row for (name, size), row in zip(sizes.items(), ends, strict=True)}
    )
    pairs = merits.reshape(len(sizes), 2, -1)
    names = [after("motion_px", depth) for depth in CALIBRATIONS]
    rows = []
    for (name, size), pair in zip(sizes.items(), pairs, strict=True):
        worst = {
            each: _worst(each, pair[:, evaluator.names.index(each)]) for each in (*names, merit)
        }
        rows.append(
            SingleErrorEffect(
                name=name,
                tolerance=size,
                motion_px=tuple(worst[n] for n in names),
                merit=worst[merit],
            )
        )
    return tuple(
        sorted(rows, key=lambda row: -np.inf if row.motion_px[0] is None else -row.motion_px[0])
    )


def _worst(name: str, values: Array) -> float | None:
    """Return the worse of two values; None if rays are lost."""
    return finite(float(values.min() if is_lower_limit(name) else values.max()))


def _yield_result(
    statistics: YieldStatistics, merit: str, rows: tuple[SingleErrorEffect, ...]
) -> YieldResult:
    yields = statistics.yields
    median, upper = (finite(statistics.quantile(merit, fraction)) for fraction in (0.5, 0.95))
    return YieldResult(
        trials=statistics.trials,
        lost=statistics.lost,
        fraction=yields.value,
        low=yields.low,
        high=yields.high,
        median=median,
        quantile_95=upper,
        rows=rows,
    )


def _cache_key(tables: Mapping[str, Any]) -> str:
    """Serialise tables as a cache key."""
    return json.dumps(tables, sort_keys=True)


@lru_cache(maxsize=MAX_EVALUATORS)
def _cached_evaluator(tables: str, refocus: Refocus, required: tuple[str, ...]) -> TrialEvaluator:
    """Return the cached trial evaluator of a sensor; its set-up takes longer than a trial."""
    return TrialEvaluator.of(
        aligned_sensor(sensor_from_tables(json.loads(tables))), refocus, required
    )
