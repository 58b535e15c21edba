"""How much light comes: what the mirror returns, what the lens dims, what the housing in the light sends out itself."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base.parameters import Parameter
from ..optics.mirrors.reflectivity import Reflectivity, reflectance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Radiometry:
    """How the mirror and the lens dim the light, and how grey what stands in it is; by default nothing is dimmed.

    What stands in the light is the sensor's own :class:`~omnimirror.optics.housing.Housing`.

    Parameters
    ----------
    grey
        Light that camera, rod and rim send out, linear, white at 1.
    reflectivity
        Share of the light that the mirror returns: a number, a metal's index ``n + 1j k`` or its name, which
        follow Fresnel's formulas (:func:`omnimirror.optics.mirrors.reflectivity.reflectance`), or three of them, for
        red, green and blue.
    vignetting
        1: the natural one of a lens, with the fourth power of the cosine; 0: none.
    sees_past
        Whether the camera sees the world beside the mirror; else it is black there.

    Raises
    ------
    InvalidParameter
        A number outside its range.

    Examples
    --------
    >>> Radiometry(reflectivity="aluminium").returned(np.zeros(1)).round(3)
    array([0.921])
    """

    grey: float = 0.02
    reflectivity: Reflectivity | tuple[Reflectivity, Reflectivity, Reflectivity] = 1.0
    vignetting: float = 0.0
    sees_past: bool = False

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "grey": Parameter("", 0.0, 1e3, "light that camera, rod and rim send out"),
        "vignetting": Parameter("", 0.0, 1.0, "share of the natural vignetting of the lens"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            if f.name in self.PARAMETERS:
                self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        for each in self.reflectivity if isinstance(self.reflectivity, tuple) else (self.reflectivity,):
            reflectance(0.0, each)

    def returned(self, gamma: Array) -> Array:
        """Share of the light that the mirror returns; of one colour.

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

    def of_colours(self) -> tuple[Radiometry, Radiometry, Radiometry] | None:
        """The same as red, green and blue light meet it.

        Returns
        -------
        tuple of three Radiometry
            None where all colours are alike.
        """
        if not isinstance(self.reflectivity, tuple):
            return None
        red, green, blue = (replace(self, reflectivity=each) for each in self.reflectivity)
        return red, green, blue


def camera_front(place: Array) -> Array:
    """How light (n,) a camera's front is at places (n, 2) in radii of its lens's front ring; as in the kernels."""
    x, y = place.T
    with np.errstate(invalid="ignore"):
        q = np.hypot(x, y)
        glint = np.hypot(x + 0.2, y + 0.25) < 0.12
        mark = (np.abs(x) < 0.12) & (y < 0) & (q > 1.15) & (q < 1.55)
        parts = [
            (glint & (q < 0.62), 12.0), (q < 0.55, 0.25), (q < 0.62, 1.0), (q < 0.74, 6.0), (q < 1.0, 1.5),
            (q < 1.06, 0.3), (mark, 12.0), (q < 2.2, 1.0),
        ]  # fmt: skip
    return np.select([where for where, _ in parts], [light for _, light in parts], 0.7)
