"""Relative illumination over the field, for objects of uniform radiance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import number
from ..base.errors import InvalidParameter
from ..base.results import FieldResult, Fields, TabularResult, column_fields
from ..base.typing import Array
from ..optics.materials import Reflectivity, reflectance
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.shell_transmission import transmit_rays
from .evaluation import field_angles
from .ray_bundles import Pupil, gaussian, trace_bundles

RINGS = 24
FINE_RINGS = 48  # for an aperture vignetted by the rim
CHIEF = Pupil(np.zeros((1, 2)), np.ones(1))


@dataclass(frozen=True)
class Illumination(TabularResult, FieldResult):
    """Illumination of the imager at k field angles, by an object of uniform radiance."""

    omega_deg: Array
    """Field angles (k,)."""
    azimuth_deg: Array
    """Azimuths (k,)."""
    irradiance_sr: Array
    """Irradiance of the imager per radiance of the object (k,), steradians."""
    relative: Array
    """Irradiance (k,) relative to a pixel on the axis with the mirror at normal incidence."""
    reflectance: Array
    """Mean R(gamma) over the aperture (k,), of the light on the mirror."""
    filled: Array
    """Unvignetted fraction of the aperture (k,), after blocking by rim, lens and housing."""

    def records(self) -> list[dict[str, float]]:
        """Return one record per field angle."""
        names = ("omega_deg", "azimuth_deg", "irradiance_sr", "relative", "reflectance", "filled")
        rows = zip(*(getattr(self, name).tolist() for name in names), strict=True)
        return [dict(zip(names, row, strict=True)) for row in rows]

    def _fields(self) -> Fields:
        return column_fields(self._table(), {}, "azimuth_deg")


def illumination(
    sensor: Sensor,
    omega_deg: ArrayLike | None = None,
    *,
    azimuth_deg: ArrayLike = 0.0,
    reflectivity: Reflectivity = 1.0,
    transmission: float = 1.0,
) -> Illumination:
    """Compute the illumination over the field, ``E = L T integral of R(gamma) cos^4 dA / b0^2``.

    The cosine refers to the angle of each ray at the imager, R to that at the mirror: rays are
    traced from the pixel outwards through every part of the aperture, modelled as a flat disc; rays
    that miss the mirror or are blocked by lens or housing contribute 0. On the axis this is ``pi L
    T R sin^2(u)`` with ``tan(u) = 1/(2 F_w)``; a lens that obeys the sine condition has ``sin(u) =
    1/(2 F_w)`` instead and therefore a relative excess of 1/(4 F_w^2): 1.4 % at F/4, 11 % at F/1.4.
    Mirrors conserve radiance; therefore the image area of a degree (Ds in the paper) has no effect.
    Reflections at both sides of a cover (Fresnel equations) are losses.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    omega_deg : (n,), optional
        Field angles, deg; by default every 5 deg of the field.
    azimuth_deg : scalar or (n,)
        Direction in the image, deg from right towards bottom.
    reflectivity
        Constant, complex refractive index ``n + 1j k`` of a metal, or one of
        :data:`omnimirror.optics.materials.METALS`.
    transmission
        Transmittance T of the lens.

    Returns
    -------
    Illumination
        Irradiance per radiance (sr) and its ratio to the maximum, (n,).

    Raises
    ------
    OutsideField, InvalidParameter
        If a field angle is outside the field of view, or a number is invalid.

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
        raise InvalidParameter(
            f"transmission must be greater than 0, up to 1; got {transmission:g}"
        )
    sensor.check("illumination", "single mirror")
    normal = float(reflectance([0.0], reflectivity)[0])
    angles = field_angles(sensor) if omega_deg is None else omega_deg
    chief = trace_bundles(sensor, angles, CHIEF, azimuth_deg)
    height = chief.chief_mm(sensor)
    light, reflected, filled = _through(sensor, height, gaussian(RINGS), reflectivity)
    if (
        is_vignetted := filled < 1 - 1e-12
    ).any():  # vignetted by the edge of the rim, which requires more rays
        for column, part in zip(
            (light, reflected, filled),
            _through(sensor, height[is_vignetted], gaussian(FINE_RINGS), reflectivity),
            strict=True,
        ):
            column[is_vignetted] = part
    # Area of the aperture over the squared image distance: pi (D/2)^2 / b0^2 = pi / (4 F_w^2).
    open_aperture = np.pi * transmission / (4 * sensor.lens.image_f_number() ** 2)
    pupil = gaussian(RINGS)
    on_axis = normal * float(
        sensor.lens.falloff(np.zeros_like(pupil.points), pupil.points) @ pupil.weights
    )
    with np.errstate(invalid="ignore"):
        mean = np.where(filled > 0, reflected / filled, 0.0)
    return Illumination(
        chief.omega_deg, chief.azimuth_deg, open_aperture * light, light / on_axis, mean, filled
    )


def _through(
    sensor: Sensor, height: Array, pupil: Pupil, reflectivity: Reflectivity
) -> tuple[Array, Array, Array]:
    """Return light, reflectance and unvignetted fraction (k,) of image points (k, 2) mm."""
    k, n = len(height), len(pupil.points)
    image, aperture = np.repeat(height, n, axis=0), np.tile(pupil.points, (k, 1))
    train = sensor.optical_train
    start, towards = train.rays_of_image(image, aperture)
    reflections = train.posed_mirror.trace(start, towards)
    passes = train.passes(start, towards, reflections)
    cos_gamma = np.clip(np.einsum("ni,ni->n", reflections.directions, reflections.normals), -1, 1)
    gamma = np.where(passes, np.arccos(cos_gamma), 0.0)
    reflected = np.where(passes, reflectance(gamma, reflectivity), 0.0)
    light = reflected * sensor.lens.falloff(image, aperture)
    if (shell := sensor.obstructions.housing.shell) is not None:
        hit = passes
        light[hit] *= transmit_rays(
            shell, reflections.points[hit], reflections.directions[hit]
        ).passed
    return tuple(a.reshape(k, n) @ pupil.weights for a in (light, reflected, passes))  # type: ignore[return-value]  # the length of the generator is fixed
