"""Camera models: calibrated mappings between pixels and rays, other tools' and our own; each is a Camera."""

from .ball import MirrorBall
from .base import CameraModel, Image, ModelParameter
from .ocam import OCam, load_ocam, parse_ocam
from .radial import RadialModel
from .spheres import Unified

__all__ = [
    "CameraModel",
    "Image",
    "MirrorBall",
    "ModelParameter",
    "OCam",
    "RadialModel",
    "Unified",
    "load_ocam",
    "parse_ocam",
]
