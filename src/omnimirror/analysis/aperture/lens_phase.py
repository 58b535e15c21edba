"""The wave behind a real lens: the integral of where its rays land.

Rays cross a wavefront square to it. Against the wave that meets in the chief ray's image point, one that lands eps
beside it is behind by W, whose change from ray to ray is ``dW = -eps . dL``, L being the direction cosines of the rays
at the imager. Of glass both are traced, so that W is exact; a table gives them to first order in the aperture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from ...lenses import FieldLens, TabulatedLens
from ...sensor import Sensor
from .bundles import Bundles
from .pupil_fit import DEGREE, FITTED, basis, fit, integral, slopes

Array = NDArray[np.float64]


def check_wave_is_known(lens: FieldLens) -> None:
    """Raise InvalidParameter for a table that says how large the lens's own blur is: of what shape, it does not say."""
    blurs = (lens.own_blur_t_mm, lens.own_blur_s_mm) if isinstance(lens, TabulatedLens) else ()
    if any(blur is not None and any(blur) for blur in blurs):
        raise InvalidParameter(
            "the wavefront (PSF and MTF) is not known of a lens table with own_blur_t_mm and own_blur_s_mm, which say "
            "how large the lens's own blur is and not of what shape; valid are a table without them, or its surfaces"
        )


def phase_of_real_lens(bundles: Bundles, sensor: Sensor, strayed: Array) -> tuple[Array, Array]:
    """W (k, n), mm, of rays that land (k, n, 2) mm beside their chief rays, and how rough (k,) mm rms it is.

    Roughness is what polynomials do not follow: slopes of a degree above theirs, which add up to no more over a
    wave of that degree.
    """
    at = bundles.seen_at - sensor.optical_train.lens_offset
    assert isinstance(sensor.lens, FieldLens)
    cosines = sensor.lens.image_cosines(at, bundles.to_pupils)
    by = slopes()
    coefficients = np.einsum("tn,knc->ktc", fit(), cosines)
    # (2, k, n): by the aperture's x and by its y
    wanted = np.stack([-np.einsum("knc,nt,ktc->kn", strayed, rate, coefficients, optimize=True) for rate in by])
    k, n = strayed.shape[:2]
    found = np.einsum("tm,km->kt", integral(), wanted.transpose(1, 0, 2).reshape(k, 2 * n))
    phase = np.einsum("nt,kt->kn", basis(FITTED.points), found)
    missed = [np.einsum("nt,kt->kn", rate, found) - slope for rate, slope in zip(by, wanted, strict=True)]
    rough = np.sqrt((missed[0] ** 2 + missed[1] ** 2) @ FITTED.weights) / DEGREE
    return phase, rough
