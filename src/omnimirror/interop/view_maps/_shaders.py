"""View maps as shaders: GLSL, HLSL, OBS Studio and GStreamer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.escaping import c_string, gstreamer_comment, shell_word
from ...io import write_image
from ..export_formats import Deviation, ExportFormat, SourceCode, fill_template, write_script
from ._spline_grid import SplineGrid, finest_grid, join_lines, run_table
from ._view_map import ViewMap, check_16_bit_size

GPU_FILTER_PX = 2.0**-9
"""Rounding of bilinear filter weights to 1/256 by graphics hardware."""
GPU_REASON = "bilinear filter weights of graphics hardware are rounded to 1/256"
OUTSIDE_PX = -1e6
"""Coordinate of missing pixels; interpolation with a valid neighbour is outside, too."""

# -- GLSL and HLSL -------------------------------------------------------------------------------


def _shader_writer(
    template: str,
) -> Callable[[ViewMap, tuple[Path, ...]], tuple[str, Deviation]]:
    def write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
        """Write the shader and its map: little-endian floats (u, v) by rows from the top."""
        shader, table = paths
        np.nan_to_num(view.dewarp_map, nan=OUTSIDE_PX).astype("<f4").tofile(table)
        write_script(shader, fill_template(template, map_file=table.name, **view.template_values))
        return view.sizes, Deviation(GPU_FILTER_PX, "px", GPU_REASON)

    return write


GLSL: ExportFormat[ViewMap] = ExportFormat(
    _shader_writer("view.frag.in"), (".frag", "-map.bin"), "WebGL 2, OpenGL ES 3, OpenGL 3"
)
HLSL: ExportFormat[ViewMap] = ExportFormat(
    _shader_writer("view.hlsl.in"), (".hlsl", "-map.bin"), "Direct3D, Unity, Unreal"
)

# -- OBS Studio ----------------------------------------------------------------------------------

OBS_STEPS_PER_PX = 256
OBS_OFFSET_PX = 1
"""Offset of coded coordinates, which may be up to 1 px outside; code 0 marks missing pixels."""
OBS_ROUNDING_PX = float(np.hypot(1, 1)) / (2 * OBS_STEPS_PER_PX)


def map_image(pixels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Encode pixel coordinates as an 8-bit RGB image for shaders without float textures.

    Each coordinate is a 24-bit number in 1/256 px with the most significant byte in red. The left
    half of the image holds u, the right half v.

    Parameters
    ----------
    pixels
        (h, w, 2) coordinates, px; NaN for missing pixels.

    Returns
    -------
    (h, 2 w, 3) array

    Examples
    --------
    >>> map_image(np.array([[[0.0, 300.5], [np.nan, np.nan]]]))[0].tolist()
    [[0, 1, 0], [0, 0, 0], [1, 45, 128], [0, 0, 0]]
    """
    valid = np.isfinite(pixels).all(axis=-1, keepdims=True)
    shifted = np.where(valid, pixels, 0.0) + OBS_OFFSET_PX
    code = np.rint(shifted * OBS_STEPS_PER_PX).astype(np.uint32) * valid
    digits = np.stack([code >> 16, code >> 8 & 255, code & 255], axis=-1).astype(np.uint8)
    return np.concatenate([digits[:, :, 0], digits[:, :, 1]], axis=1)


def _write_obs(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    effect, table = paths
    check_16_bit_size(view.source_size, "source image")
    write_image(table, map_image(view.dewarp_map))
    map_file = SourceCode(c_string(table.name))
    write_script(effect, fill_template("view.effect.in", map_file=map_file, **view.template_values))
    deviation = Deviation(OBS_ROUNDING_PX + GPU_FILTER_PX, "px", f"{GPU_REASON}, as is the map")
    return f"{view.sizes} and an image of the map", deviation


OBS: ExportFormat[ViewMap] = ExportFormat(
    _write_obs, (".effect", "-map.png"), "OBS Studio (plug-in obs-shaderfilter)"
)

# -- GStreamer -----------------------------------------------------------------------------------

GRID_STEPS = (64, 32, 16, 8, 4)
MAX_ARGUMENT_BYTES = 120_000
"""Maximum length of the shader in a command line; Linux permits 131,072 bytes per argument."""


def _write_gstreamer(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Write a pipeline and a shader with the map as constants; glshader has one texture only."""
    script, shader = paths
    values = view.template_values
    comments = {key: SourceCode(gstreamer_comment(str(values[key]))) for key in ("camera", "view")}
    for steps in (GRID_STEPS, GRID_STEPS[:-1]):  # coarser if the finest grid is too long
        grid = finest_grid(view.dewarp_map, steps)
        text = fill_template("view-gst.frag.in", **values | comments, **_glsl_constants(grid))
        if len(text) <= MAX_ARGUMENT_BYTES:
            break
    else:
        raise InvalidParameter(
            f"the shader for gstreamer must be at most {MAX_ARGUMENT_BYTES} bytes long to fit on "
            f"a command line; got {len(text)}; use a smaller view without discontinuities"
        )
    write_script(shader, text)
    shader_word = SourceCode(shell_word(shader.name))
    write_script(script, fill_template("view-gst.sh.in", **values, shader=shader_word))
    error = float(np.hypot(*grid.error)) + GPU_FILTER_PX
    reason = f"cubic interpolation between nodes every {grid.step} px; {GPU_REASON}"
    return f"{view.sizes}, {grid.nodes[..., 0].size} nodes", Deviation(error, "px", reason)


def _glsl_constants(grid: SplineGrid) -> dict[str, object]:
    """Return the template values of a grid as GLSL source code."""
    starts, runs = run_table(grid.runs)
    pairs = np.reshape(runs, (-1, 2))
    nodes = [f"vec2({u:.3f},{v:.3f})" for u, v in grid.nodes.reshape(-1, 2)]
    return {
        "step": grid.step,
        "columns": grid.nodes.shape[1],
        "count": len(nodes),
        "nodes": join_lines(nodes),
        "run_count": len(pairs),
        "runs": join_lines([f"ivec2({first},{first + n})" for first, n in pairs.tolist()]),
        "start_count": len(starts),
        "starts": join_lines(starts),
    }


GSTREAMER: ExportFormat[ViewMap] = ExportFormat(
    _write_gstreamer, (".sh", ".frag"), "GStreamer (element glshader)"
)
