"""Contrast at a spatial frequency in closed form: diffraction, defocus and pixel.

Transfer function of a circular aperture with a defocus of blur Delta along the pattern (Hopkins,
Proc. R. Soc. A 231, 91, 1955), with s the frequency nu relative to the cut-off frequency, ``s = nu
Airy / 2.44``:

    MTF = (4/pi) integral_0^(1-s) sqrt(1 - (x+s)^2) cos(pi Delta nu x) dx

Defocus perpendicular to the modulation has no effect; therefore the tangential contrast depends on
the tangential blur and the sagittal contrast on the sagittal blur. Further aberrations of the
mirror, such as coma, are neglected; :func:`omnimirror.mtf` includes them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

AIRY = 2.44  # diameter of the Airy disk in wavelengths times the F-number
NODES, PER_RADIAN = 24, 0.5  # Gauss-Legendre nodes: minimum, and number per radian of phase at the edge


def contrast(blur_px: Array, airy_px: Array, cycles_per_px: float) -> Array:
    """Return the contrast at a spatial frequency, negative for contrast reversal.

    Parameters
    ----------
    blur_px, airy_px : (..,)
        Signed geometric blur along the modulation, and Airy disk, px; or complex arrays, whose
        imaginary parts are derivatives.
    cycles_per_px
        Spatial frequency on the imager.

    Examples
    --------
    Pixel contribution alone, in focus and without diffraction:

    >>> contrast(np.array([0.0]), np.array([1e-9]), 0.5).round(4), round(2 / np.pi, 4)
    (array([0.6366]), 0.6366)
    """
    blur, s = np.broadcast_arrays(blur_px, airy_px * (cycles_per_px / AIRY))
    passes = s.real < 1
    s = np.where(passes, s, 0.5)[..., None]
    phase = np.pi * cycles_per_px * blur[..., None]
    edge = float(np.nan_to_num(np.abs(phase.real)).max(initial=0.0))
    u, weight = np.polynomial.legendre.leggauss(int(NODES + PER_RADIAN * min(edge, 1e3)))
    half = np.arccos(s) / 2
    psi = half * (u + 1)  # the substitution x + s = cos(psi) removes the root
    rows = np.sin(psi) ** 2 * np.cos(phase * (np.cos(psi) - s))
    found: Array = (rows * weight).sum(-1) * half[..., 0] * (4 / np.pi) * np.sinc(cycles_per_px)
    return np.where(passes, found, 0.0)
