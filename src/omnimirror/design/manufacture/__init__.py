"""What a workshop and other programs need of a sensor: tables, CAD and lens files, and a drawing."""

from .best_sphere import BestSphere, best_sphere
from .body import Body
from .drawing import Drawing, draw_sheet
from .export import DEFAULT_FORMATS, FORMATS, Exported, export
from .forms import Asphere, Curve, asphere_of, curve_of
from .gridsag import format_grid_sag
from .sensitivity import Sensitivity, sensitivities
from .supports import Hidden, Support, hidden_percent, obscuration
from .table import format_table, sag_table, table_points
from .zmx import format_zmx

__all__ = [
    "DEFAULT_FORMATS",
    "FORMATS",
    "Asphere",
    "BestSphere",
    "Body",
    "Curve",
    "Drawing",
    "Exported",
    "Hidden",
    "Sensitivity",
    "Support",
    "asphere_of",
    "best_sphere",
    "curve_of",
    "draw_sheet",
    "export",
    "format_grid_sag",
    "format_table",
    "format_zmx",
    "hidden_percent",
    "obscuration",
    "sag_table",
    "sensitivities",
    "table_points",
]
