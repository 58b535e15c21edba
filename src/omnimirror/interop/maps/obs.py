"""OBS Studio: an effect for its shader filter, which takes the map as a picture of 8 bits a channel.

Each place is a number of three bytes, red the highest, in 1/256 px: u in the left half of the picture, v at right.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...escaping import c_string
from ...media import write_image
from ..formats import Code, Deviation, ProgramFormat, filled, write_script
from .fixed_views import ViewMap, check_small
from .shaders import CARD_PX

STEPS_PER_PX = 256
BEFORE_PX = 1  # that places may lie before the picture; its number 0 is nowhere
ROUNDING_PX = float(np.hypot(1, 1)) / (2 * STEPS_PER_PX)


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    effect, table = paths
    check_small(view.source_size, "pictures")
    write_image(table, coded(view.straighten))
    write_script(effect, filled("view.effect.in", table=Code(c_string(table.name)), **view.words))
    why = "graphics cards know 256 places between pixels, and so does the table"
    return f"{view.sizes}, and a picture of its map", Deviation(ROUNDING_PX + CARD_PX, "px", why)


def coded(places: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The picture (h, 2 w, 3) of places (h, w, 2) px.

    >>> coded(np.array([[[0.0, 300.5], [np.nan, np.nan]]]))[0].tolist()
    [[0, 1, 0], [0, 0, 0], [1, 45, 128], [0, 0, 0]]
    """
    there = np.isfinite(places).all(axis=-1, keepdims=True)
    whole = np.rint((np.where(there, places, 0.0) + BEFORE_PX) * STEPS_PER_PX).astype(np.uint32) * there
    digits = np.stack([whole >> 16, whole >> 8 & 255, whole & 255], axis=-1).astype(np.uint8)
    return np.concatenate([digits[:, :, 0], digits[:, :, 1]], axis=1)


OBS: ProgramFormat[ViewMap] = ProgramFormat(_write, (".effect", "-places.png"), "OBS Studio's filter obs-shaderfilter")
