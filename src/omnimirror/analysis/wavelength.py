"""A sensor in light of one wavelength: how its lens and its cover refract there."""

from __future__ import annotations

from dataclasses import replace

from ..base.arguments import checked, number
from ..optics.sensor import Sensor


@checked
def at_wavelength(sensor: Sensor, wavelength_nm: float) -> Sensor:
    """A sensor as it is for light of one wavelength.

    Mirrors have no colour; a lens made of surfaces has that of its glasses, one known by a table what that says of
    lateral colour, and a cover that of its materials. Stop and imager stay where they are.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives.
    wavelength_nm
        300 to 1100.

    Returns
    -------
    Sensor
        An ordinary one.

    Raises
    ------
    InvalidParameter
        A wavelength out of range, or a lens of whose indices at other wavelengths nothing is said.

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
