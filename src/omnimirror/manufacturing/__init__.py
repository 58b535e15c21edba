"""What a workshop and other programs need of a sensor: tables, CAD and lens files, and a drawing."""

from .body import Body
from .drawings.drawing import Drawing, draw_sheets
from .drawings.image_shift import Sensitivity, sensitivities
from .exporter import DEFAULT_FORMATS, FORMATS, Content, Exported, Format, export, register_format
from .formats.sag import format_grid_sag, format_table, sag_table, table_points
from .formats.tool_path import Tool, ToolPath, format_gcode, format_points, tool_path
from .formats.zmx import format_zmx
from .surface_approximation import Asphere, BestSphere, ProfileCurve, asphere_of, best_sphere, curve_of
from .workshop import Making, TitleBlock, Workshop, load_workshop

__all__ = [
    "DEFAULT_FORMATS",
    "FORMATS",
    "Asphere",
    "BestSphere",
    "Body",
    "Content",
    "Drawing",
    "Exported",
    "Format",
    "Making",
    "ProfileCurve",
    "Sensitivity",
    "TitleBlock",
    "Tool",
    "ToolPath",
    "Workshop",
    "asphere_of",
    "best_sphere",
    "curve_of",
    "draw_sheets",
    "export",
    "format_gcode",
    "format_grid_sag",
    "format_points",
    "format_table",
    "format_zmx",
    "load_workshop",
    "register_format",
    "sag_table",
    "sensitivities",
    "table_points",
    "tool_path",
]
