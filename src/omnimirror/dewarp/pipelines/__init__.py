"""Dewarping of files: images, folders, videos, cameras and streams, from source to output."""

from .border import BorderColour
from .pictures import Straightened
from .request import Recording, Straightening, is_video

__all__ = ["BorderColour", "Recording", "Straightened", "Straightening", "is_video"]
