"""Mirrors with a prescribed mapping from field angle to image height: one class per mapping."""

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
"""Mappings by name, which is also the kind of the mirror."""

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
