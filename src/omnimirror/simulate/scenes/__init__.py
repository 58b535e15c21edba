"""Scenes to take pictures of: the contract, environments far away, and the scenes that come with the project."""

from .bundled import BUNDLED, bundled_scene
from .contract import Distant, Measured, Scene
from .environment import Environment
from .hall import Hall
from .placed import Placed, Pose
from .room import Room
from .street import Street

__all__ = [
    "BUNDLED",
    "Distant",
    "Environment",
    "Hall",
    "Measured",
    "Placed",
    "Pose",
    "Room",
    "Scene",
    "Street",
    "bundled_scene",
]
