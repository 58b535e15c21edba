"""Mirror-outline detection: ellipse of the rim, the camera's own image, and the confidence."""

from ._initial_camera import (
    DEFAULT_PRESET,
    PRESETS,
    MirrorPreset,
    camera_from_rim,
    mirror_by_name,
    sensor_from_rim,
    sensors_from_rim,
)
from ._rim_detection import (
    MIN_CONFIDENCE,
    CameraImage,
    MirrorOutline,
    check_image_sizes,
    detect_mirror_outline,
)

__all__ = [
    "DEFAULT_PRESET",
    "MIN_CONFIDENCE",
    "PRESETS",
    "CameraImage",
    "MirrorOutline",
    "MirrorPreset",
    "camera_from_rim",
    "check_image_sizes",
    "detect_mirror_outline",
    "mirror_by_name",
    "sensor_from_rim",
    "sensors_from_rim",
]
