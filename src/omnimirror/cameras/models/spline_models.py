"""Spline camera models: radius and viewpoint as splines of the field angle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Self

import numpy as np

from ...base.arguments import finite, format_value, integer, number
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.numerics import increasing_inverse, increasing_root
from ...base.typing import Array
from ._distortion import MIN_RATE
from .camera_model import MAX_PX, AngleRates, ParameterSlot, RadialModel, RadialProjection

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

# -- Even and odd cubic splines on uniform knots ---------------------------------------------------
#
# A spline through knots mirrored about 0 is odd or even; only its part above 0 is kept.


@lru_cache(maxsize=64)
def odd_basis(count: int, end: float) -> PPoly:
    """Return odd splines, ``f(-x) = -f(x)``, with the value 1 at one of ``count`` uniform knots up
    to ``end`` and 0 at the others; ``count`` is 3 or more.

    >>> spline = spline_through(odd_basis(4, 2.0), np.array([0.5, 1.0, 1.5, 2.0]) ** 3)
    >>> spline(np.array([0.3, 1.7])).round(12)  # exact for cubics
    array([0.027, 4.913])
    """
    from scipy.interpolate import CubicSpline, PPoly

    knots, values = np.linspace(0.0, end, count + 1), np.eye(count + 1)[:, 1:]
    spline = CubicSpline(
        np.concatenate([-knots[:0:-1], knots]), np.concatenate([-values[:0:-1], values])
    )
    coefficients = spline.c[:, count:]
    coefficients[[1, 3], 0] = 0.0  # exact zero: rounding would affect radii near the axis
    return PPoly(coefficients, knots)


@lru_cache(maxsize=64)
def even_basis(count: int, end: float) -> PPoly:
    """Return even splines, ``f(-x) = f(x)``, with the value 1 at one of ``count`` uniform knots up
    to ``end`` and 0 at the others; they are parabolic below the first knot.

    >>> spline = spline_through(even_basis(4, 2.0), np.array([0.5, 1.0, 1.5, 2.0]) ** 2)
    >>> spline(np.array([0.3, 1.7])).round(12)
    array([0.09, 2.89])
    """
    from scipy.interpolate import CubicSpline

    knots, values = np.linspace(0.0, end, count + 1)[1:], np.eye(count)
    return CubicSpline(
        np.concatenate([-knots[::-1], knots]), np.concatenate([values[::-1], values])
    )


def spline_through(basis: PPoly, values: Array) -> PPoly:
    """Return the spline with values (n,) at the knots of a basis."""
    from scipy.interpolate import PPoly

    return PPoly(basis.c @ values, basis.x)


# -- Camera models ---------------------------------------------------------------------------------

NODES_PER_CELL = 16  # nodes of the table of initial values for inversion
MIN_KNOTS = 3
MAX_FITTED_KNOTS, MAX_FIT_ERROR_PX = 16, 0.5  # limits of a spline fitted to another model
FIT_SAMPLES = 2001
MAX_MM = 1e6
MIN_FIELD_DEG = 1e-3  # star trackers have degrees; rates of narrower fields would overflow


@dataclass(frozen=True, kw_only=True)
class SplineModel(RadialModel):
    """Radius given by a cubic spline of the field angle, odd about the axis.

    Parameters
    ----------
    radii_px : (n,) px
        Radii at the knots, increasing, three or more.
    field_deg : deg
        Full field angle, up to the last knot.
    stretch_x, shear
        Affine distortion of the circular image.
    p1, p2 : 1/px
        Tangential distortion.
    **others
        Parameters of :class:`RadialModel`.
    """

    radii_px: tuple[float, ...]
    field_deg: float
    stretch_x: float = 0.0
    shear: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    AFFINE = (((1.0, 0.0), (0.0, -1.0)), ((0.0, 1.0), (1.0, 0.0)))
    LENS = {"p1": ("1/px", 1e-5), "p2": ("1/px", 1e-5)}  # noqa: RUF012

    def __post_init__(self) -> None:
        super().__post_init__()
        number("field_deg", self.field_deg, low=MIN_FIELD_DEG, high=360.0, unit="deg")
        radii = finite("radii_px", self.radii_px, high=MAX_PX, unit="px")
        if radii.ndim != 1 or len(radii) < MIN_KNOTS or not (np.diff(radii, prepend=0.0) > 0).all():
            raise InvalidParameter(
                f"radii_px must be at least {MIN_KNOTS} increasing radii greater than 0; "
                f"got {format_value(self.radii_px)}"
            )
        for name in ("stretch_x", "shear"):
            number(name, getattr(self, name), low=-0.5, high=0.5)

    @property
    def matrix(self) -> Array:
        """Stretch and shear (2, 2); rotation belongs to the mount, scale to the radii."""
        s, h = self.stretch_x, self.shear
        return np.array([[1 + s, h], [h, 1 - s]])

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        slots = tuple(
            ParameterSlot(f"r{i}", "radii_px", i - 1, "px", 1.0)
            for i in range(1, len(self.radii_px) + 1)
        )
        return slots, (
            ParameterSlot("stretch_x", "stretch_x", None, "", 0.01),
            ParameterSlot("shear", "shear", None, "", 0.01),
        )

    @property
    def _basis(self) -> PPoly:
        return odd_basis(len(self.radii_px), float(np.radians(self.field_deg / 2)))

    @cached_property
    def _spline(self) -> PPoly:
        return spline_through(self._basis, np.array(self.radii_px))

    @cached_property
    def _projection_end(self) -> float:
        rate = self._spline.derivative()
        ends = rate.solve(MIN_RATE * float(rate(0.0)), extrapolate=False)
        falling = ends[rate(ends, 1) < 0]
        return float(falling.min(initial=np.radians(self.field_deg / 2)))

    def _projected_radius(self, omega: Array) -> Array:
        return np.asarray(self._spline(omega))

    def _projection(self, omega: Array) -> RadialProjection:
        return RadialProjection(self._spline(omega), self._spline(omega, 1), self._basis(omega))

    def _inverse_projection(self, radius: Array) -> Array:
        return increasing_inverse(
            lambda omega: (self._spline(omega), self._spline(omega, 1)), radius, *self._table
        )

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        omegas = np.linspace(0.0, self._projection_end, NODES_PER_CELL * len(self.radii_px) + 1)
        return omegas, self._spline(omegas)


def _fitted_parameters(
    camera: RadialModel, knots: int | None, min_knots: int, field_deg: float | None
) -> dict[str, object]:
    """Return radii, centre, stretch and orientation of another model for a spline."""
    model_field = float(np.degrees(2 * camera.model_end))
    if field_deg is None:  # radii of some models are unbounded; the image limits them
        is_unbounded = (
            not float(camera.radius_from_omega(np.array([camera.model_end]))[0]) <= MAX_PX
        )
        field_deg = float(np.degrees(2 * camera.omega_max)) if is_unbounded else model_field
    field = number("field_deg", field_deg, low=MIN_FIELD_DEG, high=360.0, unit="deg")
    if field > model_field * (1 + 1e-9):
        raise InvalidParameter(
            f"field_deg must be at most {model_field:g} deg, the field of the model; got {field:g}"
        )
    end = float(np.radians(field / 2))
    count = (
        _sufficient_knots(camera, min_knots, end)
        if knots is None
        else integer("knots", knots, MIN_KNOTS)
    )
    omega = np.minimum(np.arange(1, count + 1) / count * end, camera.model_end)
    half = (camera.stretch + camera.stretch.T) / 2
    mean = half.trace() / 2
    return {
        "radii_px": tuple((mean * camera.radius_from_omega(omega)).tolist()),
        "field_deg": field,
        "centre_px": camera.centre_px,
        "image_size": camera.image_size,
        "stretch_x": float((half[0, 0] - half[1, 1]) / 2 / mean),
        "shear": float(half[0, 1] / mean),
        "optics": camera.optics,
        "mount": camera.mount,
        "rim_radius_px": camera.rim_radius_px,
    }


def _sufficient_knots(camera: RadialModel, min_knots: int, end: float) -> int:
    """Return the number of even knots that fit the radii of a model.

    Radii of a mirror with low resolution at the rim increase rapidly there and need many cubic
    pieces.
    """
    omega = np.linspace(0.0, end, FIT_SAMPLES)
    radii = camera.radius_from_omega(np.minimum(omega, camera.model_end))
    for count in range(min_knots, MAX_FITTED_KNOTS):
        spline = spline_through(
            odd_basis(count, end),
            np.interp(np.arange(1, count + 1) / count * end, omega, radii),
        )
        if np.abs(spline(omega) - radii).max() <= MAX_FIT_ERROR_PX:
            return count
    return MAX_FITTED_KNOTS


@dataclass(frozen=True, kw_only=True)
class RadialSpline(SplineModel):
    """Central camera without a formula: the radius is a cubic spline of the field angle.

    Knots are equally spaced from the axis, with radius 0, to half of ``field_deg``, the end of the
    field; it also ends if the rate of the radius falls below 1 % of that at the centre. OpenCV's
    tangential terms follow, and a matrix ``[[1 + stretch_x, shear], [shear, 1 - stretch_x]]``.

    Parameters
    ----------
    **others
        Parameters of :class:`SplineModel`.

    Examples
    --------
    >>> camera = RadialSpline(
    ...     radii_px=(100.0, 200.0, 300.0),
    ...     field_deg=270.0,
    ...     centre_px=(319.5, 319.5),
    ...     image_size=(640, 640),
    ... )
    >>> camera.image([[10.0, 0.0, 0.0]]).pixels  # 90 deg from the axis
    array([[519.5, 319.5]])
    """

    KIND = "radial-spline"

    @classmethod
    def from_model(
        cls, camera: RadialModel, knots: int | None = None, field_deg: float | None = None
    ) -> Self:
        """Fit a spline to another model's radii, without tangential distortion.

        Parameters
        ----------
        camera
            Any radial model.
        knots
            Number of knots, 3 or more; by default 6, or as many as required for 0.5 px, 16 at most.
        field_deg : deg, optional
            Full field angle; by default that of the other model, or that of its image if its radii
            are unbounded.

        Returns
        -------
        RadialSpline
            Fitted spline.

        Raises
        ------
        InvalidParameter
            If the field is wider than that of the other model.
        """
        return cls(**_fitted_parameters(camera, knots, 6, field_deg))  # type: ignore[arg-type]  # types of the keywords depend on their names


@dataclass(frozen=True, kw_only=True)
class ViewpointSpline(SplineModel):
    """Non-central camera with viewpoints given by a spline of the field angle.

    The radius is that of :class:`RadialSpline`. A ray of field angle Omega starts at ``z(Omega)``
    along the axis, in the direction of the image centre, from the origin of the camera frame. z is
    an even cubic spline through ``viewpoints_mm`` at the same knots. A constant in z is equivalent
    to a translation of the scene: the middle knot is fixed and not a parameter. Points are valid if
    they are farther from their viewpoint than the caustic of the rays, :attr:`nearest_mm`.

    Parameters
    ----------
    viewpoints_mm : (n,) mm
        Viewpoints at the knots.
    **others
        Parameters of :class:`SplineModel`.

    Examples
    --------
    Objects at 90 deg are at the height of that ray's viewpoint:

    >>> camera = ViewpointSpline(
    ...     radii_px=(100.0, 200.0, 300.0),
    ...     viewpoints_mm=(0.0, 2.0, 5.0),
    ...     field_deg=270.0,
    ...     centre_px=(319.5, 319.5),
    ...     image_size=(640, 640),
    ... )
    >>> camera.image([[100.0, 0.0, -2.0]]).pixels
    array([[519.5, 319.5]])
    """

    viewpoints_mm: tuple[float, ...]

    KIND = "viewpoint-spline"

    def __post_init__(self) -> None:
        super().__post_init__()
        heights = finite("viewpoints_mm", self.viewpoints_mm, -MAX_MM, MAX_MM, unit="mm")
        if heights.shape != (len(self.radii_px),):
            raise InvalidParameter(
                f"viewpoints_mm must have one value for each of the {len(self.radii_px)} knots; "
                f"got {format_value(self.viewpoints_mm)}"
            )

    @classmethod
    def from_model(
        cls, camera: RadialModel, knots: int | None = None, field_deg: float | None = None
    ) -> Self:
        """Fit a spline to another model's radii and viewpoints, as an initial value.

        Parameters
        ----------
        camera
            Any radial model; the viewpoints of a central one are 0.
        knots
            Number of knots, 3 or more; by default 8, or as many as required for 0.5 px, 16 at most.
        field_deg : deg, optional
            Full field angle; by default that of the other model, or that of its image if its radii
            are unbounded.

        Returns
        -------
        ViewpointSpline
            Fitted spline.

        Raises
        ------
        InvalidParameter
            If the field is wider than that of the other model.
        """
        start = _fitted_parameters(camera, knots, 8, field_deg)
        count = len(start["radii_px"])  # type: ignore[arg-type]  # values differ in type
        omega = np.radians(float(start["field_deg"]) / 2) * np.arange(1, count + 1) / count  # type: ignore[arg-type]  # values differ in type
        inside = np.minimum(omega, camera.model_end)
        heights = (
            camera._heights(inside) if isinstance(camera, ViewpointSpline) else np.zeros(count)
        )
        start["viewpoints_mm"] = tuple(heights.tolist())
        return cls(**start)  # type: ignore[arg-type]  # types of the keywords depend on their names

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        radii, affine = super()._parameter_slots
        heights = (
            ParameterSlot(f"z{i + 1}", "viewpoints_mm", i, "mm", 1.0) for i in self._free_heights
        )
        return (*radii, *heights), affine

    @property
    def _free_heights(self) -> list[int]:
        count = len(self.viewpoints_mm)
        return [i for i in range(count) if i != count // 2]

    @property
    def _height_basis(self) -> PPoly:
        return even_basis(len(self.viewpoints_mm), float(np.radians(self.field_deg / 2)))

    @cached_property
    def _heights(self) -> PPoly:
        return spline_through(self._height_basis, np.array(self.viewpoints_mm))

    @cached_property
    def nearest_mm(self) -> float:
        """Minimum distance, mm, of valid points: that of the farthest ray intersection."""
        omega = np.linspace(0.0, self.model_end, NODES_PER_CELL * len(self.radii_px) + 1)
        return float(np.abs(self._heights(omega, 1) * np.sin(omega)).max())

    @property
    def is_central(self) -> bool:
        return False

    def _viewpoint_mm(self, omega: Array) -> Array:
        return np.asarray(self._heights(omega))

    def _ray_origins(self, omega: Array) -> tuple[Array, Array]:
        """Return ray origins beyond all ray intersections, on a shell about the viewpoints."""
        return self.nearest_mm * np.sin(omega), self._heights(omega) + self.nearest_mm * np.cos(
            omega
        )

    def _field_angle(self, rho: Array, z: Array, distant: bool) -> Array:
        """Solve ``(z - z(Omega)) sin(Omega) = rho cos(Omega)`` for the ray through a point.

        The difference of both sides has a single sign change, from negative to positive, because
        points behind the ray origin are excluded.
        """
        if distant:
            return super()._field_angle(rho, z, distant)
        is_finite = np.isfinite(rho) & np.isfinite(z)
        rho, z = np.where(is_finite, rho, 0.0), np.where(is_finite, z, 0.0)
        end = self.model_end

        def difference(omega: Array) -> tuple[Array, Array]:
            sin, cos, inside = np.sin(omega), np.cos(omega), np.minimum(omega, end)
            height = z - self._heights(inside)
            rate = np.where(omega < end, self._heights(inside, 1), 0.0)
            return height * sin - rho * cos, height * cos + rho * sin - rate * sin

        first = np.minimum(np.arctan2(rho, z), end)
        start = np.arctan2(rho, z - self._heights(first))
        omega = increasing_root(
            difference, np.zeros_like(rho), np.full_like(rho, np.pi), start, np.pi
        )
        distance = (z - self._heights(np.minimum(omega, end))) * np.cos(omega) + rho * np.sin(omega)
        return np.where(is_finite & (distance > self.nearest_mm), omega, np.nan)

    def _angle_rates(self, omega: Array, rho: Array, z: Array, distant: bool) -> AngleRates:
        """Compute derivatives of the same equation by the implicit function theorem."""
        if distant:
            central = super()._angle_rates(omega, rho, z, distant)
            return central._replace(terms=np.zeros((len(omega), len(self._free_heights))))
        sin, cos, inside = np.sin(omega), np.cos(omega), np.minimum(omega, self.model_end)
        weights = self._height_basis(inside)
        rate = (z - self._heights(inside)) * cos + (rho - self._heights(inside, 1)) * sin
        return AngleRates(
            cos / rate, -sin / rate, (sin / rate)[:, None] * weights[:, self._free_heights]
        )
