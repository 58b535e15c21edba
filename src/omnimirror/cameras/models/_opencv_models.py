"""Models of OpenCV: Kannala-Brandt fisheye, thin-prism fisheye and rational pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.polynomial.polynomial import polysub, polyval

from ...base.arguments import number
from ...base.caching import cached_property
from ...base.numerics import increasing_inverse
from ...base.typing import Array
from ._distortion import (
    MAX_COEFFICIENT,
    MIN_RATE,
    DistortionModel,
    Rational,
    ThinPrism,
    smallest_positive_root,
)
from .camera_model import ROUNDING, FocalModel, Optics, ParameterSlot, RadialProjection

# -- Kannala-Brandt fisheye model ------------------------------------------------------------------

NODES = 257  # nodes of the table of initial values for inversion


@dataclass(frozen=True, kw_only=True)
class KannalaBrandt(FocalModel):
    """Fisheye model with a radius polynomial, odd in the field angle.

    ``r = Omega (1 + k1 Omega^2 + k2 Omega^4 + k3 Omega^6 + k4 Omega^8)``. The field ends at 180
    deg, or at the angle with a rate of r below 1 % of that at the centre, the limit of validity of
    a fitted polynomial.

    Parameters
    ----------
    k1, k2, k3, k4
        Coefficients of the polynomial.
    **others
        Parameters of :class:`FocalModel`.

    References
    ----------
    J. Kannala and S. Brandt, "A generic camera model and calibration method for conventional, wide-angle, and
    fish-eye lenses", IEEE PAMI 28(8), 2006.

    Examples
    --------
    >>> camera = KannalaBrandt(
    ...     focal_px=(180 / np.pi, 180 / np.pi), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> camera.image([[100.0, 0.0, 0.0]]).pixels  # 90 deg from the axis
    array([[409.5, 239.5]])
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    optics: Optics = "fisheye"

    KIND = "kannala-brandt"
    COEFFICIENTS: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.COEFFICIENTS:
            number(name, getattr(self, name), low=-MAX_COEFFICIENT, high=MAX_COEFFICIENT)

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        slots = tuple(
            ParameterSlot(name, name, None, "", 0.1**i)
            for i, name in enumerate(self.COEFFICIENTS, start=1)
        )
        return slots, self._affine_slots

    @property
    def _polynomial(self) -> Array:
        """Polynomial of r / Omega in the squared field angle."""
        return np.array([1.0, *(getattr(self, name) for name in self.COEFFICIENTS)])

    @property
    def _rate_polynomial(self) -> Array:
        return self._polynomial * np.arange(1, 2 * len(self._polynomial), 2)

    @cached_property
    def _projection_end(self) -> float:
        return float(
            min(
                np.sqrt(
                    smallest_positive_root(
                        np.asarray(polysub(self._rate_polynomial, [MIN_RATE]), dtype=float)
                    )
                ),
                np.pi,
            )
        )

    def _projected_radius(self, omega: Array) -> Array:
        radius: Array = omega * polyval(omega * omega, self._polynomial)
        return radius

    def _projection(self, omega: Array) -> RadialProjection:
        square = omega * omega
        odd = np.empty((len(omega), len(self.COEFFICIENTS)))
        odd[:, 0] = omega * square
        for i in range(1, len(self.COEFFICIENTS)):
            odd[:, i] = odd[:, i - 1] * square
        return RadialProjection(self._projected_radius(omega), self._projection_rate(omega), odd)

    def _projection_rate(self, omega: Array) -> Array:
        return np.asarray(polyval(omega * omega, self._rate_polynomial), dtype=float)

    def _inverse_projection(self, radius: Array) -> Array:
        return increasing_inverse(
            lambda omega: (self._projected_radius(omega), self._projection_rate(omega)),
            radius,
            *self._table,
        )

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        omegas = np.asarray(np.linspace(0.0, self._projection_end, NODES), dtype=float)
        return omegas, self._projected_radius(omegas)


# -- Rational pinhole and thin-prism fisheye -------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class RationalPinhole(FocalModel):
    """Pinhole model with rational radial distortion, as in OpenCV and ROS.

    Parameters
    ----------
    k1, k2, k3, k4, k5, k6
        Radial distortion: k1 to k3 in the numerator, k4 to k6 in the denominator.
    p1, p2
        Tangential distortion.
    **others
        Parameters of :class:`FocalModel`.

    Examples
    --------
    >>> camera = RationalPinhole(
    ...     focal_px=(100.0, 100.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> camera.image([[100.0, 0.0, 100.0]]).pixels
    array([[419.5, 239.5]])
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    optics: Optics = "fisheye"

    KIND = "rational-pinhole"
    LENS = {**{f"k{i}": ("", 0.1) for i in range(1, 7)}, "p1": ("", 0.01), "p2": ("", 0.01)}  # noqa: RUF012

    @cached_property
    def distortion(self) -> DistortionModel:
        """Distortion of the model."""
        return Rational(**{name: getattr(self, name) for name in self.LENS})

    @property
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        return (), self._affine_slots

    @property
    def _projection_end(self) -> float:
        return np.pi / 2 * (1 - ROUNDING)

    def _projected_radius(self, omega: Array) -> Array:
        return np.tan(omega)

    def _projection(self, omega: Array) -> RadialProjection:
        tan = np.tan(omega)
        return RadialProjection(tan, 1 + tan * tan, np.empty((len(omega), 0)))

    def _inverse_projection(self, radius: Array) -> Array:
        return np.arctan(radius)


@dataclass(frozen=True, kw_only=True)
class ThinPrismFisheye(KannalaBrandt):
    """Kannala-Brandt polynomial with two more terms, tangential and thin-prism distortion.

    It is RAD_TAN_THIN_PRISM_FISHEYE in COLMAP and Fisheye624 in project Aria.

    Parameters
    ----------
    k1, k2, k3, k4, k5, k6
        Coefficients of the polynomial.
    p1, p2
        Tangential distortion, in OpenCV's order: COLMAP's p1 and p0.
    s1, s2, s3, s4
        Thin-prism distortion: of columns by r^2 and r^4, then of rows.
    **others
        Parameters of :class:`FocalModel`.

    Examples
    --------
    >>> camera = ThinPrismFisheye(
    ...     focal_px=(100.0, 100.0), centre_px=(319.5, 239.5), image_size=(640, 480), s3=0.1
    ... )
    >>> camera.image([[1.0, 0.0, 0.0]]).pixels.round(2)  # 90 deg to the right
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
    def distortion(self) -> DistortionModel:
        """Distortion of the model."""
        return ThinPrism(**{name: getattr(self, name) for name in self.LENS})
