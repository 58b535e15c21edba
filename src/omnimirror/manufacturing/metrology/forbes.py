"""Forbes Qbfs representation of a rotationally symmetric mirror."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import numbers
from ...base.errors import InvalidParameter
from ...base.numerics import qbfs_values
from ...base.typing import Array
from ...optics.mirrors import Mirror
from ...optics.mirrors.mirror import conic_profile

POINTS = 400
MAX_TERMS = 16
LEFT_UM = 1e-3  # residual that requires no further terms
UM = 1e3


@dataclass(frozen=True)
class ForbesAsphere:
    """Qbfs asphere: ``z = c x^2/(1 + phi) + u^2 (1 - u^2)/phi sum(a_m Q_m(u^2))``.

    ``phi = sqrt(1 - c^2 x^2)`` and u = x/M.

    Attributes
    ----------
    radius_mm
        Radius 1/c of the best-fit sphere through vertex and rim.
    rim_radius_mm
        Rim radius M.
    um
        Coefficients a_m.
    rms_residual_um
        Axial RMS residual over the meridian.
    """

    radius_mm: float
    rim_radius_mm: float
    um: tuple[float, ...]
    rms_residual_um: float

    def sag(self, x_mm: ArrayLike) -> Array:
        """Compute the sag (n,) in mm at radii x (n,) in mm, up to the rim.

        Raises
        ------
        InvalidParameter
            If the radii are not numbers.
        """
        x = numbers("x_mm", x_mm)
        return (
            sphere_sag(x, self.radius_mm)
            + _terms(x, self.radius_mm, self.rim_radius_mm, len(self.um)) @ self.um / UM
        )


def forbes_asphere(mirror: Mirror, rms_residual_um: float = LEFT_UM) -> ForbesAsphere:
    """Fit a Qbfs asphere with the minimum number of terms, up to 16.

    Parameters
    ----------
    mirror
        Mirror with a smooth apex, flatter than a hemisphere.
    rms_residual_um
        Permitted axial RMS residual over the meridian.

    Returns
    -------
    ForbesAsphere
        Best-fit sphere and coefficients.

    Raises
    ------
    InvalidParameter
        If the mirror is pointed, or its depth is not smaller than its rim radius.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Paraboloid
    >>> found = forbes_asphere(Paraboloid(40.0, 20.0))
    >>> round(found.radius_mm, 9), len(found.um), found.rms_residual_um < 1e-3
    (42.5, 3, True)
    """
    M = mirror.rim_radius_mm
    x = M * np.sin((np.arange(POINTS) + 0.5) / POINTS * np.pi / 2)
    z, (deep,) = mirror.sag(x), mirror.sag(np.array([M]))
    if mirror.is_pointed or not 0 < abs(deep) < M:
        raise InvalidParameter(
            "a Qbfs asphere requires a smooth mirror with a depth less than its rim radius; got a depth of "
            f"{deep:.4g} mm and a rim radius of {M:g} mm{' with a pointed apex' if mirror.is_pointed else ''}"
        )
    radius = float((deep**2 + M**2) / (2 * deep))
    departure, basis = UM * (z - sphere_sag(x, radius)), _terms(x, radius, M, MAX_TERMS)
    for count in range(1, MAX_TERMS + 1):
        result, *_ = np.linalg.lstsq(basis[:, :count], departure, rcond=None)
        residual = float(np.sqrt(np.mean((departure - basis[:, :count] @ result) ** 2)))
        if residual <= rms_residual_um:
            break
    return ForbesAsphere(radius, M, tuple(result.tolist()), residual)


def sphere_sag(x: Array, radius: float) -> Array:
    """Compute the sag of a sphere, mm."""
    return conic_profile(x, radius, 0.0)[0]


def _terms(x: Array, radius: float, rim: float, count: int) -> Array:
    """Return the axial contribution (n, count) of each term per unit coefficient."""
    phi = np.sqrt(1 - (x / radius) ** 2)
    terms: Array = qbfs_values(np.ravel(x) / rim, count) / np.ravel(phi)[:, None]
    return terms
