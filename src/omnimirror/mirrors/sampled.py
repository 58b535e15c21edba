"""A mirror given by points of its meridian: measured, or computed elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidParameter
from ..parameters import Parameter
from .base import RIM_RADIUS, Array, Mirror
from .columns import PROFILE_FILE, read_columns

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 5  # quintic: the curvature is then a smooth cubic, as good a spline as the sag has elsewhere


@dataclass(frozen=True)
class SampledProfile(Mirror):
    """A quintic spline (C4) through points (x, z) from the axis to at least the rim.

    The points are taken over to the other side of the axis, evenly for a smooth apex, so that the
    slope is exactly zero there; a ``"pointed"`` apex is left as it comes. Sags count from the first
    point.

    Parameters
    ----------
    x_mm, z_mm : sequences of at least 6 numbers, mm
        x starts at 0 and grows.
    rim_radius_mm : mm, optional
        The last x by default.
    apex : "smooth" or "pointed"

    Raises
    ------
    InvalidParameter
        Too few points, x not growing from 0, different lengths, or a rim beyond the last point.

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

    KIND: ClassVar[str] = "sampled"
    FILE = PROFILE_FILE
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "x_mm": Parameter("mm", 0.0, 1e5, "distances from the axis, growing from 0"),
        "z_mm": Parameter("mm", -1e5, 1e5, "heights, growing away from the lens"),
        "rim_radius_mm": RIM_RADIUS,
        "apex": Parameter("", 0, 0, "shape at the axis", choices=("smooth", "pointed")),
    }

    def __post_init__(self) -> None:
        x, z = (tuple(float(v) for v in a) for a in (self.x_mm, self.z_mm))
        if len(x) != len(z):
            raise InvalidParameter(f"x_mm has {len(x)} points and z_mm {len(z)}; they need the same number")
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
        if rim is not None and rim > x[-1]:
            raise InvalidParameter(
                f"rim_radius_mm = {rim:g} lies beyond the last point of the profile; it is valid up to {x[-1]:g}"
            )
        self._check()

    @classmethod
    def from_csv(cls, path: str | Path, rim_radius_mm: float | None = None, apex: str = "smooth") -> SampledProfile:
        """Read a profile from a CSV file of two columns x, z in mm; lines that hold no number are skipped.

        Raises
        ------
        OmnimirrorError
            The file is missing, or a line after the first number does not hold two numbers.
        """
        x, z = read_columns(Path(path))
        return cls(x, z, rim_radius_mm, apex)

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline, BSpline]:
        from scipy.interpolate import make_interp_spline

        x, z = np.array(self.x_mm), np.array(self.z_mm) - self.z_mm[0]
        if self.apex == "smooth":
            x, z = np.concatenate([-x[:0:-1], x]), np.concatenate([z[:0:-1], z])
        spline = make_interp_spline(x, z, k=DEGREE)
        return spline, spline.derivative(), spline.derivative(2)

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        x = np.asarray(x_mm, dtype=float)
        z, slope, curvature = (np.asarray(s(x, extrapolate=False)) for s in self._splines)
        if self.apex == "smooth":
            slope = np.where(x == 0.0, 0.0, slope)  # by symmetry; the spline says 1e-18
        return z, slope, curvature
