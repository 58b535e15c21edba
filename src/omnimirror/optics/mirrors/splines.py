"""Spline mirrors: freeform mirror with a spline of the slope, and sampled or measured profile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates, floats, number, validate_arguments
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from .measured import (
    CLOUD_FILE,
    GRID_FILE,
    PROFILE_FILE,
    SMOOTHING_DEGREE,
    Fit,
    fitted,
    read_columns,
)
from .mirror import RIM_RADIUS, Mirror, near_apex

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


# -- Freeform mirror: spline of the slope ----------------------------------------------------------
#
# The slope determines the reflected ray and is therefore the design variable. Spline, sag and
# curvature are linear in the given slopes: the only nonlinearity of an optimisation is that of the
# optics.

SLOPE_DEGREE = 5  # quintic: the curvature, which determines focus, has three continuous derivatives
MIN_SLOPES = 4


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
    return make_interp_spline(u, slopes, k=min(SLOPE_DEGREE, 2 * ((len(u) - 1) // 2) - 1))


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
        "slopes": Parameter(
            "",
            -1e3,
            1e3,
            "dz/dx at equal steps from the axis to the rim; the first is 0, except for a pointed mirror",
        ),
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        object.__setattr__(self, "slopes", floats("slopes", self.slopes))
        if len(self.slopes) < MIN_SLOPES:
            raise InvalidParameter(
                f"slopes must have at least {MIN_SLOPES} values; got {len(self.slopes)}"
            )
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


# -- Sampled profile -------------------------------------------------------------------------------

EXTRAPOLATION = 1e-5  # of the rim radius


@dataclass(frozen=True)
class SmoothCurve(Mirror):
    """Mirror with a quintic spline as its meridian."""

    rim_radius_mm: float
    spline: BSpline
    apex: str

    KIND: ClassVar[str] = "sampled"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {"rim_radius_mm": RIM_RADIUS}

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline, BSpline]:
        return self.spline, self.spline.derivative(), self.spline.derivative(2)

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x = coordinates("x_mm", x_mm)
        z, slope, curvature = (np.asarray(s(x)) for s in self._splines)
        if self.apex == "smooth":
            slope = near_apex(x / self.rim_radius_mm, x * curvature, slope)
        return z - self._splines[0](0.0), slope, curvature


@dataclass(frozen=True)
class SampledProfile(Mirror):
    """Quintic spline (C4) through meridian points (x, z), smoothed if noisy.

    A smooth apex is continued symmetrically across the axis, for a slope of exactly 0 there; a
    ``"pointed"`` apex is not. Sags are relative to the axis.

    Curvature affects the angles of the image strongly: an interpolating spline amplifies noise of a
    few nanometres. Noisy points are therefore smoothed to their uncertainty, single outliers are
    excluded (:attr:`outliers`), and exact points are interpolated; see
    :mod:`omnimirror.optics.mirrors.measured`.

    Parameters
    ----------
    x_mm, z_mm : sequences of at least 6 numbers, mm
        x starts at 0 and increases.
    rim_radius_mm : mm, optional
        Last x by default.
    apex : "smooth" or "pointed"
    uncertainty_um : um, optional
        Standard uncertainty of the heights; estimated by default, 0 for interpolation.

    Raises
    ------
    InvalidParameter
        If there are too few points, x does not increase from 0, lengths differ, the rim is beyond
        the last point, or points scatter far more than specified.

    Examples
    --------
    >>> x = np.linspace(0, 44, 45)
    >>> mirror = SampledProfile(tuple(x), tuple(50 - np.sqrt(2500 - x**2)))
    >>> round(float(mirror.radius_t(20.5)), 3)
    50.0
    """

    x_mm: tuple[float, ...]
    z_mm: tuple[float, ...]
    rim_radius_mm: float | None = None  # type: ignore[assignment]  # optional here, set from the knots
    apex: str = "smooth"
    uncertainty_um: float | None = None

    KIND: ClassVar[str] = "sampled"
    FILES = (PROFILE_FILE, CLOUD_FILE, GRID_FILE)
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "x_mm": Parameter("mm", 0.0, 1e5, "distances from the axis, increasing from 0"),
        "z_mm": Parameter("mm", -1e5, 1e5, "heights, increasing away from the lens"),
        "rim_radius_mm": RIM_RADIUS,
        "apex": Parameter("", 0, 0, "shape at the axis", choices=("smooth", "pointed")),
        "uncertainty_um": Parameter(
            "um",
            0.0,
            1e4,
            "standard uncertainty of the heights, estimated by default; 0 interpolates the points",
        ),
    }

    def __post_init__(self) -> None:
        x, z = floats("x_mm", self.x_mm), floats("z_mm", self.z_mm)
        if len(x) != len(z):
            raise InvalidParameter(
                f"x_mm and z_mm must have equally many values; got {len(x)} and {len(z)}"
            )
        if not np.isfinite([x, z]).all():
            raise InvalidParameter("x_mm and z_mm must be finite")
        if len(x) <= SMOOTHING_DEGREE:
            raise InvalidParameter(
                f"a sampled profile must have at least {SMOOTHING_DEGREE + 1} points; got {len(x)}"
            )
        if x[0] != 0.0:
            raise InvalidParameter(f"x_mm must start with 0, on the axis; got {x[0]:g}")
        if not np.all(np.diff(x) > 0):
            i = int(np.argmin(np.diff(x) > 0))
            raise InvalidParameter(
                f"x_mm must increase; got {x[i]:g} and {x[i + 1]:g} mm at points {i} and {i + 1}"
            )
        object.__setattr__(self, "x_mm", x)
        object.__setattr__(self, "z_mm", z)
        rim: float | None = self.rim_radius_mm
        object.__setattr__(self, "rim_radius_mm", x[-1] if rim is None else rim)
        if rim is not None and number("rim_radius_mm", rim) > x[-1]:
            raise InvalidParameter(
                f"rim_radius_mm must be at most {x[-1]:g} mm, the last point of the profile; got {rim:g}"
            )
        self._check()

    @classmethod
    @validate_arguments
    def from_csv(
        cls,
        path: str | Path,
        rim_radius_mm: float | None = None,
        apex: str = "smooth",
        uncertainty_um: float | None = None,
    ) -> SampledProfile:
        """Read a profile from a CSV file of two columns x, z in mm.

        Raises
        ------
        OmnimirrorError
            If the file is missing, or a line after the first number does not hold two numbers.
        """
        x, z = read_columns(Path(path))
        return cls(x, z, rim_radius_mm, apex, uncertainty_um)

    @cached_property
    def fit(self) -> Fit:
        """Fitted curve, uncertainty of one height, and points used."""
        stated = None if self.uncertainty_um is None else self.uncertainty_um * 1e-3
        return fitted(np.array(self.x_mm), np.array(self.z_mm), self.apex == "smooth", stated)

    @property
    def _rim(self) -> float:
        rim: float = self.rim_radius_mm  # type: ignore[assignment]  # None only until it is made
        return rim

    @property
    def outliers(self) -> tuple[int, ...]:
        """Indices (from 0) of the outliers, which are excluded."""
        return tuple(int(i) for i in np.flatnonzero(~self.fit.used))

    def deviated(self, factor: float) -> list[SmoothCurve]:
        """Return the mirror, and mirrors perturbed by a fraction of each independent deviation.

        The squared changes of any result, divided by the squared fraction, sum to its variance. The
        mirrors extend slightly beyond the rim, for field angles shifted there.
        """
        from scipy.interpolate import BSpline

        fit, rim, factor = self.fit, self._rim * (1 + EXTRAPOLATION), number("share", factor)
        curves = [
            fit.spline,
            *(
                BSpline(fit.spline.t, fit.spline.c + factor * d, SMOOTHING_DEGREE)
                for d in fit.deviations
            ),
        ]
        return [SmoothCurve(rim, curve, self.apex) for curve in curves]

    @property
    def breaks(self) -> Array:
        x = self.fit.spline.t[SMOOTHING_DEGREE:-SMOOTHING_DEGREE]
        inner: Array = x[(x > 0) & (x < self.rim_radius_mm)]
        return np.concatenate([[0.0], inner, [self.rim_radius_mm]])

    @cached_property
    def _curve(self) -> SmoothCurve:
        return SmoothCurve(self._rim, self.fit.spline, self.apex)

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x = coordinates("x_mm", x_mm)
        z, slope, curvature = self._curve.profile(x)
        there = (x >= 0.0 if self.apex == "pointed" else np.abs(x) <= self.x_mm[-1]) & (
            x <= self.x_mm[-1]
        )
        return tuple(np.where(there, a, np.nan) for a in (z, slope, curvature))  # type: ignore[return-value]  # the length of the generator is fixed
