"""Calibration pipeline: steps in order, with the best result available after each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from ...base.errors import InvalidParameter, OmnimirrorError
from ...cameras.models.camera_model import CameraModel
from ...cameras.models.sphere_models import Unified
from ...cameras.models.spline_models import ViewpointSpline
from .._worker_processes import WorkerPool
from ..sensor_model import SensorModel
from ..straight_edges import StraightEdges
from ._bundle_adjustment import CAUCHY, RELATIVE_TOLERANCE, Adjustment, Prior, adjust, shared_names
from ._cross_validation import HeldOut, ModelCandidate, held_out, select_model
from ._mount_stability import SEVERAL, check_mount_stability, flipped_pictures, reason
from ._residuals import UNSEEN_PX, BoardShape, Loss
from .model_sequence import (
    KINDS,
    REFERENCE_MODELS,
    ROUGH_TOLERANCE,
    field_of,
    fit_first_model,
    fit_next_model,
    initial_model,
    is_central,
    mirror_farther,
    mirror_of_viewpoints,
)
from .observation_checks import (
    Outlier,
    check_poses,
    inconsistent_images,
    joined_names,
    without_outliers,
    without_rejected,
)
from .observations import Sighting, from_the_front

THINNED, TRIAL_STEPS = 3, 25  # thinning factor and steps for the comparison of initial values
TERMS = "mirror.coefficients"
ENOUGH = 200  # minimum number of points after thinning
AXIS = ("imager.centre_px[0]", "imager.centre_px[1]")
HOPELESS = 1.1  # ratio to the best held-out error above which a model is not compared
FAR = 1.5  # ratio to the noise of the best model above which full convergence is not required
FREEDOM = 0.5  # maximum number of unknowns per measurement; more would fit outliers
MIN_IMAGES_FOR_REFERENCE = 5  # minimum number of images; with fewer, flexible models fit any data


class CalibrationStopped(Exception):
    """Cancellation by the caller."""


@dataclass(frozen=True)
class ProgressReporter:
    """Progress reports and cancellation."""

    progress: Callable[[str, float], None] | None
    stop: Callable[[], bool] | None

    def at(self, what: str, share: float) -> None:
        """Report the current step and the completed fraction; raise `CalibrationStopped` if cancelled."""
        if self.stop is not None and self.stop():
            raise CalibrationStopped
        if self.progress is not None:
            self.progress(what, share)


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
        said = {p.name for p in self.priors}
        own = (Prior(*p) for p in getattr(model, "priors", ()))
        priors = (*self.priors, *(p for p in own if p.name not in said))
        return tuple(n for n in self.fixed if n in names), tuple(
            p for p in priors if p.name in names
        )

    def check(self, fits: Iterable[Adjustment]) -> None:
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

    fit: Adjustment | None = None
    held: HeldOut | None = None
    outliers: tuple[Outlier, ...] = ()
    candidates: tuple[ModelCandidate, ...] = ()
    strangers: dict[str, str] = field(default_factory=dict)
    wandering: Adjustment | None = None
    """Best fit with several viewpoints."""
    failures: dict[str, str] = field(default_factory=dict)
    """Reasons for failed fits by model."""
    edges: StraightEdges | None = None
    """Edges that the best model straightens."""


@dataclass(frozen=True)
class CalibrationPlan:
    """Inputs of a calibration."""

    sightings: tuple[Sighting, ...]
    image_size: tuple[int, int]
    centre_px: tuple[float, float] | None
    empty: Unified
    """Empty model that holds optics and mount."""
    wanted: tuple[str | CameraModel, ...]
    """Model names, or a camera model as the initial value."""
    known: ParameterPriors
    shape: BoardShape | None
    is_mirrored_alike: bool
    """Whether the board equals its mirror image and a detector may number its corners in reverse.
    """
    seed: int
    edges: StraightEdges | None = None


def run(plan: CalibrationPlan, watch: ProgressReporter, course: FitState) -> None:
    """Run all steps: initial fit, model sequence, outlier rejection, comparison, selection."""
    with WorkerPool() as spread:
        if SensorModel.KIND in map(_kind, plan.wanted):
            spread.begin()
        watch.at("estimating board poses", 0.0)
        base = _first_fit(plan, course)
        _fit_and_select(base, plan, watch, course, spread)
    watch.at("done", 1.0)


def _first_fit(plan: CalibrationPlan, course: FitState) -> Adjustment:
    """Return a unified model fitted to images with different board poses."""
    fixed, priors = (
        plan.known.of(plan.empty, None) if Unified.KIND in map(_kind, plan.wanted) else ((), ())
    )
    low = fit_first_model(
        plan.sightings,
        plan.image_size,
        plan.centre_px,
        plan.empty.optics,
        plan.empty.mount,
        fixed=fixed,
        priors=priors,
    )
    course.fit, course.strangers = low.fit, low.strangers
    check_poses(low.fit.sightings)
    return (
        replace(low.fit, sightings=from_the_front(low.fit.sightings))
        if plan.is_mirrored_alike
        else low.fit
    )


def _fit_and_select(
    base: Adjustment,
    plan: CalibrationPlan,
    watch: ProgressReporter,
    course: FitState,
    spread: WorkerPool,
) -> None:
    """Fit the model sequence, reject outliers, compare and select a model."""
    fits = _all_fits(base, plan, watch, course, spread)
    plan.known.check(fits.values())
    judge = _reference_fit(fits)
    watch.at("rejecting outliers", 0.4)
    judge = _agreeing(_without_strangers(judge, course), fits, plan, course)
    if plan.edges is not None:
        watch.at("fitting straight edges", 0.45)
        course.edges = plan.edges.straight_for(judge.again(judge.sightings, edges=plan.edges).model)
    names = {_kind(w) for w in plan.wanted}
    wandering = [fit for fit in fits.values() if not is_central(fit.model)]
    if wandering:
        course.wandering = _frozen(
            min(wandering, key=lambda fit: fit.question.noise_px), judge, course
        )
    course.fit = judge if judge.model.KIND in names else course.fit
    _compare(
        {k: _frozen(fit, judge, course) for k, fit in fits.items() if k in names},
        plan,
        watch,
        course,
        spread,
    )


def _compare(
    fits: dict[str, Adjustment],
    plan: CalibrationPlan,
    watch: ProgressReporter,
    course: FitState,
    spread: WorkerPool,
) -> None:
    """Cross-validate the models in order of fit error; skip those with a hopeless fit error."""
    compared: list[tuple[Adjustment, HeldOut | None]] = []
    for number, fit in enumerate(sorted(fits.values(), key=lambda fit: fit.rms_px)):
        watch.at(f"cross-validating {fit.model.KIND}", 0.5 + 0.5 * number / len(fits))
        is_beaten = course.held is not None and fit.rms_px > HOPELESS * course.held.rms_px
        compared.append((fit, None if is_beaten else held_out(fit, seed=plan.seed, spread=spread)))
        best, course.candidates = select_model(compared)
        course.fit, course.held = compared[best]


def _kind(wanted: str | CameraModel) -> str:
    return wanted if isinstance(wanted, str) else wanted.KIND


def _all_fits(
    base: Adjustment,
    plan: CalibrationPlan,
    watch: ProgressReporter,
    course: FitState,
    spread: WorkerPool,
) -> dict[str, Adjustment]:
    """Return robust fits of the requested models and of the reference models for outliers."""
    ladder: list[str | CameraModel] = list(plan.wanted)
    if len(base.sightings) >= MIN_IMAGES_FOR_REFERENCE:
        ladder += [kind for kind in REFERENCE_MODELS if kind not in map(_kind, ladder)]
    fits: dict[str, Adjustment] = {}
    unified = base.model
    assert isinstance(unified, Unified)
    for number, wanted in enumerate(sorted(ladder, key=_order)):
        kind = _kind(wanted)
        watch.at(f"fitting {kind}", 0.05 + 0.35 * number / len(ladder))
        try:
            starts = (
                [wanted]
                if isinstance(wanted, CameraModel)
                else _starts(wanted, unified, base, fits)
            )
            fits[kind] = _best_fit(base, starts, plan, spread)
        except OmnimirrorError as e:
            course.failures[kind] = str(e)
            continue
        if course.fit is None or fits[kind].question.noise_px < course.fit.question.noise_px:
            course.fit = fits[kind]
    failed = [f"{k}: {why}" for k, why in course.failures.items() if k in map(_kind, plan.wanted)]
    if len(failed) == len(plan.wanted):
        raise InvalidParameter("; ".join(failed))
    return fits


def _starts(
    kind: str, unified: Unified, base: Adjustment, fits: dict[str, Adjustment]
) -> list[CameraModel]:
    """Return initial models of a kind, including mirror sizes estimated from fitted viewpoints.

    An unknown mirror has several initial values: if the images determine its distance poorly, the
    sum of squares has several valleys, and only one contains the global minimum.
    """
    usual, wandering = initial_model(kind, unified, field_of(base)), fits.get(ViewpointSpline.KIND)
    if kind != SensorModel.KIND:
        return [usual]
    sized = None if wandering is None else mirror_of_viewpoints(unified, wandering, field_of(base))
    far = mirror_farther(unified, field_of(base))
    return [usual, far] if sized is None else [sized, usual, far]


def _best_fit(
    base: Adjustment, starts: Sequence[CameraModel], plan: CalibrationPlan, spread: WorkerPool
) -> Adjustment:
    """Return the fit from the best initial value.

    Initial values are compared by their robust loss after some steps with some of the points, with
    gross errors counted at their bounded loss.
    """

    def known(into: CameraModel) -> dict[str, Any]:
        fixed, priors = plan.known.of(into, plan.shape)
        return {"shape": plan.shape, "fixed": fixed, "priors": priors}

    if len(starts) == 1:
        return fit_next_model(base, starts[0], **known(starts[0]))
    every = min(THINNED, max(1, sum(map(len, base.sightings)) // ENOUGH))
    some = replace(
        base, sightings=tuple(s.only(np.arange(0, len(s), every)) for s in base.sightings)
    )
    jobs = [
        (some, into, known(into), is_conic_first)
        for into, is_conic_first in product(starts, (False, True))
    ]
    found = spread.map(_trial, jobs)
    tried = [fit for fit in found if isinstance(fit, Adjustment)]
    options = [
        own for fit, (_, _, own, _) in zip(found, jobs, strict=True) if isinstance(fit, Adjustment)
    ]
    if not tried:
        raise next(fit for fit in found if isinstance(fit, OmnimirrorError))
    loss = Loss("cauchy", CAUCHY * min(fit.question.noise_px for fit in tried))
    sums = [loss.sum(np.where(fit.seen[:, None], fit.residuals, UNSEEN_PX)) for fit in tried]
    number = int(np.argmin(sums))
    best = tried[number]
    placed = [s.moved(b.motion) for s, b in zip(base.sightings, best.sightings, strict=True)]
    best = best.again(placed, loss="cauchy", settled=ROUGH_TOLERANCE)
    return adjust(
        best.model,
        best.sightings,
        **options[number] | {"shape": best.shape},
        loss="cauchy",
        settled=ROUGH_TOLERANCE,
    )


def _trial(
    some: Adjustment, into: CameraModel, known: dict[str, Any], is_conic_first: bool
) -> Adjustment | OmnimirrorError:
    """Return the fit after some steps from an initial value, or the error."""
    try:
        return _some_steps(some, into, known, is_conic_first)
    except OmnimirrorError as e:
        return e


def _some_steps(
    some: Adjustment, into: CameraModel, known: dict[str, Any], is_conic_first: bool
) -> Adjustment:
    """Return the fit after some steps, with aspheric terms free at once or after the conic.

    With its axis free from the start, an unknown mirror may converge to an implausible shape; with
    free aspheric terms, these may compensate for a conic of the wrong size.
    """
    terms = (
        tuple(p.name for p in into.parameters if p.name.startswith(TERMS)) if is_conic_first else ()
    )
    fit = fit_next_model(
        some, into, **known | {"fixed": (*known["fixed"], *AXIS, *terms)}, most_steps=TRIAL_STEPS
    )
    if not terms:
        return fit
    freed = known | {"fixed": (*known["fixed"], *AXIS), "shape": fit.shape}
    return adjust(
        fit.model,
        fit.sightings,
        **freed,
        loss="cauchy",
        settled=ROUGH_TOLERANCE,
        most_steps=TRIAL_STEPS,
    )


def _order(wanted: str | CameraModel) -> int:
    kinds = list(KINDS)
    return kinds.index(wanted) if isinstance(wanted, str) and wanted in kinds else len(kinds)


def _without_strangers(fit: Adjustment, course: FitState) -> Adjustment:
    """Return the fit without images that even the best model does not explain."""
    found = inconsistent_images(fit)
    if not found:
        return fit
    course.strangers |= found
    return fit.again([s for s in fit.sightings if s.name not in found], loss="cauchy")


def _agreeing(
    robust: Adjustment, fits: dict[str, Adjustment], plan: CalibrationPlan, course: FitState
) -> Adjustment:
    """Return the fit without outliers, of images with a consistent mirror centre.

    Inconsistent images are recorded in ``course.strangers``.
    """
    fit, course.outliers = without_outliers(robust)
    odd: dict[str, str] = {}
    if plan.is_mirrored_alike:  # the model with fewer parameters is more sensitive
        odd = flipped_pictures(fit) or flipped_pictures(
            _frozen(fits.get(Unified.KIND, fit), fit, course)
        )
    odd = odd or check_mount_stability(fit)
    if odd:
        course.strangers |= odd
        fit, course.outliers = without_outliers(
            robust.again([s for s in robust.sightings if s.name not in odd], loss="cauchy")
        )
        if more := check_mount_stability(fit):
            raise InvalidParameter(f"{joined_names([*odd, *more])}: {reason(SEVERAL, fit)}")
    return fit


def _reference_fit(fits: dict[str, Adjustment]) -> Adjustment:
    """Return the reference fit for outliers: the smallest noise among well-determined models."""
    sound = [fit for fit in fits.values() if fit.unknowns <= FREEDOM * fit.residuals.size]
    return (
        min(sound, key=lambda fit: fit.question.noise_px)
        if sound
        else min(fits.values(), key=lambda f: f.unknowns)
    )


def _frozen(fit: Adjustment, judge: Adjustment, course: FitState) -> Adjustment:
    """Return the least-squares fit of a model to the remaining corners."""
    names = {s.name for s in judge.sightings}
    kept = without_rejected(tuple(s for s in fit.sightings if s.name in names), course.outliers)
    is_far = fit.question.noise_px > FAR * judge.question.noise_px
    return fit.again(
        kept, settled=ROUGH_TOLERANCE if is_far else RELATIVE_TOLERANCE, edges=course.edges
    )
