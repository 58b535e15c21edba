"""NVIDIA VPI's dense warp maps: what a ``vpi.WarpMap`` of the view's size holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats import Deviation, ProgramFormat
from .fixed_views import ViewMap
from .opencv import OUTSIDE


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """(height, width, 2) float32: x and y in the picture, whole numbers at pixel centres."""
    np.save(paths[0], np.nan_to_num(view.straighten, nan=OUTSIDE).astype(np.float32))
    return "{} x {} control points, one for each pixel".format(*view.size), Deviation()


VPI: ProgramFormat[ViewMap] = ProgramFormat(_write, (".npy",), "NVIDIA VPI, and whatever takes (h, w, 2) arrays")
