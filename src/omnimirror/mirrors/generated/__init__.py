"""Mirrors generated from a wanted mapping of field angles to the image: one class per mapping."""

from .base import Generated, Mapped
from .distant import Conformal, Equiangular, Equiareal, Equidistant, Rectifying, UnitAspect
from .finite import CylinderMapping, GroundPlane
from .table import TabulatedMapping

__all__ = [
    "Conformal",
    "CylinderMapping",
    "Equiangular",
    "Equiareal",
    "Equidistant",
    "Generated",
    "GroundPlane",
    "Mapped",
    "Rectifying",
    "TabulatedMapping",
    "UnitAspect",
]
