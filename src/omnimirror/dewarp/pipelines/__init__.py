"""Files straightened: pictures, folders of them, videos, cameras and streams, from their source to what is written."""

from .border import BorderColour
from .pictures import Straightened
from .request import Recording, Straightening, is_video

__all__ = ["BorderColour", "Recording", "Straightened", "Straightening", "is_video"]
