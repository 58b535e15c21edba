"""Cross-validation with held-out images, and model selection."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ...base.worker_processes import WorkerPool
from ..sensor_model import SensorModel
from ._bundle_adjustment import BundleAdjustment, bundle_adjust
from ._residuals import SHAPE_NAMES, UNSEEN_PX, residuals_at_poses
from .observations import rms_px

# -- Held-out residuals ----------------------------------------------------------------------------

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
