"""Contrast of a fine pattern in closed form: diffraction, defocus and the pixel.

The transfer of a round aperture whose wave is bent along the pattern by a defocus of blur Delta (Hopkins, Proc. R. Soc.
A 231, 91, 1955): with s the frequency nu over that at which diffraction ends, ``s = nu Airy / 2.44``,

    MTF = (4/pi) integral_0^(1-s) sqrt(1 - (x+s)^2) cos(pi Delta nu x) dx

Bending across the pattern does not matter, so that the tangential blur makes the tangential one, the sagittal blur the
sagittal one. What a mirror adds beside it (coma and more) is left out; :func:`omnimirror.mtf` has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

AIRY = 2.44  # diameter of the disk in wavelengths times the F-number
NODES, PER_RADIAN = 24, 0.5  # of Gauss's rule; and for each radian of the phase at the edge


def contrast(blur_px: Array, airy_px: Array, cycles_per_px: float) -> Array:
    """Contrast of waves of a frequency, the pixel's share included; below 0 where they are reversed.

    Parameters
    ----------
    blur_px, airy_px : (..,)
        Signed geometric blur along the pattern, and Airy disk, px; complex too, whose imaginary parts are derivatives.
    cycles_per_px
        The frequency on the imager.

    Examples
    --------
    In focus, behind a lens that resolves endlessly, the pixel alone:

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
    psi = half * (u + 1)  # x + s = cos(psi) takes the root away
    rows = np.sin(psi) ** 2 * np.cos(phase * (np.cos(psi) - s))
    found: Array = (rows * weight).sum(-1) * half[..., 0] * (4 / np.pi) * np.sinc(cycles_per_px)
    return np.where(passes, found, 0.0)
