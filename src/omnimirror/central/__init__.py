"""Cameras with a single viewpoint, as other tools calibrate them; each satisfies the Camera contract."""

from .ball import MirrorBall
from .base import CentralCamera
from .ocam import OCam, load_ocam, parse_ocam

__all__ = ["CentralCamera", "MirrorBall", "OCam", "load_ocam", "parse_ocam"]
