"""Lenses: image height and blur of the virtual image behind the mirror."""

from ._field_lens import FieldLens
from ._surface_lens import SurfaceLens
from ._tabulated_lens import TabulatedLens
from .lens import (
    BLUR_MODES,
    BlurMode,
    DepthOfField,
    GaussianLens,
    Lens,
    Orthographic,
    Perspective,
    ThroughFocus,
)

LENSES: dict[str, type[Lens]] = {
    cls.KIND: cls for cls in (Perspective, Orthographic, TabulatedLens, SurfaceLens)
}
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
