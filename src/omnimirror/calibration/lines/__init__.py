"""Calibration without a target: straight edges of rooms and streets, and levelling by what stands upright."""

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
