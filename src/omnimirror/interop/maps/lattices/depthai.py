"""A mesh for DepthAI's ``Warp``: where in the picture every sixteenth pixel of a view lies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidParameter
from ...formats import Deviation, ProgramFormat
from ..fixed_views import ViewMap
from .lattice import lattice_of

CELL = 16  # px; and what the widths must be multiples of
FARTHEST_PX = 8  # that a mesh may be off: more is a step


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Points (x, y) row by row; the last of each lie at the far edge of the view."""
    (width, height), (source_width, _) = view.size, view.source_size
    if width % CELL or height % CELL:
        raise InvalidParameter(
            f"a view of {width} x {height} px has no mesh; valid are sides that are multiples of {CELL}"
        )
    if source_width % CELL:
        raise InvalidParameter(f"DepthAI warps pictures whose width is a multiple of {CELL} px; {source_width} is none")
    mesh = lattice_of(view.straighten, CELL).nodes[1:-1, 1:-1]
    off = float(np.nanmax(np.linalg.norm(between(mesh) - view.straighten, axis=-1)))
    if off > FARTHEST_PX:
        raise InvalidParameter(
            f"straight lines between points every {CELL} px miss this view by {off:.0f} px; valid are single views of "
            "about the picture's resolution"
        )
    rows, columns = mesh.shape[:2]
    content = {
        "size": view.size, "source_size": view.source_size, "mesh_width": columns, "mesh_height": rows,
        "points": mesh.reshape(-1, 2).round(3).tolist(),
    }  # fmt: skip
    paths[0].write_text(json.dumps(content), encoding="utf-8")
    return f"{columns} x {rows} points", Deviation(off, "px", f"straight lines between points every {CELL} px")


def between(mesh: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (h, w, 2) of all pixels, on straight lines between the points of a mesh (rows, columns, 2)."""
    for axis in (0, 1):
        at, part = np.divmod(np.arange((mesh.shape[axis] - 1) * CELL), CELL)
        share = (part / CELL).reshape(-1, 1, 1) if axis == 0 else (part / CELL).reshape(1, -1, 1)
        mesh = (1 - share) * mesh.take(at, axis) + share * mesh.take(at + 1, axis)
    return mesh


DEPTHAI: ProgramFormat[ViewMap] = ProgramFormat(_write, (".json",), "DepthAI's Warp, on Luxonis' cameras")
