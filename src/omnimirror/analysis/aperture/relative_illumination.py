"""How bright an evenly lit world appears over the field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import number
from ...base.errors import InvalidParameter
from ...optics.mirrors.reflectivity import Reflectivity, reflectance
from ...optics.sensor import Sensor, check_sensor
from ...optics.tracing.walls import let_out
from ..evaluation import field_angles
from .bundles import trace_bundles
from .pupil import Pupil, gaussian
from .records import Recorded

Array = NDArray[np.float64]

RINGS = 24
FINE_RINGS = 48  # where the rim cuts the aperture
CHIEF = Pupil(np.zeros((1, 2)), np.ones(1))


@dataclass(frozen=True)
class Illumination(Recorded):
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
    """(k,) unvignetted share of the aperture; below 1 where the rim, the lens or the housing blocks rays."""

    def records(self) -> list[dict[str, float]]:
        """One record per field angle."""
        names = ("omega_deg", "azimuth_deg", "irradiance_sr", "relative", "reflectance", "filled")
        rows = zip(*(getattr(self, name).tolist() for name in names), strict=True)
        return [dict(zip(names, row, strict=True)) for row in rows]


def illumination(
    sensor: Sensor,
    omega_deg: ArrayLike | None = None,
    *,
    azimuth_deg: ArrayLike = 0.0,
    reflectivity: Reflectivity = 1.0,
    transmission: float = 1.0,
) -> Illumination:
    """Illumination over the field: ``E = L T integral of R(gamma) cos^4 dA / b0^2`` over the aperture.

    The angle of the cosine is that of each ray at the imager, and R that at the mirror: rays are traced from the
    pixel outwards through every part of the aperture, a flat disk as everywhere here; those that miss the mirror or
    that lens or housing block contribute nothing. On the axis this is ``pi L T R sin^2(u)`` with
    ``tan(u) = 1/(2 F_w)``; a lens that obeys the sine condition has ``sin(u) = 1/(2 F_w)`` instead and gets
    1/(4 F_w^2) of it more: 1.4 % at F/4, 11 % at F/1.4. Radiance is conserved by mirrors, so the image area of a
    degree (the paper's Ds) does not enter. What a cover reflects (Fresnel's formulas, both sides) is lost.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives.
    omega_deg : (n,), optional
        Field angles, deg; every 5 deg seen by default.
    azimuth_deg : scalar or (n,)
        Direction in the picture, deg from right towards bottom.
    reflectivity
        A number, a metal's ``n + 1j k``, or one of :data:`omnimirror.optics.mirrors.reflectivity.METALS`.
    transmission
        T of the lens.

    Returns
    -------
    Illumination
        Irradiance per radiance (sr) and its share of the largest, (n,).

    Raises
    ------
    OutsideField, InvalidParameter
        A field angle that is not seen; numbers that are not valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.illumination(om.load_sensor("paper-spherical"), [0.0, 90.0, 134.0], reflectivity="aluminium")
    >>> found.relative.round(3)
    array([1.   , 0.941, 0.88 ])
    """
    check_sensor(sensor)
    transmission = number("transmission", transmission)
    if not 0 < transmission <= 1:
        raise InvalidParameter(f"transmission = {transmission:g} is not a share; it is valid above 0, up to 1")
    sensor.check("illumination", "one mirror")
    normal = float(reflectance([0.0], reflectivity)[0])
    angles = field_angles(sensor) if omega_deg is None else omega_deg
    chief = trace_bundles(sensor, angles, CHIEF, azimuth_deg)
    height = chief.chief_mm(sensor)
    light, reflected, filled = _through(sensor, height, gaussian(RINGS), reflectivity)
    if (cut := filled < 1 - 1e-12).any():  # by the rim's edge, which more rays follow better
        for whole, part in zip(
            (light, reflected, filled), _through(sensor, height[cut], gaussian(FINE_RINGS), reflectivity), strict=True
        ):
            whole[cut] = part
    open_aperture = np.pi * transmission / (4 * sensor.lens.image_f_number() ** 2)
    pupil = gaussian(RINGS)
    on_axis = normal * float(sensor.lens.falloff(np.zeros_like(pupil.points), pupil.points) @ pupil.weights)
    with np.errstate(invalid="ignore"):
        mean = np.where(filled > 0, reflected / filled, 0.0)
    return Illumination(chief.omega_deg, chief.azimuth_deg, open_aperture * light, light / on_axis, mean, filled)


def _through(sensor: Sensor, height: Array, pupil: Pupil, reflectivity: Reflectivity) -> tuple[Array, Array, Array]:
    """Light, reflectance and share of the aperture (k,) that reach image points (k, 2) mm, each summed over it."""
    k, n = len(height), len(pupil.points)
    image, aperture = np.repeat(height, n, axis=0), np.tile(pupil.points, (k, 1))
    train = sensor.optical_train
    start, towards = train.rays_of_image(image, aperture)
    found = train.posed_mirror.trace(start, towards)
    passes = train.passes(start, towards, found)
    cos_gamma = np.clip(np.einsum("ni,ni->n", found.directions, found.normals), -1, 1)
    gamma = np.where(passes, np.arccos(cos_gamma), 0.0)
    reflected = np.where(passes, reflectance(gamma, reflectivity), 0.0)
    light = reflected * sensor.lens.falloff(image, aperture)
    if (shell := sensor.obstructions.housing.shell) is not None:
        hit = passes
        light[hit] *= let_out(shell, found.points[hit], found.directions[hit]).passed
    return tuple(a.reshape(k, n) @ pupil.weights for a in (light, reflected, passes))  # type: ignore[return-value]
