"""Lenses: image height and blur of the virtual image behind the mirror."""

from .base import BLUR_MODES, BlurMode, DepthOfField, Lens, ThroughFocus
from .field_lens import FieldLens
from .gaussian import GaussianLens
from .orthographic import Orthographic
from .perspective import Perspective
from .surfaces import SurfaceLens
from .tabulated import TabulatedLens

LENSES: dict[str, type[Lens]] = {cls.KIND: cls for cls in (Perspective, Orthographic, TabulatedLens, SurfaceLens)}
"""Lens classes by their name in sensor files."""

__all__ = [
    "BLUR_MODES",
    "LENSES",
    "BlurMode",
    "DepthOfField",
    "FieldLens",
    "GaussianLens",
    "Lens",
    "Orthographic",
    "Perspective",
    "SurfaceLens",
    "TabulatedLens",
    "ThroughFocus",
]
