"""Ray fields of NVIDIA Newton's cameras (``newton.sensors.SensorCamera``, which takes a ray for each pixel)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats import Deviation, ProgramFormat
from .table import RayTable, in_axes

AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Newton's camera frame in ours: x right, y up, and it looks along -z (as in USD and OpenGL)."""


def _write(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """(rows, columns, 1, 2, 3) float32: one sample a pixel, its origin in metres and its direction."""
    origins, directions = in_axes(table, AXES)
    rays = np.stack([1e-3 * origins, directions * (table.weights > 0)[..., None]], axis=2)[:, :, None]
    np.save(paths[0], rays.astype(np.float32))
    return "{} x {} rays, metres, x right, y up, looking along -z".format(*table.size), Deviation()


NEWTON: ProgramFormat[RayTable] = ProgramFormat(_write, (".npy",), "NVIDIA Newton")
