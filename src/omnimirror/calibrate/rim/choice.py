"""Which of a picture's rings is the rim, and how sure that is: odds of every ring, and of none of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .cues import Cues, Ring, cues_of

Array = NDArray[np.float64]

FLAT = -4.0  # logarithm of the texture, below which nothing is shown
WEIGHTS = np.array(
    [
        -4.618,
        -13.802,
        37.574,
        6.644,
        2.612,
        -0.735,
        2.376,
        3.336,
        15.435,
        -0.627,
        -8.214,
        0.571,
        3.825,
        -0.427,
        -0.112,
        -0.330,
        -8.023,
        4.366,
        -1.375,
        5.955,
        -7.839,
        -3.630,
    ]
)
NONE = 19.886


def terms(cues: Cues) -> Array:
    """What is weighed (22,): the cues within the ranges that were met, and what bends."""
    ends, near = np.clip([cues.ends, cues.ends_near], -3.0, 3.0)
    return np.array([
        cues.support, cues.support**2, cues.close, cues.close**2, cues.chance, np.clip(cues.step, -2.5, 1.0),
        np.clip(cues.differs, -2.0, 2.0), max(cues.continues, 0.0), cues.seen, cues.radius, cues.radius**2,
        cues.texture, min(cues.texture - FLAT, 0.0), ends, min(ends, 0.0), near, cues.calm_inside, cues.calm_outside,
        cues.framed, cues.frames, cues.within, cues.about,
    ])  # fmt: skip


def odds(rings: Sequence[Ring], short_side: float) -> Array:
    """Logarithms (n,) of the odds of every ring against there being no rim among them."""
    every = list(rings)
    found = [float(terms(cues_of(ring, every, short_side)) @ WEIGHTS) - NONE for ring in every]
    return np.array(found)


def confidence(odds: Array, same: NDArray[np.bool_]) -> float:
    """By how much it is more probable that the rim is one of the rings marked as the same, than the next best answer.

    Probabilities of all rings, and of none of them, add to 1. A difference is small both where another ring is as
    good, and where none is good.
    """
    top = max(float(odds.max(initial=0.0)), 0.0)
    weights = np.exp(odds - top)
    none = float(np.exp(-top))
    rival = max(float(weights[~same].max(initial=0.0)), none)
    return max(0.0, (float(weights[same].sum()) - rival) / (float(weights.sum()) + none))
