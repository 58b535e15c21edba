"""Plumb-line calibration: refinement from straight edges, and levelling from upright edges."""

from .calibrator import LineCalibration, calibrate_lines, drawn_edges
from .chains import edge_chains
from .levelling import Level, level_from, level_in
from .marked import read_lines

__all__ = [
    "Level",
    "LineCalibration",
    "calibrate_lines",
    "drawn_edges",
    "edge_chains",
    "level_from",
    "level_in",
    "read_lines",
]
