"""What the scatter of a measured profile does to numbers that are computed from it: their standard deviations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..optics.mirrors import Mirror, SampledProfile

Array = NDArray[np.float64]

SHARE = 1e-4  # of a standard deviation, by which the profile is moved


def standard_deviations(mirror: Mirror, columns_of: Callable[[Mirror], dict[str, Array]]) -> dict[str, Array]:
    """Standard deviations (n,) of the columns (n,) computed from a mirror; none for one that is not measured.

    The smooth curve is linear in the heights, so each of its independent deviations is tried alone and what it
    changes in the columns is added in quadrature.
    """
    if not (isinstance(mirror, SampledProfile) and len(mirror.fit.deviations)):
        return {}
    nominal, *moved = (columns_of(m) for m in mirror.deviated(SHARE))
    with np.errstate(invalid="ignore"):  # lengths per pixel of distant objects are infinite
        return {name: np.sqrt(sum((m[name] - nominal[name]) ** 2 for m in moved)) / SHARE for name in nominal}
