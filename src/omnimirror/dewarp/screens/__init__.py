"""Screens: targets of the pixels of a dewarped image.

Screens are drawn as seen from inside or from above, in the world frame of
:mod:`omnimirror.cameras.camera`, independent of the orientation of the source image. Each screen is
at ``distance_mm`` from its centre, infinite by default; at a finite distance ``offset_mm`` moves
it.
"""

from typing import TypeAlias

from ._mosaics import FACES, LAYOUTS, CubeMap, Layout, Mosaic
from ._projections import (
    Composite,
    Cylinder,
    DomeMaster,
    Equirectangular,
    Ground,
    LittlePlanet,
    Panorama,
    Plane,
    Pole,
    Rows,
    Screen,
    ScreenPart,
    View,
    parts_of,
)

Shape: TypeAlias = (
    Cylinder | Equirectangular | Plane | Ground | DomeMaster | LittlePlanet | CubeMap | Mosaic
)
"""All views of this package; each can be ``zoomed`` and ``panned``."""

__all__ = [
    "FACES",
    "LAYOUTS",
    "Composite",
    "CubeMap",
    "Cylinder",
    "DomeMaster",
    "Equirectangular",
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
    "View",
    "parts_of",
]
