"""The formats of maps, and the one call that writes them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...arguments import checked
from ...cameras import Camera
from ...dewarp.screens import View
from ...dewarp.viewpoints import Viewpoint
from ..formats import Formats, HandedOver, hand_over, registry
from .ffmpeg import FFMPEG
from .fixed_views import ViewMap, view_map
from .lattices.c99 import C99
from .lattices.depthai import DEPTHAI
from .lattices.gstreamer import GSTREAMER
from .lattices.openmv import OPENMV
from .obs import OBS
from .opencv import OPENCV, OPENCV_YML
from .shaders import GLSL, HLSL
from .stmap import STMAP
from .vpi import VPI

MAP_FORMATS: Formats[ViewMap] = registry(
    "omnimirror.map_formats",
    "a format of maps",
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
"""Every format of maps by the word that names it."""


@checked
def write_maps(
    camera: Camera,
    view: View,
    path: str | Path,
    *,
    formats: Iterable[str] | str | None = None,
    viewpoint: Viewpoint = "exact",
) -> list[HandedOver]:
    """Write the map of a fixed view for other programs: all files, or none.

    Parameters
    ----------
    camera
        A sensor, aligned or not, or a calibrated camera.
    view
        A screen of :mod:`omnimirror.screens`, or a view of :mod:`omnimirror.views`.
    path
        A folder, or a file whose suffix says the format unless ``formats`` names one; where that is several files, the
        stem is the name of all.
    formats : optional
        Of :data:`MAP_FORMATS`, for a folder.
    viewpoint
        As for :class:`omnimirror.Dewarper`.

    Returns
    -------
    list of HandedOver
        The files of each format, what they hold and by how much they deviate.

    Raises
    ------
    InvalidParameter
        A format or suffix that is not known, or a view that the format has no place for.
    OutsideField
        The view sees nothing of the camera's field.
    OmnimirrorError
        A package of ``omnimirror[interop]`` is missing, or a file cannot be written.

    Examples
    --------
    >>> import cv2, tempfile, numpy as np, omnimirror as om
    >>> sensor, ahead = om.load_sensor("paper-spherical"), om.screens.Plane((320, 240), hfov_deg=80.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (done,) = om.write_maps(sensor, ahead, f"{folder}/ahead.npz")
    ...     maps = np.load(done.paths[0])
    >>> picture = np.full((1024, 1024), 90, np.uint8)
    >>> cv2.remap(picture, maps["map_x"], maps["map_y"], cv2.INTER_LINEAR)[120, 160]
    np.uint8(90)
    """
    fixed = view_map(camera, view, viewpoint)
    return hand_over(fixed, MAP_FORMATS, fixed.name, path, formats)
