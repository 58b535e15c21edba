"""Camera file formats of other programs."""

from ._camera_format import CameraFile, CameraFormat, Layout, Reading, Stored
from ._registry import FORMATS, read_cameras, register_camera_format, targets_of

__all__ = [
    "FORMATS",
    "CameraFile",
    "CameraFormat",
    "Layout",
    "Reading",
    "Stored",
    "read_cameras",
    "register_camera_format",
    "targets_of",
]
