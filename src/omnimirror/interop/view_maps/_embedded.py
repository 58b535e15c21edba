"""View maps for microcontrollers: C99 source files and MicroPython modules.

Both contain the map of the view and the rays of the source image as spline grids in fixed-point
numbers, so that images are dewarped and points on the floor are measured without a full map.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.escaping import python_string
from ...base.typing import Array
from ..export_formats import (
    Deviation,
    ExportFormat,
    SourceCode,
    fill_template,
    include_name,
    write_script,
)
from ..ray_tables import ray_table
from ._spline_grid import (
    Runs,
    SplineGrid,
    catmull_rom_weights,
    finest_grid,
    interpolate,
    join_lines,
    run_table,
    spline_grid,
)
from ._view_map import ViewMap, check_16_bit_size

PIXEL_FRACTION_BITS = 15
FIXED_POINT_PX = 0.002
"""Rounding error of the fixed-point interpolation."""
DIRECTION_SCALE = 16384.0
"""Units per 1 of direction components in 16 bits."""
MAX_RAY_NODES = 64
"""Ray nodes along the longer side of the image."""
FLOOR_RADIUS_M = 3.0
"""Distance for which the floor error is reported, with the mirror 1 m above the floor."""


class _Tables(NamedTuple):
    """Grids of a view in fixed-point units."""

    grid: SplineGrid
    rays: SplineGrid
    origin_scale: float
    """Units per mm of ray origins in 16 bits."""
    floor_error_cm: float

    @property
    def grid_units(self) -> Array:
        """(rows, columns, 2) source pixels in 1/2^15 px."""
        units: Array = self.grid.nodes * 2**PIXEL_FRACTION_BITS
        return units

    @property
    def ray_units(self) -> Array:
        """(rows, columns, 6) origins and directions of rays in 16-bit units."""
        scale = np.repeat([self.origin_scale, DIRECTION_SCALE], 3)
        units: Array = (self.rays.nodes * scale).clip(-32768, 32767)
        return units

    @property
    def floor_text(self) -> str:
        return f"floor error {self.floor_error_cm:.2g} cm within {FLOOR_RADIUS_M:g} m at 1 m height"

    @property
    def deviation(self) -> Deviation:
        error = float(np.hypot(*self.grid.error)) + FIXED_POINT_PX
        return Deviation(error, "px", f"interpolation between nodes every {self.grid.step} px")


def _tables(view: ViewMap) -> _Tables:
    check_16_bit_size(view.source_size, "source image")
    check_16_bit_size(view.size, "view")
    rays, floor_error_cm = _ray_grid(view)
    largest_mm = max(1e-3, np.abs(rays.nodes[..., :3]).max())
    scale = float(np.floor(32767 / largest_mm))
    return _Tables(finest_grid(view.dewarp_map), rays, scale, floor_error_cm)


def _ray_grid(view: ViewMap) -> tuple[SplineGrid, float]:
    """Return a grid of ray origins, mm, and directions, and its error on the floor, cm.

    The error is the maximum distance between points on a floor 1 m below the mirror from
    interpolated and traced rays, up to :data:`FLOOR_RADIUS_M`.
    """
    step = 8
    while max(view.source_size) > MAX_RAY_NODES * step:
        step *= 2
    table = ray_table(view.camera)
    rays = np.concatenate([table.origins, table.directions], axis=-1)
    rays[~table.has_ray] = np.nan
    grid = spline_grid(rays, step, table.weights > 0)
    approximate = interpolate(grid.nodes, step)[: rays.shape[0], : rays.shape[1]]
    exact, interpolated = _floor_points(rays), _floor_points(approximate)
    with np.errstate(invalid="ignore"):  # NaN for rays above the horizon
        near = np.linalg.norm(exact, axis=-1) < 1000 * FLOOR_RADIUS_M
    error = np.linalg.norm(interpolated - exact, axis=-1)[near & (table.weights > 0)]
    return grid, float(np.nanmax(error, initial=0.0)) / 10


def _floor_points(rays: Array) -> Array:
    """Intersect rays (h, w, 6) with a floor 1 m below; return (h, w, 2) mm, NaN without hit."""
    with np.errstate(all="ignore"):  # rays parallel to the floor
        reach = (-1000.0 - rays[..., 2]) / rays[..., 5]
        points = rays[..., :2] + reach[..., None] * rays[..., 3:5]
        return np.where((reach > 0)[..., None], points, np.nan)


# -- C99 -----------------------------------------------------------------------------------------


def _write_c99(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    source, header = paths
    tables = _tables(view)
    name = re.sub(r"[^A-Za-z0-9]+", "_", source.stem).strip("_") or "view"
    if name[0].isdigit():
        name = f"v_{name}"
    starts, runs = run_table(tables.grid.runs)
    floor_starts, floor_runs = run_table(tables.rays.runs)
    values = {
        **view.template_values,
        "name": SourceCode(name),
        "guard": SourceCode(name.upper()),
        "header": SourceCode(include_name(header)),
        "step": tables.grid.step,
        "columns": tables.grid.nodes.shape[1],
        "bits": PIXEL_FRACTION_BITS,
        "nodes": join_lines(_integers(tables.grid_units)),
        "starts": join_lines(starts),
        "runs": join_lines(runs),
        "floor_step": tables.rays.step,
        "floor_columns": tables.rays.nodes.shape[1],
        "origin_scale": SourceCode(f"{tables.origin_scale:.1f}f"),
        "rays": join_lines(_integers(tables.ray_units)),
        "floor_starts": join_lines(floor_starts),
        "floor_runs": join_lines(floor_runs),
        "weights": _braced(np.rint(1024 * catmull_rom_weights(tables.grid.step))),
    }
    for path, template in ((source, "view.c.in"), (header, "view.h.in")):
        write_script(path, fill_template(template, **values))
    size = 8 * tables.grid.nodes[..., 0].size + 12 * tables.rays.nodes[..., 0].size
    return f"{view.sizes}, {size / 1000:.0f} KB of tables; {tables.floor_text}", tables.deviation


def _integers(values: Array) -> list[int]:
    """Round all values to integers."""
    integers: list[int] = np.rint(values).astype(int).ravel().tolist()
    return integers


def _braced(values: Array) -> SourceCode:
    """Write rows of integers, each in braces."""
    rows = ("{" + ", ".join(str(int(v)) for v in row) + "}" for row in values)
    return SourceCode(",\n    ".join(rows))


C99: ExportFormat[ViewMap] = ExportFormat(
    _write_c99, (".c", ".h"), "C99: ESP32, OpenMV and other microcontrollers"
)

# -- MicroPython ---------------------------------------------------------------------------------


def _write_openmv(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    script, table_file = paths
    tables = _tables(view)
    scale = np.float32(tables.origin_scale)
    nodes = np.rint(tables.grid_units).astype("<i4")
    rays = np.rint(tables.ray_units).astype("<i2")
    visible = np.packbits(_run_mask(tables.rays.runs, view.source_size[0]), axis=1)
    table_file.write_bytes(nodes.tobytes() + rays.tobytes() + visible.tobytes())
    text = fill_template(
        "openmv_view.py.in",
        **view.template_values,
        table_file=table_file.name,
        table_file_literal=SourceCode(python_string(table_file.name)),
        step=tables.grid.step,
        columns=nodes.shape[1],
        bits=PIXEL_FRACTION_BITS,
        rays_offset=nodes.nbytes,
        floor_step=tables.rays.step,
        floor_columns=rays.shape[1],
        origin_scale=float(scale),
        visible_offset=nodes.nbytes + rays.nbytes,
        visible_row_bytes=visible.shape[1],
    )
    write_script(script, text)
    size = table_file.stat().st_size / 1000
    return f"{view.sizes}, {size:.0f} KB; {tables.floor_text}", tables.deviation


def _run_mask(runs: Runs, width: int) -> NDArray[np.bool_]:
    """Return the mask (rows, width) of runs."""
    mask = np.zeros((len(runs), width), bool)
    for row, row_runs in zip(mask, runs, strict=True):
        for first, count in row_runs:
            row[first : first + count] = True
    return mask


OPENMV: ExportFormat[ViewMap] = ExportFormat(
    _write_openmv, (".py", ".bin"), "MicroPython: OpenMV, ESP32"
)
