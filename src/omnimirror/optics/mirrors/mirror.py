"""Mirror interface: sag, slope and curvature of a meridian; secondary mirror.

The vertex is at the origin and z points from the lens to the mirror; a mirror convex towards the
lens has ``z = sag(x) >= 0``. Subclasses are frozen dataclasses with parameters, described in
``PARAMETERS``, and their kernels; sensor files, sliders, optimisers and tolerances use this
description and need no code per mirror.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import check_fields, coordinates, number
from ...base.errors import InvalidParameter, OutsideMirror
from ...base.parameters import Parameter
from ...base.typing import Array
from .measured import ColumnFile

# -- Mirror interface ------------------------------------------------------------------------------

APEX = 1e-6  # of the rim radius: odd functions are linear to 1e-12 within
RIM_RADIUS = Parameter("mm", 1e-3, 1e5, "radius of the mirror's rim")


class Mirror(ABC):
    """Mirror of revolution; lengths in mm, slope angles from ``slope = dz/dx = tan(beta)``."""

    KIND: ClassVar[str]
    """Name of the mirror in sensor files."""
    PARAMETERS: ClassVar[dict[str, Parameter]]
    """Parameters in the order of the fields."""

    FILES: ClassVar[tuple[ColumnFile, ...]] = ()
    """Entries that may name a file with parameters."""

    rim_radius_mm: float

    @abstractmethod
    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        """Compute sag, slope and curvature, each of the shape of x; NaN outside the surface."""

    def sag(self, x_mm: ArrayLike) -> Array:
        """Compute the height z above the vertex plane, mm."""
        return self.profile(x_mm)[0]

    def slope(self, x_mm: ArrayLike) -> Array:
        """Compute dz/dx = tan(beta), dimensionless (Eq. 2)."""
        return self.profile(x_mm)[1]

    def curvature(self, x_mm: ArrayLike) -> Array:
        """Compute d2z/dx2, 1/mm, used in the tangential radius (Eq. 14)."""
        return self.profile(x_mm)[2]

    def radius_t(self, x_mm: ArrayLike) -> Array:
        """Compute the tangential radius of curvature, mm (Eq. 14)."""
        _, slope, curvature = self.profile(x_mm)
        return tangential_radius(slope, curvature)

    def radius_s(self, x_mm: ArrayLike) -> Array:
        """Compute the sagittal radius of curvature, mm (Eq. 18)."""
        x = coordinates("x_mm", x_mm)
        _, slope, curvature = self.profile(x)
        return sagittal_radius(x, slope, curvature)

    @property
    def is_pointed(self) -> bool:
        """True for a mirror with an apex (a cone), without tangent plane on the axis."""
        return bool(self.slope(0.0) != 0.0)

    def scaled(self, factor: float) -> Self:
        """Return the mirror scaled uniformly: all lengths are multiplied by a factor."""
        factor = number("factor", factor, above=0.0)

        def scaled_value(name: str) -> Any:
            value, unit = getattr(self, name), self.PARAMETERS[name].unit
            power = {"mm": 1, "um": 1, "nm": 1, "1/mm": -1}.get(unit, 0)
            if value is None or not power:
                return value
            return (
                tuple(v * factor**power for v in value)
                if isinstance(value, tuple)
                else value * factor**power
            )

        return replace(self, **{name: scaled_value(name) for name in self.PARAMETERS})  # type: ignore[type-var]  # each is one

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Extent of the meridian in mm, ``((x_min, x_max), (z_min, z_max))``."""
        z = self.sag(np.linspace(0.0, self.rim_radius_mm, 513))
        return (0.0, self.rim_radius_mm), (float(z.min()), float(z.max()))

    @property
    def breaks(self) -> Array | None:
        """Ends of the polynomial pieces (degree <= 5) of the sag, mm; None for other mirrors."""
        return None

    @classmethod
    def from_spec(cls, data: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """Load the column file that a mirror table names; a folder of None forbids files."""
        for file in cls.FILES:
            data = file.followed(data, folder)
        return data

    @classmethod
    def file_entries(cls) -> dict[str, tuple[str, ...]]:
        """Return the entries of a mirror table that name a file, with the entries that it provides."""
        return {file.entry: file.columns for file in cls.FILES}

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the parameters only; cached results are recomputed."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]  # subclasses are dataclasses

    def _check(self) -> None:
        """Check that all parameters are in range and that the surface extends to the rim."""
        self._check_parameters()
        self._check_surface()

    def _check_parameters(self) -> None:
        check_fields(self)
        for f in fields(self):  # type: ignore[arg-type]  # subclasses are dataclasses
            if (value := getattr(self, f.name)) is not None:
                self.PARAMETERS[f.name].check(f.name, value)

    def _check_surface(self) -> None:
        x = np.linspace(0.0, self.rim_radius_mm, 513)
        with np.errstate(all="ignore"):
            z, slope, curvature = self.profile(x)
        missing = ~(np.isfinite(z) & np.isfinite(slope) & np.isfinite(curvature))
        if missing.any():
            extent = self._reach(x[int(np.argmax(missing))])
            raise OutsideMirror(
                f"rim_radius_mm must be less than {extent:.6g} mm, where the {self.KIND} ends; "
                f"got {self.rim_radius_mm:g}"
            )

    def _reach(self, first_missing_mm: float) -> float:
        """Return the radius of the surface's end; overridden if known exactly."""
        return first_missing_mm


def near_apex(u: Array, linear: Array, value: Array) -> Array:
    """Replace values (n,) of an odd spline near its centre (|u| < APEX) by the linear term.

    The absolute rounding error of the spline, 1e-18, would dominate the small values there.
    """
    return np.where(np.abs(u) < APEX, linear, value)


def tangential_radius(slope: Array, curvature: Array) -> Array:
    """Compute Eq. 14, mm.

    >>> tangential_radius(np.array([0.0, 0.75]), np.array([0.02, 0.0390625]))  # sphere of 50 mm
    array([50., 50.])
    """
    with np.errstate(divide="ignore"):
        return (1 + slope**2) ** 1.5 / curvature


def sagittal_radius(x: Array, slope: Array, curvature: Array) -> Array:
    """Compute Eq. 18, mm: the length of the normal from the surface to the axis.

    At the apex, the limit is 1/z'' for a smooth mirror and 0 for a cone.

    >>> sagittal_radius(np.array([0.0, 30.0]), np.array([0.0, 0.75]), np.array([0.02, 0.0390625]))
    array([50., 50.])
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(slope == 0.0, 1 / curvature, x * np.sqrt(1 + slope**2) / slope)


# -- Secondary mirror ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Secondary:
    """Mirror that faces the primary and reflects its light to the camera.

    Parameters
    ----------
    mirror
        Shape as seen from the camera: convex for a sag increasing outwards, concave for a
        decreasing one, or flat. Its rim obscures the centre of the field.
    distance_mm : mm
        Distance s from the vertex of the primary to that of the secondary. The lens is at ``m - s``
        from the secondary, towards the primary; m is the path from lens to primary over the
        secondary.
    bore_radius_mm : mm
        Radius of the bore in the primary for the camera; for a lens in front of the primary, radius
        of the camera's front.

    Raises
    ------
    InvalidParameter
        If the position or the bore is outside its range.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Flat
    >>> Secondary(Flat(22.0), distance_mm=90.0, bore_radius_mm=5.0).lens_height(180.0)
    0.0
    """

    mirror: Mirror
    distance_mm: float
    bore_radius_mm: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "distance_mm": Parameter(
            "mm", 1e-3, 1e7, "distance from the vertex of the primary to that of the secondary (s)"
        ),
        "bore_radius_mm": Parameter(
            "mm", 0.0, 1e5, "radius of the bore in the primary, or of the camera's front"
        ),
    }

    def __post_init__(self) -> None:
        for name, parameter in self.PARAMETERS.items():
            parameter.check(name, getattr(self, name))

    def lens_height(self, mirror_distance_mm: float) -> float:
        """Return the height z (mm) of the lens above the primary's vertex."""
        return mirror_distance_mm - 2 * self.distance_mm

    def height(self, x_mm: Array) -> Array:
        """Return heights z (mm) above the primary's vertex, at distances x (n,)."""
        return -self.distance_mm - self.mirror.sag(x_mm)

    def check_before(self, primary: Mirror, mirror_distance_mm: float) -> None:
        """Check that the secondary is between lens and primary without contact to the primary."""
        if not self.distance_mm < mirror_distance_mm:
            raise InvalidParameter(
                f"distance_mm must be less than mirror_distance_mm = {mirror_distance_mm:g}, "
                f"the path from lens to primary over the secondary; got {self.distance_mm:g}"
            )
        x = np.linspace(0.0, min(primary.rim_radius_mm, self.mirror.rim_radius_mm), 513)
        gap = primary.sag(x) - self.height(x)
        if not (gap > 0).all():
            raise InvalidParameter(
                f"distance_mm must be greater than {self.distance_mm - gap.min():.6g} mm, where "
                f"the mirrors touch; got {self.distance_mm:g}"
            )
