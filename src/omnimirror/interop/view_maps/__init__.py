"""View maps: the source pixel of each pixel of a fixed view and the inverse, for other programs."""

from ._view_map import ViewMap, view_map
from ._writers import MAP_FORMATS, write_maps

__all__ = ["MAP_FORMATS", "ViewMap", "view_map", "write_maps"]
