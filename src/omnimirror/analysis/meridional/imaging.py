"""Image-forming characteristics: the image of an object of 1 deg x 1 deg (Eqs. 9-13)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.typing import Array


class ImagingCharacteristics(NamedTuple):
    """Image of an object of 1 deg x 1 deg at n field angles; each array (n,)."""

    height: Array
    """Radial extent Dh, px per deg (Eq. 9)."""
    width: Array
    """Azimuthal extent Dw, px per deg (Eq. 10)."""
    area: Array
    """Area Ds = Dh Dw, px^2 per square degree (Eq. 11; erratum 5)."""
    aspect: Array
    """Aspect ratio Dw / Dh (Eq. 12)."""


def imaging_characteristics(
    omega: Array, h_px: Array, dh_domega_px: Array, parallax_t: Array | float = 1.0, parallax_s: Array | float = 1.0
) -> ImagingCharacteristics:
    """Compute image-forming characteristics from the mapping.

    Parameters
    ----------
    omega : (n,) radians
    h_px : (n,) px
        Image height.
    dh_domega_px : (n,) px per radian
    parallax_t, parallax_s : (n,)
        Image motion of a finite object relative to a distant one, seen from the mirror point at its
        distance p: perpendicular to the ray ``1 + cos(gamma)/(cos(beta) p dOmega/dx)``, around the
        axis ``1 + x/(p sin(Omega))``.

    Notes
    -----
    On the axis of a smooth mirror, ``h / sin(Omega)`` is 0/0 and tends to ``dh/dOmega``: aspect 1.

    Examples
    --------
    The mapping h = 100 tan(Omega/2) is conformal, with an aspect of 1 at all field angles:

    >>> omega = np.radians([0.0, 90.0, 120.0])
    >>> c = imaging_characteristics(omega, 100 * np.tan(omega / 2), 50 / np.cos(omega / 2) ** 2)
    >>> c.aspect.round(12)
    array([1., 1., 1.])
    """
    degree = np.pi / 180
    height = dh_domega_px * degree
    with np.errstate(divide="ignore", invalid="ignore"):
        # Dh = dh/dOmega (Eq. 9). One degree perpendicular to the meridian subtends the azimuth
        # 1 deg / sin(Omega), which is an arc of h / sin(Omega) per radian in the image (Eq. 10).
        width = np.where(omega == 0.0, height, h_px * degree / np.sin(omega)) / parallax_s
        height = height / parallax_t
        return ImagingCharacteristics(height, width, height * width, width / height)
