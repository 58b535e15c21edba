"""Screens: what every pixel of a straightened picture looks at.

Screens are drawn as seen from inside or from above, in the world frame of :mod:`omnimirror.cameras.frames`;
none of them knows which way round the raw picture is. Each shape stands at ``distance_mm`` from its
centre, infinitely far unless said otherwise, and at a finite distance ``offset_mm`` moves it.
"""

from typing import TypeAlias

from .base import Composite, Screen, ScreenPart, View, parts_of
from .domes import Dome, LittlePlanet, Pole
from .mosaics import FACES, LAYOUTS, CubeMap, Layout, Mosaic
from .panoramas import Cylinder, Panorama, Rows, Sphere
from .planes import Ground, Plane

Shape: TypeAlias = Cylinder | Sphere | Plane | Ground | Dome | LittlePlanet | CubeMap | Mosaic
"""Every kind of view that is here; each can be ``zoomed`` and ``panned``."""

__all__ = [
    "FACES",
    "LAYOUTS",
    "Composite",
    "CubeMap",
    "Cylinder",
    "Dome",
    "Ground",
    "Layout",
    "LittlePlanet",
    "Mosaic",
    "Panorama",
    "Plane",
    "Pole",
    "Rows",
    "Screen",
    "ScreenPart",
    "Shape",
    "Sphere",
    "View",
    "parts_of",
]
