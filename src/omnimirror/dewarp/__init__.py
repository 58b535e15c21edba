"""Straightening pictures: screens say where to look, cameras where that is in the picture."""

from . import screens, views
from .colours import ColourDewarper
from .dewarper import Dewarper

__all__ = ["ColourDewarper", "Dewarper", "screens", "views"]
