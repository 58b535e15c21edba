"""What a mirror is: sag, slope and curvature of one meridian. One class per shape, one registry."""

from .aspheres import ConicAsphere, EvenPolynomial
from .base import Mirror
from .cone import Cone
from .conics import Ellipsoid, Hyperboloid, Paraboloid, Sphere
from .flat import Flat
from .generated import Equidistant
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
    )
}
"""Every mirror by the word that names it in a sensor file. Adding one is a class and a line here."""

SECONDARIES: dict[str, type[Mirror]] = {Flat.KIND: Flat, **MIRRORS}
"""What can stand as a second mirror: those, and a flat one."""

__all__ = [
    "MIRRORS",
    "SECONDARIES",
    "Cone",
    "ConicAsphere",
    "Ellipsoid",
    "Equidistant",
    "EvenPolynomial",
    "Flat",
    "Hyperboloid",
    "Mirror",
    "Paraboloid",
    "SampledProfile",
    "Secondary",
    "SlopeSpline",
    "Sphere",
]
