"""Camera models: calibrated mappings between pixels and rays."""

from typing import TypeAlias, get_args

from .ball import MirrorBall
from .base import CameraModel, Image, ModelParameter
from .kannala_brandt import KannalaBrandt
from .ocam import OCam, load_ocam, parse_ocam
from .opencv_lenses import RationalPinhole, ThinPrismFisheye
from .radial import RadialModel
from .spheres import DoubleSphere, EnhancedUnified, Unified
from .splines import RadialSpline, ViewpointSpline

CalibratedCamera: TypeAlias = (
    Unified
    | EnhancedUnified
    | DoubleSphere
    | KannalaBrandt
    | ThinPrismFisheye
    | RationalPinhole
    | OCam
    | RadialSpline
    | ViewpointSpline
    | MirrorBall
)
CAMERAS: dict[str, type[CalibratedCamera]] = {cls.KIND: cls for cls in get_args(CalibratedCamera)}
"""Camera models by their kinds in files."""

__all__ = [
    "CAMERAS",
    "CalibratedCamera",
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
    "RationalPinhole",
    "ThinPrismFisheye",
    "Unified",
    "ViewpointSpline",
    "load_ocam",
    "parse_ocam",
]
