"""Accuracy of a calibration: covariance of its parameters, and cross-validation with held-out images.

Cross-validation also selects the camera model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ...base.errors import OmnimirrorError
from ...base.results import Columns, Result
from ...base.typing import Array
from ...base.worker_processes import WorkerPool
from ...cameras.models.camera_model import CameraModel, RadialModel
from ...cameras.models.sphere_models import Unified
from ..sensor_model import SensorModel
from ._bundle_adjustment import (
    BundleAdjustment,
    assembled,
    bundle_adjust,
    reduced_system,
    shared_values,
    with_priors,
)
from .observations import (
    SHAPE_NAMES,
    UNSEEN_PX,
    eliminate_line_positions,
    residuals_at_poses,
    rms_px,
)

# -- Covariance, standard deviations and weakly determined combinations ----------------------------

FREE_ABOVE = 0.02
"""Fraction of the larger image side.

Parameters are free if each may move the image by more than this, but not all of them together.
"""
FOLLOWED_PX = 1.0  # image motion by the weakest combination above which its valley is followed
FOLLOWED_TO = 9.0  # chi-square above that of the estimate at the end of a valley
MAX_FITS = 14  # in each direction of a valley
FIT_STEPS, FIT_SETTLED = 12, 1e-6  # per fit along a valley
GROWTH, SHRINKAGE = 1.6, 0.4  # factors of the step along a valley
OTHER_XIS = (0.5, 0.7, 0.85, 1.0, 1.15, 1.3, 1.5, 1.8)  # initial values for other minima
NEAR_XIS = (-0.1, -0.07, -0.04, 0.04, 0.07, 0.1)
"""Further initial values, relative to the estimate: the minima may be as close and as narrow."""
SAME_XI = 0.02
HELD_STEPS, FREE_STEPS, ROUGHLY = 8, 20, 1e-4  # steps of these fits, xi held and free; tolerance
HOPELESS = 500.0  # chi-square above that of the estimate, with xi held
GRID = 400  # samples of the likelihood along a valley
NAMED_ABOVE = 0.25  # fraction of the largest component of a combination
MIN_EIGENVALUE = 1e-13  # relative to the largest; smaller eigenvalues are rounding errors


class UndeterminedCombination(NamedTuple):
    """Combination of parameters that the images do not determine."""

    names: tuple[str, ...]
    """Parameter names, largest component first."""
    parts: tuple[float, ...]
    """Joint deviations (1 sigma) of the parameters, each in its own unit."""
    sigma_px: float
    """Image motion by the first parameter if the others did not compensate for it."""
    units: tuple[str, ...]

    def __str__(self) -> str:
        """Return the combination in words.

        >>> str(UndeterminedCombination(("lens.focal_length_mm", "xi"), (3.79, -1164.2), 90.0, ("mm", "")))
        'lens.focal_length_mm larger by 3.8 mm with xi smaller by 1200'
        """
        return " with ".join(map(_change_text, self.names, self.parts, self.units))


def _change_text(name: str, part: float, unit: str) -> str:
    """Return the change of a parameter in words, with two digits."""
    size = f"{float(f'{abs(part):.2g}'):g}"
    return f"{name} {'larger' if part > 0 else 'smaller'} by {size} {unit if unit != '1' else ''}".rstrip()


@dataclass(frozen=True)
class ParameterCovariance(Result):
    """Covariance of the parameters.

    Parameters
    ----------
    names
        Names of all shared parameters.
    covariance : (g, g)
        Covariance in parameter units; 0 for fixed parameters.
    free
        Weakly determined combinations.
    sigmas : (g,)
        Standard deviations of single parameters. Along a curved valley they differ from the square
        roots of the diagonal of the covariance, which applies to directions.
    """

    names: tuple[str, ...]
    covariance: Array
    free: tuple[UndeterminedCombination, ...]
    sigmas: Array

    def _table(self) -> Columns:
        return {"name": list(self.names), "sigma": self.sigmas} | {
            name: self.covariance[:, i] for i, name in enumerate(self.names)
        }

    @property
    def correlations(self) -> Array:
        """Correlation matrix (g, g); 0 for fixed parameters."""
        sigmas = np.sqrt(np.diag(self.covariance))
        inverse = np.divide(1.0, sigmas, out=np.zeros_like(sigmas), where=sigmas > 0)
        return np.asarray(self.covariance * inverse[:, None] * inverse)


def uncertainty(adjustment: BundleAdjustment) -> ParameterCovariance:
    """Estimate the covariance and the standard deviations of the parameters.

    The covariance is the inverse of the reduced normal equations, after elimination of the poses,
    times the noise variance. Standard deviations along a weakly determined combination follow from
    its valley.
    """
    names, free = adjustment.names, adjustment.problem.free
    covariance, scales, extents, vectors = _paraboloid(adjustment)
    sigmas = np.sqrt(np.diag(covariance))
    valleys = None
    if len(extents) and extents[0] > FOLLOWED_PX and isinstance(adjustment.model, RadialModel):
        weakest = int(np.flatnonzero(free)[np.argmax(np.abs(vectors[:, 0]))])
        valleys = _valleys(adjustment, weakest, float(sigmas[weakest]))
    if valleys is not None:
        conditional = (
            covariance
            - np.outer(covariance[weakest], covariance[weakest]) / covariance[weakest, weakest]
        )
        sigmas = np.sqrt(np.maximum(np.diag(conditional), 0.0) + np.diag(valleys))
        sizes, axes = np.linalg.eigh(valleys[np.ix_(free, free)] / scales[:, None] / scales)
        extents[0], vectors[:, 0] = np.sqrt(max(sizes[-1], 0.0)), axes[:, -1]
    limit = FREE_ABOVE * max(adjustment.model.image_size)
    free_parameters = [(n, u) for n, u, f in zip(names, adjustment.units, free, strict=True) if f]
    undetermined = [
        _combination(free_parameters, vectors[:, i], scales, float(extents[i]))
        for i in np.flatnonzero(extents > limit)
    ]
    return ParameterCovariance(names, covariance, tuple(undetermined), sigmas)


class _Paraboloid(NamedTuple):
    """Second-order expansion of the sum of squares around an estimate."""

    covariance: Array
    """Covariance (g, g); 0 for fixed parameters."""
    scales: Array
    """Changes (f,) of single free parameters that move the image by 1 px rms."""
    extents: Array
    """Standard deviations (f,) along the axes in these scales, largest first."""
    vectors: Array
    """Axes (f, f) as columns."""


def _paraboloid(adjustment: BundleAdjustment) -> _Paraboloid:
    """Return covariance and axes of the paraboloid that the normal equations describe."""
    problem, free = adjustment.problem, adjustment.problem.free
    linearised = eliminate_line_positions(adjustment.linearised)
    scales = _scales(linearised.d_shared[:, :, free][linearised.visible])
    weights = linearised.visible.astype(float) / adjustment.noise_px**2
    blocks = assembled(
        problem.stack,
        linearised.residuals,
        linearised.d_shared[:, :, free],
        linearised.d_pose,
        weights,
        problem.moving,
    )
    prior = problem.prior(shared_values(adjustment.estimate))
    matrix, _ = reduced_system(with_priors(blocks, prior.information, prior.pull))
    values, vectors = np.linalg.eigh(matrix * scales[:, None] * scales)
    values = np.maximum(values, max(MIN_EIGENVALUE * float(values.max(initial=0.0)), 1e-300))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = (vectors / values) @ vectors.T * scales[:, None] * scales
    return _Paraboloid(covariance, scales, values**-0.5, vectors)


def _valleys(adjustment: BundleAdjustment, number: int, sigma: float) -> Array | None:
    """Return second moments (g, g) of the parameters along valleys of one parameter.

    All other parameters are fitted at values of this parameter on both sides of the estimate. The
    moments are those of the likelihood ``exp(-chi^2 / 2)`` over these fits and over those around
    other minima of similar depth. None if no fit succeeds.
    """
    start = _State(
        0.0,
        shared_values(adjustment.estimate),
        adjustment,
        _chi_square(adjustment, adjustment.noise_px),
    )
    minima = [start, *_other_minima(start, number)]
    min_chi_square = min(s.chi_square for s in minima)
    total, moments = 0.0, np.zeros((len(start.values),) * 2)
    for minimum in minima:
        step = (
            sigma if minimum is start else float(_paraboloid(minimum.fit)[0][number, number]) ** 0.5
        )
        states = [
            *reversed(_follow_valley(minimum, number, -step)),
            minimum,
            *_follow_valley(minimum, number, step),
        ]
        if len(states) < 2:
            continue
        offsets = np.array([s.at for s in states])
        grid = np.linspace(offsets[0], offsets[-1], GRID)
        chi_square = PchipInterpolator(offsets, [s.chi_square for s in states])(grid)
        likelihood = np.exp(-(chi_square - minimum.chi_square) / 2)
        deviations = PchipInterpolator(offsets, [s.values - start.values for s in states])(grid)
        # weights by depth: the noise splits a valley into narrow minima, whose widths mean little
        weight = float(np.exp(-(minimum.chi_square - min_chi_square) / 2))
        moments += (
            weight * np.einsum("t,tg,th->gh", likelihood, deviations, deviations) / likelihood.sum()
        )
        total += weight
    return moments / total if total > 0 else None


def _other_minima(start: _State, number: int) -> list[_State]:
    """Return fits of a unified model at other minima that are not significantly worse.

    With three radial terms, unified cameras with different xi may produce nearly the same image. A
    barrier separates these minima, and no sequence of fits passes it.
    """
    fit = start.fit
    if not isinstance(fit.model, Unified) or "xi" in fit.fixed or "k1" in fit.fixed:
        return []
    minima = [start]
    for xi in (*OTHER_XIS, *(fit.model.xi + offset for offset in NEAR_XIS)):
        focal = fit.model.scale_px * (1 + xi) / (1 + fit.model.xi)
        ratio = focal / fit.model.scale_px
        model = replace(
            fit.model,
            xi=xi,
            focal_px=(fit.model.focal_px[0] * ratio, fit.model.focal_px[1] * ratio),
            uncertainty=None,
        )
        options: dict[str, Any] = {
            "shape": fit.shape,
            "noise_px": fit.noise_px,
            "priors": fit.priors,
        }
        try:
            held = bundle_adjust(
                model,
                fit.observations,
                **options,
                fixed=(*fit.fixed, "xi"),
                max_steps=HELD_STEPS,
                relative_tolerance=ROUGHLY,
            )
            if _chi_square(held, fit.noise_px) > start.chi_square + HOPELESS:
                continue
            options |= {"shape": held.shape, "fixed": fit.fixed, "edges": fit.edges}
            candidate = bundle_adjust(
                held.model,
                held.observations,
                **options,
                max_steps=FREE_STEPS,
                relative_tolerance=ROUGHLY,
            )
            if _is_known(candidate.model, minima):
                continue
            candidate = candidate.refit(
                candidate.observations, noise_px=fit.noise_px, relative_tolerance=FIT_SETTLED
            )
        except OmnimirrorError:
            continue
        state = _State(
            shared_values(candidate.estimate)[number] - start.values[number],
            shared_values(candidate.estimate),
            candidate,
            _chi_square(candidate, fit.noise_px),
        )
        if state.chi_square < start.chi_square + FOLLOWED_TO and not _is_known(
            candidate.model, minima
        ):
            minima.append(state)
    return minima[1:]


def _is_known(model: CameraModel, minima: list[_State]) -> bool:
    """Return whether a unified model belongs to a known minimum."""
    xis = [m.fit.model.xi for m in minima if isinstance(m.fit.model, Unified)]
    return isinstance(model, Unified) and any(abs(model.xi - xi) < SAME_XI for xi in xis)


class _State(NamedTuple):
    """Fit with one parameter held."""

    at: float
    """Offset of the parameter from the estimate."""
    values: Array
    """Values (g,) of all shared parameters."""
    fit: BundleAdjustment
    chi_square: float


def _follow_valley(start: _State, number: int, step: float) -> list[_State]:
    """Return fits along a valley in one direction, up to a limit of chi-square."""
    states = [start]
    for _ in range(MAX_FITS):
        state = _fit_with_fixed(states, number, step, start.fit.noise_px)
        if state is None or state.chi_square > start.chi_square + 2 * FOLLOWED_TO:
            step *= SHRINKAGE
            continue
        states.append(state)
        if state.chi_square > start.chi_square + FOLLOWED_TO:
            break
        step *= GROWTH
    return states[1:]


def _fit_with_fixed(
    states: list[_State], number: int, step: float, noise_px: float
) -> _State | None:
    """Return the fit with a parameter moved by a step, None on failure.

    The initial value is extrapolated linearly from the last two fits.
    """
    last = states[-1]
    count, size = len(last.fit.model.parameters), len(last.values)
    extrapolation = np.zeros(size)
    if len(states) > 1:
        extrapolation = (last.values - states[-2].values) * (step / (last.at - states[-2].at))
    values = last.values + extrapolation
    values[number] = last.values[number] + step
    fit, shape = last.fit, last.fit.shape
    end = count + (len(shape.values) if shape else 0)
    try:
        fixed_fit = bundle_adjust(
            fit.model.with_parameters(values[:count]),
            fit.observations,
            shape=shape.with_values(values[count:end]) if shape else None,
            fixed=(*fit.fixed, fit.names[number]),
            priors=fit.priors,
            edges=fit.edges,
            noise_px=noise_px,
            max_steps=FIT_STEPS,
            relative_tolerance=FIT_SETTLED,
        )
    except OmnimirrorError:
        return None
    return _State(
        last.at + step,
        shared_values(fixed_fit.estimate),
        fixed_fit,
        _chi_square(fixed_fit, noise_px),
    )


def _chi_square(fit: BundleAdjustment, noise_px: float) -> float:
    """Return the sum of squared residuals over the noise variance, including priors."""
    prior = fit.problem.prior(shared_values(fit.estimate)).cost
    penalty = UNSEEN_PX**2 * int((~fit.visible).sum())
    return (
        float(np.sum(eliminate_line_positions(fit.linearised).residuals ** 2)) + penalty
    ) / noise_px**2 + prior


def _scales(derivatives: Array) -> Array:
    """Return changes (g,) of single parameters that move the image by 1 px rms.

    The input are derivatives (n, 2, g).
    """
    size = (
        np.sqrt(np.mean(np.sum(derivatives**2, axis=1), axis=0)) if len(derivatives) else np.ones(0)
    )
    return np.asarray(1 / np.where(size > 0, size, 1.0))


def _combination(
    parameters: list[tuple[str, str]], vector: Array, scales: Array, sigma: float
) -> UndeterminedCombination:
    order = [
        i
        for i in np.argsort(-np.abs(vector))
        if abs(vector[i]) > NAMED_ABOVE * np.abs(vector).max()
    ]
    vector = vector * np.sign(vector[order[0]])
    return UndeterminedCombination(
        tuple(parameters[i][0] for i in order),
        tuple(float(sigma * vector[i] * scales[i]) for i in order),
        sigma,
        tuple(parameters[i][1] for i in order),
    )


# -- Cross-validation with held-out images, and model selection ------------------------------------

MAX_LEAVE_ONE_OUT = (
    20  # maximum number of images for leave-one-out; larger sets are split into groups
)
GROUPS = 10
MAX_STEPS = 12
RELATIVE_TOLERANCE = (
    1e-5  # relative decrease that ends an iteration; fits start at the joint solution
)


class HeldOut(NamedTuple):
    """Cross-validation residuals."""

    rms_px: float
    residuals: Array
    """Residuals (n, 2) px, in the order of the adjustment."""


def folds(count: int, seed: int = 0) -> list[NDArray[np.int64]]:
    """Return the folds of a cross-validation: leave-one-out, or 10 random groups for many images.

    >>> [len(fold) for fold in folds(25)]
    [3, 3, 3, 3, 3, 2, 2, 2, 2, 2]
    """
    if count <= MAX_LEAVE_ONE_OUT:
        return [np.array([i]) for i in range(count)]
    return list(np.array_split(np.random.default_rng(seed).permutation(count), GROUPS))


def held_out(
    adjustment: BundleAdjustment, *, seed: int = 0, pool: WorkerPool | None = None
) -> HeldOut:
    """Compute residuals of held-out images: fit all others, then estimate only the held-out poses.

    Surveyed points are held out in 10 groups and without a new pose, which the others determine.

    Parameters
    ----------
    adjustment
        Fit to all images; initial value of each fit.
    seed
        Random seed of the groups.
    pool
        Worker processes for slow fits.

    Returns
    -------
    HeldOut
        NaN for a single board without surveyed points.
    """
    observations = adjustment.observations
    residuals = np.full(adjustment.residuals.shape, np.nan)
    if len(observations) < 2 and not observations[0].is_surveyed:
        return HeldOut(float("nan"), residuals)
    boards = np.array([i for i, s in enumerate(observations) if not s.is_surveyed], dtype=np.int64)
    jobs = [
        (adjustment, boards[fold]) for fold in (folds(len(boards), seed) if len(boards) else ())
    ]
    is_expensive = isinstance(adjustment.model, SensorModel)
    fold_residuals = (
        pool.starmap(_fold_errors, jobs)
        if pool is not None and is_expensive
        else list(starmap(_fold_errors, jobs))
    )
    for (_, indices), image_residuals in zip(jobs, fold_residuals, strict=True):
        for number, errors in zip(indices, image_residuals, strict=True):
            residuals[adjustment.problem.stack.slices[number]] = errors
    if len(boards) < len(observations):
        _hold_out_points(adjustment, seed, residuals)
    return HeldOut(rms_px(residuals), residuals)


def _fold_errors(adjustment: BundleAdjustment, indices: NDArray[np.int64]) -> list[Array]:
    """Return the residuals (n, 2) of each held-out board, from a fit to all others."""
    observations = adjustment.observations
    others = [s for i, s in enumerate(observations) if i not in indices]
    fit = adjustment.refit(
        others,
        noise_px=adjustment.noise_px,
        max_steps=MAX_STEPS,
        relative_tolerance=RELATIVE_TOLERANCE,
    )
    posed = bundle_adjust(
        fit.model,
        [observations[i] for i in indices],
        shape=fit.shape,
        fixed=fit.names,
        max_steps=MAX_STEPS,
    )
    errors = np.where(posed.visible[:, None], posed.residuals, UNSEEN_PX)
    return [errors[part] for part in posed.problem.stack.slices]


def _hold_out_points(adjustment: BundleAdjustment, seed: int, residuals: Array) -> None:
    """Compute residuals (n, 2) of surveyed points in place, from fits to 90 % of them."""
    random = np.random.default_rng(seed)
    groups = [
        random.permutation(len(s)) % GROUPS if s.is_surveyed else None
        for s in adjustment.observations
    ]
    for group in range(GROUPS):
        parts = [
            (i, np.asarray(point_groups == group))
            for i, point_groups in enumerate(groups)
            if point_groups is not None and (point_groups == group).any()
        ]
        masks = dict(parts)
        others = [
            s.subset(~masks[i]) if i in masks else s for i, s in enumerate(adjustment.observations)
        ]
        fit = adjustment.refit(
            others,
            noise_px=adjustment.noise_px,
            max_steps=MAX_STEPS,
            relative_tolerance=RELATIVE_TOLERANCE,
        )
        held_out_observations = [
            adjustment.observations[i].subset(mask).with_pose(fit.observations[i].pose)
            for i, mask in parts
        ]
        linearised = residuals_at_poses(fit.model, held_out_observations)
        errors = np.where(linearised.visible[:, None], linearised.residuals, UNSEEN_PX)
        rows = [
            np.arange(len(mask))[mask] + adjustment.problem.stack.slices[i].start
            for i, mask in parts
        ]
        residuals[np.concatenate(rows)] = errors


# -- Model selection -------------------------------------------------------------------------------

MIN_GAIN = 0.02  # minimum relative improvement by a richer model


class ModelCandidate(NamedTuple):
    """Candidate of the model selection."""

    kind: str
    parameters: int
    rms_px: float
    held_out_rms_px: float
    why: str
    """Reason for the selection or rejection."""


def select_model(
    fits: Sequence[tuple[BundleAdjustment, HeldOut | None]],
) -> tuple[int, tuple[ModelCandidate, ...]]:
    """Return the index of the selected model and the reason for each decision.

    Among models within 2 % of the smallest held-out error, the mirror model is preferred because it
    is valid at all object distances; otherwise the model with the fewest parameters. Smaller
    differences are not significant in other images.
    """
    errors = [np.inf if validation is None else validation.rms_px for _, validation in fits]
    counts = [_count(fit) for fit, _ in fits]
    min_error = min(errors)
    is_mirror = [fit.model.KIND == SensorModel.KIND for fit, _ in fits]
    equivalent = [i for i, e in enumerate(errors) if e <= (1 + MIN_GAIN) * min_error]
    best = min(equivalent, key=lambda i: (not is_mirror[i], counts[i], errors[i]))
    merit = (
        "and the physical mirror, valid at all distances"
        if is_mirror[best]
        else "with fewer parameters"
    )
    candidates = []
    for i, (fit, validation) in enumerate(fits):
        increase_percent = 100 * (errors[i] / errors[best] - 1)
        if i == best:
            reason = "smallest error in held-out images"
            if errors[i] > min_error:
                reason = f"within {100 * MIN_GAIN:.0f} % of the smallest error in held-out images, {merit}"
        elif validation is None:
            reason = "fit error above the error of another model in held-out images"
        elif increase_percent < 100 * MIN_GAIN:
            disadvantage = (
                "with one viewpoint" if counts[i] < counts[best] else "with more parameters"
            )
            reason = (
                f"no improvement above {100 * MIN_GAIN:.0f} % in held-out images, {disadvantage}"
            )
        elif fit.rms_px < fits[best][0].rms_px:
            reason = f"smaller fit error, but {increase_percent:.0f} % larger error in held-out images: overfitting"
        else:
            reason = f"{increase_percent:.0f} % larger error in held-out images"
        held_out_rms_px = float("nan") if validation is None else validation.rms_px
        candidates.append(
            ModelCandidate(fit.model.KIND, counts[i], fit.rms_px, held_out_rms_px, reason)
        )
    return best, tuple(candidates)


def _count(fit: BundleAdjustment) -> int:
    """Return the number of free parameters of the camera itself."""
    return int(fit.problem.free.sum()) - (len(SHAPE_NAMES) if fit.shape is not None else 0)
