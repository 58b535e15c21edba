"""Sensor at one wavelength: refraction of lens and cover."""

from __future__ import annotations

from dataclasses import replace

from ..base.arguments import checked, number
from ..optics.sensor import Sensor


@checked
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
        Wavelength out of range, or a lens without dispersion data.

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
    housing = sensor.housing if shell is None else replace(sensor.housing, shell=shell.at_wavelength(wavelength_nm))
    return replace(sensor, lens=sensor.lens.at_wavelength(wavelength_nm), housing=housing)
