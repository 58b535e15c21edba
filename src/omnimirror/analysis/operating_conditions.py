"""Operating conditions: a sensor at one wavelength or temperature, and its thermal image motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import number, validate_arguments
from ..base.errors import InvalidParameter
from ..optics.housing import Housing
from ..optics.lenses import Lens, Perspective
from ..optics.sensor import Sensor
from ..optics.thermal import EXPANSIONS_PPM, INDEX_RATES_PER_K, Thermal

# -- Wavelength ------------------------------------------------------------------------------------


@validate_arguments
def at_wavelength(sensor: Sensor, wavelength_nm: float) -> Sensor:
    """Return a sensor at one wavelength.

    Mirrors are achromatic. The dispersion of a lens follows from its glasses or from the lateral
    colour of its table, that of a cover from its materials. Stop and imager are unchanged.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    wavelength_nm
        Wavelength, 300 to 1100 nm.

    Returns
    -------
    Sensor
        Sensor with lens and cover at this wavelength.

    Raises
    ------
    InvalidParameter
        If the wavelength is out of range, or the lens has no dispersion data.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.optics.housing import Dome, Housing
    >>> domed = replace(om.load_sensor("paper-spherical"), housing=Housing(shell=Dome(material="polycarbonate")))
    >>> red, blue = (om.evaluate(om.at_wavelength(domed, nm), [60.0]).h_px[0] for nm in (650.0, 450.0))
    >>> float(round(blue - red, 2))
    -0.06
    """
    wavelength_nm = number("wavelength_nm", wavelength_nm, low=300.0, high=1100.0, unit="nm")
    shell = sensor.housing.shell
    housing = (
        sensor.housing
        if shell is None
        else replace(sensor.housing, shell=shell.at_wavelength(wavelength_nm))
    )
    return replace(sensor, lens=sensor.lens.at_wavelength(wavelength_nm), housing=housing)


# -- Temperature -----------------------------------------------------------------------------------

PPM = 1e-6


@validate_arguments
def at_temperature(sensor: Sensor, temperature_c: float) -> Sensor:
    """Return a sensor at a uniform temperature.

    Parameters
    ----------
    sensor
        Sensor with ``thermal`` properties, the table [thermal] of its file.
    temperature_c
        Temperature in degrees Celsius.

    Returns
    -------
    Sensor
        Sensor with expanded mirror and mirror distance, and the resulting focus; the temperature is
        the reference of its ``thermal`` properties.

    Raises
    ------
    InvalidParameter
        If the sensor has no thermal properties, or the lens does not support them.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = replace(om.load_sensor("paper-spherical"), thermal=om.Thermal(spacer_material="aluminium"))
    >>> warm = om.at_temperature(sensor, 60.0)
    >>> round(warm.mirror_distance_mm - sensor.mirror_distance_mm, 3)
    0.17
    """
    thermal = sensor.thermal
    if thermal is None:
        raise InvalidParameter(
            f"the thermal model of {sensor.name!r} is missing; add a table [thermal] to "
            'its file, for example with mirror_material = "acrylic", spacer_material = '
            '"aluminium"'
        )
    warmer = (
        number("temperature_c", temperature_c, low=-273.0, high=1000.0, unit="C")
        - thermal.reference_c
    )
    if not warmer:
        return sensor
    mirror_grows = 1 + PPM * thermal.expansion_ppm("mirror") * warmer
    spacer_grows = 1 + PPM * thermal.expansion_ppm("spacer") * warmer
    attachment = (
        float(sensor.mirror.sag(sensor.mirror.rim_radius_mm)) if thermal.held_at == "rim" else 0.0
    )
    # the spacer, from lens to attachment, and the mirror, from attachment to vertex, expand separately
    distance = (sensor.mirror_distance_mm + attachment) * spacer_grows - attachment * mirror_grows
    pose = sensor.mirror_pose
    shifts = ("decentre_x_mm", "decentre_y_mm", "displacement_mm")
    lengths = {name: getattr(pose, name) * spacer_grows for name in shifts}
    second = sensor.secondary
    if second is not None:
        second = replace(
            second,
            mirror=second.mirror.scaled(mirror_grows),
            distance_mm=second.distance_mm * spacer_grows,
            bore_radius_mm=second.bore_radius_mm * mirror_grows,
        )
    imager = sensor.imager
    pitch = imager.pixel_pitch_um * (1 + PPM * thermal.imager_ppm_per_k * warmer)
    return replace(
        sensor,
        mirror=sensor.mirror.scaled(mirror_grows),
        lens=_lens(sensor.lens, thermal, warmer),
        imager=replace(imager, pixel_pitch_um=pitch),
        mirror_distance_mm=distance,
        mirror_pose=replace(pose, **lengths),
        secondary=second,
        housing=_housing(sensor.housing, warmer),
        thermal=replace(thermal, reference_c=thermal.reference_c + warmer),
    )


def _lens(lens: Lens, thermal: Thermal, warmer: float) -> Lens:
    """Return the lens with changed focal length and image distance."""
    focal, mount = thermal.focal_ppm_per_k, thermal.expansion_ppm("mount")
    if not (focal or mount):
        return lens
    if not isinstance(lens, Perspective):
        raise InvalidParameter(
            "thermal changes of focal length and mount are not supported for "
            f"lenses of kind {lens.KIND}; remove focal_ppm_per_k, mount_material and mount_ppm_per_k "
            "from [thermal]"
        )
    f = lens.focal_length_mm * (1 + PPM * focal * warmer)
    behind = lens.image_distance * (1 + PPM * mount * warmer)
    if not behind > f:
        raise InvalidParameter(
            f"the imager must be farther behind the lens than its focal length, {f:.4f} "
            f"mm; at {warmer:+g} K it is at {behind:.4f} mm, where no object is in focus"
        )
    # The imager stays at its expanded distance b: the focus follows from 1/L0 = 1/f - 1/b.
    return replace(lens, focal_length_mm=f, focus_distance_mm=1 / (1 / f - 1 / behind))


def _housing(housing: Housing, warmer: float) -> Housing:
    """Return the housing with its clear wall expanded and its refractive index changed."""
    shell: Any = housing.shell
    if shell is None:
        return housing
    changed: dict[str, Any] = {}
    if shell.material is not None:
        grows = 1 + PPM * EXPANSIONS_PPM.get(shell.material, 0.0) * warmer
        changed |= {
            name: getattr(shell, name) * grows
            for name, parameter in shell.PARAMETERS.items()
            if parameter.unit == "mm" and getattr(shell, name) is not None
        }
        index = shell.index + INDEX_RATES_PER_K.get(shell.material, 0.0) * warmer
        changed |= {"material": None, "refractive_index": index}
    if shell.medium is not None and shell.medium in INDEX_RATES_PER_K:
        changed |= {
            "medium": None,
            "medium_index": shell.outer_index + INDEX_RATES_PER_K[shell.medium] * warmer,
        }
    return replace(housing, shell=replace(shell, **changed))


@validate_arguments
def thermal_motion_px(
    sensor: Sensor, temperature_c: float, *, omega_deg: ArrayLike | None = None
) -> float:
    """Compute the largest image motion due to a change of temperature.

    Parameters
    ----------
    sensor
        Sensor with ``thermal`` properties and an aligned mirror.
    temperature_c
        Temperature in degrees Celsius.
    omega_deg : (n,), optional
        Field angles of distant objects; by default the common field at both temperatures.

    Returns
    -------
    float
        Image motion in pixels, along the meridian.

    Raises
    ------
    InvalidParameter
        As in :func:`at_temperature`.

    Examples
    --------
    >>> import omnimirror as om
    >>> thermal = om.Thermal(mirror_material="acrylic", spacer_material="aluminium")
    >>> sensor = replace(om.load_sensor("paper-hyperboloidal"), thermal=thermal)
    >>> 0.1 < om.thermal_motion_px(sensor, 60.0) < 2.0
    True
    """
    from .evaluation import evaluate

    moved = at_temperature(sensor, temperature_c)
    if omega_deg is None:
        low, high = (
            f(a, b) for f, a, b in zip((max, min), sensor.field_deg, moved.field_deg, strict=True)
        )
        omega_deg = np.linspace(low, high, 181)
    before, after = (evaluate(states, omega_deg).h_px for states in (sensor, moved))
    return float(np.nanmax(np.abs(after - before)))
