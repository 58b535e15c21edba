"""Models that project onto a sphere first, and from there, off its centre, onto the picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import number
from ...base.parameters import Uncertainty
from ..frames import Mount
from .base import Optics
from .distortion import LARGEST_COEFFICIENT
from .focal import FocalModel
from .radial import ROUNDING, Law, Place

Array = NDArray[np.float64]

MOST = 1e4  # of a number of shape: past it every sphere is the same plane


@dataclass(frozen=True)
class Unified(FocalModel):
    """The unified sphere with radial and tangential distortion, as in OpenCV's module omnidir.

    A point is projected onto the unit sphere, and from there onto a plane as seen from ``xi`` behind its centre:
    ``r = sin(Omega) / (cos(Omega) + xi)``. Hyperboloids and paraboloids (xi = 1) seen from their foci are exactly
    that; other mirrors, and fisheyes, nearly. The field ends where r no longer grows, at
    ``cos(Omega) = -min(xi, 1/xi)``: with xi = 1 it is all but one direction, with xi = 0, a pinhole, 90 deg.
    Distortion that folds the picture ends it earlier.

    Parameters
    ----------
    xi
        From the sphere's centre to the point of view, 0 or more.
    focal_px : (fx, fy)
    centre_px : (u, v)
        Image of the axis; integers are pixel centres.
    image_size : (width, height)
    skew_px
    k1, k2, k3
        Radial distortion; omnidir has no k3.
    p1, p2
        Tangential distortion.
    optics
        ``"mirror"`` or ``"fisheye"``: whether the centre of the picture looks back or ahead.
    mount
        How the camera stands.
    rim_radius_px : px, optional
        Where the field ends, measured in the picture.
    uncertainty : Uncertainty, optional
        Covariance of the parameters, of a calibration.

    Raises
    ------
    InvalidParameter
        For numbers that describe no camera.

    References
    ----------
    C. Mei and P. Rives, "Single view point omnidirectional camera calibration from planar grids", ICRA 2007.

    Examples
    --------
    The horizon of a paraboloid lies two focal lengths of the mirror, here one of the model, from the centre:

    >>> camera = Unified(1.0, (200.0, 200.0), (319.5, 239.5), (640, 480))
    >>> camera.image([[100.0, 0.0, 0.0]]).pixels
    array([[519.5, 239.5]])
    """

    xi: float
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    image_size: tuple[int, int]
    skew_px: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    optics: Optics = "mirror"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    uncertainty: Uncertainty | None = field(default=None, repr=False)

    KIND = "unified"
    LENS = {"k1": ("", 0.1), "k2": ("", 0.1), "k3": ("", 0.1), "p1": ("", 0.01), "p2": ("", 0.01)}  # noqa: RUF012

    def __post_init__(self) -> None:
        self._check_focal()
        number("xi", self.xi, low=0.0, high=MOST)
        for name in self.LENS:
            number(name, getattr(self, name), low=-LARGEST_COEFFICIENT, high=LARGEST_COEFFICIENT)

    @property
    def _places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        return (Place("xi", "xi", None, "", 0.1),), self._affine_places

    @property
    def _law_end(self) -> float:
        least = min(self.xi, 1 / self.xi) if self.xi else 0.0
        return float(np.arccos(-least)) * (1 - ROUNDING)

    def _law_radius(self, omega: Array) -> Array:
        return np.sin(omega) / self._depth(omega)

    def _law(self, omega: Array) -> Law:
        sin, cos, depth = np.sin(omega), np.cos(omega), self._depth(omega)
        return Law(sin / depth, (1 + self.xi * cos) / depth**2, (-sin / depth**2)[:, None])

    def _depth(self, omega: Array) -> Array:
        """``cos(Omega) + xi``, without cancellation for xi = 1 at the end."""
        depth: Array = 2 * np.cos(omega / 2) ** 2 + (self.xi - 1)
        return depth

    def _law_inverse(self, radius: Array) -> Array:
        square = radius * radius
        inside = np.maximum(1 + (1 - self.xi**2) * square, 0.0)  # the end itself, for xi > 1
        length = (self.xi + np.sqrt(inside)) / (1 + square)
        return np.arctan2(length * radius, length - self.xi)


@dataclass(frozen=True)
class EnhancedUnified(FocalModel):
    """The enhanced unified model: an ellipsoid in place of the sphere.

    ``r = sin(Omega) / (alpha q + (1 - alpha) cos(Omega))`` with ``q = sqrt(beta sin(Omega)^2 + cos(Omega)^2)``.
    The field ends where r no longer grows, at ``cos(Omega) = -w q`` with w = alpha / (1 - alpha), or 1/w where
    alpha > 1/2. alpha = xi / (1 + xi) and beta = 1 is the unified sphere; alpha = 0 a pinhole.

    Parameters
    ----------
    alpha
        0 to 1.
    beta
        Above 0.
    focal_px : (fx, fy)
    centre_px : (u, v)
        Image of the axis; integers are pixel centres.
    image_size : (width, height)
    skew_px
    optics
        ``"mirror"`` or ``"fisheye"``: whether the centre of the picture looks back or ahead.
    mount
        How the camera stands.
    rim_radius_px : px, optional
        Where the field ends, measured in the picture.
    uncertainty : Uncertainty, optional
        Covariance of the parameters, of a calibration.

    Raises
    ------
    InvalidParameter
        For numbers that describe no camera.

    References
    ----------
    B. Khomutenko, G. Garcia and P. Martinet, "An enhanced unified camera model", IEEE RA-L 1(1), 2016.

    Examples
    --------
    >>> camera = EnhancedUnified(0.5, 1.0, (100.0, 100.0), (319.5, 239.5), (640, 480))
    >>> camera.image([[100.0, 0.0, 0.0]]).pixels
    array([[519.5, 239.5]])
    """

    alpha: float
    beta: float
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    image_size: tuple[int, int]
    skew_px: float = 0.0
    optics: Optics = "mirror"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    uncertainty: Uncertainty | None = field(default=None, repr=False)

    KIND = "enhanced-unified"

    def __post_init__(self) -> None:
        self._check_focal()
        number("alpha", self.alpha, low=0.0, high=1.0)
        number("beta", self.beta, low=1 / MOST, high=MOST)

    @property
    def _places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        return (Place("alpha", "alpha", None, "", 0.01), Place("beta", "beta", None, "", 0.05)), self._affine_places

    @property
    def _law_end(self) -> float:
        w = _cosine_at_the_end(self.alpha)
        return float(np.arctan2(np.sqrt(1 - w * w), -w * np.sqrt(self.beta))) * (1 - ROUNDING)

    def _law_radius(self, omega: Array) -> Array:
        sin, cos = np.sin(omega), np.cos(omega)
        radius: Array = sin / (self.alpha * np.sqrt(self.beta * sin**2 + cos**2) + (1 - self.alpha) * cos)
        return radius

    def _law(self, omega: Array) -> Law:
        a, sin, cos = self.alpha, np.sin(omega), np.cos(omega)
        q = np.sqrt(self.beta * sin**2 + cos**2)
        depth = a * q + (1 - a) * cos
        terms = np.stack([(cos - q) * sin, -a * sin**3 / (2 * q)], axis=-1) / depth[:, None] ** 2
        return Law(sin / depth, (1 - a + a * cos / q) / depth**2, terms)

    def _law_inverse(self, radius: Array) -> Array:
        a, square = self.alpha, self.beta * radius * radius
        root = np.sqrt(np.maximum(1 - (2 * a - 1) * square, 0.0))
        return np.arctan2(radius, (1 - a * a * square) / (a * root + 1 - a))


@dataclass(frozen=True)
class DoubleSphere(FocalModel):
    """The double sphere: a point is projected onto one unit sphere, then onto a second, and seen off its centre.

    ``r = sin(Omega) / (alpha d + (1 - alpha) (xi + cos(Omega)))`` with ``d^2 = 1 + 2 xi cos(Omega) + xi^2``. The field
    ends where r no longer grows, at ``(xi + cos(Omega)) / d = -w`` with w = alpha / (1 - alpha), or 1/w where
    alpha > 1/2; the bound that the paper gives lies inside.

    Parameters
    ----------
    xi
        Distance of the spheres' centres, -1 to 1.
    alpha
        0 to 1.
    focal_px : (fx, fy)
    centre_px : (u, v)
        Image of the axis; integers are pixel centres.
    image_size : (width, height)
    skew_px
    optics
        ``"mirror"`` or ``"fisheye"``: whether the centre of the picture looks back or ahead.
    mount
        How the camera stands.
    rim_radius_px : px, optional
        Where the field ends, measured in the picture.
    uncertainty : Uncertainty, optional
        Covariance of the parameters, of a calibration.

    Raises
    ------
    InvalidParameter
        For numbers that describe no camera.

    References
    ----------
    V. Usenko, N. Demmel and D. Cremers, "The double sphere camera model", 3DV 2018.

    Examples
    --------
    >>> camera = DoubleSphere(0.0, 0.5, (100.0, 100.0), (319.5, 239.5), (640, 480), optics="fisheye")
    >>> camera.image([[0.0, 100.0, 0.0]]).pixels
    array([[319.5, 439.5]])
    """

    xi: float
    alpha: float
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    image_size: tuple[int, int]
    skew_px: float = 0.0
    optics: Optics = "mirror"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    uncertainty: Uncertainty | None = field(default=None, repr=False)

    KIND = "double-sphere"

    def __post_init__(self) -> None:
        self._check_focal()
        number("xi", self.xi, low=-1.0, high=1.0)
        number("alpha", self.alpha, low=0.0, high=1.0)

    @property
    def _places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        return (Place("xi", "xi", None, "", 0.05), Place("alpha", "alpha", None, "", 0.01)), self._affine_places

    @property
    def _law_end(self) -> float:
        w = _cosine_at_the_end(self.alpha)
        distance = np.sqrt(1 - self.xi**2 * (1 - w * w)) - self.xi * w
        return float(np.arccos(np.clip(-distance * w - self.xi, -1.0, 1.0))) * (1 - ROUNDING)

    def _law_radius(self, omega: Array) -> Array:
        cos = np.cos(omega)
        d = np.sqrt(1 + 2 * self.xi * cos + self.xi**2)
        radius: Array = np.sin(omega) / (self.alpha * d + (1 - self.alpha) * (self.xi + cos))
        return radius

    def _law(self, omega: Array) -> Law:
        xi, a, sin, cos = self.xi, self.alpha, np.sin(omega), np.cos(omega)
        d = np.sqrt(1 + 2 * xi * cos + xi * xi)
        depth = a * d + (1 - a) * (xi + cos)
        growth = a * np.divide(xi + cos, d, out=np.zeros_like(d), where=d > 0) + 1 - a
        terms = np.stack([-sin * growth, -sin * (d - xi - cos)], axis=-1) / depth[:, None] ** 2
        return Law(sin / depth, (1 + xi * cos) * growth / depth**2, terms)

    def _law_inverse(self, radius: Array) -> Array:
        xi, a, square = self.xi, self.alpha, radius * radius
        root = np.sqrt(np.maximum(1 - (2 * a - 1) * square, 0.0))
        z = (1 - a * a * square) / (a * root + 1 - a)
        length = (z * xi + np.sqrt(np.maximum(z * z + (1 - xi * xi) * square, 0.0))) / (z * z + square)
        return np.arctan2(length * radius, length * z - xi)


def _cosine_at_the_end(alpha: float) -> float:
    """How far behind the last sphere (or ellipsoid) is seen: where the depth, or the growth of r, becomes 0."""
    return alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
