"""Scenes to take pictures of: the contract, and a furnished room that satisfies it."""

from .contract import Distant, Scene
from .room import Room

__all__ = ["Distant", "Room", "Scene"]
