"""Formats of view maps and the function that writes them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...base.arguments import validate_arguments
from ...cameras.camera import Camera
from ...dewarp.screens import View
from ...dewarp.view_geometry import Viewpoint
from ..export_formats import ExportedFiles, ExportFormats, format_registry, write_formats
from ._arrays import DEPTHAI, FFMPEG, OPENCV, OPENCV_YML, STMAP, VPI
from ._embedded import C99, OPENMV
from ._shaders import GLSL, GSTREAMER, HLSL, OBS
from ._view_map import ViewMap, view_map

MAP_FORMATS: ExportFormats[ViewMap] = format_registry(
    "omnimirror.map_formats",
    "a format of view maps",
    {
        "stmap": STMAP,
        "opencv": OPENCV,
        "opencv-yml": OPENCV_YML,
        "ffmpeg": FFMPEG,
        "glsl": GLSL,
        "hlsl": HLSL,
        "vpi": VPI,
        "c99": C99,
        "openmv": OPENMV,
        "gstreamer": GSTREAMER,
        "depthai": DEPTHAI,
        "obs": OBS,
    },
)
"""Formats of view maps by name."""


@validate_arguments
def write_maps(
    camera: Camera,
    view: View,
    path: str | Path,
    *,
    formats: Iterable[str] | str | None = None,
    viewpoint: Viewpoint = "exact",
) -> list[ExportedFiles]:
    """Write the map of a fixed view for other programs: all files or none.

    Parameters
    ----------
    camera
        Sensor, aligned or misaligned, or calibrated camera.
    view
        Screen of :mod:`omnimirror.screens` or view of :mod:`omnimirror.views`.
    path
        Folder, or a file whose suffix selects the format unless ``formats`` does; for a format of
        several files, the stem is common to all of them.
    formats : optional
        Names from :data:`MAP_FORMATS`; required for a folder.
    viewpoint
        Viewpoint mode, as for :class:`omnimirror.Dewarper`.

    Returns
    -------
    list of ExportedFiles
        Files, description and deviation of each format.

    Raises
    ------
    InvalidParameter
        If a format or suffix is unknown, or a format cannot represent the view.
    OutsideField
        If no pixel of the view is inside the field of the camera.
    OmnimirrorError
        If a package of ``omnimirror[interop]`` is missing or a file cannot be written.

    Examples
    --------
    >>> import cv2, tempfile, numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> ahead = om.screens.Plane((320, 240), hfov_deg=80.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (exported,) = om.write_maps(sensor, ahead, f"{folder}/ahead.npz")
    ...     maps = np.load(exported.paths[0])
    >>> image = np.full((1024, 1024), 90, np.uint8)
    >>> cv2.remap(image, maps["map_x"], maps["map_y"], cv2.INTER_LINEAR)[120, 160]
    np.uint8(90)
    """
    mapping = view_map(camera, view, viewpoint)
    return write_formats(mapping, MAP_FORMATS, mapping.name, path, formats)
