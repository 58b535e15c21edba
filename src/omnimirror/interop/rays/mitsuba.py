"""Mitsuba 3: a sensor plugin in Python that takes its rays from the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...escaping import python_string
from ..formats import Code, Deviation, ProgramFormat, filled, write_script
from .table import RayTable, deviation_between


def _write(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    script, rays = paths
    each = np.concatenate([table.origins, table.directions, table.weights[..., None]], axis=-1)
    np.save(rays, each.astype(np.float32))
    width, height = table.image_size
    words = {"rays": Code(python_string(rays.name)), "camera": table.name}
    write_script(script, filled("mitsuba_sensor.py.in", width=width, height=height, step=table.step, **words))
    return "{} x {} rays and the sensor `omnimirror` for scenes in mm".format(*table.size), deviation_between(table)


MITSUBA: ProgramFormat[RayTable] = ProgramFormat(_write, (".py", ".npy"), "Mitsuba 3")
