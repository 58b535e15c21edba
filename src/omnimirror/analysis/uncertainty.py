"""Propagation of the scatter of a measured profile to standard deviations of results."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.typing import Array
from ..optics.mirrors import Mirror, SampledProfile

SHARE = 1e-4  # perturbation of the profile relative to a standard deviation


def standard_deviations(mirror: Mirror, columns_of: Callable[[Mirror], dict[str, Array]]) -> dict[str, Array]:
    """Return standard deviations (n,) of columns (n,) computed from a measured mirror.

    The smoothed curve is linear in the heights; therefore the effects of its independent deviations
    are computed one at a time and added in quadrature.
    """
    if not (isinstance(mirror, SampledProfile) and len(mirror.fit.deviations)):
        return {}
    nominal, *moved = (columns_of(m) for m in mirror.deviated(SHARE))
    with np.errstate(invalid="ignore"):  # lengths per pixel of distant objects are infinite
        return {name: np.sqrt(sum((m[name] - nominal[name]) ** 2 for m in moved)) / SHARE for name in nominal}
