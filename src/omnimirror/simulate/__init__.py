"""What a sensor would see: scenes, and the pictures that a camera takes of them."""

from .datasets.truth import Truth, ground_truth
from .detector import Detector
from .radiometry import Radiometry
from .rendering.exposure import expose
from .rendering.picture import pinhole_picture, take_picture
from .restoration.bracketing import merge_bracket, plan_bracket
from .restoration.noise import Noise, estimate_noise
from .restoration.sharpening import restore
from .scenes import Distant, Environment, Hall, Pose, PosedScene, Room, Scene, Street

__all__ = [
    "Detector",
    "Distant",
    "Environment",
    "Hall",
    "Noise",
    "Pose",
    "PosedScene",
    "Radiometry",
    "Room",
    "Scene",
    "Street",
    "Truth",
    "estimate_noise",
    "expose",
    "ground_truth",
    "merge_bracket",
    "pinhole_picture",
    "plan_bracket",
    "restore",
    "take_picture",
]
