"""Camera calibration: estimation of a camera model, target poses and target shape from images."""

from ..straight_edges import StraightEdges
from ._bundle_adjustment import BundleAdjustment, Prior, bundle_adjust
from ._camera_calibration import calibrate_camera
from .calibration_result import Calibration
from .observations import (
    Observation,
    RigidTransform,
    SurveyData,
    read_observations,
    simulate_detections,
)

__all__ = [
    "BundleAdjustment",
    "Calibration",
    "Observation",
    "Prior",
    "RigidTransform",
    "StraightEdges",
    "SurveyData",
    "bundle_adjust",
    "calibrate_camera",
    "read_observations",
    "simulate_detections",
]
