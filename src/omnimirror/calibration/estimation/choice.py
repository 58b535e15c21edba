"""Model selection by cross-validation among camera models of increasing complexity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..physical import SensorModel
from .bundle.adjustment import Adjustment
from .bundle.board_shape import NAMES
from .leaving_out import HeldOut

GAIN = 0.02  # minimum relative improvement by a richer model


class TriedModel(NamedTuple):
    """Candidate of the model selection."""

    kind: str
    parameters: int
    rms_px: float
    held_out_rms_px: float
    why: str
    """Reason for the selection or rejection."""


def chosen(fits: Sequence[tuple[Adjustment, HeldOut | None]]) -> tuple[int, tuple[TriedModel, ...]]:
    """Return the index of the selected model and the reason for each decision.

    Among models within 2 % of the smallest held-out error, the mirror model is preferred because it
    is valid at all object distances; otherwise the model with the fewest parameters. Smaller
    differences are not significant in other images.
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
    """Return the number of free parameters of the camera itself."""
    return int(fit.question.free.sum()) - (len(NAMES) if fit.shape is not None else 0)
