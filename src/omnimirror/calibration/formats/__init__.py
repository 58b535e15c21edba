"""Camera file formats of other programs."""

from .base import CameraFile, CameraFormat, Layout, Reading, Stored
from .registry import FORMATS, read_cameras, register_camera_format, targets_of

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
