"""What a sensor would see: scenes, and the pictures that a camera takes of them."""

from .bracketing import merge_bracket, plan_bracket
from .detector import Detector
from .exposure import expose
from .hardware import Hardware
from .noise import Noise, estimate_noise
from .picture import pinhole_picture, take_picture
from .restoration import restore
from .scenes import Distant, Environment, Hall, Placed, Pose, Room, Scene, Street
from .truth import Truth, ground_truth

__all__ = [
    "Detector",
    "Distant",
    "Environment",
    "Hall",
    "Hardware",
    "Noise",
    "Placed",
    "Pose",
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
