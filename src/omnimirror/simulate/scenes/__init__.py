"""Scenes to take pictures of: the contract, environments far away, and the scenes that come with the project."""

from .contract import Distant, Measured, Scene
from .environment import Environment
from .posed import Pose, PosedScene
from .worlds.bundled import BUNDLED, bundled_scene
from .worlds.hall import Hall
from .worlds.room import Room
from .worlds.street import Street

__all__ = [
    "BUNDLED",
    "Distant",
    "Environment",
    "Hall",
    "Measured",
    "Pose",
    "PosedScene",
    "Room",
    "Scene",
    "Street",
    "bundled_scene",
]
