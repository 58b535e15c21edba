"""Outlier rejection with a limit on the number of rejected corners.

Rejection of all corners that a model does not fit makes any model appear good. Therefore at most
1 % are rejected, one at a time with an adjustment in between, by the best available model; the
set is frozen before models are compared. Gross errors, 3 times beyond the noise limit, do not
depend on the model: up to 5 % are rejected, together if several have similar size. Remaining
corners beyond the noise are reported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bundle.adjustment import MEDIAN_OF_NOISE, Adjustment
from .bundle.linearisation import UNSEEN_PX
from .bundle.observations import Sighting

MOST_REJECTED, MOST_GROSS = 0.01, 0.05  # fraction of all corners
GROSS = 3.0  # multiple of the noise limit
ALIKE = 0.5  # fraction of the largest gross error above which others are rejected together with it
MOST_TAKEN_UP = 0.75  # maximum fraction of the noise absorbed by estimated parameters
DOUBT = 1.44  # two relative standard errors of the Rayleigh median, times sqrt(n)
CHANCE = 0.02  # probability that data without gross errors lose a corner
LEAST_REJECTED_PX = 0.25  # corners with smaller residuals are never rejected
FEWEST_POINTS = 6  # minimum number of corners retained per image


class Outlier(NamedTuple):
    """Rejected corner."""

    picture: str
    corner: int
    residual_px: float


def outlier_limit_px(adjustment: Adjustment) -> float:
    """Return the residual above which a corner is an outlier of normally distributed noise."""
    lengths = np.hypot(*adjustment.residuals[adjustment.seen].T)
    taken_up = 1 - min(adjustment.unknowns / max(2 * len(lengths), 1), MOST_TAKEN_UP)  # noise in parameters
    noise = float(np.median(lengths)) / MEDIAN_OF_NOISE / np.sqrt(taken_up) if len(lengths) else 0.0
    noise *= 1 + DOUBT / np.sqrt(max(len(lengths), 1))
    return max(float(noise) * float(np.sqrt(2 * np.log(max(len(lengths), 2) / CHANCE))), LEAST_REJECTED_PX)


def without_outliers(adjustment: Adjustment, *, most: int | None = None) -> tuple[Adjustment, tuple[Outlier, ...]]:
    """Reject the worst corner and adjust again until none is significant or the limit is reached.

    Parameters
    ----------
    adjustment
        Robust or least-squares fit to all corners.
    most
        Maximum number of rejected corners; by default 1 %, of gross errors 5 %, and at least 1.

    Returns
    -------
    adjustment
        Least-squares fit to the remaining corners.
    outliers
        Rejected corners, worst first.
    """
    count = len(adjustment.residuals)
    left, left_gross = ((max(1, int(s * count)) if most is None else most) for s in (MOST_REJECTED, MOST_GROSS))
    found: list[Outlier] = []
    now = adjustment
    while True:
        lengths = np.where(now.seen, np.hypot(*now.residuals.T), UNSEEN_PX)
        at, limit = _worst(now, lengths), outlier_limit_px(now)
        if at is None or lengths[at] <= limit:
            break
        rejected = np.array([at])
        if lengths[at] > GROSS * limit:
            alike = np.flatnonzero(lengths > max(GROSS * limit, ALIKE * lengths[at]))
            rejected = _spared(now, alike[np.argsort(-lengths[alike])][: left_gross - len(found)])
        if len(found) + len(rejected) > (left_gross if lengths[at] > GROSS * limit else left) or not len(rejected):
            break
        outliers = [_outlier(now, int(i), float(lengths[i])) for i in rejected]
        found += outliers
        now = now.again(
            frozen(now.sightings, tuple(outliers)), loss="cauchy", noise_px=now.question.noise_px, most_steps=2
        )
    kept = now.again(now.sightings)
    return kept, tuple(sorted(found, key=lambda o: -o.residual_px))


def remaining_outliers(adjustment: Adjustment) -> tuple[Outlier, ...]:
    """Return corners of the final fit with residuals beyond the noise, worst first.

    They are outliers beyond the rejection limit, or corners of a board or an image that the model
    does not describe.
    """
    lengths = np.where(adjustment.seen, np.hypot(*adjustment.residuals.T), UNSEEN_PX)
    beyond = np.flatnonzero(lengths > outlier_limit_px(adjustment))
    return tuple(_outlier(adjustment, int(i), float(lengths[i])) for i in beyond[np.argsort(-lengths[beyond])])


def _outlier(adjustment: Adjustment, at: int, length_px: float) -> Outlier:
    """Return a point of an adjustment with its image and number."""
    stack = adjustment.question.stack
    return Outlier(adjustment.sightings[int(stack.owner[at])].name, int(stack.ids[at]), length_px)


def _spared(adjustment: Adjustment, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the points, in order, that can be removed while each image retains the minimum."""
    owner = adjustment.question.stack.owner
    spare = np.bincount(owner) - FEWEST_POINTS
    kept = []
    for point in points:
        spare[owner[point]] -= 1
        if spare[owner[point]] >= 0:
            kept.append(point)
    return np.array(kept, dtype=np.int64)


def _worst(adjustment: Adjustment, lengths: NDArray[np.float64]) -> int | None:
    """Return the point with the largest residual among images that can lose one."""
    counts = np.bincount(adjustment.question.stack.owner)
    spare = counts[adjustment.question.stack.owner] > FEWEST_POINTS
    return int(np.argmax(np.where(spare, lengths, -1.0))) if spare.any() else None


def frozen(sightings: tuple[Sighting, ...], outliers: tuple[Outlier, ...]) -> tuple[Sighting, ...]:
    """Return sightings without the given outliers."""
    named: dict[str, list[int]] = {}
    for outlier in outliers:
        named.setdefault(outlier.picture, []).append(outlier.corner)
    return tuple(
        s.only(~np.isin(s.ids, named[s.name])) if s.name in named and s.ids is not None else s for s in sightings
    )
