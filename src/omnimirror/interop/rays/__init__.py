"""Ray tables: where the ray of each pixel starts, where it goes and how much it weighs, for renderers."""

from .table import RayTable, ray_table
from .writer import RAY_FORMATS, write_rays

__all__ = ["RAY_FORMATS", "RayTable", "ray_table", "write_rays"]
