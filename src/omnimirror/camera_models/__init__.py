"""Camera models: calibrated mappings between pixels and rays, other tools' and our own; each is a Camera."""

from .ball import MirrorBall
from .base import CameraModel, Image, ModelParameter
from .kannala_brandt import KannalaBrandt
from .ocam import OCam, load_ocam, parse_ocam
from .opencv_lenses import RationalPinhole, ThinPrismFisheye
from .radial import RadialModel
from .spheres import DoubleSphere, EnhancedUnified, Unified
from .splines import RadialSpline, ViewpointSpline

CAMERAS: dict[str, type[RadialModel]] = {
    cls.KIND: cls
    for cls in (
        Unified,
        EnhancedUnified,
        DoubleSphere,
        KannalaBrandt,
        ThinPrismFisheye,
        RationalPinhole,
        OCam,
        RadialSpline,
        ViewpointSpline,
        MirrorBall,
    )
}
"""Camera models by the kinds that files name."""

__all__ = [
    "CAMERAS",
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
