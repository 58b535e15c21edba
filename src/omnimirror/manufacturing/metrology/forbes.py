"""A mirror about its axis as an asphere of Forbes: a sphere through vertex and rim, and terms along its normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import numbers
from ...errors import InvalidParameter
from ...mirrors import Mirror
from ...numerics.forbes import qbfs_values

Array = NDArray[np.float64]

POINTS = 400
MOST_TERMS = 16
LEFT_UM = 1e-3  # so little left needs no more terms
UM = 1e3


@dataclass(frozen=True)
class ForbesAsphere:
    """A Qbfs asphere: ``z = c x^2/(1 + phi) + u^2 (1 - u^2)/phi sum(a_m Q_m(u^2))``.

    With ``phi = sqrt(1 - c^2 x^2)`` and u = x/M.

    Attributes
    ----------
    radius_mm : of the best-fit sphere, 1/c
    rim_radius_mm : M
    um : coefficients a_m
    left_um : rms over the meridian of what the terms do not hold, along the axis
    """

    radius_mm: float
    rim_radius_mm: float
    um: tuple[float, ...]
    left_um: float

    def sag(self, x_mm: ArrayLike) -> Array:
        """Sag (n,) mm at distances x (n,) mm from the axis, up to the rim.

        Raises
        ------
        InvalidParameter
            Distances that are no numbers.
        """
        x = numbers("x_mm", x_mm)
        return _sphere(x, self.radius_mm) + _terms(x, self.radius_mm, self.rim_radius_mm, len(self.um)) @ self.um / UM


def forbes_asphere(mirror: Mirror, left_um: float = LEFT_UM) -> ForbesAsphere:
    """The asphere of Forbes that is a mirror, of as few terms as leave so little (rms), up to 16.

    Parameters
    ----------
    mirror
        Smooth at its apex, flatter than half a ball.
    left_um
        Of the meridian, along the axis.

    Returns
    -------
    ForbesAsphere
        Its sphere and its terms.

    Raises
    ------
    InvalidParameter
        A pointed mirror, or one as deep as its rim is wide: no such sphere passes both.

    Examples
    --------
    >>> from omnimirror.mirrors import Paraboloid
    >>> found = forbes_asphere(Paraboloid(40.0, 20.0))
    >>> round(found.radius_mm, 9), len(found.um), found.left_um < 1e-3
    (42.5, 3, True)
    """
    M = mirror.rim_radius_mm
    x = M * np.sin((np.arange(POINTS) + 0.5) / POINTS * np.pi / 2)
    z, (deep,) = mirror.sag(x), mirror.sag(np.array([M]))
    if mirror.is_pointed or not 0 < abs(deep) < M:
        raise InvalidParameter(
            f"a mirror {deep:.4g} mm deep with a rim of {M:g} mm{' and a pointed apex' if mirror.is_pointed else ''} "
            "is no asphere about a sphere; valid are smooth ones less deep than their rim is wide from the axis"
        )
    radius = float((deep**2 + M**2) / (2 * deep))
    departure, basis = UM * (z - _sphere(x, radius)), _terms(x, radius, M, MOST_TERMS)
    for count in range(1, MOST_TERMS + 1):
        found, *_ = np.linalg.lstsq(basis[:, :count], departure, rcond=None)
        left = float(np.sqrt(np.mean((departure - basis[:, :count] @ found) ** 2)))
        if left <= left_um:
            break
    return ForbesAsphere(radius, M, tuple(found.tolist()), left)


def _sphere(x: Array, radius: float) -> Array:
    square = x**2 / radius
    sag: Array = square / (1 + np.sqrt(1 - square / radius))
    return sag


def _terms(x: Array, radius: float, rim: float, count: int) -> Array:
    """What each term does along the axis (n, count), per its coefficient."""
    phi = np.sqrt(1 - (x / radius) ** 2)
    terms: Array = qbfs_values(np.ravel(x) / rim, count) / np.ravel(phi)[:, None]
    return terms
