"""Reflectance of a mirror: a constant, or Fresnel's equations for a metal."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import number, shown
from ...base.errors import InvalidParameter
from ...base.typing import Array

Reflectivity: TypeAlias = float | complex | str
"""Constant from 0 to 1, complex refractive index ``n + 1j k`` of a metal, or name of a metal."""

METALS: dict[str, complex] = {
    "aluminium": 0.96 + 6.69j,  # Rakic 1995
    "silver": 0.06 + 3.59j,  # Johnson and Christy 1972
    "gold": 0.43 + 2.46j,  # Johnson and Christy 1972
}
"""Refractive indices of clean metals at 550 nm."""


def reflectance(gamma: ArrayLike, reflectivity: Reflectivity) -> Array:
    """Compute the reflectance for unpolarised light at angles of incidence gamma, radians.

    A constant is independent of the angle; metals follow Fresnel's equations, averaged over
    polarisations.

    Raises
    ------
    InvalidParameter
        If a constant is outside 0 to 1, an index is not that of a metal, or a name is unknown.

    Examples
    --------
    >>> reflectance(np.radians([0.0, 60.0]), "aluminium").round(3)
    array([0.921, 0.907])
    >>> reflectance([0.0], 0.96 + 6.69j).round(3), reflectance([0.5], 0.9)
    (array([0.921]), array([0.9]))
    """
    index = _index(reflectivity)
    cos = np.cos(np.asarray(gamma, dtype=float))
    if isinstance(index, float):
        return np.full_like(cos, index)
    inside = np.sqrt(1 - (1 - cos**2) / index**2)  # cosine in the metal, complex
    # Fresnel's equations, s and p polarisation
    s = (cos - index * inside) / (cos + index * inside)
    p = (index * cos - inside) / (index * cos + inside)
    mean: Array = (np.abs(s) ** 2 + np.abs(p) ** 2) / 2
    return mean


def _index(reflectivity: Reflectivity) -> float | complex:
    """Return a constant as float, or a refractive index as complex."""
    if isinstance(reflectivity, str):
        if reflectivity not in METALS:
            raise InvalidParameter(f"reflectivity = {shown(reflectivity)} is not known; valid are {', '.join(METALS)}")
        return METALS[reflectivity]
    if isinstance(reflectivity, complex):
        if not (np.isfinite(reflectivity) and reflectivity.real > 0 and reflectivity.imag >= 0):
            raise InvalidParameter(f"reflectivity = {reflectivity} is not an index n + k j with n > 0 and k >= 0")
        return reflectivity
    share = number("reflectivity", reflectivity)
    if not 0 < share <= 1:
        raise InvalidParameter(f"reflectivity = {share:g} is not a share; it is valid above 0, up to 1")
    return share
