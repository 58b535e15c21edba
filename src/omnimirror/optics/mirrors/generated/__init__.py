"""Mirrors generated from a wanted mapping of field angles to the image: one class per mapping."""

from .base import Generated, Mapped
from .distant import Conformal, Equiangular, Equiareal, Equidistant, Rectifying, UnitAspect
from .finite import CylinderMapping, GroundPlane
from .table import TabulatedMapping

MAPPINGS: dict[str, type[Mapped]] = {
    cls.KIND: cls
    for cls in (
        Equidistant,
        Equiangular,
        Conformal,
        UnitAspect,
        Equiareal,
        Rectifying,
        GroundPlane,
        CylinderMapping,
        TabulatedMapping,
    )
}
"""Every mapping by its name, which is also the kind of its mirror."""

__all__ = [
    "MAPPINGS",
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
