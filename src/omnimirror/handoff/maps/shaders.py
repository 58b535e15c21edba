"""Shaders that straighten: GLSL for WebGL 2 and OpenGL ES 3, HLSL for Direct3D 10 and up, with the map as a texture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..formats import Deviation, ProgramFormat, filled
from .fixed_views import ViewMap

NOWHERE = -1e6  # px; far from anything, so that means with it are outside too


def _writer(template: str) -> Callable[[ViewMap, tuple[Path, ...]], tuple[str, Deviation]]:
    def write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
        """The shader, and its table: little-endian floats (u, v), row by row from the top."""
        shader, table = paths
        np.nan_to_num(view.straighten, nan=NOWHERE).astype("<f4").tofile(table)
        (width, height), (source_width, source_height) = view.size, view.source_size
        words = filled(
            template, camera=view.name, view=view.view, table=table.name, width=width, height=height,
            source_width=source_width, source_height=source_height,
        )  # fmt: skip
        shader.write_text(words, encoding="utf-8")
        why = "graphics cards know 256 places between pixels"
        return f"{width} x {height} px of {source_width} x {source_height}", Deviation(2.0**-9, "px", why)

    return write


GLSL: ProgramFormat[ViewMap] = ProgramFormat(
    _writer("view.frag.in"), (".frag", "-table.bin"), "WebGL 2, OpenGL ES 3, OpenGL 3"
)
HLSL: ProgramFormat[ViewMap] = ProgramFormat(
    _writer("view.hlsl.in"), (".hlsl", "-table.bin"), "Direct3D, Unity, Unreal"
)
