"""Wavefront of a real lens, as a function of the direction cosines of its rays at the imager.

Rays are normal to the wavefront. Relative to the reference sphere about the image point of the
chief ray, a ray with the transverse aberration eps has the phase lag W, with ``dW = -eps . dL``,
where L are the direction cosines of the rays at the imager. In these coordinates the field at the
imager is a Fourier integral. For a lens made of surfaces, both are traced, and W and L are exact; a
table provides them to first order in the aperture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.lenses import FieldLens, TabulatedLens
from .pupil_fit import DEGREE, FITTED, basis, fit, fitted_at, integral, slopes

BOUNDARY = 2 * np.pi * np.arange(96) / 96  # azimuths of the edge of the stop
ROUND = 2e-3  # relative to the radius: largest deviation of a section treated as an ellipse


class LightCone(NamedTuple):
    """Cone of light behind a real lens: section in direction cosines, scaled to the unit disk."""

    points: Array
    """Tangential and sagittal coordinates (n, 2) of rays in the section."""
    shares: Array
    """Ratio (n,) of aperture area to section area."""
    f_numbers: tuple[float, float]
    """Tangential and sagittal F-number of the disk."""
    stop: Array | None
    """Clearance (n,) at the stop edge, in stop radii, for a non-elliptical section, or None."""


def check_wave_is_known(lens: FieldLens) -> None:
    """Check that a lens table contains no lens blur of unknown shape."""
    blurs = (lens.own_blur_t_mm, lens.own_blur_s_mm) if isinstance(lens, TabulatedLens) else ()
    if any(blur is not None and any(blur) for blur in blurs):
        raise InvalidParameter(
            "the wavefront (PSF and MTF) is not known of a lens table with own_blur_t_mm and own_blur_s_mm, which say "
            "how large the lens's own blur is and not of what shape; valid are a table without them, or its surfaces"
        )


def phase_of_real_lens(cosines: Array, strayed: Array) -> tuple[Array, Array]:
    """Return W (k, n), mm, from transverse aberrations (k, n, 2) mm, and its roughness (k,), mm.

    The roughness is the residual slope of the polynomial fit divided by its degree, the RMS of a
    wave of the next degree with this slope.

    Parameters
    ----------
    cosines, strayed : (k, n, 2) arrays
        Direction cosines of the rays at the imager, and their positions relative to the chief rays.
    """
    by = slopes()
    coefficients = np.einsum("tn,knc->ktc", fit(), cosines)
    # (2, k, n): derivatives by the x and the y of the aperture
    wanted = np.stack([-np.einsum("knc,nt,ktc->kn", strayed, rate, coefficients, optimize=True) for rate in by])
    k, n = strayed.shape[:2]
    found = np.einsum("tm,km->kt", integral(), wanted.transpose(1, 0, 2).reshape(k, 2 * n))
    phase = np.einsum("nt,kt->kn", basis(FITTED.points), found)
    missed = [np.einsum("nt,kt->kn", rate, found) - slope for rate, slope in zip(by, wanted, strict=True)]
    rough = np.sqrt((missed[0] ** 2 + missed[1] ** 2) @ FITTED.weights) / DEGREE
    return phase, rough


def cone_of_light(cosines: Array, at_stop: Array, axes: Array) -> LightCone:
    """Return the cone of light of one object from the rays at :data:`FITTED`.

    Parameters
    ----------
    cosines : (n, 2) array
        Direction cosines at the imager.
    at_stop : (n, 2) array
        Positions in the stop, in stop radii.
    axes : (2, 2) array
        Unit vectors of the tangential and the sagittal direction.
    """
    tangential, sagittal = (rate @ fit() @ cosines for rate in slopes())
    area = np.abs(tangential[:, 0] * sagittal[:, 1] - tangential[:, 1] * sagittal[:, 0])
    cosines = cosines @ axes.T
    edge = basis(np.stack([np.cos(BOUNDARY), np.sin(BOUNDARY)], axis=-1)) @ fitted_at(at_stop) @ cosines
    low, high = edge.min(axis=0), edge.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    reach = np.hypot(*((edge - middle) / half).T)
    stop = None
    if np.ptp(reach) > 2 * ROUND:
        half = half * reach.max()
        stop = (1 - (at_stop**2).sum(axis=1)) / 2
    points = (cosines - middle) / half
    t, s = 1 / (2 * half)
    return LightCone(points, half[0] * half[1] / area, (float(t), float(s)), stop)
