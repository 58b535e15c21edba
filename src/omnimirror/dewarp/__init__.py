"""Straightening pictures: screens say where to look, cameras where that is in the picture."""

from . import screens, views
from .dewarper import Dewarper

__all__ = ["Dewarper", "screens", "views"]
