"""ST maps: pictures of places, for compositors (Nuke, Fusion, Natron, Blender) and Meshroom, in both directions.

Red is how far right in the other picture, green how far **up**, both from 0 to 1 between its outer edges: the middle of
its first pixel is half a pixel from 0. Alpha is 1 where there is such a place; elsewhere red and green are -1.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...media.pictures.exr import write_exr
from ..formats import Deviation, ProgramFormat
from .fixed_views import ViewMap

NOWHERE = -1.0


def st_map(places: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float32]:
    """The ST map (h, w, 4), red, green, blue and alpha, of places (h, w, 2) px in a picture of a size.

    >>> st_map(np.array([[[0.0, 0.0], [9.0, 4.0], [np.nan, np.nan]]]), (10, 5)).tolist()
    [[[0.05..., 0.89..., 0.0, 1.0], [0.94..., 0.10..., 0.0, 1.0], [-1.0, -1.0, 0.0, 0.0]]]
    """
    width, height = size
    there = np.isfinite(places).all(axis=-1)
    s, t = (places[..., 0] + 0.5) / width, 1 - (places[..., 1] + 0.5) / height
    channels = [np.where(there, s, NOWHERE), np.where(there, t, NOWHERE), np.zeros_like(s), there]
    return np.stack(channels, axis=-1).astype(np.float32)


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    straighten, bend = paths
    write_exr(straighten, st_map(view.straighten, view.source_size))
    write_exr(bend, st_map(view.bend, view.size))
    return "{} x {} px to straighten, {} x {} px to bend back".format(*view.size, *view.source_size), Deviation()


STMAP: ProgramFormat[ViewMap] = ProgramFormat(
    _write, ("-straighten.exr", "-bend.exr"), "Nuke, Fusion, Natron, Blender, Meshroom", ("OpenEXR",)
)
