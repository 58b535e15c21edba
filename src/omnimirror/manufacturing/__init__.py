"""Manufacturing: drawings, export formats, tolerance analysis, and metrology of mirrors."""

from .body import Body
from .drawings.drawing import Drawing, draw_sheets
from .drawings.image_shift import ImageShift, image_shifts
from .exporter import (
    DEFAULT_FORMATS,
    FORMATS,
    Content,
    ExportedFile,
    Format,
    export,
    register_format,
)
from .formats.sag import format_grid_sag, format_table, sag_table, table_points
from .formats.tool_paths import Tool, ToolPath, format_gcode, format_points, tool_path
from .formats.zmx import format_zmx
from .surface_approximation import (
    Asphere,
    BestFitSphere,
    ProfileCurve,
    best_fit_sphere,
    fit_asphere,
    profile_curve,
)
from .workshop import PartSpecification, TitleBlock, Workshop, load_workshop

__all__ = [
    "DEFAULT_FORMATS",
    "FORMATS",
    "Asphere",
    "BestFitSphere",
    "Body",
    "Content",
    "Drawing",
    "ExportedFile",
    "Format",
    "ImageShift",
    "PartSpecification",
    "ProfileCurve",
    "TitleBlock",
    "Tool",
    "ToolPath",
    "Workshop",
    "best_fit_sphere",
    "draw_sheets",
    "export",
    "fit_asphere",
    "format_gcode",
    "format_grid_sag",
    "format_points",
    "format_table",
    "format_zmx",
    "image_shifts",
    "load_workshop",
    "profile_curve",
    "register_format",
    "sag_table",
    "table_points",
    "tool_path",
]
