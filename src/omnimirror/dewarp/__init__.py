"""Dewarping of images: screens define the targets of output pixels, cameras project them."""

from . import screens, views
from .colours import ColourDewarper
from .dewarper import Dewarper

__all__ = ["ColourDewarper", "Dewarper", "screens", "views"]
