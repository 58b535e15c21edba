"""What a mirror is: sag, slope and curvature of one meridian. One class per shape, one registry."""

from .aspheres import ConicAsphere, EvenPolynomial
from .base import Mirror
from .cone import Cone
from .conics import Ellipsoid, Hyperboloid, Paraboloid, Sphere
from .generated import Equidistant
from .sampled import SampledProfile
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

__all__ = [
    "MIRRORS",
    "Cone",
    "ConicAsphere",
    "Ellipsoid",
    "Equidistant",
    "EvenPolynomial",
    "Hyperboloid",
    "Mirror",
    "Paraboloid",
    "SampledProfile",
    "SlopeSpline",
    "Sphere",
]
