"""Radiometry: mirror reflectivity, lens vignetting and light from the housing."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np

from ..base.parameters import Parameter
from ..base.typing import Array
from ..optics.materials import Reflectivity, reflectance


@dataclass(frozen=True)
class Radiometry:
    """Reflectivity of the mirror, vignetting of the lens, and grey level of obstructions; by
    default without losses.

    Obstructions are defined by the :class:`~omnimirror.optics.housing.Housing` of the sensor.

    Parameters
    ----------
    housing_light
        Light emitted by camera, rod and rim, linear, white at 1.
    reflectivity
        Reflectivity of the mirror: a number, the complex index ``n + 1j k`` of a metal or its name,
        with Fresnel's equations (:func:`omnimirror.optics.materials.reflectance`), or
        three of them, for red, green and blue.
    vignetting
        1: natural vignetting with the fourth power of the cosine; 0: none.
    direct_view
        True if the camera images the world past the mirror; otherwise it is black there.

    Raises
    ------
    InvalidParameter
        If a number is out of range.

    Examples
    --------
    >>> Radiometry(reflectivity="aluminium").returned(np.zeros(1)).round(3)
    array([0.921])
    """

    housing_light: float = 0.02
    reflectivity: Reflectivity | tuple[Reflectivity, Reflectivity, Reflectivity] = 1.0
    vignetting: float = 0.0
    direct_view: bool = False

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "housing_light": Parameter("", 0.0, 1e3, "radiance of the camera, the rod and the rim"),
        "vignetting": Parameter("", 0.0, 1.0, "fraction of the natural vignetting of the lens"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            if f.name in self.PARAMETERS:
                self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        for each in (
            self.reflectivity if isinstance(self.reflectivity, tuple) else (self.reflectivity,)
        ):
            reflectance(0.0, each)

    def returned(self, gamma: Array) -> Array:
        """Return the reflectivity of the mirror for one colour.

        Parameters
        ----------
        gamma : (n,)
            Angles of incidence, radians.

        Returns
        -------
        (n,) array
        """
        assert not isinstance(self.reflectivity, tuple)
        return reflectance(gamma, self.reflectivity)

    def by_colour(self) -> tuple[Radiometry, Radiometry, Radiometry] | None:
        """Return the radiometry for red, green and blue light.

        Returns
        -------
        tuple of three Radiometry
            None if all colours are equal.
        """
        if not isinstance(self.reflectivity, tuple):
            return None
        red, green, blue = (replace(self, reflectivity=each) for each in self.reflectivity)
        return red, green, blue


def camera_front(position: Array) -> Array:
    """Return the grey level (n,) of the camera front at points (n, 2) in radii of its front ring,
    as in the kernels.
    """
    x, y = position.T
    with np.errstate(invalid="ignore"):
        q = np.hypot(x, y)
        glint = np.hypot(x + 0.2, y + 0.25) < 0.12
        mark = (np.abs(x) < 0.12) & (y < 0) & (q > 1.15) & (q < 1.55)
        parts = [
            (glint & (q < 0.62), 12.0),
            (q < 0.55, 0.25),
            (q < 0.62, 1.0),
            (q < 0.74, 6.0),
            (q < 1.0, 1.5),
            (q < 1.06, 0.3),
            (mark, 12.0),
            (q < 2.2, 1.0),
        ]
    return np.select([where for where, _ in parts], [light for _, light in parts], 0.7)
