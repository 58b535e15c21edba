"""Ray tables as OpenEXR pictures: seven channels of 32-bit floats, and a header that says what they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...escaping import visible
from ...media.pictures.exr import write_channels
from ..formats import Deviation, ProgramFormat
from .table import RayTable

FRAME = "x forward, y left, z up; right-handed; origin at the mirror's vertex"


def channels_of(table: RayTable) -> dict[str, NDArray[np.float32]]:
    """Channels (rows, columns) by name: layers of three, and the weight."""
    layers = (("origin", table.origins), ("direction", table.directions))
    named = {f"{layer}.{axis}": values[..., i] for layer, values in layers for i, axis in enumerate("XYZ")}
    named["weight.Y"] = table.weights
    return {name: np.ascontiguousarray(values, np.float32) for name, values in named.items()}


def header_of(table: RayTable) -> dict[str, str | int]:
    """What readers must know of the numbers."""
    width, height = table.image_size
    return {
        "omnimirror:camera": visible(table.name),
        "omnimirror:units": "origin mm, direction of length 1, weight from 0 to 1",
        "omnimirror:frame": FRAME,
        "omnimirror:pixels": "row i, column j: the centre of pixel (j step, i step), whole numbers at pixel centres",
        "omnimirror:step": table.step,
        "omnimirror:imageWidth": width,
        "omnimirror:imageHeight": height,
    }


def _write(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    write_channels(paths[0], channels_of(table), header_of(table))
    return "{} x {} rays of 32-bit floats".format(*table.size), Deviation()


EXR: ProgramFormat[RayTable] = ProgramFormat(_write, (".exr",), "whatever reads OpenEXR", ("OpenEXR",))
