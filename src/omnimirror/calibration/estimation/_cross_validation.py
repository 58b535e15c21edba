"""Cross-validation with held-out images, and model selection."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from .._worker_processes import WorkerPool
from ..sensor_model import SensorModel
from ._bundle_adjustment import Adjustment, adjust
from ._residuals import SHAPE_NAMES, UNSEEN_PX, as_placed
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


def held_out(adjustment: Adjustment, *, seed: int = 0, spread: WorkerPool | None = None) -> HeldOut:
    """Compute residuals of held-out images: fit all others, then estimate only the held-out poses.

    Surveyed points are held out in 10 groups and without a new pose, which the others determine.

    Parameters
    ----------
    adjustment
        Fit to all images; initial value of each fit.
    seed
        Random seed of the groups.
    spread
        Worker processes for slow fits.

    Returns
    -------
    HeldOut
        NaN for a single board without surveyed points.
    """
    sightings = adjustment.sightings
    residuals = np.full(adjustment.residuals.shape, np.nan)
    if len(sightings) < 2 and not sightings[0].is_surveyed:
        return HeldOut(float("nan"), residuals)
    boards = np.array([i for i, s in enumerate(sightings) if not s.is_surveyed], dtype=np.int64)
    jobs = [
        (adjustment, boards[fold]) for fold in (folds(len(boards), seed) if len(boards) else ())
    ]
    is_dear = isinstance(adjustment.model, SensorModel)
    lost = (
        spread.map(_left_out, jobs)
        if spread is not None and is_dear
        else list(starmap(_left_out, jobs))
    )
    for (_, out), found in zip(jobs, lost, strict=True):
        for number, wrong in zip(out, found, strict=True):
            residuals[adjustment.question.stack.slices[number]] = wrong
    if len(boards) < len(sightings):
        _leave_points_out(adjustment, seed, residuals)
    return HeldOut(rms_px(residuals), residuals)


def _left_out(adjustment: Adjustment, out: NDArray[np.int64]) -> list[Array]:
    """Return the residuals (n, 2) of each held-out board, from a fit to all others."""
    sightings = adjustment.sightings
    others = [s for i, s in enumerate(sightings) if i not in out]
    fit = adjustment.again(
        others, noise_px=adjustment.noise_px, most_steps=MAX_STEPS, settled=RELATIVE_TOLERANCE
    )
    placed = adjust(
        fit.model,
        [sightings[i] for i in out],
        shape=fit.shape,
        fixed=fit.names,
        most_steps=MAX_STEPS,
    )
    lost = np.where(placed.seen[:, None], placed.residuals, UNSEEN_PX)
    return [lost[where] for where in placed.question.stack.slices]


def _leave_points_out(adjustment: Adjustment, seed: int, residuals: Array) -> None:
    """Compute residuals (n, 2) of surveyed points in place, from fits to 90 % of them."""
    random = np.random.default_rng(seed)
    groups = [
        random.permutation(len(s)) % GROUPS if s.is_surveyed else None for s in adjustment.sightings
    ]
    for group in range(GROUPS):
        parts = [
            (i, np.asarray(of == group))
            for i, of in enumerate(groups)
            if of is not None and (of == group).any()
        ]
        lost = dict(parts)
        others = [s.only(~lost[i]) if i in lost else s for i, s in enumerate(adjustment.sightings)]
        fit = adjustment.again(
            others, noise_px=adjustment.noise_px, most_steps=MAX_STEPS, settled=RELATIVE_TOLERANCE
        )
        out = [
            adjustment.sightings[i].only(mask).moved(fit.sightings[i].motion) for i, mask in parts
        ]
        found = as_placed(fit.model, out)
        wrong = np.where(found.seen[:, None], found.residuals, UNSEEN_PX)
        rows = [
            np.arange(len(mask))[mask] + adjustment.question.stack.slices[i].start
            for i, mask in parts
        ]
        residuals[np.concatenate(rows)] = wrong


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
    fits: Sequence[tuple[Adjustment, HeldOut | None]],
) -> tuple[int, tuple[ModelCandidate, ...]]:
    """Return the index of the selected model and the reason for each decision.

    Among models within 2 % of the smallest held-out error, the mirror model is preferred because it
    is valid at all object distances; otherwise the model with the fewest parameters. Smaller
    differences are not significant in other images.
    """
    errors = [np.inf if held is None else held.rms_px for _, held in fits]
    counts = [_count(fit) for fit, _ in fits]
    least = min(errors)
    is_mirror = [fit.model.KIND == SensorModel.KIND for fit, _ in fits]
    alike = [i for i, e in enumerate(errors) if e <= (1 + MIN_GAIN) * least]
    best = min(alike, key=lambda i: (not is_mirror[i], counts[i], errors[i]))
    merit = (
        "and the physical mirror, valid at all distances"
        if is_mirror[best]
        else "with fewer parameters"
    )
    candidates = []
    for i, (fit, held) in enumerate(fits):
        worse = 100 * (errors[i] / errors[best] - 1)
        if i == best:
            why = "smallest error in held-out images"
            if errors[i] > least:
                why = f"within {100 * MIN_GAIN:.0f} % of the smallest error in held-out images, {merit}"
        elif held is None:
            why = "fit error above the error of another model in held-out images"
        elif worse < 100 * MIN_GAIN:
            less = "with one viewpoint" if counts[i] < counts[best] else "with more parameters"
            why = f"no improvement above {100 * MIN_GAIN:.0f} % in held-out images, {less}"
        elif fit.rms_px < fits[best][0].rms_px:
            why = (
                f"smaller fit error, but {worse:.0f} % larger error in held-out images: overfitting"
            )
        else:
            why = f"{worse:.0f} % larger error in held-out images"
        left_out = float("nan") if held is None else held.rms_px
        candidates.append(ModelCandidate(fit.model.KIND, counts[i], fit.rms_px, left_out, why))
    return best, tuple(candidates)


def _count(fit: Adjustment) -> int:
    """Return the number of free parameters of the camera itself."""
    return int(fit.question.free.sum()) - (len(SHAPE_NAMES) if fit.shape is not None else 0)
