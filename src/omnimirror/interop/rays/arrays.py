"""Ray tables as NumPy arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..formats import Deviation, ProgramFormat
from .exr import FRAME
from .table import RayTable


def _write(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    np.savez_compressed(
        paths[0],
        origins_mm=table.origins,
        directions=table.directions,
        weights=table.weights,
        image_size_px=np.array(table.image_size),
        step_px=np.array(table.step),
        frame=np.array(FRAME),
        camera=np.array(table.name),
    )
    return "{} x {} rays of 64-bit floats".format(*table.size), Deviation()


NPZ: ProgramFormat[RayTable] = ProgramFormat(_write, (".npz",), "NumPy")
