"""How bright an evenly lit world appears over the field."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..files import write_text
from ..mirrors.reflectivity import Reflectivity, reflectance
from ..sensor import Sensor
from .bundles import trace_bundles
from .evaluation import field_angles
from .pupil import Pupil, gaussian

Array = NDArray[np.float64]

RINGS = 24
CHIEF = Pupil(np.zeros((1, 2)), np.ones(1))


@dataclass(frozen=True)
class Illumination:
    """Illumination of the imager at k field angles, by an object of the same radiance everywhere."""

    omega_deg: Array
    """(k,)"""
    azimuth_deg: Array
    """(k,)"""
    irradiance_sr: Array
    """(k,) irradiance of the imager per radiance of the object, steradians."""
    relative: Array
    """(k,) against a pixel on the optical axis that sees the same mirror at normal incidence."""
    reflectance: Array
    """(k,) mean R(gamma) over the aperture, of the light that the mirror catches."""
    filled: Array
    """(k,) share of the aperture that the mirror fills; below 1 next to the rim."""

    def to_csv(self, path: str | Path) -> None:
        """Write one line per field angle."""
        names = ("omega_deg", "azimuth_deg", "irradiance_sr", "relative", "reflectance", "filled")
        rows = zip(*(getattr(self, name) for name in names), strict=True)
        write_text(path, "\n".join([",".join(names), *(",".join(f"{v:.10g}" for v in row) for row in rows)]) + "\n")


def illumination(
    sensor: Sensor,
    omega_deg: ArrayLike | None = None,
    *,
    azimuth_deg: ArrayLike = 0.0,
    reflectivity: Reflectivity = 1.0,
    transmission: float = 1.0,
) -> Illumination:
    """Illumination over the field: ``E = pi L T R(gamma) cos^4(theta) / (4 F_w^2)``.

    R is the mean over the aperture, whose rays are traced from the pixel outwards; those that miss the
    mirror bring nothing. Radiance is conserved by mirrors, so the image area of a degree (the paper's
    Ds) does not enter. Under a telecentric lens theta is 0.

    Parameters
    ----------
    omega_deg : (k,)
        Field angles; every 5 deg of an aligned sensor's field when nothing is given.
    reflectivity
        A number, a metal's ``n + 1j k``, or one of :data:`omnimirror.mirrors.reflectivity.METALS`.
    transmission
        T of the lens.

    Raises
    ------
    OutsideField, InvalidParameter
        A field angle that is not seen; numbers that are not valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.illumination(om.load_sensor("paper-spherical"), [0.0, 90.0, 134.0], reflectivity="aluminium")
    >>> found.relative.round(3)
    array([1.   , 0.94 , 0.878])
    """
    if not 0 < transmission <= 1:
        raise InvalidParameter(f"transmission = {transmission:g} is not a share; it is valid above 0, up to 1")
    sensor.check_one_mirror("illumination")
    angles = field_angles(sensor) if omega_deg is None else omega_deg
    chief = trace_bundles(sensor, angles, CHIEF, azimuth_deg)
    height, pupil = chief.chief_mm(sensor), gaussian(RINGS)
    k, n = len(height), len(pupil.points)
    image, aperture = np.repeat(height, n, axis=0), np.tile(pupil.points, (k, 1))
    origins, directions = sensor.lens_rays_of_image(image, aperture)
    found = sensor.posed_mirror.trace(origins, directions)
    cos_gamma = np.clip(np.einsum("ni,ni->n", found.directions, found.normals), -1, 1)
    gamma = np.where(found.valid, np.arccos(cos_gamma), 0.0)
    reflected = np.where(found.valid, reflectance(gamma, reflectivity), 0.0).reshape(k, n)
    on_axis = np.pi * transmission / (4 * sensor.lens.image_f_number() ** 2)
    filled = found.valid.reshape(k, n) @ pupil.weights
    irradiance = on_axis * (reflected @ pupil.weights) * sensor.lens.falloff(height)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (reflected @ pupil.weights) / filled
        relative = irradiance / (on_axis * reflectance([0.0], reflectivity)[0])
    return Illumination(chief.omega_deg, chief.azimuth_deg, irradiance, relative, mean, filled)
