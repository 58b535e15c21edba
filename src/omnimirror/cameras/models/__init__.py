"""Camera models: calibrated mappings between pixels and rays."""

from typing import TypeAlias, get_args

from ._opencv_models import KannalaBrandt, RationalPinhole, ThinPrismFisheye
from .camera_model import CameraModel, ModelParameter, PointImages, RadialModel
from .ocam import OCam, load_ocam, parse_ocam
from .sphere_models import DoubleSphere, EnhancedUnified, MirrorBall, Unified
from .spline_models import RadialSpline, ViewpointSpline

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
"""Camera models by their names in files."""

__all__ = [
    "CAMERAS",
    "CalibratedCamera",
    "CameraModel",
    "DoubleSphere",
    "EnhancedUnified",
    "KannalaBrandt",
    "MirrorBall",
    "ModelParameter",
    "OCam",
    "PointImages",
    "RadialModel",
    "RadialSpline",
    "RationalPinhole",
    "ThinPrismFisheye",
    "Unified",
    "ViewpointSpline",
    "load_ocam",
    "parse_ocam",
]
