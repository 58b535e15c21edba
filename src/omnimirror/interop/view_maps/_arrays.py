"""View maps as arrays, images and meshes: ST maps, OpenCV, FFmpeg, NVIDIA VPI and DepthAI."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...io.exr import write_exr
from ..export_formats import Deviation, ExportFormat
from ._spline_grid import spline_grid
from ._view_map import ViewMap, check_16_bit_size

OUTSIDE_PX = -2.0
"""Coordinate of missing pixels in float maps, beyond the support of bilinear kernels."""

# -- ST maps -------------------------------------------------------------------------------------

ST_OUTSIDE = -1.0


def st_map(pixels: Array, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the ST map of pixel coordinates, as used by Nuke, Fusion, Natron and Blender.

    Red is the horizontal and green the vertical coordinate in the other image, counted from the
    left and **bottom** outer edges from 0 to 1. Coordinates are clamped to the centres of the
    border pixels, so that filters do not mix them with the outside. Alpha is 1 for valid pixels;
    red and green of other pixels are -1.

    Parameters
    ----------
    pixels
        (h, w, 2) coordinates (u, v), px; NaN for missing pixels.
    size
        (width, height) of the image that the coordinates refer to, px.

    Returns
    -------
    (h, w, 4) array
        Red, green, blue and alpha.

    Examples
    --------
    >>> st_map(np.array([[[0.0, 0.0], [9.0, 4.0], [np.nan, np.nan]]]), (10, 5)).tolist()
    [[[0.05..., 0.89..., 0.0, 1.0], [0.94..., 0.10..., 0.0, 1.0], [-1.0, -1.0, 0.0, 0.0]]]
    """
    width, height = size
    valid = np.isfinite(pixels).all(axis=-1)
    pixels = np.clip(pixels, 0.0, np.array(size) - 1.0)
    s, t = (pixels[..., 0] + 0.5) / width, 1 - (pixels[..., 1] + 0.5) / height
    red, green = np.where(valid, s, ST_OUTSIDE), np.where(valid, t, ST_OUTSIDE)
    return np.stack([red, green, np.zeros_like(s), valid], axis=-1).astype(np.float32)


def _write_stmap(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    dewarp, warp = paths
    write_exr(dewarp, st_map(view.dewarp_map, view.source_size))
    write_exr(warp, st_map(view.warp_map, view.size))
    sizes = "{} x {} px (dewarp), {} x {} px (warp)".format(*view.size, *view.source_size)
    return sizes, Deviation()


STMAP: ExportFormat[ViewMap] = ExportFormat(
    _write_stmap,
    ("-dewarp.exr", "-warp.exr"),
    "Nuke, Fusion, Natron, Blender, Meshroom",
    ("OpenEXR",),
)

# -- OpenCV --------------------------------------------------------------------------------------

FIXED_POINT_PX = float(np.hypot(1, 1)) / 64
"""Rounding of both coordinates to 1/32 px."""
OPENCV_DEVIATION = Deviation(
    FIXED_POINT_PX, "px", "fixed_map1 and fixed_map2; map_x and map_y are exact"
)


def _opencv_maps(view: ViewMap) -> dict[str, Any]:
    """Return float and fixed-point maps for ``cv2.remap`` by name."""
    pixels = view.border_clamped_dewarp_map
    x, y = (np.ascontiguousarray(pixels[..., axis], np.float32) for axis in (0, 1))
    for coordinate in (x, y):
        coordinate[np.isnan(coordinate)] = OUTSIDE_PX
    integer, fraction = cv2.convertMaps(x, y, cv2.CV_16SC2)
    return {"map_x": x, "map_y": y, "fixed_map1": integer, "fixed_map2": fraction}


def _write_npz(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    np.savez_compressed(paths[0], **_opencv_maps(view), source_size=np.array(view.source_size))
    return "{} x {} px".format(*view.size), OPENCV_DEVIATION


def _write_yml(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    storage = cv2.FileStorage(str(paths[0]), cv2.FILE_STORAGE_WRITE)
    for name, values in _opencv_maps(view).items():
        storage.write(name, values)
    storage.release()
    return "{} x {} px".format(*view.size), OPENCV_DEVIATION


OPENCV: ExportFormat[ViewMap] = ExportFormat(_write_npz, (".npz",), "OpenCV in Python")
OPENCV_YML: ExportFormat[ViewMap] = ExportFormat(
    _write_yml, (".yml",), "OpenCV in C++ (cv::FileStorage)"
)

# -- NVIDIA VPI ----------------------------------------------------------------------------------


def _write_vpi(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Write (height, width, 2) float32 source pixels, integers at pixel centres."""
    pixels = np.nan_to_num(view.border_clamped_dewarp_map, nan=OUTSIDE_PX)
    np.save(paths[0], pixels.astype(np.float32))
    return "{} x {} control points, one per pixel".format(*view.size), Deviation()


VPI: ExportFormat[ViewMap] = ExportFormat(
    _write_vpi, (".npy",), "NVIDIA VPI (WarpMap) and other programs that read (h, w, 2) arrays"
)

# -- FFmpeg --------------------------------------------------------------------------------------

FFMPEG_OUTSIDE = 65535
"""Coordinate beyond the image, which the filter fills with its colour ``fill``."""


def _write_ffmpeg(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Write two 16-bit PGM images of integer coordinates; the filter uses nearest neighbours."""
    check_16_bit_size(view.source_size, "source image")
    pixels = view.dewarp_map
    valid = np.asarray(np.isfinite(pixels).all(axis=-1))
    last = np.array(view.source_size) - 1
    with np.errstate(invalid="ignore"):  # NaN is replaced
        nearest = np.clip(np.rint(pixels), 0, last)
        rounded = np.where(valid[..., None], nearest, FFMPEG_OUTSIDE)
    for path, values in zip(paths, np.moveaxis(rounded, -1, 0), strict=True):
        path.write_bytes(b"P5\n%d %d\n65535\n" % view.size + values.astype(">u2").tobytes())
    error = np.linalg.norm((rounded - pixels)[valid], axis=-1)
    description = "{} x {} px".format(*view.size)
    return description, Deviation(float(error.max()), "px", "nearest-neighbour sampling")


FFMPEG: ExportFormat[ViewMap] = ExportFormat(
    _write_ffmpeg, ("-x.pgm", "-y.pgm"), "FFmpeg (filter remap)"
)

# -- DepthAI -------------------------------------------------------------------------------------

MESH_CELL_PX = 16
"""Mesh spacing, and the divisor that DepthAI requires of image widths."""
MAX_MESH_ERROR_PX = 8
"""Maximum interpolation error; larger errors indicate discontinuities."""


def _write_depthai(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Write mesh points (x, y) by rows; the last row and column are at the edge of the view."""
    (width, height), (source_width, _) = view.size, view.source_size
    if width % MESH_CELL_PX or height % MESH_CELL_PX:
        raise InvalidParameter(
            f"the sides of a view for depthai must be multiples of {MESH_CELL_PX} px; got {width} x {height} px"
        )
    if source_width % MESH_CELL_PX:
        raise InvalidParameter(
            f"the image width for depthai must be a multiple of {MESH_CELL_PX} px; got {source_width} px"
        )
    mesh = spline_grid(view.dewarp_map, MESH_CELL_PX).nodes[1:-1, 1:-1]
    difference = interpolate_mesh(mesh) - view.dewarp_map
    error = float(np.nanmax(np.linalg.norm(difference, axis=-1)))
    if error > MAX_MESH_ERROR_PX:
        raise InvalidParameter(
            f"the mesh error for depthai must be at most {MAX_MESH_ERROR_PX} px; got "
            f"{error:.0f} px; use a single view of about the resolution of the source image"
        )
    rows, columns = mesh.shape[:2]
    content = {
        "size": view.size,
        "source_size": view.source_size,
        "mesh_width": columns,
        "mesh_height": rows,
        "points": mesh.reshape(-1, 2).round(3).tolist(),
    }
    paths[0].write_text(json.dumps(content), encoding="utf-8")
    reason = f"linear interpolation between points every {MESH_CELL_PX} px"
    return f"{columns} x {rows} points", Deviation(error, "px", reason)


def interpolate_mesh(mesh: Array) -> Array:
    """Interpolate a mesh (rows, columns, 2) bilinearly at all pixels of the view."""
    for axis in (0, 1):
        cell, offset = np.divmod(np.arange((mesh.shape[axis] - 1) * MESH_CELL_PX), MESH_CELL_PX)
        t = (offset / MESH_CELL_PX).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        mesh = (1 - t) * mesh.take(cell, axis) + t * mesh.take(cell + 1, axis)
    return mesh


DEPTHAI: ExportFormat[ViewMap] = ExportFormat(
    _write_depthai, (".json",), "DepthAI (node Warp) on Luxonis cameras"
)
