"""Closed-form mirror shapes: conics, cone, flat mirror, even polynomial and conic asphere.

All conics share one formula in the vertex radius ``R`` and the conic constant ``k``
(``k = -e**2``): sphere 0, paraboloid -1, hyperboloid < -1, prolate ellipsoid between -1 and 0,
oblate > 0.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates, floats, number
from ...base.parameters import Parameter
from ...base.typing import Array
from .mirror import RIM_RADIUS, Mirror

# -- Conics ----------------------------------------------------------------------------------------
#
# Each class has its customary parameters and uses the same three kernels.


def conic_profile(x: Array, R: float | Array, k: float | Array) -> tuple[Array, Array, Array]:
    """Compute sag (mm), slope and curvature (1/mm) of a conic; NaN beyond its equator.

    The sag ``c x^2 / (1 + sqrt(1 - (1 + k) c^2 x^2))`` with ``c = 1/R`` is accurate near the axis
    and for the paraboloid, unlike the textbook solution, which divides by ``1 + k = 0``.

    >>> conic_profile(np.array([30.0]), R=50.0, k=0.0)  # sphere: 50 - 40, tan, 50^2 / 40^3
    (array([10.]), array([0.75]), array([0.0390625]))
    """
    root = conic_root(x, R, k)
    return x**2 / (R * (1 + root)), x / (R * root), 1 / (R * root**3)


def conic_root(x: Array, R: float | Array, k: float | Array) -> Array:
    """Compute ``sqrt(1 - (1 + k) (x/R)^2)``; NaN outside the surface, checked by callers."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(1 - (1 + k) * (x / R) ** 2)


def conic_reach(R: float, k: float) -> float:
    """Return the distance from the axis at which the conic ends (its equator), mm.

    >>> conic_reach(50.0, 0.0), conic_reach(50.0, -1.0)
    (50.0, inf)
    """
    return abs(R) / float(np.sqrt(1 + k)) if k > -1 else float("inf")


class Conic(Mirror):
    """Base class of pure conics: vertex radius, conic constant and kernels."""

    @property
    @abstractmethod
    def vertex_radius(self) -> float:
        """Radius of curvature at the vertex, mm."""

    @property
    @abstractmethod
    def conic(self) -> float:
        """Conic constant k = -e^2."""

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        return conic_profile(coordinates("x_mm", x_mm), self.vertex_radius, self.conic)

    def _reach(self, first_missing_mm: float) -> float:
        return conic_reach(self.vertex_radius, self.conic)


@dataclass(frozen=True)
class _OfSemiAxes(Conic):
    """Conic given by its semi-axes; the vertex radius is A^2/B."""

    a_mm: float
    b_mm: float
    rim_radius_mm: float

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "a_mm": Parameter("mm", 1e-3, 1e6, "semi-axis perpendicular to the mirror axis (A)"),
        "b_mm": Parameter("mm", 1e-3, 1e6, "semi-axis along the mirror axis (B)"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._check()

    @property
    def vertex_radius(self) -> float:
        return self.a_mm**2 / self.b_mm


@dataclass(frozen=True)
class Sphere(Conic):
    """Sphere ``z = A - sqrt(A^2 - x^2)``, the paper's SPH, with R_t = R_s = A.

    >>> float(Sphere(radius_mm=50.0, rim_radius_mm=44.0).sag(30.0))
    10.0
    """

    radius_mm: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "sphere"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "radius_mm": Parameter("mm", 1e-3, 1e6, "radius of the sphere (A)"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._check()

    @property
    def vertex_radius(self) -> float:
        return self.radius_mm

    @property
    def conic(self) -> float:
        return 0.0


@dataclass(frozen=True)
class Hyperboloid(_OfSemiAxes):
    """Hyperboloid ``z = -B + (B/A) sqrt(A^2 + x^2)``, the paper's SVP (erratum 1 in its Table 1).

    It has a single viewpoint, at its inner focus, if the lens is at the outer focus:
    ``m = B + C``, ``C = sqrt(A^2 + B^2)``, which is :attr:`single_viewpoint_distance`.

    >>> mirror = Hyperboloid(a_mm=3.0, b_mm=4.0, rim_radius_mm=4.0)
    >>> float(mirror.sag(4.0)), mirror.single_viewpoint_distance  # -4 + 4/3 * 5
    (2.666..., 9.0)
    """

    KIND: ClassVar[str] = "hyperboloid"

    @property
    def conic(self) -> float:
        return -1 - (self.a_mm / self.b_mm) ** 2

    @property
    def single_viewpoint_distance(self) -> float:
        """Distance m from lens to vertex, mm, of the single-viewpoint configuration."""
        return self.b_mm + float(np.hypot(self.a_mm, self.b_mm))


@dataclass(frozen=True)
class Paraboloid(Conic):
    """Paraboloid ``z = x^2/(2 s)``: single viewpoint with an orthographic lens.

    >>> float(Paraboloid(vertex_radius_mm=20.0, rim_radius_mm=44.0).sag(20.0))
    10.0
    """

    vertex_radius_mm: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "paraboloid"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "vertex_radius_mm": Parameter("mm", 1e-3, 1e6, "radius of curvature at the vertex (s)"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._check()

    @property
    def vertex_radius(self) -> float:
        return self.vertex_radius_mm

    @property
    def conic(self) -> float:
        return -1.0


@dataclass(frozen=True)
class Ellipsoid(_OfSemiAxes):
    """Convex ellipsoid ``z = B - B sqrt(1 - x^2/A^2)``.

    >>> float(Ellipsoid(a_mm=50.0, b_mm=100.0, rim_radius_mm=44.0).sag(30.0))
    20.0
    """

    KIND: ClassVar[str] = "ellipsoid"

    @property
    def conic(self) -> float:
        return (self.a_mm / self.b_mm) ** 2 - 1


# -- Cone ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Cone(Mirror):
    """Cone ``z = x tan(beta)``: R_t is infinite and R_s = x / sin(beta).

    Its field extends from ``Omega = 2 beta`` to ``2 beta + theta`` of the rim: a narrow band around
    the horizon for beta near 45 deg. It has no single viewpoint (:meth:`pinhole_ring`) unless m ->
    0.

    >>> round(float(Cone(slope_deg=45.0, rim_radius_mm=20.0).sag(10.0)), 12)
    10.0
    """

    slope_deg: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "cone"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "slope_deg": Parameter(
            "deg", 0.1, 89.9, "angle of the surface from the plane perpendicular to the axis (beta)"
        ),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x, slope = coordinates("x_mm", x_mm), float(np.tan(np.radians(self.slope_deg)))
        return x * slope, np.full_like(x, slope), np.zeros_like(x)

    def pinhole_ring(self, mirror_distance_mm: float) -> tuple[float, float]:
        """Return radius and height z (mm) of the ring of virtual pinholes.

        Each half of a meridian is a plane mirror for the rays in that plane; it images the lens at
        ``(-m sin(2 beta), m cos(2 beta))``, on the far side of the axis. All rays pass one point
        only for m -> 0, with the lens at the apex.

        >>> radius, z = Cone(slope_deg=45.0, rim_radius_mm=20.0).pinhole_ring(100.0)
        >>> round(radius, 9), round(z, 9)
        (100.0, 0.0)
        """
        m, double_angle = (
            number("mirror_distance_mm", mirror_distance_mm),
            2 * np.radians(self.slope_deg),
        )
        return m * float(np.sin(double_angle)), m * float(np.cos(double_angle))


# -- Flat mirror -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Flat(Mirror):
    """Flat mirror ``z = 0``, which folds the path between mirror and lens.

    >>> Flat(rim_radius_mm=20.0).sag([0.0, 10.0])
    array([0., 0.])
    """

    rim_radius_mm: float

    KIND: ClassVar[str] = "flat"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {"rim_radius_mm": RIM_RADIUS}

    def __post_init__(self) -> None:
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        zero = np.zeros_like(coordinates("x_mm", x_mm))
        return zero, zero, zero


# -- Polynomial mirrors ----------------------------------------------------------------------------
#
# Coefficients refer to powers of ``x / normalization_radius_mm`` and are in units of the
# normalisation radius: the paper's numbers can be entered as printed, and parameters are well scaled
# for optimisation. With a normalisation radius of 1 mm they are the usual even-asphere coefficients,
# in mm^(1-2i).

NORMALIZATION = Parameter("mm", 1e-3, 1e5, "length unit of the coefficients")


def even_polynomial(
    x: Array, coefficients: tuple[float, ...], first: int
) -> tuple[Array, Array, Array]:
    """Compute ``sum c_i x^(2 (first + i))`` and two derivatives by Horner's scheme in x^2.

    >>> even_polynomial(np.array([2.0]), (1.0, 0.5), first=1)  # x^2 + x^4/2
    (array([12.]), array([20.]), array([26.]))
    """
    u = x * x
    value, slope, curvature = np.zeros_like(u), np.zeros_like(u), np.zeros_like(u)
    for i in reversed(range(len(coefficients))):
        n, c = 2 * (first + i), coefficients[i]
        value = value * u + c
        slope = slope * u + n * c
        curvature = curvature * u + n * (n - 1) * c
    low = x ** (2 * first - 2)
    return value * low * u, slope * low * x, curvature * low


@dataclass(frozen=True)
class EvenPolynomial(Mirror):
    """``z = N sum c_i (x/N)^(2i)``, i >= 1; the paper's E-DI: 0.6409, 0.1550, -0.01.

    >>> mirror = EvenPolynomial((0.6409, 0.1550, -0.01), rim_radius_mm=1.0)
    >>> round(float(mirror.sag(1.0)), 4)
    0.7859
    """

    coefficients: tuple[float, ...]
    rim_radius_mm: float
    normalization_radius_mm: float = 1.0

    KIND: ClassVar[str] = "even-polynomial"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "coefficients": Parameter(
            "", -1e9, 1e9, "coefficients of (x/N)^2, (x/N)^4, ... in units of N"
        ),
        "rim_radius_mm": RIM_RADIUS,
        "normalization_radius_mm": NORMALIZATION,
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", floats("coefficients", self.coefficients))
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        N = self.normalization_radius_mm
        z, slope, curvature = even_polynomial(
            coordinates("x_mm", x_mm) / N, self.coefficients, first=1
        )
        return z * N, slope, curvature / N


@dataclass(frozen=True)
class ConicAsphere(Mirror):
    """Even asphere: a conic plus ``N sum a_i (x/N)^(2i)``, i = 2, 3, ...

    This is the standard even asphere of optical design programs; R defines the x^2 term.

    >>> ConicAsphere(vertex_radius_mm=50.0, conic=0.0, rim_radius_mm=40.0).sag([30.0])
    array([10.])
    """

    vertex_radius_mm: float
    conic: float
    rim_radius_mm: float
    coefficients: tuple[float, ...] = ()
    normalization_radius_mm: float = 1.0

    KIND: ClassVar[str] = "conic-asphere"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "vertex_radius_mm": Parameter("mm", 1e-3, 1e6, "radius of curvature at the vertex (R)"),
        "conic": Parameter("", -1e3, 1e3, "conic constant k = -e^2"),
        "rim_radius_mm": RIM_RADIUS,
        "coefficients": Parameter(
            "", -1e9, 1e9, "coefficients of (x/N)^4, (x/N)^6, ... in units of N"
        ),
        "normalization_radius_mm": NORMALIZATION,
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", floats("coefficients", self.coefficients))
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x, R, N = coordinates("x_mm", x_mm), self.vertex_radius_mm, self.normalization_radius_mm
        z, slope, curvature = conic_profile(x, R, self.conic)
        dz, dslope, dcurvature = even_polynomial(x / N, self.coefficients, first=2)
        return z + dz * N, slope + dslope, curvature + dcurvature / N

    def _reach(self, first_missing_mm: float) -> float:
        return conic_reach(self.vertex_radius_mm, self.conic)
