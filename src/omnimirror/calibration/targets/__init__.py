"""Calibration targets: definition, printing, detection, and corner refinement."""

from ._corner_refinement import refine_corners
from .board_detection import find_board, find_boards
from .boards import Board, Detection
from .frame_selection import select_frames
from .printing import draw_board, write_board

__all__ = [
    "Board",
    "Detection",
    "draw_board",
    "find_board",
    "find_boards",
    "refine_corners",
    "select_frames",
    "write_board",
]
