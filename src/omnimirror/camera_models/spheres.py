"""Models that project onto a sphere first, and from there, off its centre, onto the picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..arguments import number
from ..frames import Mount
from .base import Optics
from .focal import FocalModel
from .radial import ROUNDING, Law, Place

Array = NDArray[np.float64]


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

    KIND = "unified"
    LENS = {"k1": ("", 0.1), "k2": ("", 0.1), "k3": ("", 0.1), "p1": ("", 0.01), "p2": ("", 0.01)}  # noqa: RUF012

    def __post_init__(self) -> None:
        self._check_focal()
        number("xi", self.xi, low=0.0)
        for name in self.LENS:
            number(name, getattr(self, name))

    @property
    def _places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        return (Place("xi", "xi", None, "", 0.1),), self._affine_places

    @property
    def _law_end(self) -> float:
        least = min(self.xi, 1 / self.xi) if self.xi else 0.0
        return float(np.arccos(-least)) * (1 - ROUNDING)

    def _law_radius(self, omega: Array) -> Array:
        return np.sin(omega) / (np.cos(omega) + self.xi)

    def _law(self, omega: Array) -> Law:
        sin, cos = np.sin(omega), np.cos(omega)
        depth = cos + self.xi
        return Law(sin / depth, (1 + self.xi * cos) / depth**2, (-sin / depth**2)[:, None])

    def _law_inverse(self, radius: Array) -> Array:
        square = radius * radius
        inside = np.maximum(1 + (1 - self.xi**2) * square, 0.0)  # the end itself, for xi > 1
        length = (self.xi + np.sqrt(inside)) / (1 + square)
        return np.arctan2(length * radius, length - self.xi)
