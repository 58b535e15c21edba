"""ffmpeg's ``remap`` filter: two PGM pictures of whole pixels, since it takes the nearest one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats import Deviation, ProgramFormat
from .fixed_views import ViewMap, check_small

NOWHERE = 65535  # beyond the picture, which ffmpeg fills with its colour `fill`


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    check_small(view.source_size, "pictures")
    places = view.straighten
    there = np.asarray(np.isfinite(places).all(axis=-1))
    last = np.array(view.source_size) - 1
    with np.errstate(invalid="ignore"):
        whole = np.where(there[..., None], np.clip(np.rint(places), 0, last), NOWHERE)
    for path, values in zip(paths, np.moveaxis(whole, -1, 0), strict=True):
        path.write_bytes(b"P5\n%d %d\n65535\n" % view.size + values.astype(">u2").tobytes())
    off = np.linalg.norm((whole - places)[there], axis=-1)
    return "{} x {} px".format(*view.size), Deviation(float(off.max()), "px", "it takes the nearest pixel")


FFMPEG: ProgramFormat[ViewMap] = ProgramFormat(_write, ("-x.pgm", "-y.pgm"), "ffmpeg's remap filter")
