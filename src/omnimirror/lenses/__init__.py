"""Lenses: how a virtual image behind the mirror becomes a height and a blur on the imager."""

from .base import BLUR_MODES, BlurMode, DepthOfField, Lens, ThroughFocus
from .gaussian import GaussianLens
from .orthographic import Orthographic
from .perspective import Perspective

LENSES: dict[str, type[Lens]] = {cls.KIND: cls for cls in (Perspective, Orthographic)}
"""Every lens by the word that names it in a sensor file."""

__all__ = [
    "BLUR_MODES",
    "LENSES",
    "BlurMode",
    "DepthOfField",
    "GaussianLens",
    "Lens",
    "Orthographic",
    "Perspective",
    "ThroughFocus",
]
