"""Sphere-based models: unified sphere, enhanced unified and double sphere, and the mirror ball."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...base.arguments import number
from ...base.errors import InvalidParameter
from ...base.typing import Array
from .camera_model import ROUNDING, FocalModel, Optics, ParameterSlot, RadialModel, RadialProjection

# -- Projection onto a sphere, then from an offset point onto the image ----------------------------

MAX_SHAPE = 1e4  # largest shape parameter: all larger ones are equivalent


@dataclass(frozen=True, kw_only=True)
class Unified(FocalModel):
    """Unified sphere model with radial and tangential distortion, as in OpenCV's module omnidir.

    A point is projected onto the unit sphere, and from a point ``xi`` behind its centre onto a
    plane: ``r = sin(Omega) / (cos(Omega) + xi)``. The model is exact for hyperboloids and
    paraboloids (xi = 1) in single-viewpoint configuration, and approximate for other mirrors and
    fisheyes. The field ends at the maximum of r, at ``cos(Omega) = -min(xi, 1/xi)``: all but one
    direction for xi = 1, 90 deg for xi = 0 (a pinhole). Distortion that folds the image reduces it.

    Parameters
    ----------
    xi
        Distance of the projection centre from the sphere's centre, 0 or more.
    k1, k2, k3
        Radial distortion; omnidir does not have k3.
    p1, p2
        Tangential distortion.
    **others
        Parameters of :class:`FocalModel`.

    References
    ----------
    C. Mei and P. Rives, "Single view point omnidirectional camera calibration from planar grids", ICRA 2007.

    Examples
    --------
    The horizon of a paraboloid is two mirror focal lengths, here one model focal length, from the
    centre:

    >>> camera = Unified(
    ...     xi=1.0, focal_px=(200.0, 200.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> camera.image([[100.0, 0.0, 0.0]]).pixels
    array([[519.5, 239.5]])
    """

    xi: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    KIND = "unified"
    LENS = {"k1": ("", 0.1), "k2": ("", 0.1), "k3": ("", 0.1), "p1": ("", 0.01), "p2": ("", 0.01)}  # noqa: RUF012

    def __post_init__(self) -> None:
        super().__post_init__()
        number("xi", self.xi, low=0.0, high=MAX_SHAPE)

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        return (ParameterSlot("xi", "xi", None, "", 0.1),), self._affine_slots

    @property
    def _projection_end(self) -> float:
        end_cosine = min(self.xi, 1 / self.xi) if self.xi else 0.0
        return float(np.arccos(-end_cosine)) * (1 - ROUNDING)

    def _projected_radius(self, omega: Array) -> Array:
        return np.sin(omega) / self._depth(omega)

    def _projection(self, omega: Array) -> RadialProjection:
        sin, cos, depth = np.sin(omega), np.cos(omega), self._depth(omega)
        return RadialProjection(
            sin / depth, (1 + self.xi * cos) / depth**2, (-sin / depth**2)[:, None]
        )

    def _depth(self, omega: Array) -> Array:
        """Compute ``cos(Omega) + xi`` without cancellation for xi = 1 at the end of the field."""
        depth: Array = 2 * np.cos(omega / 2) ** 2 + (self.xi - 1)
        return depth

    def _inverse_projection(self, radius: Array) -> Array:
        # The ray (radius, 1) from the point xi behind the centre meets the unit sphere at this length
        # (Mei and Rives, Eq. 4); the root vanishes at the end of the field for xi > 1.
        square = radius * radius
        inside = np.maximum(1 + (1 - self.xi**2) * square, 0.0)
        length = (self.xi + np.sqrt(inside)) / (1 + square)
        return np.arctan2(length * radius, length - self.xi)


@dataclass(frozen=True, kw_only=True)
class EnhancedUnified(FocalModel):
    """Enhanced unified model: an ellipsoid instead of the sphere.

    ``r = sin(Omega) / (alpha q + (1 - alpha) cos(Omega))`` with
    ``q = sqrt(beta sin(Omega)^2 + cos(Omega)^2)``. The field ends at the maximum of r, at
    ``cos(Omega) = -w q`` with w = alpha / (1 - alpha), or 1/w for alpha > 1/2. The unified sphere
    has alpha = xi / (1 + xi) and beta = 1; alpha = 0 is a pinhole.

    Parameters
    ----------
    alpha
        Shape parameter, 0 to 1.
    beta
        Shape parameter, positive.
    **others
        Parameters of :class:`FocalModel`.

    References
    ----------
    B. Khomutenko, G. Garcia and P. Martinet, "An enhanced unified camera model", IEEE RA-L 1(1), 2016.

    Examples
    --------
    >>> camera = EnhancedUnified(
    ...     alpha=0.5,
    ...     beta=1.0,
    ...     focal_px=(100.0, 100.0),
    ...     centre_px=(319.5, 239.5),
    ...     image_size=(640, 480),
    ... )
    >>> camera.image([[100.0, 0.0, 0.0]]).pixels
    array([[519.5, 239.5]])
    """

    alpha: float
    beta: float

    KIND = "enhanced-unified"

    def __post_init__(self) -> None:
        super().__post_init__()
        number("alpha", self.alpha, low=0.0, high=1.0)
        number("beta", self.beta, low=1 / MAX_SHAPE, high=MAX_SHAPE)

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        return (
            ParameterSlot("alpha", "alpha", None, "", 0.01),
            ParameterSlot("beta", "beta", None, "", 0.05),
        ), self._affine_slots

    @property
    def _projection_end(self) -> float:
        w = _field_end_cosine(self.alpha)
        return float(np.arctan2(np.sqrt(1 - w * w), -w * np.sqrt(self.beta))) * (1 - ROUNDING)

    def _projected_radius(self, omega: Array) -> Array:
        sin, cos = np.sin(omega), np.cos(omega)
        with np.errstate(divide="ignore"):  # infinite at the end of the field
            radius: Array = sin / (
                self.alpha * np.sqrt(self.beta * sin**2 + cos**2) + (1 - self.alpha) * cos
            )
        return radius

    def _projection(self, omega: Array) -> RadialProjection:
        a, sin, cos = self.alpha, np.sin(omega), np.cos(omega)
        q = np.sqrt(self.beta * sin**2 + cos**2)
        depth = a * q + (1 - a) * cos
        terms = np.stack([(cos - q) * sin, -a * sin**3 / (2 * q)], axis=-1) / depth[:, None] ** 2
        return RadialProjection(sin / depth, (1 - a + a * cos / q) / depth**2, terms)

    def _inverse_projection(self, radius: Array) -> Array:
        a, square = self.alpha, self.beta * radius * radius
        root = np.sqrt(np.maximum(1 - (2 * a - 1) * square, 0.0))
        return np.arctan2(radius, (1 - a * a * square) / (a * root + 1 - a))


@dataclass(frozen=True, kw_only=True)
class DoubleSphere(FocalModel):
    """Double sphere model: projection onto two unit spheres in sequence.

    ``r = sin(Omega) / (alpha d + (1 - alpha) (xi + cos(Omega)))`` with
    ``d^2 = 1 + 2 xi cos(Omega) + xi^2``. The field ends at the maximum of r, at
    ``(xi + cos(Omega)) / d = -w`` with w = alpha / (1 - alpha), or 1/w for alpha > 1/2; the bound
    of the paper is inside.

    Parameters
    ----------
    xi
        Distance of the spheres' centres, -1 to 1.
    alpha
        Shape parameter, 0 to 1.
    **others
        Parameters of :class:`FocalModel`.

    References
    ----------
    V. Usenko, N. Demmel and D. Cremers, "The double sphere camera model", 3DV 2018.

    Examples
    --------
    >>> camera = DoubleSphere(
    ...     xi=0.0,
    ...     alpha=0.5,
    ...     focal_px=(100.0, 100.0),
    ...     centre_px=(319.5, 239.5),
    ...     image_size=(640, 480),
    ...     optics="fisheye",
    ... )
    >>> camera.image([[0.0, 100.0, 0.0]]).pixels
    array([[319.5, 439.5]])
    """

    xi: float
    alpha: float

    KIND = "double-sphere"

    def __post_init__(self) -> None:
        super().__post_init__()
        number("xi", self.xi, low=-1.0, high=1.0)
        number("alpha", self.alpha, low=0.0, high=1.0)

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        return (
            ParameterSlot("xi", "xi", None, "", 0.05),
            ParameterSlot("alpha", "alpha", None, "", 0.01),
        ), self._affine_slots

    @property
    def _projection_end(self) -> float:
        w = _field_end_cosine(self.alpha)
        distance = np.sqrt(1 - self.xi**2 * (1 - w * w)) - self.xi * w
        return float(np.arccos(np.clip(-distance * w - self.xi, -1.0, 1.0))) * (1 - ROUNDING)

    def _projected_radius(self, omega: Array) -> Array:
        cos = np.cos(omega)
        d = np.sqrt(1 + 2 * self.xi * cos + self.xi**2)
        with np.errstate(divide="ignore"):  # infinite at the end of the field
            radius: Array = np.sin(omega) / (self.alpha * d + (1 - self.alpha) * (self.xi + cos))
        return radius

    def _projection(self, omega: Array) -> RadialProjection:
        xi, a, sin, cos = self.xi, self.alpha, np.sin(omega), np.cos(omega)
        d = np.sqrt(1 + 2 * xi * cos + xi * xi)
        depth = a * d + (1 - a) * (xi + cos)
        growth = a * np.divide(xi + cos, d, out=np.zeros_like(d), where=d > 0) + 1 - a
        terms = np.stack([-sin * growth, -sin * (d - xi - cos)], axis=-1) / depth[:, None] ** 2
        return RadialProjection(sin / depth, (1 + xi * cos) * growth / depth**2, terms)

    def _inverse_projection(self, radius: Array) -> Array:
        xi, a, square = self.xi, self.alpha, radius * radius
        root = np.sqrt(np.maximum(1 - (2 * a - 1) * square, 0.0))
        z = (1 - a * a * square) / (a * root + 1 - a)
        length = (z * xi + np.sqrt(np.maximum(z * z + (1 - xi * xi) * square, 0.0))) / (
            z * z + square
        )
        return np.arctan2(length * radius, length * z - xi)


def _field_end_cosine(alpha: float) -> float:
    """Return the negative cosine, on the last surface, of zero depth or rate."""
    return alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha


# -- Mirror ball -----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class MirrorBall(RadialModel):
    """Reflecting ball, or its part within a circular rim, for distant camera and objects.

    For parallel rays, a sphere of radius A deflects the ray at distance x from its axis by twice
    the slope angle, ``sin(Omega / 2) = x / A``: the projection is exactly equal-area.

    Parameters
    ----------
    rim_radius_px : px
        Radius of the outline.
    field_deg : deg
        Full field angle: the rim is at ``Omega = field_deg / 2``. A complete ball has nearly 360
        deg, a convex traffic mirror much less.
    **others
        Parameters of :class:`RadialModel`.

    Raises
    ------
    InvalidParameter
        If the radius is not positive, or the field is outside 0 to 360 deg.

    Examples
    --------
    At half the rim radius of a complete ball, ``sin(Omega / 2) = 1/2``:

    >>> ball = MirrorBall(
    ...     centre_px=(511.5, 511.5), rim_radius_px=500.0, field_deg=360.0, image_size=(1024, 1024)
    ... )
    >>> np.degrees(ball.omega_from_radius(np.array([250.0]))).round(9)
    array([60.])
    """

    rim_radius_px: float = field()  # required
    field_deg: float
    optics: Optics = field(default="mirror", init=False, repr=False)

    KIND = "ball"

    def __post_init__(self) -> None:
        super().__post_init__()
        number("rim_radius_px", self.rim_radius_px, above=0.0, unit="px")
        number("field_deg", self.field_deg)
        if not 0 < self.field_deg <= 360:
            raise InvalidParameter(
                f"field_deg must be greater than 0 and at most 360 deg; got {self.field_deg:g}"
            )

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        return (ParameterSlot("rim_radius_px", "rim_radius_px", None, "px", 1.0),), ()

    @property
    def _projection_end(self) -> float:
        return float(np.radians(self.field_deg / 2))

    def _projected_radius(self, omega: Array) -> Array:
        return self._ball_radius_px * np.sin(omega / 2)

    def _projection(self, omega: Array) -> RadialProjection:
        radius = self._projected_radius(omega)
        return RadialProjection(
            radius,
            self._ball_radius_px / 2 * np.cos(omega / 2),
            (radius / self.rim_radius_px)[:, None],
        )

    def _inverse_projection(self, radius: Array) -> Array:
        return 2 * np.arcsin(np.minimum(radius / self._ball_radius_px, 1.0))

    @property
    def _ball_radius_px(self) -> float:
        """Radius of the complete ball's outline, which the rim may truncate."""
        return self.rim_radius_px / float(np.sin(self._projection_end / 2))
