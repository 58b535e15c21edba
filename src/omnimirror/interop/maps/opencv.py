"""OpenCV's maps, for ``cv2.remap``: of floats, and the fixed-point ones that it is quicker with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..formats import Deviation, ProgramFormat
from .fixed_views import ViewMap

OUTSIDE = -2.0  # px: farther than any kernel of two pixels reaches
FIXED_PX = float(np.hypot(1, 1)) / 64  # halves of the 1/32 px to which places are rounded


def float_maps(view: ViewMap) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """map_x and map_y (h, w)."""
    x, y = (np.ascontiguousarray(view.straighten[..., axis], np.float32) for axis in (0, 1))
    for places in (x, y):
        places[np.isnan(places)] = OUTSIDE
    return x, y


def _named(view: ViewMap) -> dict[str, Any]:
    x, y = float_maps(view)
    places, fractions = cv2.convertMaps(x, y, cv2.CV_16SC2)
    return {"map_x": x, "map_y": y, "fixed_map1": places, "fixed_map2": fractions}


def _write_npz(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    np.savez_compressed(paths[0], **_named(view), source_size=np.array(view.source_size))
    return "{} x {} px".format(*view.size), Deviation(FIXED_PX, "px", "fixed_map1 and 2; map_x and map_y are exact")


def _write_yml(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    storage = cv2.FileStorage(str(paths[0]), cv2.FILE_STORAGE_WRITE)
    for name, values in _named(view).items():
        storage.write(name, values)
    storage.release()
    return "{} x {} px".format(*view.size), Deviation(FIXED_PX, "px", "fixed_map1 and 2; map_x and map_y are exact")


OPENCV: ProgramFormat[ViewMap] = ProgramFormat(_write_npz, (".npz",), "OpenCV in Python")
OPENCV_YML: ProgramFormat[ViewMap] = ProgramFormat(_write_yml, (".yml",), "OpenCV in C++ (cv::FileStorage)")
