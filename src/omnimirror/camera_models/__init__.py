"""Camera models: calibrated mappings between pixels and rays, other tools' and our own; each is a Camera."""

from .ball import MirrorBall
from .base import CameraModel, Image, ModelParameter
from .kannala_brandt import KannalaBrandt
from .ocam import OCam, load_ocam, parse_ocam
from .radial import RadialModel
from .spheres import DoubleSphere, EnhancedUnified, Unified
from .splines import RadialSpline, ViewpointSpline

__all__ = [
    "CameraModel",
    "DoubleSphere",
    "EnhancedUnified",
    "Image",
    "KannalaBrandt",
    "MirrorBall",
    "ModelParameter",
    "OCam",
    "RadialModel",
    "RadialSpline",
    "Unified",
    "ViewpointSpline",
    "load_ocam",
    "parse_ocam",
]
