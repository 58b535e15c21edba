"""Mirror-outline detection: ellipse of the rim, the camera's own image, and the confidence."""

from .finder import SURE, CameraImage, FoundRim, check_alike, find_rim
from .first_camera import DEFAULT, PRESETS, CommonMirror, camera_from_rim, mirror_of, sensor_from_rim, sensors_from_rim

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
