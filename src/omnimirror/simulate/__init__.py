"""What a sensor would see: scenes, and the pictures that a camera takes of them."""

from .exposure import expose
from .hardware import Hardware
from .picture import pinhole_picture, take_picture
from .scenes import Distant, Environment, Room, Scene

__all__ = ["Distant", "Environment", "Hardware", "Room", "Scene", "expose", "pinhole_picture", "take_picture"]
