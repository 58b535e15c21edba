"""What a sensor does: imaging characteristics, viewpoints, virtual images, blur, and all of it together."""

from .blur_check import BlurCheck, check_blur
from .comparison import Comparison, compare
from .evaluation import COLUMNS, Evaluation, evaluate, field_angles
from .focus import BestFocus, best_focus
from .illumination import Illumination, illumination
from .merits import MERITS
from .point_spread import Psf, psf
from .spot_diagrams import Spots, spots
from .transfer import Mtf, mtf
from .viewpoints import SingleViewpoint, best_viewpoint

__all__ = [
    "COLUMNS",
    "MERITS",
    "BestFocus",
    "BlurCheck",
    "Comparison",
    "Evaluation",
    "Illumination",
    "Mtf",
    "Psf",
    "SingleViewpoint",
    "Spots",
    "best_focus",
    "best_viewpoint",
    "check_blur",
    "compare",
    "evaluate",
    "field_angles",
    "illumination",
    "mtf",
    "psf",
    "spots",
]
