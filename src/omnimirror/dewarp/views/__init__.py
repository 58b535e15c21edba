"""Default views for a camera: they cover its field at the resolution of its image."""

from .makers import cube, dome, ground, mosaic, panorama, perspective, planet, sphere
from .names import VIEWS, register_view
from .presets import PRESETS, Preset, preset
from .sizes import LARGEST_MAGNIFICATION, largest_zoom, resolution

__all__ = [
    "LARGEST_MAGNIFICATION",
    "PRESETS",
    "VIEWS",
    "Preset",
    "cube",
    "dome",
    "ground",
    "largest_zoom",
    "mosaic",
    "panorama",
    "perspective",
    "planet",
    "preset",
    "register_view",
    "resolution",
    "sphere",
]
