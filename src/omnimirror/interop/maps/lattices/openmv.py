"""A view for MicroPython, as on OpenMV: a small module, and tables that are read a few bytes at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....escaping import python_string
from ...formats import Code, Deviation, ProgramFormat, filled, write_script
from ..fixed_views import ViewMap
from .c99 import c_values, deviation_of


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    script, tables = paths
    values, lattice, rays = c_values(view)
    scale = np.float32(str(values["origin_scale"]).rstrip("f"))
    places = np.rint(lattice.nodes * 2.0 ** int(str(values["bits"]))).astype("<i4")
    floor = np.rint(rays.nodes * np.repeat([scale, 16384.0], 3)).clip(-32768, 32767).astype("<i2")
    seen = np.packbits(_mask(rays.spans, view.source_size[0]), axis=1)
    tables.write_bytes(places.tobytes() + floor.tobytes() + seen.tobytes())
    write_script(
        script,
        filled(
            "openmv_view.py.in", **view.words, tables=tables.name, tables_name=Code(python_string(tables.name)),
            step=lattice.step, columns=lattice.nodes.shape[1], bits=values["bits"], rays_at=places.nbytes,
            floor_step=rays.step, floor_columns=rays.nodes.shape[1], origin_scale=float(scale),
            seen_at=places.nbytes + floor.nbytes, seen_bytes=seen.shape[1],
        ),
    )  # fmt: skip
    size = tables.stat().st_size / 1000
    return f"{view.sizes}, {size:.0f} KB; {values['floor_words']}", deviation_of(lattice)


def _mask(spans: list[list[tuple[int, int]]], width: int) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(rows, width) True in the runs of each row."""
    mask = np.zeros((len(spans), width), bool)
    for row, runs in zip(mask, spans, strict=True):
        for first, count in runs:
            row[first : first + count] = True
    return mask


OPENMV: ProgramFormat[ViewMap] = ProgramFormat(_write, (".py", ".bin"), "MicroPython: OpenMV, ESP32")
