"""Camera models: calibrated mappings between pixels and rays, other tools' and our own; each is a Camera."""

from .ball import MirrorBall
from .base import CentralCamera
from .ocam import OCam, load_ocam, parse_ocam

__all__ = ["CentralCamera", "MirrorBall", "OCam", "load_ocam", "parse_ocam"]
