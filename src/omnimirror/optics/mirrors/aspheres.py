"""Polynomial mirrors: the even polynomial of the paper's E-DI, and the even asphere.

Coefficients refer to powers of ``x / normalization_radius_mm`` and are in units of the
normalisation radius: the paper's numbers can be entered as printed, and parameters are well scaled
for optimisation. With a normalisation radius of 1 mm they are the usual even-asphere coefficients,
in mm^(1-2i).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates, floats
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import RIM_RADIUS, Mirror
from .conics import conic_profile, conic_reach

NORMALIZATION = Parameter("mm", 1e-3, 1e5, "length unit of the coefficients")


def even_polynomial(x: Array, coefficients: tuple[float, ...], first: int) -> tuple[Array, Array, Array]:
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
        "coefficients": Parameter("", -1e9, 1e9, "coefficients of (x/N)^2, (x/N)^4, .. in units of N"),
        "rim_radius_mm": RIM_RADIUS,
        "normalization_radius_mm": NORMALIZATION,
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", floats("coefficients", self.coefficients))
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        N = self.normalization_radius_mm
        z, slope, curvature = even_polynomial(coordinates("x_mm", x_mm) / N, self.coefficients, first=1)
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
        "coefficients": Parameter("", -1e9, 1e9, "coefficients of (x/N)^4, (x/N)^6, .. in units of N"),
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
