"""Camera calibration: estimation of a camera model, target poses and target shape from images."""

from .bundle.adjustment import Adjustment, Prior, adjust
from .bundle.edges import StraightEdges
from .bundle.observations import Motion, Sighting
from .bundle.surveys import Surveys, read_surveys
from .calibration import calibrate_camera
from .results import Calibration
from .simulated import simulate_detections

__all__ = [
    "Adjustment",
    "Calibration",
    "Motion",
    "Prior",
    "Sighting",
    "StraightEdges",
    "Surveys",
    "adjust",
    "calibrate_camera",
    "read_surveys",
    "simulate_detections",
]
