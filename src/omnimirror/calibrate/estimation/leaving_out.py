"""Error in pictures that a model was not fitted to: what tells a good model from a flexible one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bundle.adjustment import Adjustment, adjust
from .bundle.linearisation import UNSEEN_PX
from .bundle.observations import rms_px

Array = NDArray[np.float64]

EACH_UP_TO = 20  # pictures that are left out one by one; more are left out in groups
GROUPS = 10
STEPS = 12
SETTLED = 1e-5  # share of the sum below which a step is the last: each fit begins where all pictures agree


class HeldOut(NamedTuple):
    """Residuals of pictures in fits that did not see them."""

    rms_px: float
    residuals: Array
    """(n, 2) px, in the order of the adjustment's"""


def folds(count: int, seed: int = 0) -> list[NDArray[np.int64]]:
    """Which pictures are left out together: each alone, or ten groups by chance where there are many.

    >>> [len(fold) for fold in folds(25)]
    [3, 3, 3, 3, 3, 2, 2, 2, 2, 2]
    """
    if count <= EACH_UP_TO:
        return [np.array([i]) for i in range(count)]
    return list(np.array_split(np.random.default_rng(seed).permutation(count), GROUPS))


def held_out(adjustment: Adjustment, *, seed: int = 0) -> HeldOut:
    """Leave pictures out, fit all others, then place the boards of those left out and nothing else.

    Parameters
    ----------
    adjustment
        Of all pictures; each fit begins there.
    seed
        Of the groups of many pictures.

    Returns
    -------
    HeldOut
        NaN with fewer than two pictures.
    """
    sightings = adjustment.sightings
    residuals = np.full(adjustment.residuals.shape, np.nan)
    if len(sightings) < 2:
        return HeldOut(float("nan"), residuals)
    for out in folds(len(sightings), seed):
        others = [s for i, s in enumerate(sightings) if i not in out]
        fit = adjustment.again(others, noise_px=adjustment.noise_px, most_steps=STEPS, settled=SETTLED)
        placed = adjust(fit.model, [sightings[i] for i in out], shape=fit.shape, fixed=fit.names, most_steps=STEPS)
        lost = np.where(placed.seen[:, None], placed.residuals, UNSEEN_PX)
        for number, where in zip(out, placed.question.stack.slices, strict=True):
            residuals[adjustment.question.stack.slices[number]] = lost[where]
    return HeldOut(rms_px(residuals), residuals)
