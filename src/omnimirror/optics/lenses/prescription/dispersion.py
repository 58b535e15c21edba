"""Interpolation over wavelength from values at three wavelengths."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ....base.arguments import number
from ....base.errors import InvalidParameter
from ....base.typing import Array

FRAUNHOFER_NM = np.array([486.1327, 587.5618, 656.2725])
"""Fraunhofer lines F, d and C."""


def through_three(wavelength_nm: float, known_nm: ArrayLike, values: Array) -> Array:
    """Interpolate values (3, n) at three wavelengths to (n,) at another.

    The formula is a parabola in the inverse squared wavelength.

    Raises
    ------
    InvalidParameter
        If the wavelength is outside the visible and near-visible range, or two of the three are
        equal.

    Examples
    --------
    N-BK7, from its indices at these lines:

    >>> rows = np.array([[1.52238], [1.51680], [1.51432]])
    >>> through_three(546.07, FRAUNHOFER_NM, rows).round(4)  # n_e of the data sheet: 1.51872
    array([1.5187])
    """
    number("wavelength_nm", wavelength_nm, low=300.0, high=1100.0, unit="nm")
    x = np.asarray(known_nm, dtype=float) ** -2.0
    if len(set(x)) < len(x):
        raise InvalidParameter("wavelengths_nm are not three different ones; colour is valid of those only")
    at = wavelength_nm**-2.0
    found: Array = values[1]
    for i, j in ((0, 2), (2, 0)):  # equal values at all three stay equal
        share = (at - x[1]) * (at - x[j]) / ((x[i] - x[1]) * (x[i] - x[j]))
        found = found + share * (values[i] - values[1])
    return found
