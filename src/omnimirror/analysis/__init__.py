"""What a sensor does: imaging characteristics, viewpoints, virtual images, blur, and all of it together."""

from .evaluation import COLUMNS, Evaluation, evaluate, field_angles
from .focus import MERITS, BestFocus, best_focus
from .viewpoints import SingleViewpoint, best_viewpoint

__all__ = [
    "COLUMNS",
    "MERITS",
    "BestFocus",
    "Evaluation",
    "SingleViewpoint",
    "best_focus",
    "best_viewpoint",
    "evaluate",
    "field_angles",
]
