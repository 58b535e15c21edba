"""Dewarping of images: screens define the targets of output pixels, cameras project them."""

from . import screens, views
from ._dewarper import ColourDewarper, Dewarper

__all__ = ["ColourDewarper", "Dewarper", "screens", "views"]
