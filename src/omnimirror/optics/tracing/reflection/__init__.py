"""Reflection points: ray endpoints, surface, minimisation, and lookup tables for kernels."""

from .ends import Ends, Specular
from .limits import LONGEST_STEP, MAX_STEPS, REFLECTS, RIM_SLACK
from .search import footprint, specular_points
from .surface import Surface, continued_profile
from .tables import BEYOND, CELLS, TIP, MirrorTables, cubic_pieces, meridian_table, radii

__all__ = [
    "BEYOND",
    "CELLS",
    "LONGEST_STEP",
    "MAX_STEPS",
    "REFLECTS",
    "RIM_SLACK",
    "TIP",
    "Ends",
    "MirrorTables",
    "Specular",
    "Surface",
    "continued_profile",
    "cubic_pieces",
    "footprint",
    "meridian_table",
    "radii",
    "specular_points",
]
