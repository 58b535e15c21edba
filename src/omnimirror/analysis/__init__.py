"""What a sensor does: imaging characteristics, viewpoints, virtual images, blur, and all of it together."""

from .aperture.blur_check import BlurCheck, check_blur
from .aperture.point_spread import Psf, psf
from .aperture.relative_illumination import Illumination, illumination
from .aperture.spot_diagrams import Spots, spots
from .aperture.transfer import Mtf, mtf
from .calibration import CameraMapping, evaluate_camera
from .comparison import Comparison, compare
from .evaluation import COLUMNS, Evaluation, evaluate, field_angles
from .meridional.focus import BestFocus, best_focus
from .meridional.focus_merits import FOCUS_MERITS
from .meridional.viewpoints import SingleViewpoint, best_viewpoint
from .wall_reflections import Ghosts, ghosts

__all__ = [
    "COLUMNS",
    "FOCUS_MERITS",
    "BestFocus",
    "BlurCheck",
    "CameraMapping",
    "Comparison",
    "Evaluation",
    "Ghosts",
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
    "evaluate_camera",
    "field_angles",
    "ghosts",
    "illumination",
    "mtf",
    "psf",
    "spots",
]
