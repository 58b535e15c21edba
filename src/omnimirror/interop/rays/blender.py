"""Blender Cycles: custom camera in OSL that reads the ray table, and the script that sets it up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...escaping import c_string, python_string
from ...media.pictures.exr import write_exr
from ..formats import Code, Deviation, ProgramFormat, filled, write_script
from .table import RayTable, deviation_between, in_axes

AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Axes of a Cycles camera in the world frame: x right, y up, z along the optical axis."""


def _write(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    script, shader, origin, direction = paths
    origins, directions = in_axes(table, AXES)
    write_exr(origin, np.concatenate([1e-3 * origins, table.weights[..., None]], axis=-1).astype(np.float32))
    write_exr(direction, np.concatenate([directions, table.has_ray[..., None]], axis=-1).astype(np.float32))
    width, height = table.image_size
    columns, rows = table.size
    places = {"width": width, "height": height, "step": table.step, "columns": columns, "rows": rows}
    for path, literal in ((script, python_string), (shader, c_string)):
        texts = {"shader": shader.name, "origin": origin.name, "direction": direction.name, "name": table.name}
        literals = {key: Code(literal(text)) for key, text in texts.items()}
        write_script(path, filled(f"blender_camera{path.suffix}.in", **places, **literals, camera=table.name))
    return f"{columns} x {rows} rays, an OSL camera for them and the script that sets it up", deviation_between(table)


BLENDER: ProgramFormat[RayTable] = ProgramFormat(
    _write, (".py", ".osl", "-origin.exr", "-direction.exr"), "Blender 4.5 and later, Cycles", ("OpenEXR",)
)
