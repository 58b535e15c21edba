"""Camera file formats of other programs."""

from ._camera_format import CameraEntry, CameraFile, CameraFormat, Layout, ReadOptions
from ._registry import FORMATS, output_layouts, read_cameras, register_camera_format

__all__ = [
    "FORMATS",
    "CameraEntry",
    "CameraFile",
    "CameraFormat",
    "Layout",
    "ReadOptions",
    "output_layouts",
    "read_cameras",
    "register_camera_format",
]
