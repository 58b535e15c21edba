"""Calibration targets: boards and how they are printed, found in distorted pictures, and their corners measured."""

from .boards import Board
from .detections import Detection
from .finding import find_board, find_boards
from .refinement import refine_corners

__all__ = ["Board", "Detection", "find_board", "find_boards", "refine_corners"]
