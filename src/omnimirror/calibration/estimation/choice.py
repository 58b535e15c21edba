"""Models to choose from, simple ones first, and the choice by error in pictures that were held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..physical import SensorModel
from .bundle.adjustment import Adjustment
from .bundle.board_shape import NAMES
from .leaving_out import HeldOut

GAIN = 0.02  # relative; a richer model has to be better by more


class TriedModel(NamedTuple):
    """A model that was tried."""

    kind: str
    parameters: int
    rms_px: float
    held_out_rms_px: float
    why: str
    """why it was chosen, or was not"""


def chosen(fits: Sequence[tuple[Adjustment, HeldOut | None]]) -> tuple[int, tuple[TriedModel, ...]]:
    """The number of the model with the least held-out error, and why each was chosen or not.

    Of those that are no more than 2 % worse than the best the mirror itself is taken, which is right at all distances;
    else the simplest: less does not show in other pictures.
    """
    errors = [np.inf if held is None else held.rms_px for _, held in fits]
    counts = [_count(fit) for fit, _ in fits]
    least = min(errors)
    is_mirror = [fit.model.KIND == SensorModel.KIND for fit, _ in fits]
    alike = [i for i, e in enumerate(errors) if e <= (1 + GAIN) * least]
    best = min(alike, key=lambda i: (not is_mirror[i], counts[i], errors[i]))
    merit = "and the mirror itself, right at all distances" if is_mirror[best] else "with fewer parameters"
    candidates = []
    for i, (fit, held) in enumerate(fits):
        worse = 100 * (errors[i] / errors[best] - 1)
        if i == best:
            why = "least error in pictures left out"
            if errors[i] > least:
                why = f"within {100 * GAIN:.0f} % of the least error in pictures left out, {merit}"
        elif held is None:
            why = "the fit alone is worse than that of another model in pictures left out"
        elif worse < 100 * GAIN:
            less = "with one viewpoint" if counts[i] < counts[best] else "with more parameters"
            why = f"no better by more than {100 * GAIN:.0f} % in pictures left out, {less}"
        elif fit.rms_px < fits[best][0].rms_px:
            why = f"fits better and predicts {worse:.0f} % worse: it follows the noise"
        else:
            why = f"{worse:.0f} % more error in pictures left out"
        left_out = float("nan") if held is None else held.rms_px
        candidates.append(TriedModel(fit.model.KIND, counts[i], fit.rms_px, left_out, why))
    return best, tuple(candidates)


def _count(fit: Adjustment) -> int:
    """Free parameters of the camera itself."""
    return int(fit.question.free.sum()) - (len(NAMES) if fit.shape is not None else 0)
