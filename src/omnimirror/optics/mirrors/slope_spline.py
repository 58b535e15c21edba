"""Freeform mirror: a spline of the slope, whose integral is the sag.

The slope determines the reflected ray and is therefore the design variable. Spline, sag and
curvature are linear in the given slopes: the only nonlinearity of an optimisation is that of the
optics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates, floats
from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import RIM_RADIUS, Mirror, near_apex

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 5  # quintic: the curvature, which determines focus, has three continuous derivatives
FEWEST = 4


def spline_of_slopes(slopes: Array) -> BSpline:
    """Fit a spline over [-1, 1] through slopes (n, ...) at 0, 1/(n-1), ..., 1, odd about the axis.

    A non-zero first slope means a pointed mirror; its spline starts on the axis.

    >>> spline_of_slopes(np.array([0.0, 0.5, 1.0]))([0.25, -0.25])
    array([ 0.25, -0.25])
    """
    from scipy.interpolate import make_interp_spline

    u = np.linspace(0.0, 1.0, len(slopes))
    if not np.any(slopes[0]):
        u, slopes = np.concatenate([-u[:0:-1], u]), np.concatenate([-slopes[:0:-1], slopes])
    return make_interp_spline(u, slopes, k=min(DEGREE, 2 * ((len(u) - 1) // 2) - 1))


@dataclass(frozen=True)
class SlopeSpline(Mirror):
    """Quintic spline of dz/dx through slopes at equal steps from axis to rim; z is its integral.

    Parameters
    ----------
    slopes : sequence of at least 4 numbers
        dz/dx at x = 0, h, 2h, ... and the rim. The first is 0, or the slope of a pointed mirror.
    rim_radius_mm : mm

    Examples
    --------
    >>> x = np.linspace(0, 44, 23)
    >>> mirror = SlopeSpline(tuple(x / np.sqrt(50**2 - x**2)), 44.0)  # of a sphere
    >>> round(float(mirror.radius_t(20.5)), 3), round(float(mirror.sag(30.0)), 4)
    (50.0, 10.0)
    """

    slopes: tuple[float, ...]
    rim_radius_mm: float

    KIND: ClassVar[str] = "slope-spline"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "slopes": Parameter("", -1e3, 1e3, "dz/dx at equal steps from the axis to the rim; the first is 0, or a point"),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "slopes", floats("slopes", self.slopes))
        if len(self.slopes) < FEWEST:
            raise InvalidParameter(f"slopes has {len(self.slopes)} numbers; it needs at least {FEWEST}")
        self._check()

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline, BSpline]:
        slope = spline_of_slopes(np.array(self.slopes))
        return slope.antiderivative(), slope, slope.derivative()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        M = self.rim_radius_mm
        u = coordinates("x_mm", x_mm) / M
        u = np.where((u >= 0) & (u <= 1 + 1e-12), u, np.nan)
        sag, slope, curvature = self._splines
        dz: Array = slope(u)
        bend = curvature(u)
        if not self.slopes[0]:
            dz = near_apex(u, u * bend, dz)
        return (sag(u) - sag(0.0)) * M, dz, bend / M
