"""Calibration targets: boards and how they are printed, found in distorted pictures, and their corners measured."""

from .boards import Board
from .detections import Detection

__all__ = ["Board", "Detection"]
