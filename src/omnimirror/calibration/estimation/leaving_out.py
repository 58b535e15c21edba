"""Cross-validation: residuals in held-out images."""

from __future__ import annotations

from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ..helpers import Helpers
from ..physical import SensorModel
from .bundle.adjustment import Adjustment, adjust
from .bundle.linearisation import UNSEEN_PX, as_placed
from .bundle.observations import rms_px

EACH_UP_TO = 20  # maximum number of images for leave-one-out; larger sets are split into groups
GROUPS = 10
STEPS = 12
SETTLED = 1e-5  # relative decrease that ends an iteration; fits start at the joint solution


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
    if count <= EACH_UP_TO:
        return [np.array([i]) for i in range(count)]
    return list(np.array_split(np.random.default_rng(seed).permutation(count), GROUPS))


def held_out(adjustment: Adjustment, *, seed: int = 0, spread: Helpers | None = None) -> HeldOut:
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
    jobs = [(adjustment, boards[fold]) for fold in (folds(len(boards), seed) if len(boards) else ())]
    is_dear = isinstance(adjustment.model, SensorModel)
    lost = spread.map(_left_out, jobs) if spread is not None and is_dear else list(starmap(_left_out, jobs))
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
    fit = adjustment.again(others, noise_px=adjustment.noise_px, most_steps=STEPS, settled=SETTLED)
    placed = adjust(fit.model, [sightings[i] for i in out], shape=fit.shape, fixed=fit.names, most_steps=STEPS)
    lost = np.where(placed.seen[:, None], placed.residuals, UNSEEN_PX)
    return [lost[where] for where in placed.question.stack.slices]


def _leave_points_out(adjustment: Adjustment, seed: int, residuals: Array) -> None:
    """Compute residuals (n, 2) of surveyed points in place, from fits to 90 % of them."""
    random = np.random.default_rng(seed)
    groups = [random.permutation(len(s)) % GROUPS if s.is_surveyed else None for s in adjustment.sightings]
    for group in range(GROUPS):
        parts = [(i, np.asarray(of == group)) for i, of in enumerate(groups) if of is not None and (of == group).any()]
        lost = dict(parts)
        others = [s.only(~lost[i]) if i in lost else s for i, s in enumerate(adjustment.sightings)]
        fit = adjustment.again(others, noise_px=adjustment.noise_px, most_steps=STEPS, settled=SETTLED)
        out = [adjustment.sightings[i].only(mask).moved(fit.sightings[i].motion) for i, mask in parts]
        found = as_placed(fit.model, out)
        wrong = np.where(found.seen[:, None], found.residuals, UNSEEN_PX)
        rows = [np.arange(len(mask))[mask] + adjustment.question.stack.slices[i].start for i, mask in parts]
        residuals[np.concatenate(rows)] = wrong
