"""A view in C99: one file and its header, without a library, that straighten pictures and measure the floor."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...formats import Code, Deviation, ProgramFormat, filled, quotable, write_script
from ...rays.table import ray_table
from ..fixed_views import ViewMap, check_small
from .lattice import MapLattice, finest_lattice, interpolated, lattice_of, listed, spans_of, weights

PLACE_BITS = 15  # of the fraction of a pixel
ROUNDING_PX = 0.002
FLOOR_NODES = 64  # along the longer side of the picture
FLOOR_REACH = 3.0  # heights, to which its error is told


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    source, header = paths
    values, lattice, rays = c_values(view)
    name = re.sub(r"[^A-Za-z0-9]+", "_", source.stem).strip("_") or "view"
    name = f"v_{name}" if name[0].isdigit() else name
    names = {"name": Code(name), "guard": Code(name.upper()), "header": Code(quotable(header))}
    for path, template in ((source, "view.c.in"), (header, "view.h.in")):
        write_script(path, filled(template, **values, **names))
    bytes_ = 8 * lattice.nodes[..., 0].size + 12 * rays.nodes[..., 0].size
    return f"{view.sizes}, {bytes_ / 1000:.0f} KB of tables; {values['floor_words']}", deviation_of(lattice)


def deviation_of(lattice: MapLattice) -> Deviation:
    """What places between nodes cost."""
    size = float(np.hypot(*lattice.error)) + ROUNDING_PX
    return Deviation(size, "px", f"places between nodes every {lattice.step} px")


def c_values(view: ViewMap) -> tuple[dict[str, object], MapLattice, MapLattice]:
    """What the templates are filled with: sizes and tables, as text."""
    check_small(view.source_size, "pictures")
    check_small(view.size, "views")
    lattice, (rays, floor_cm) = finest_lattice(view.straighten), floor_lattice(view)
    origin_scale = float(np.floor(32767 / max(1e-3, np.abs(rays.nodes[..., :3]).max())))
    whole = (rays.nodes * np.repeat([origin_scale, 16384.0], 3)).clip(-32768, 32767)
    starts, runs = spans_of(lattice.spans)
    floor_starts, floor_runs = spans_of(rays.spans)
    return (
        {
            **view.words,
            "step": lattice.step, "columns": lattice.nodes.shape[1], "bits": PLACE_BITS,
            "nodes": listed(flat(lattice.nodes * 2**PLACE_BITS)), "starts": listed(starts), "runs": listed(runs),
            "floor_step": rays.step, "floor_columns": rays.nodes.shape[1], "origin_scale": Code(f"{origin_scale:.1f}f"),
            "rays": listed(flat(whole)), "floor_starts": listed(floor_starts), "floor_runs": listed(floor_runs),
            "weights": braced(np.rint(1024 * weights(lattice.step))),
            "floor_words": f"floor within {floor_cm:.2g} cm at 1 m height, as far as {FLOOR_REACH:g} m",
        },
        lattice,
        rays,
    )  # fmt: skip


def floor_lattice(view: ViewMap) -> tuple[MapLattice, float]:
    """Nodes (rows, columns, 6) of the camera's rays, origins in mm and directions, and what they cost on a floor, cm.

    That is the largest error of points on a floor 1 m below, no farther than :data:`FLOOR_REACH` m.
    """
    step = 8
    while max(view.source_size) > FLOOR_NODES * step:
        step *= 2
    table = ray_table(view.camera)
    rays = np.concatenate([table.origins, table.directions], axis=-1)
    rays[~table.has_ray] = np.nan
    lattice = lattice_of(rays, step, table.weights > 0)
    near = interpolated(lattice.nodes, step)[: rays.shape[0], : rays.shape[1]]
    exact, found = (_on_floor(each) for each in (rays, near))
    with np.errstate(invalid="ignore"):
        counts = (table.weights > 0) & (np.linalg.norm(exact, axis=-1) < 1000 * FLOOR_REACH)
    off = np.linalg.norm(found - exact, axis=-1)[counts]
    return lattice, float(np.nanmax(off, initial=0.0)) / 10


def _on_floor(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (h, w, 2), mm, at which rays (h, w, 6) meet a floor 1 m below; NaN where they do not."""
    with np.errstate(all="ignore"):
        far = (-1000.0 - rays[..., 2]) / rays[..., 5]
        return np.where((far > 0)[..., None], rays[..., :2] + far[..., None] * rays[..., 3:5], np.nan)


def flat(values: NDArray[np.float64]) -> list[int]:
    """The whole numbers next to all values."""
    numbers: list[int] = np.rint(values).astype(int).ravel().tolist()
    return numbers


def braced(values: NDArray[np.float64]) -> Code:
    """Write rows of whole numbers, each in braces."""
    return Code(",\n    ".join("{" + ", ".join(str(int(v)) for v in row) + "}" for row in values))


C99: ProgramFormat[ViewMap] = ProgramFormat(_write, (".c", ".h"), "C99: ESP32, OpenMV, any microcontroller")
