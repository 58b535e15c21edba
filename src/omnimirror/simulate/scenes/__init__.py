"""Scenes to take pictures of: the contract, environments far away, and a furnished room."""

from .contract import Distant, Scene
from .environment import Environment
from .room import Room

__all__ = ["Distant", "Environment", "Room", "Scene"]
