"""Calibration targets: definition, printing, detection, and corner refinement."""

from .boards import Board
from .choosing import choose_frames
from .detections import Detection
from .finding import find_board, find_boards
from .printing import draw_board, write_board
from .refinement import refine_corners

__all__ = [
    "Board",
    "Detection",
    "choose_frames",
    "draw_board",
    "find_board",
    "find_boards",
    "refine_corners",
    "write_board",
]
