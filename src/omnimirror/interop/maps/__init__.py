"""Maps of fixed views: where each pixel of a view lies in the camera's picture, and back, for programs that remap."""

from .fixed_views import ViewMap, view_map
from .writer import MAP_FORMATS, write_maps

__all__ = ["MAP_FORMATS", "ViewMap", "view_map", "write_maps"]
