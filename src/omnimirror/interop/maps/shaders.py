"""Shaders that straighten: GLSL for WebGL 2 and OpenGL ES 3, HLSL for Direct3D 10 and up, with the map as a texture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..formats import Deviation, ProgramFormat, filled, write_script
from .fixed_views import ViewMap

CARD_PX = 2.0**-9
"""By how much graphics cards miss a place: they know 256 of them between pixels."""
NOWHERE = -1e6  # px; far from anything, so that means with it are outside too


def _writer(template: str) -> Callable[[ViewMap, tuple[Path, ...]], tuple[str, Deviation]]:
    def write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
        """The shader, and its table: little-endian floats (u, v), row by row from the top."""
        shader, table = paths
        np.nan_to_num(view.straighten, nan=NOWHERE).astype("<f4").tofile(table)
        write_script(shader, filled(template, table=table.name, **view.words))
        return view.sizes, Deviation(CARD_PX, "px", "graphics cards know 256 places between pixels")

    return write


GLSL: ProgramFormat[ViewMap] = ProgramFormat(
    _writer("view.frag.in"), (".frag", "-table.bin"), "WebGL 2, OpenGL ES 3, OpenGL 3"
)
HLSL: ProgramFormat[ViewMap] = ProgramFormat(
    _writer("view.hlsl.in"), (".hlsl", "-table.bin"), "Direct3D, Unity, Unreal"
)
