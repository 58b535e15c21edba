"""Files straightened: pictures, folders of them, videos, cameras and streams, from their source to what is written."""

from .border import BorderColour
from .pictures import Restoration, Straightened, dewarp_pictures
from .request import Recording, Straightening, is_video

__all__ = [
    "BorderColour",
    "Recording",
    "Restoration",
    "Straightened",
    "Straightening",
    "dewarp_pictures",
    "is_video",
]
