"""What a mirror is: sag, slope and curvature of one meridian. One class per shape, one registry."""

from .aspheres import ConicAsphere, EvenPolynomial
from .base import Mirror
from .cone import Cone
from .conics import Ellipsoid, Hyperboloid, Paraboloid, Sphere
from .flat import Flat
from .generated import (
    Conformal,
    CylinderMapping,
    Equiangular,
    Equiareal,
    Equidistant,
    GroundPlane,
    Rectifying,
    TabulatedMapping,
    UnitAspect,
)
from .sampled import SampledProfile
from .secondary import Secondary
from .slope_spline import SlopeSpline

MIRRORS: dict[str, type[Mirror]] = {
    cls.KIND: cls
    for cls in (
        Sphere,
        Hyperboloid,
        Paraboloid,
        Ellipsoid,
        Cone,
        EvenPolynomial,
        ConicAsphere,
        SampledProfile,
        Equidistant,
        SlopeSpline,
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
"""Every mirror by the word that names it in a sensor file. Adding one is a class and a line here."""

SECONDARIES: dict[str, type[Mirror]] = {Flat.KIND: Flat, **MIRRORS}
"""What can stand as a second mirror: those, and a flat one."""

__all__ = [
    "MIRRORS",
    "SECONDARIES",
    "Cone",
    "Conformal",
    "ConicAsphere",
    "CylinderMapping",
    "Ellipsoid",
    "Equiangular",
    "Equiareal",
    "Equidistant",
    "EvenPolynomial",
    "Flat",
    "GroundPlane",
    "Hyperboloid",
    "Mirror",
    "Paraboloid",
    "Rectifying",
    "SampledProfile",
    "Secondary",
    "SlopeSpline",
    "Sphere",
    "TabulatedMapping",
    "UnitAspect",
]
