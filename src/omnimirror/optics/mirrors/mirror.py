"""Mirrors: interface, closed-form shapes, secondary mirror, pose and form error.

The vertex is at the origin and z points from the lens to the mirror; a mirror convex towards the
lens has ``z = sag(x) >= 0``. Subclasses of :class:`Mirror` are frozen dataclasses with parameters,
described in ``PARAMETERS``, and their kernels; sensor files, sliders, optimisers and tolerances use
this description and need no code per mirror. :class:`MirrorPose` and :class:`MirrorForm` describe
the deviations of an as-built mirror from its shape.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import check_fields, coordinates, floats, number
from ...base.caching import cached_property
from ...base.errors import InvalidParameter, OutsideMirror
from ...base.numerics import monomial_index, noll, zernike_powers, zernike_terms
from ...base.parameters import Parameter
from ...base.typing import Array
from ...cameras.camera import rotate_vectors
from .measured import ColumnFile

# -- Mirror interface ------------------------------------------------------------------------------

APEX = 1e-6  # relative to the rim radius: odd functions are linear to 1e-12 within
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


# -- Conics and aspheres ---------------------------------------------------------------------------
#
# All conics share one formula in the vertex radius ``R`` and the conic constant ``k``
# (``k = -e**2``): sphere 0, paraboloid -1, hyperboloid < -1, prolate ellipsoid between -1 and 0,
# oblate > 0.
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


# -- Pose of an as-built mirror --------------------------------------------------------------------
#
# All values are in the camera frame (X right and Y down in the image, Z from the lens to the mirror),
# with its origin at the nominal mirror vertex. The mirror is first rotated about its own vertex, by
# ``tilt_x_deg`` about X and then by ``tilt_y_deg`` about Y (right-hand rule), and then translated by
# ``(decentre_x_mm, decentre_y_mm, displacement_mm)``.

SHIFT = (-1e4, 1e4)
TILT = (-60.0, 60.0)


@dataclass(frozen=True)
class MirrorPose:
    """Pose of a mirror relative to its lens; aligned by default.

    Parameters
    ----------
    decentre_x_mm, decentre_y_mm
        Shift of the vertex to the right and down in the image.
    displacement_mm
        Shift of the vertex away from the lens, added to the sensor's ``mirror_distance_mm``.
    tilt_x_deg, tilt_y_deg
        Rotation about the vertex: about X, then about Y. A small positive ``tilt_y_deg`` tilts the
        far end of the mirror axis to the right, a small positive ``tilt_x_deg`` upwards (to -Y).

    Raises
    ------
    InvalidParameter
        If a number is outside its range.

    Examples
    --------
    >>> pose = MirrorPose(decentre_x_mm=0.5, tilt_y_deg=90.0 / 2)
    >>> pose.to_camera([[0.0, 0.0, 1.0]]).round(4)  # a point of the mirror axis leans to the right
    array([[1.2071, 0.    , 0.7071]])
    >>> pose.to_mirror(pose.to_camera([[3.0, -2.0, 1.0]])).round(9)
    array([[ 3., -2.,  1.]])
    """

    decentre_x_mm: float = 0.0
    decentre_y_mm: float = 0.0
    displacement_mm: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "decentre_x_mm": Parameter(
            "mm", *SHIFT, "decentring of the vertex to the right in the image"
        ),
        "decentre_y_mm": Parameter("mm", *SHIFT, "decentring of the vertex downwards in the image"),
        "displacement_mm": Parameter("mm", *SHIFT, "displacement of the vertex away from the lens"),
        "tilt_x_deg": Parameter(
            "deg",
            *TILT,
            "rotation about the X axis of the image, through the vertex; applied first",
        ),
        "tilt_y_deg": Parameter(
            "deg", *TILT, "rotation about the Y axis of the image, through the vertex"
        ),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))

    @property
    def is_axial(self) -> bool:
        """True if mirror and lens are coaxial: neither decentred nor tilted."""
        return not (self.decentre_x_mm or self.decentre_y_mm or self.tilt_x_deg or self.tilt_y_deg)

    @property
    def shift(self) -> Array:
        """Vertex (3,), mm, in the camera frame."""
        return np.array([self.decentre_x_mm, self.decentre_y_mm, self.displacement_mm])

    def rotation(self) -> Array:
        """Return the rotation (3, 3) from the mirror frame to the camera frame."""
        (cx, cy), (sx, sy) = (
            f(np.radians([self.tilt_x_deg, self.tilt_y_deg])) for f in (np.cos, np.sin)
        )
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        rotation: Array = about_y @ about_x
        return rotation

    def to_camera(self, points: ArrayLike) -> Array:
        """Convert points (n, 3), mm, from the mirror frame to the camera frame."""
        return self.rotate_to_camera(points) + self.shift

    def to_mirror(self, points: ArrayLike) -> Array:
        """Convert points (n, 3), mm, from the camera frame to the mirror frame."""
        return self.rotate_to_mirror(np.asarray(points, dtype=float) - self.shift)

    def rotate_to_camera(self, directions: ArrayLike) -> Array:
        """Convert directions (n, 3) from the mirror frame to the camera frame."""
        return rotate_vectors(directions, self.rotation().T)

    def rotate_to_mirror(self, directions: ArrayLike) -> Array:
        """Convert directions (n, 3) from the camera frame to the mirror frame."""
        return rotate_vectors(directions, self.rotation())


# -- Form error in Zernike terms -------------------------------------------------------------------

MAX_ORDER = 12
TERMS = zernike_terms(MAX_ORDER)
"""Number of Zernike terms up to the largest order, and exponents of ``x^i y^j``."""
MM_PER_UM = 1e-3


class SurfaceHeights(NamedTuple):
    """Heights of a surface, or of its form error, with derivatives; arrays of one shape."""

    z: Array
    """mm"""
    gx: Array
    gy: Array
    """First derivatives."""
    hxx: Array
    hxy: Array
    hyy: Array
    """Second derivatives, 1/mm."""


@dataclass(frozen=True)
class MirrorForm:
    """Form error along the axis, positive away from the lens, in the mirror frame; none by default.

    Parameters
    ----------
    zernike
        Noll indices of the Zernike terms over the disc of the rim; up to order 12.
    um
        Amplitude of each term, rms over the disc.

    Raises
    ------
    InvalidParameter
        If a term is invalid or repeated, or the number of amplitudes differs from that of terms.

    Examples
    --------
    >>> form = MirrorForm((5, 8), (0.3, -0.1))
    >>> bool(abs(form.heights(20.0, np.array([[20.0, 0.0]])).z[0] / 1e-3 + 0.1 * 8**0.5) < 1e-12)  # coma at the rim
    True
    """

    zernike: tuple[int, ...] = ()
    um: tuple[float, ...] = ()

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "zernike": Parameter("", 1, TERMS, "Zernike terms of the form error (Noll indices)"),
        "um": Parameter(
            "um", -1e4, 1e4, "rms of each term over the disc of the rim, along the axis"
        ),
    }

    def __post_init__(self) -> None:
        for name, parameter in self.PARAMETERS.items():
            parameter.check(name, getattr(self, name))
        terms = np.array(self.zernike, dtype=float)
        if (terms != np.round(terms)).any() or len(set(terms)) != len(terms):
            raise InvalidParameter(
                f"zernike must contain different indices of terms; got {list(self.zernike)}"
            )
        if len(self.um) != len(terms):
            raise InvalidParameter(
                f"um must have one amplitude for each of the {len(terms)} terms; got {len(self.um)}"
            )
        object.__setattr__(self, "zernike", tuple(int(j) for j in terms))
        object.__setattr__(self, "um", tuple(float(v) for v in self.um))

    @property
    def is_empty(self) -> bool:
        """True without form error."""
        return not any(self.um)

    @cached_property
    def _powers(self) -> Array:
        """Coefficients (n, n), mm, of (x/rim)^i (y/rim)^j."""
        order = max(noll(j)[0] for j in self.zernike)
        rows = zernike_powers(order)
        mixed = MM_PER_UM * sum(
            um * rows[j - 1] for j, um in zip(self.zernike, self.um, strict=True)
        )
        square = np.zeros((order + 1, order + 1))
        for i in range(order + 1):
            for j in range(order + 1 - i):
                square[i, j] = np.asarray(mixed)[monomial_index(i, j)]
        return square

    def heights(self, rim_mm: float, xy: Array) -> SurfaceHeights:
        """Compute heights and derivatives at points (n, 2), mm, for a rim radius."""
        count = len(xy)
        if self.is_empty:
            return SurfaceHeights(*np.zeros((6, count)))
        u, v = (xy / rim_mm).T
        size = len(self._powers)
        powers = np.arange(size)
        rows, columns = ([_derived(w, powers, k) for k in range(3)] for w in (u, v))

        def summed(a: int, b: int) -> Array:
            total: Array = np.einsum(
                "ni,ij,nj->n", rows[a], self._powers, columns[b], optimize=True
            )
            return total / rim_mm ** (a + b)

        return SurfaceHeights(
            *(summed(a, b) for a, b in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)))
        )


def _derived(w: Array, powers: NDArray[np.intp], times: int) -> Array:
    """Compute derivatives (n, k) of powers of w."""
    factor = np.ones(len(powers))
    for k in range(times):
        factor = factor * (powers - k)
    derived: Array = factor * w[:, None] ** np.maximum(powers - times, 0)
    return derived


NO_FORM = MirrorForm()
