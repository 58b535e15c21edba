"""Lens models with additional terms: OpenCV's rational pinhole, and the thin-prism fisheye."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ...base.arguments import number
from ...base.numerics.lazy import cached_property
from ...base.parameters import Uncertainty
from ...base.typing import Array
from ..frames import Mount
from .base import Optics
from .distortion import LARGEST_COEFFICIENT, AnyDistortion, Rational, ThinPrism
from .focal import FocalModel
from .kannala_brandt import KannalaBrandt
from .radial import ROUNDING, Law, Place


@dataclass(frozen=True)
class RationalPinhole(FocalModel):
    """Pinhole model with rational radial distortion, as in OpenCV and ROS.

    Parameters
    ----------
    focal_px : (fx, fy)
    centre_px : (u, v)
        Image of the axis; integers are pixel centres.
    image_size : (width, height)
    k1, k2, k3, k4, k5, k6
        Radial distortion: k1 to k3 in the numerator, k4 to k6 in the denominator.
    p1, p2
        Tangential distortion.
    skew_px
    optics
        ``"fisheye"`` or ``"mirror"``: the image centre is directed forwards or backwards.
    mount
        Orientation of the camera.
    rim_radius_px : px, optional
        Radius of the field in the image.
    uncertainty : Uncertainty, optional
        Covariance of the calibrated parameters.

    Raises
    ------
    InvalidParameter
        If the parameters are invalid.

    Examples
    --------
    >>> camera = RationalPinhole((100.0, 100.0), (319.5, 239.5), (640, 480))
    >>> camera.image([[100.0, 0.0, 100.0]]).pixels
    array([[419.5, 239.5]])
    """

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    image_size: tuple[int, int]
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    skew_px: float = 0.0
    optics: Optics = "fisheye"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    uncertainty: Uncertainty | None = field(default=None, repr=False)

    KIND = "rational-pinhole"
    LENS = {**{f"k{i}": ("", 0.1) for i in range(1, 7)}, "p1": ("", 0.01), "p2": ("", 0.01)}  # noqa: RUF012

    def __post_init__(self) -> None:
        self._check_focal()
        for name in self.LENS:
            number(name, getattr(self, name), low=-LARGEST_COEFFICIENT, high=LARGEST_COEFFICIENT)

    @cached_property
    def distortion(self) -> AnyDistortion:
        """Distortion of the model."""
        return Rational(**{name: getattr(self, name) for name in self.LENS})

    @property
    def _places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        return (), self._affine_places

    @property
    def _law_end(self) -> float:
        return np.pi / 2 * (1 - ROUNDING)

    def _law_radius(self, omega: Array) -> Array:
        return np.tan(omega)

    def _law(self, omega: Array) -> Law:
        tan = np.tan(omega)
        return Law(tan, 1 + tan * tan, np.empty((len(omega), 0)))

    def _law_inverse(self, radius: Array) -> Array:
        return np.arctan(radius)


@dataclass(frozen=True)
class ThinPrismFisheye(KannalaBrandt):
    """Kannala-Brandt polynomial with two more terms, tangential and thin-prism distortion.

    It is RAD_TAN_THIN_PRISM_FISHEYE in COLMAP and Fisheye624 in project Aria.

    Parameters
    ----------
    focal_px : (fx, fy)
    centre_px : (u, v)
        Image of the axis; integers are pixel centres.
    image_size : (width, height)
    k1, k2, k3, k4, k5, k6
        Coefficients of the polynomial.
    skew_px
    optics
        ``"fisheye"`` or ``"mirror"``: the image centre is directed forwards or backwards.
    mount
        Orientation of the camera.
    rim_radius_px : px, optional
        Radius of the field in the image.
    uncertainty : Uncertainty, optional
        Covariance of the calibrated parameters.
    p1, p2
        Tangential distortion, in OpenCV's order: COLMAP's p1 and p0.
    s1, s2, s3, s4
        Thin-prism distortion: of columns by r^2 and r^4, then of rows.

    Raises
    ------
    InvalidParameter
        If the parameters are invalid.

    Examples
    --------
    >>> camera = ThinPrismFisheye((100.0, 100.0), (319.5, 239.5), (640, 480), s3=0.1)
    >>> camera.image([[1.0, 0.0, 0.0]]).pixels.round(2)  # 90 deg to the right, pi/2 from the centre before the prism
    array([[476.58, 264.17]])
    """

    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0

    KIND = "thin-prism-fisheye"
    COEFFICIENTS: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4", "k5", "k6")
    LENS = dict.fromkeys(ThinPrism._fields, ("", 0.01))

    @cached_property
    def distortion(self) -> AnyDistortion:
        """Distortion of the model."""
        return ThinPrism(**{name: getattr(self, name) for name in self.LENS})
