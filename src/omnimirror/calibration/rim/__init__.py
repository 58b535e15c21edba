"""Mirror-outline detection: ellipse of the rim, the camera's own image, and the confidence."""

from ._initial_camera import (
    DEFAULT,
    PRESETS,
    CommonMirror,
    camera_from_rim,
    mirror_of,
    sensor_from_rim,
    sensors_from_rim,
)
from ._rim_detection import SURE, CameraImage, FoundRim, check_alike, find_rim

__all__ = [
    "DEFAULT",
    "PRESETS",
    "SURE",
    "CameraImage",
    "CommonMirror",
    "FoundRim",
    "camera_from_rim",
    "check_alike",
    "find_rim",
    "mirror_of",
    "sensor_from_rim",
    "sensors_from_rim",
]
