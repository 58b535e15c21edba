"""Rejection of corners that no camera explains; rejected corners, and those that remain, are reported.

A rejection of all that a model does not fit makes any model look good. So at most 1 % is rejected, one corner after the
other with an adjustment in between, by the best model there is; the set is frozen before models are compared. Gross
errors, three times farther off than noise explains, are no question of the model: they may be up to 5 %, and are
rejected together where several are about equally large. What remains beyond the noise is reported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bundle.adjustment import MEDIAN_OF_NOISE, Adjustment
from .bundle.linearisation import UNSEEN_PX
from .bundle.observations import Sighting

Mask = NDArray[np.bool_]

MOST_REJECTED, MOST_GROSS = 0.01, 0.05  # of all corners
GROSS = 3.0  # times the limit of what noise explains
ALIKE = 0.5  # of the largest gross error, from which on others are rejected with it
MOST_TAKEN_UP = 0.75  # of the noise by what is estimated
DOUBT = 1.44  # two standard errors of the median of Rayleigh's distribution, relative, times the root of their number
CHANCE = 0.02  # that a set without any gross error loses a corner
LEAST_REJECTED_PX = 0.25  # a corner that is closer is never called wrong
FEWEST_POINTS = 6  # that a picture keeps


class Outlier(NamedTuple):
    """A corner that was left out."""

    picture: str
    corner: int
    residual_px: float


def outlier_limit_px(adjustment: Adjustment) -> float:
    """Residual above which a corner is wrong: beyond what noise, normal in both directions, shows by chance."""
    lengths = np.hypot(*adjustment.residuals[adjustment.seen].T)
    taken_up = 1 - min(adjustment.unknowns / max(2 * len(lengths), 1), MOST_TAKEN_UP)  # what is estimated hides noise
    noise = float(np.median(lengths)) / MEDIAN_OF_NOISE / np.sqrt(taken_up) if len(lengths) else 0.0
    noise *= 1 + DOUBT / np.sqrt(max(len(lengths), 1))
    return max(float(noise) * float(np.sqrt(2 * np.log(max(len(lengths), 2) / CHANCE))), LEAST_REJECTED_PX)


def without_outliers(adjustment: Adjustment, *, most: int | None = None) -> tuple[Adjustment, tuple[Outlier, ...]]:
    """Reject the worst corner and adjust again, until none is beyond chance or 1 % (gross errors: 5 %) is rejected.

    Parameters
    ----------
    adjustment
        Of all corners, robust or not.
    most
        Largest number of rejected corners; by default 1 %, of gross errors 5 %, and at least 1.

    Returns
    -------
    adjustment
        Of the corners that are left, by least squares.
    outliers
        What was rejected, the worst first.
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
    """Return corners that are farther off than noise explains in the final fit, the worst first.

    They are wrong corners beyond the share that is rejected, or corners of a board or an image of which the model is
    wrong.
    """
    lengths = np.where(adjustment.seen, np.hypot(*adjustment.residuals.T), UNSEEN_PX)
    beyond = np.flatnonzero(lengths > outlier_limit_px(adjustment))
    return tuple(_outlier(adjustment, int(i), float(lengths[i])) for i in beyond[np.argsort(-lengths[beyond])])


def _outlier(adjustment: Adjustment, at: int, length_px: float) -> Outlier:
    """Return a point of an adjustment by its picture and number."""
    stack = adjustment.question.stack
    return Outlier(adjustment.sightings[int(stack.owner[at])].name, int(stack.ids[at]), length_px)


def _spared(adjustment: Adjustment, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return those of some points, in their order, that leave every picture enough."""
    owner = adjustment.question.stack.owner
    spare = np.bincount(owner) - FEWEST_POINTS
    kept = []
    for point in points:
        spare[owner[point]] -= 1
        if spare[owner[point]] >= 0:
            kept.append(point)
    return np.array(kept, dtype=np.int64)


def _worst(adjustment: Adjustment, lengths: NDArray[np.float64]) -> int | None:
    """The point farthest off, of pictures that can spare one."""
    counts = np.bincount(adjustment.question.stack.owner)
    spare = counts[adjustment.question.stack.owner] > FEWEST_POINTS
    return int(np.argmax(np.where(spare, lengths, -1.0))) if spare.any() else None


def frozen(sightings: tuple[Sighting, ...], outliers: tuple[Outlier, ...]) -> tuple[Sighting, ...]:
    """Sightings without corners that are named."""
    named: dict[str, list[int]] = {}
    for outlier in outliers:
        named.setdefault(outlier.picture, []).append(outlier.corner)
    return tuple(
        s.only(~np.isin(s.ids, named[s.name])) if s.name in named and s.ids is not None else s for s in sightings
    )
