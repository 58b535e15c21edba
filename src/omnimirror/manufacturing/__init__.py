"""What a workshop and other programs need of a sensor: tables, CAD and lens files, and a drawing."""

from .body import Body
from .drawings.drawing import Drawing, draw_sheets
from .exporter import DEFAULT_FORMATS, FORMATS, Content, Exported, Format, export, register_format
from .formats.gridsag import format_grid_sag
from .formats.sag_tables import format_table, sag_table, table_points
from .formats.zmx import format_zmx
from .forms import Asphere, ProfileCurve, asphere_of, curve_of
from .lathe import Tool, ToolPath, format_gcode, format_points, tool_path
from .reference_sphere import BestSphere, best_sphere
from .sensitivity import Sensitivity, sensitivities
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
