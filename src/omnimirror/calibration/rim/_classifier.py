"""Selection of the rim among the rings of an image: log odds of each ring against no rim."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ..edge_detection import WorkingImage
from ._features import Ring, RingFeatures, relations, ring_features, surrounding_statistics

CLASSIFIER_FILE = Path(__file__).with_name("rim_classifier.json")
SHORT = 16  # rings on the short list
UNLISTED = -12.0  # log odds of the other rings
MAX_SCORE = 3.0  # clipping of features in standard deviations; there are no training data beyond
FLAT = -4.0  # logarithm of the texture below which there is no structure
FIRST_WEIGHTS = np.array([
    -4.618, -13.802, 37.574, 6.644, 2.612, -0.735, 2.376, 3.336, 15.435, -0.627, -8.214, 0.571, 3.825, -0.427,
    -0.112, -0.330, -8.023, 4.366, -1.375, 5.955, -7.839, -3.630,
])  # fmt: skip
FIRST_NONE = 19.886
SAME_RANK, MIN_MARGIN, MIN_ODDS = (-2.0, 0.4), (1.55, 0.04), (-1.85, 0.2)  # centres and widths
PARALLEL_WEIGHT, USUAL_PARALLEL, MAX_PARALLEL = (
    30.0,
    0.1,
    0.2,
)  # weight, typical value and maximum of the parallel fraction
FAINT_RING, CLEAR_RING, HOUSING_COST = 0.6, 0.75, 6.0  # fractions of an inner ring, and log odds
FIRST = -2  # index of the first classifier's result among the features


@dataclass(frozen=True)
class LogisticMember:
    """Member of the ensemble: a linear term and a small hidden layer."""

    linear: Array
    bias: float
    hidden: Array
    shift: Array
    out: Array

    def odds(self, features: Array) -> Array:
        """Return log odds (n,) for features (n, count)."""
        log_odds: Array = (
            features @ self.linear
            + self.bias
            + np.tanh(features @ self.hidden + self.shift) @ self.out
        )
        return log_odds


@dataclass(frozen=True)
class RimClassifier:
    """Ensemble of classifiers with the scaling of their features."""

    middle: Array
    spread: Array
    members: tuple[LogisticMember, ...]
    trust: float
    """Factor of their mean log odds, calibrated on other images."""
    first_share: float
    """Factor of the first classifier's log odds.

    It is trained on fewer types of images and more robust outside them.
    """

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RimClassifier:
        """Create from the contents of the weights file."""
        members = [
            LogisticMember(
                *(np.array(member[name]) for name in ("linear", "bias", "hidden", "shift", "out"))  # type: ignore[arg-type]  # the last one is a number
            )
            for member in content["members"]
        ]
        trust, first_share = float(content["trust"]), float(content["first_share"])
        return cls(
            np.array(content["middle"]),
            np.array(content["spread"]),
            tuple(members),
            trust,
            first_share,
        )

    def scaled(self, rows: Array) -> Array:
        """Return features (n, count) as standard scores; 0 for unknown values."""
        scores: Array = np.clip(
            np.nan_to_num((rows - self.middle) / self.spread), -MAX_SCORE, MAX_SCORE
        )
        return scores

    def decision(self, rows: Array) -> Array:
        """Return the log odds (members, n) of each member for features (n, count)."""
        features = self.scaled(rows)
        return np.stack([member.odds(features) for member in self.members])

    def odds(self, rows: Array) -> Array:
        """Return log odds (members, n) against no rim for features (n, count).

        The result of the first classifier is included.
        """
        return self.trust * self.decision(rows) + self.first_share * np.maximum(
            rows[:, FIRST], UNLISTED
        )


@cache
def rim_classifier() -> RimClassifier:
    """Return the ensemble included in the package."""
    return RimClassifier.from_json(json.loads(CLASSIFIER_FILE.read_text()))


def odds(rings: Sequence[Ring], working: WorkingImage) -> Array:
    """Return log odds (members, n) of each ring against no rim, for each ensemble member."""
    log_odds = np.full((len(rim_classifier().members), len(rings)), UNLISTED)
    if len(rings):
        listed, rows = listed_rows(list(rings), working)
        log_odds[:, listed] = np.maximum(rim_classifier().odds(rows), UNLISTED)
    return log_odds


def listed_rows(rings: list[Ring], working: WorkingImage) -> tuple[NDArray[np.intp], Array]:
    """Return the rings on the short list, best first, with their features."""
    size = working.size
    first = np.array([terms(cues) for cues in ring_features(rings, min(size))])
    log_odds = first @ FIRST_WEIGHTS - FIRST_NONE
    listed = np.argsort(-log_odds, kind="stable")[:SHORT]
    rows = []
    for i in listed:
        ellipse = rings[i].ellipse
        centre_offset = np.hypot(*np.subtract(ellipse.centre, np.divide(size, 2))) / min(size)
        position = [centre_offset, 10 * np.hypot(*ellipse.stretch), 2 * ellipse.radius / size[0]]
        rows.append(np.concatenate([first[i], surrounding_statistics(working, ellipse), position]))
    initial_results = np.stack([log_odds[listed], log_odds[listed] - log_odds.max()], axis=1)
    return listed, np.hstack(
        [np.array(rows), relations(rings, [int(i) for i in listed]), initial_results]
    )


def terms(features: RingFeatures) -> Array:
    """Return the features (22,) of the first classifier: clipped cues and nonlinear terms."""
    texture_ratio, texture_ratio_near = np.clip([features.ends, features.ends_near], -3.0, 3.0)
    return np.array(
        [
            features.support,
            features.support**2,
            features.close,
            features.close**2,
            features.chance,
            np.clip(features.step, -2.5, 1.0),
            np.clip(features.differs, -2.0, 2.0),
            max(features.continues, 0.0),
            features.visible,
            features.radius,
            features.radius**2,
            features.texture,
            min(features.texture - FLAT, 0.0),
            texture_ratio,
            min(texture_ratio, 0.0),
            texture_ratio_near,
            features.calm_inside,
            features.calm_outside,
            features.framed,
            features.frames,
            features.within,
            features.about,
        ]
    )


def confidence(
    odds: Array, rivals: Array, chance: float, within: float = 0.0, *, evidence: float = 1.0
) -> float:
    """Return the confidence that a ring is the mirror's outline.

    It is based on the agreement between working resolutions.

    It is the product of three factors between 0 and 1:

    - Agreement: the number of resolutions at which the ring is best, from its margin over the best
      other ring. Two of three resolutions give 1/3.
    - The mean margin over the best other ring.
    - The mean log odds against no mirror. A mirror compresses its surroundings towards its outline,
      which produces edges parallel to it; a uniform plate or lamp has none. These edges also count,
      unless there is a clear concentric ring inside: that ring may be the mirror, and this one its
      housing.

    Parameters
    ----------
    odds, rivals : (resolutions,)
        Log odds of the ring at each resolution, and of the best other ring.
    chance
        Fraction of the circumference with parallel edges near the ring.
    within
        Fraction of the circumference with edges of the clearest concentric inner ring.
    evidence
        Factor of the odds: for several images of one sensor the square root of their number.
    """
    margin = odds - rivals
    agreement = float(np.mean(_share(margin, SAME_RANK)))
    parallel = PARALLEL_WEIGHT * (min(chance, MAX_PARALLEL) - USUAL_PARALLEL)
    housing = min(max((within - FAINT_RING) / (CLEAR_RING - FAINT_RING), 0.0), 1.0)
    mirror = evidence * float(np.mean(odds)) + (1 - housing) * parallel - housing * HOUSING_COST
    ranked = float(_share(np.float64(np.mean(margin)), MIN_MARGIN))
    return max(0.0, 2 * agreement - 1) * ranked * float(_share(np.float64(mirror), MIN_ODDS))


def _share(values: Array | np.float64, middle: tuple[float, float]) -> Array:
    """Return the logistic function with a centre and a width."""
    return np.asarray(1 / (1 + np.exp(-np.clip((values - middle[0]) / middle[1], -50, 50))))
