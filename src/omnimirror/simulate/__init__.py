"""What a sensor would see: scenes, and the pictures that a camera takes of them."""

from .detector import Detector
from .exposure import expose
from .hardware import Hardware
from .picture import pinhole_picture, take_picture
from .scenes import Distant, Environment, Hall, Placed, Pose, Room, Scene, Street
from .truth import Truth, ground_truth

__all__ = [
    "Detector",
    "Distant",
    "Environment",
    "Hall",
    "Hardware",
    "Placed",
    "Pose",
    "Room",
    "Scene",
    "Street",
    "Truth",
    "expose",
    "ground_truth",
    "pinhole_picture",
    "take_picture",
]
