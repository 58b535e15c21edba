"""Mirror from sampled points of its meridian, computed or measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import checked, coordinates, floats, number
from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import RIM_RADIUS, Mirror, near_apex
from .measured.columns import CLOUD_FILE, GRID_FILE, PROFILE_FILE, read_columns
from .measured.smoothing import DEGREE, Fit, fitted

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

BEYOND = 1e-5  # of the rim radius


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
    :mod:`omnimirror.optics.mirrors.measured.smoothing`.

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
    rim_radius_mm: float | None = None  # type: ignore[assignment]
    apex: str = "smooth"
    uncertainty_um: float | None = None

    KIND: ClassVar[str] = "sampled"
    FILES = (PROFILE_FILE, CLOUD_FILE, GRID_FILE)
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "x_mm": Parameter("mm", 0.0, 1e5, "distances from the axis, growing from 0"),
        "z_mm": Parameter("mm", -1e5, 1e5, "heights, growing away from the lens"),
        "rim_radius_mm": RIM_RADIUS,
        "apex": Parameter("", 0, 0, "shape at the axis", choices=("smooth", "pointed")),
        "uncertainty_um": Parameter(
            "um", 0.0, 1e4, "standard uncertainty of the heights, estimated unless given; 0 meets every point"
        ),
    }

    def __post_init__(self) -> None:
        x, z = floats("x_mm", self.x_mm), floats("z_mm", self.z_mm)
        if len(x) != len(z):
            raise InvalidParameter(f"x_mm has {len(x)} points and z_mm {len(z)}; they need the same number")
        if not np.isfinite([x, z]).all():
            raise InvalidParameter("x_mm and z_mm hold a number that is not finite; all of them must be")
        if len(x) <= DEGREE:
            raise InvalidParameter(f"a sampled profile of {len(x)} points is too short; give at least {DEGREE + 1}")
        if x[0] != 0.0:
            raise InvalidParameter(f"x_mm starts at {x[0]:g} mm; it must start on the axis, at 0")
        if not np.all(np.diff(x) > 0):
            i = int(np.argmin(np.diff(x) > 0))
            raise InvalidParameter(f"x_mm does not grow after point {i} ({x[i]:g} then {x[i + 1]:g} mm)")
        object.__setattr__(self, "x_mm", x)
        object.__setattr__(self, "z_mm", z)
        rim: float | None = self.rim_radius_mm
        object.__setattr__(self, "rim_radius_mm", x[-1] if rim is None else rim)
        if rim is not None and number("rim_radius_mm", rim) > x[-1]:
            raise InvalidParameter(
                f"rim_radius_mm = {rim:g} lies beyond the last point of the profile; it is valid up to {x[-1]:g}"
            )
        self._check()

    @classmethod
    @checked
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

    def deviated(self, share: float) -> list[SmoothCurve]:
        """Return the mirror, and mirrors perturbed by a fraction of each independent deviation.

        The squared changes of any result, divided by the squared fraction, sum to its variance. The
        mirrors extend slightly beyond the rim, for field angles shifted there.
        """
        from scipy.interpolate import BSpline

        fit, rim, share = self.fit, self._rim * (1 + BEYOND), number("share", share)
        curves = [fit.spline, *(BSpline(fit.spline.t, fit.spline.c + share * d, DEGREE) for d in fit.deviations)]
        return [SmoothCurve(rim, curve, self.apex) for curve in curves]

    @property
    def breaks(self) -> Array:
        x = self.fit.spline.t[DEGREE:-DEGREE]
        inner: Array = x[(x > 0) & (x < self.rim_radius_mm)]
        return np.concatenate([[0.0], inner, [self.rim_radius_mm]])

    @cached_property
    def _curve(self) -> SmoothCurve:
        return SmoothCurve(self._rim, self.fit.spline, self.apex)

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x = coordinates("x_mm", x_mm)
        z, slope, curvature = self._curve.profile(x)
        there = (x >= 0.0 if self.apex == "pointed" else np.abs(x) <= self.x_mm[-1]) & (x <= self.x_mm[-1])
        return tuple(np.where(there, a, np.nan) for a in (z, slope, curvature))  # type: ignore[return-value]
