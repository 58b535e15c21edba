"""What a sensor would see: scenes, and the pictures that a camera takes of them."""

from .picture import pinhole_picture, take_picture
from .scenes import Distant, Room, Scene

__all__ = ["Distant", "Room", "Scene", "pinhole_picture", "take_picture"]
