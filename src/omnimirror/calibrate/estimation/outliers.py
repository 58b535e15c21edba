"""Corners that no camera explains, rejected one by one and named.

Whoever rejects as much as a model dislikes makes any model look good. So few are rejected (1 % at most), each after the
others were forgotten and all was adjusted again, by the best model there is; the set is frozen before models are
compared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bundle.adjustment import MEDIAN_OF_NOISE, Adjustment
from .bundle.linearisation import UNSEEN_PX
from .bundle.observations import Sighting

Mask = NDArray[np.bool_]

MOST_REJECTED = 0.01
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
    """Reject the worst corner, adjust again, and so on, until none is beyond chance or 1 % are gone.

    Parameters
    ----------
    adjustment
        Of all corners, robust or not.
    most
        Corners that may be rejected; 1 % by default, and one of few.

    Returns
    -------
    adjustment
        Of the corners that are left, by least squares.
    outliers
        What was rejected, the worst first.
    """
    count = len(adjustment.residuals)
    left = max(1, int(MOST_REJECTED * count)) if most is None else most
    found: list[Outlier] = []
    now = adjustment
    while True:
        lengths = np.where(now.seen, np.hypot(*now.residuals.T), UNSEEN_PX)
        at = _worst(now, lengths)
        if at is None or len(found) >= left or lengths[at] <= outlier_limit_px(now):
            break
        number = int(now.question.stack.owner[at])
        found.append(Outlier(now.sightings[number].name, int(now.question.stack.ids[at]), float(lengths[at])))
        start = now.question.stack.slices[number].start
        now = now.again(
            without_points(now.sightings, number, at - start), loss="cauchy", noise_px=now.question.noise_px,
            most_steps=2,
        )  # fmt: skip
    kept = now.again(now.sightings)
    return kept, tuple(sorted(found, key=lambda o: -o.residual_px))


def without_points(sightings: tuple[Sighting, ...], number: int, at: int) -> tuple[Sighting, ...]:
    """Sightings of which one has lost a point."""
    kept = np.arange(len(sightings[number])) != at
    return tuple(s.only(kept) if i == number else s for i, s in enumerate(sightings))


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
