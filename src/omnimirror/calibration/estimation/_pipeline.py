"""Calibration pipeline: steps in order, with the best result available after each."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.logs import OnProgress
from ...base.worker_processes import WorkerPool
from ...cameras.models.camera_model import CameraModel
from ...cameras.models.sphere_models import Unified
from ...cameras.models.spline_models import ViewpointSpline
from ..sensor_model import SensorModel
from ..straight_edges import StraightEdges
from ._accuracy import HeldOut, ModelCandidate, held_out, select_model
from ._bundle_adjustment import (
    CAUCHY,
    RELATIVE_TOLERANCE,
    BundleAdjustment,
    Prior,
    bundle_adjust,
    shared_names,
)
from .model_sequence import (
    KINDS,
    REFERENCE_MODELS,
    ROUGH_TOLERANCE,
    distant_mirror_model,
    field_of,
    fit_first_model,
    fit_next_model,
    initial_model,
    is_central,
    mirror_from_viewpoints,
)
from .observation_checks import (
    SEVERAL,
    Outlier,
    check_mount_stability,
    check_poses,
    flipped_images,
    inconsistent_images,
    joined_names,
    reason,
    without_outliers,
    without_rejected,
)
from .observations import UNSEEN_PX, BoardShape, Loss, Observation, from_the_front

THINNED, TRIAL_STEPS = 3, 25  # thinning factor and steps for the comparison of initial values
TERMS = "mirror.coefficients"
MIN_THINNED_POINTS = 200  # minimum number of points after thinning
AXIS = ("imager.centre_px[0]", "imager.centre_px[1]")
HOPELESS = 1.1  # ratio to the best held-out error above which a model is not compared
MAX_NOISE_RATIO = (
    1.5  # ratio to the noise of the best model above which full convergence is not required
)
FREEDOM = 0.5  # maximum number of unknowns per measurement; more would fit outliers
MIN_IMAGES_FOR_REFERENCE = 5  # minimum number of images; with fewer, flexible models fit any data


LOGGER = logging.getLogger(__name__)
PERCENT = 100
"""Total of progress reports."""


class CalibrationCancelled(Exception):
    """Cancellation by the caller."""


@dataclass(frozen=True)
class ProgressReporter:
    """Progress reports and cancellation."""

    on_progress: OnProgress | None
    should_stop: Callable[[], bool] | None

    def at(self, step: str, fraction: float) -> None:
        """Report the current step and the completed fraction; raise `CalibrationCancelled` if cancelled."""
        if self.should_stop is not None and self.should_stop():
            raise CalibrationCancelled
        LOGGER.info("%s", step)
        if self.on_progress is not None:
            self.on_progress(round(PERCENT * fraction), PERCENT)


@dataclass(frozen=True)
class ParameterPriors:
    """Fixed parameters and priors, independent of the model."""

    fixed: tuple[str, ...] = ()
    priors: tuple[Prior, ...] = ()

    def of(
        self, model: CameraModel, shape: BoardShape | None
    ) -> tuple[tuple[str, ...], tuple[Prior, ...]]:
        """Return fixed names and priors of the parameters that a model has.

        The model's own priors are included.
        """
        names = shared_names(model, shape)
        specified = {p.name for p in self.priors}
        model_priors = (Prior(*p) for p in getattr(model, "priors", ()))
        priors = (*self.priors, *(p for p in model_priors if p.name not in specified))
        return tuple(n for n in self.fixed if n in names), tuple(
            p for p in priors if p.name in names
        )

    def check(self, fits: Iterable[BundleAdjustment]) -> None:
        """Check that each name belongs to at least one model."""
        names = dict.fromkeys(name for fit in fits for name in fit.names)
        for name in (*self.fixed, *(p.name for p in self.priors)):
            if name not in names:
                raise InvalidParameter(
                    f"fixed and priors must name parameters of the models ({', '.join(names)}); got {name!r}"
                )


@dataclass
class FitState:
    """State of a calibration: the best result so far."""

    fit: BundleAdjustment | None = None
    held: HeldOut | None = None
    outliers: tuple[Outlier, ...] = ()
    candidates: tuple[ModelCandidate, ...] = ()
    inconsistent: dict[str, str] = field(default_factory=dict)
    multi_viewpoint: BundleAdjustment | None = None
    """Best fit with several viewpoints."""
    failures: dict[str, str] = field(default_factory=dict)
    """Reasons for failed fits by model."""
    edges: StraightEdges | None = None
    """Edges that are straight in images undistorted with the best model."""


@dataclass(frozen=True)
class CalibrationPlan:
    """Inputs of a calibration."""

    observations: tuple[Observation, ...]
    image_size: tuple[int, int]
    centre_px: tuple[float, float] | None
    empty: Unified
    """Empty model that holds optics and mount."""
    models_to_fit: tuple[str | CameraModel, ...]
    """Model names, or a camera model as the initial value."""
    known: ParameterPriors
    shape: BoardShape | None
    is_mirror_symmetric: bool
    """True if the board equals its mirror image and a detector may number its corners in reverse.
    """
    seed: int
    edges: StraightEdges | None = None


def run(plan: CalibrationPlan, reporter: ProgressReporter, state: FitState) -> None:
    """Run all steps: initial fit, model sequence, outlier rejection, comparison, selection."""
    with WorkerPool() as pool:
        if SensorModel.KIND in map(_kind_of, plan.models_to_fit):
            pool.begin()
        reporter.at("estimating board poses", 0.0)
        base = _first_fit(plan, state)
        _fit_and_select(base, plan, reporter, state, pool)
    reporter.at("done", 1.0)


def _first_fit(plan: CalibrationPlan, state: FitState) -> BundleAdjustment:
    """Return a unified model fitted to images with different board poses."""
    fixed, priors = (
        plan.known.of(plan.empty, None)
        if Unified.KIND in map(_kind_of, plan.models_to_fit)
        else ((), ())
    )
    initial = fit_first_model(
        plan.observations,
        plan.image_size,
        plan.centre_px,
        plan.empty.optics,
        plan.empty.mount,
        fixed=fixed,
        priors=priors,
    )
    state.fit, state.inconsistent = initial.fit, initial.inconsistent
    check_poses(initial.fit.observations)
    return (
        replace(initial.fit, observations=from_the_front(initial.fit.observations))
        if plan.is_mirror_symmetric
        else initial.fit
    )


def _fit_and_select(
    base: BundleAdjustment,
    plan: CalibrationPlan,
    reporter: ProgressReporter,
    state: FitState,
    pool: WorkerPool,
) -> None:
    """Fit the model sequence, reject outliers, compare and select a model."""
    fits = _all_fits(base, plan, reporter, state, pool)
    plan.known.check(fits.values())
    reference = _reference_fit(fits)
    reporter.at("rejecting outliers", 0.4)
    reference = _without_outliers_and_moved(
        _without_inconsistent_images(reference, state), fits, plan, state
    )
    if plan.edges is not None:
        reporter.at("fitting straight edges", 0.45)
        state.edges = plan.edges.select_straight(
            reference.refit(reference.observations, edges=plan.edges).model
        )
    names = {_kind_of(w) for w in plan.models_to_fit}
    multi_viewpoint = [fit for fit in fits.values() if not is_central(fit.model)]
    if multi_viewpoint:
        state.multi_viewpoint = _least_squares_fit(
            min(multi_viewpoint, key=lambda fit: fit.problem.noise_px), reference, state
        )
    state.fit = reference if reference.model.KIND in names else state.fit
    _compare(
        {k: _least_squares_fit(fit, reference, state) for k, fit in fits.items() if k in names},
        plan,
        reporter,
        state,
        pool,
    )


def _compare(
    fits: dict[str, BundleAdjustment],
    plan: CalibrationPlan,
    reporter: ProgressReporter,
    state: FitState,
    pool: WorkerPool,
) -> None:
    """Cross-validate the models in order of fit error; skip those with a hopeless fit error."""
    compared: list[tuple[BundleAdjustment, HeldOut | None]] = []
    for number, fit in enumerate(sorted(fits.values(), key=lambda fit: fit.rms_px)):
        reporter.at(f"cross-validating {fit.model.KIND}", 0.5 + 0.5 * number / len(fits))
        is_hopeless = state.held is not None and fit.rms_px > HOPELESS * state.held.rms_px
        compared.append((fit, None if is_hopeless else held_out(fit, seed=plan.seed, pool=pool)))
        best, state.candidates = select_model(compared)
        state.fit, state.held = compared[best]


def _kind_of(model: str | CameraModel) -> str:
    return model if isinstance(model, str) else model.KIND


def _all_fits(
    base: BundleAdjustment,
    plan: CalibrationPlan,
    reporter: ProgressReporter,
    state: FitState,
    pool: WorkerPool,
) -> dict[str, BundleAdjustment]:
    """Return robust fits of the requested models and of the reference models for outliers."""
    models: list[str | CameraModel] = list(plan.models_to_fit)
    if len(base.observations) >= MIN_IMAGES_FOR_REFERENCE:
        models += [kind for kind in REFERENCE_MODELS if kind not in map(_kind_of, models)]
    fits: dict[str, BundleAdjustment] = {}
    unified = base.model
    assert isinstance(unified, Unified)
    for number, model in enumerate(sorted(models, key=_complexity)):
        kind = _kind_of(model)
        reporter.at(f"fitting {kind}", 0.05 + 0.35 * number / len(models))
        try:
            starts = (
                [model]
                if isinstance(model, CameraModel)
                else _initial_models(model, unified, base, fits)
            )
            fits[kind] = _best_fit(base, starts, plan, pool)
        except OmnimirrorError as e:
            state.failures[kind] = str(e)
            continue
        if state.fit is None or fits[kind].problem.noise_px < state.fit.problem.noise_px:
            state.fit = fits[kind]
    failed = [
        f"{k}: {reason}"
        for k, reason in state.failures.items()
        if k in map(_kind_of, plan.models_to_fit)
    ]
    if len(failed) == len(plan.models_to_fit):
        raise InvalidParameter("; ".join(failed))
    return fits


def _initial_models(
    kind: str, unified: Unified, base: BundleAdjustment, fits: dict[str, BundleAdjustment]
) -> list[CameraModel]:
    """Return initial models of a kind, including mirror sizes estimated from fitted viewpoints.

    An unknown mirror has several initial values: if the images determine its distance poorly, the
    sum of squares has several valleys, and only one contains the global minimum.
    """
    default_start, multi_viewpoint = (
        initial_model(kind, unified, field_of(base)),
        fits.get(ViewpointSpline.KIND),
    )
    if kind != SensorModel.KIND:
        return [default_start]
    estimated_start = (
        None
        if multi_viewpoint is None
        else mirror_from_viewpoints(unified, multi_viewpoint, field_of(base))
    )
    distant_start = distant_mirror_model(unified, field_of(base))
    return (
        [default_start, distant_start]
        if estimated_start is None
        else [estimated_start, default_start, distant_start]
    )


def _best_fit(
    base: BundleAdjustment, starts: Sequence[CameraModel], plan: CalibrationPlan, pool: WorkerPool
) -> BundleAdjustment:
    """Return the fit from the best initial value.

    Initial values are compared by their robust loss after some steps with some of the points, with
    gross errors counted at their bounded loss.
    """

    def options_of(start: CameraModel) -> dict[str, Any]:
        fixed, priors = plan.known.of(start, plan.shape)
        return {"shape": plan.shape, "fixed": fixed, "priors": priors}

    if len(starts) == 1:
        return fit_next_model(base, starts[0], **options_of(starts[0]))
    every = min(THINNED, max(1, sum(map(len, base.observations)) // MIN_THINNED_POINTS))
    thinned = replace(
        base, observations=tuple(s.subset(np.arange(0, len(s), every)) for s in base.observations)
    )
    jobs = [
        (thinned, start, options_of(start), is_conic_first)
        for start, is_conic_first in product(starts, (False, True))
    ]
    trials = pool.starmap(_trial, jobs)
    fits = [fit for fit in trials if isinstance(fit, BundleAdjustment)]
    options = [
        trial_options
        for fit, (_, _, trial_options, _) in zip(trials, jobs, strict=True)
        if isinstance(fit, BundleAdjustment)
    ]
    if not fits:
        raise next(fit for fit in trials if isinstance(fit, OmnimirrorError))
    loss = Loss("cauchy", CAUCHY * min(fit.problem.noise_px for fit in fits))
    sums = [loss.sum(np.where(fit.visible[:, None], fit.residuals, UNSEEN_PX)) for fit in fits]
    number = int(np.argmin(sums))
    best = fits[number]
    posed = [s.with_pose(b.pose) for s, b in zip(base.observations, best.observations, strict=True)]
    best = best.refit(posed, loss="cauchy", relative_tolerance=ROUGH_TOLERANCE)
    return bundle_adjust(
        best.model,
        best.observations,
        **options[number] | {"shape": best.shape},
        loss="cauchy",
        relative_tolerance=ROUGH_TOLERANCE,
    )


def _trial(
    thinned: BundleAdjustment, start: CameraModel, options: dict[str, Any], is_conic_first: bool
) -> BundleAdjustment | OmnimirrorError:
    """Return the fit after some steps from an initial value, or the error."""
    try:
        return _preliminary_fit(thinned, start, options, is_conic_first)
    except OmnimirrorError as e:
        return e


def _preliminary_fit(
    thinned: BundleAdjustment, start: CameraModel, options: dict[str, Any], is_conic_first: bool
) -> BundleAdjustment:
    """Return the fit after some steps, with aspheric terms free at once or after the conic.

    With its axis free from the start, an unknown mirror may converge to an implausible shape; with
    free aspheric terms, these may compensate for a conic of the wrong size.
    """
    terms = (
        tuple(p.name for p in start.parameters if p.name.startswith(TERMS))
        if is_conic_first
        else ()
    )
    fit = fit_next_model(
        thinned,
        start,
        **options | {"fixed": (*options["fixed"], *AXIS, *terms)},
        max_steps=TRIAL_STEPS,
    )
    if not terms:
        return fit
    free_options = options | {"fixed": (*options["fixed"], *AXIS), "shape": fit.shape}
    return bundle_adjust(
        fit.model,
        fit.observations,
        **free_options,
        loss="cauchy",
        relative_tolerance=ROUGH_TOLERANCE,
        max_steps=TRIAL_STEPS,
    )


def _complexity(model: str | CameraModel) -> int:
    kinds = list(KINDS)
    return kinds.index(model) if isinstance(model, str) and model in kinds else len(kinds)


def _without_inconsistent_images(fit: BundleAdjustment, state: FitState) -> BundleAdjustment:
    """Return the fit without images that even the best model does not explain."""
    inconsistent = inconsistent_images(fit)
    if not inconsistent:
        return fit
    state.inconsistent |= inconsistent
    return fit.refit([s for s in fit.observations if s.name not in inconsistent], loss="cauchy")


def _without_outliers_and_moved(
    robust: BundleAdjustment,
    fits: dict[str, BundleAdjustment],
    plan: CalibrationPlan,
    state: FitState,
) -> BundleAdjustment:
    """Return the fit without outliers, of images with a consistent mirror centre.

    Inconsistent images are recorded in ``course.inconsistent``.
    """
    fit, state.outliers = without_outliers(robust)
    inconsistent: dict[str, str] = {}
    if plan.is_mirror_symmetric:  # the model with fewer parameters is more sensitive
        inconsistent = flipped_images(fit) or flipped_images(
            _least_squares_fit(fits.get(Unified.KIND, fit), fit, state)
        )
    inconsistent = inconsistent or check_mount_stability(fit)
    if inconsistent:
        state.inconsistent |= inconsistent
        fit, state.outliers = without_outliers(
            robust.refit(
                [s for s in robust.observations if s.name not in inconsistent], loss="cauchy"
            )
        )
        if remaining := check_mount_stability(fit):
            raise InvalidParameter(
                f"{joined_names([*inconsistent, *remaining])}: {reason(SEVERAL, fit)}"
            )
    return fit


def _reference_fit(fits: dict[str, BundleAdjustment]) -> BundleAdjustment:
    """Return the reference fit for outliers: the smallest noise among well-determined models."""
    well_determined = [fit for fit in fits.values() if fit.unknowns <= FREEDOM * fit.residuals.size]
    return (
        min(well_determined, key=lambda fit: fit.problem.noise_px)
        if well_determined
        else min(fits.values(), key=lambda f: f.unknowns)
    )


def _least_squares_fit(
    fit: BundleAdjustment, reference: BundleAdjustment, state: FitState
) -> BundleAdjustment:
    """Return the least-squares fit of a model to the remaining corners."""
    names = {s.name for s in reference.observations}
    retained = without_rejected(
        tuple(s for s in fit.observations if s.name in names), state.outliers
    )
    is_far = fit.problem.noise_px > MAX_NOISE_RATIO * reference.problem.noise_px
    return fit.refit(
        retained,
        relative_tolerance=ROUGH_TOLERANCE if is_far else RELATIVE_TOLERANCE,
        edges=state.edges,
    )
