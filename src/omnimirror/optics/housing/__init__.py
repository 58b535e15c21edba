"""Housing of the mirror: camera, rod, tube, dome or window, mirror rim, and their materials."""

from .base import Envelope, HousingPart
from .materials import MATERIALS, Material, index_of
from .parts import GAP_SHARE, LENS_AT_RIMS, CameraBody, Housing, Rim, Rod
from .walls import CLEARANCE_MM, SHELLS, Dome, FlatWindow, Shell, Tube, wall_words

__all__ = [
    "CLEARANCE_MM",
    "GAP_SHARE",
    "LENS_AT_RIMS",
    "MATERIALS",
    "SHELLS",
    "CameraBody",
    "Dome",
    "Envelope",
    "FlatWindow",
    "Housing",
    "HousingPart",
    "Material",
    "Rim",
    "Rod",
    "Shell",
    "Tube",
    "index_of",
    "wall_words",
]
