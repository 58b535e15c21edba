"""Camera calibration: estimation of a camera model, target poses and target shape from images."""

from ..straight_edges import StraightEdges
from ._bundle_adjustment import Adjustment, Prior, adjust
from ._camera_calibration import calibrate_camera
from .calibration_result import Calibration
from .observations import Motion, Sighting, Surveys, read_surveys, simulate_detections

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
