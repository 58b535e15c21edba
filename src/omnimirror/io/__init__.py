"""Pictures and video in and out.

Pictures are at hand here; video is imported from its own modules, since FFmpeg is heavy: ``video`` reads
files and ``writer`` writes them, ``live`` reads cameras and streams, ``outputs`` are pipes, streams and
windows, and ``process`` leads from the one to the other.
"""

from .pictures.images import read_image, write_image
from .pictures.panorama import GPano

__all__ = ["GPano", "read_image", "write_image"]
