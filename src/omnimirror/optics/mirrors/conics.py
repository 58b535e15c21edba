"""Conic mirrors: sphere, hyperboloid, paraboloid, ellipsoid.

All conics share one formula in the vertex radius ``R`` and the conic constant ``k``
(``k = -e**2``): sphere 0, paraboloid -1, hyperboloid < -1, prolate ellipsoid between -1 and 0,
oblate > 0. Each class has its customary parameters and uses the same three kernels.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import RIM_RADIUS, Mirror


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
        "a_mm": Parameter("mm", 1e-3, 1e6, "semi-axis across the mirror axis (A)"),
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
