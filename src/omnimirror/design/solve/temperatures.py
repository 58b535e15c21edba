"""Temperature range of a sensor with all requirements met."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...analysis.temperature import at_temperature
from ...base.arguments import checked
from ...base.errors import InvalidParameter, OmnimirrorError
from ...optics.sensor import Sensor
from ..criteria.requirements import Requirements
from .verdict import judge

STEP_K = 10.0  # step of the search before bisection
CLOSE_K = 0.1


@dataclass(frozen=True)
class TemperatureRange:
    """Temperature range about the reference with all requirements met.

    Attributes
    ----------
    low_c, high_c
        Ends of the range, accurate to 0.1 K; NaN if requirements are missed at the reference.
    below, above
        Requirements missed beyond each end; empty at the ends of the searched range.
    """

    low_c: float
    high_c: float
    below: tuple[str, ...]
    above: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the range as plain data for JSON."""
        return {"low_c": self.low_c, "high_c": self.high_c, "below": list(self.below), "above": list(self.above)}


@checked
def temperature_range(
    requirements: Requirements, sensor: Sensor, *, coldest_c: float = -40.0, warmest_c: float = 85.0
) -> TemperatureRange:
    """Compute the temperature range of a sensor with all requirements met.

    Parameters
    ----------
    requirements
        Requirements as in :func:`omnimirror.judge`.
    sensor
        Sensor with ``thermal`` properties.
    coldest_c, warmest_c
        Ends of the searched range, which includes the reference of ``thermal``.

    Returns
    -------
    TemperatureRange
        Contiguous range about the reference.

    Raises
    ------
    InvalidParameter
        Sensor without thermal properties, or a range without its reference.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> wanted = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=130.0),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.905),
    ...     lens=om.LensRequirements(theta_max_deg=12.0),
    ...     limits=(om.Limit("total_blur_px", at_most=7.9),),
    ... )
    >>> thermal = om.Thermal(mirror_material="acrylic", spacer_material="aluminium")
    >>> found = temperature_range(wanted, replace(om.load_sensor("paper-spherical"), thermal=thermal))
    >>> found.low_c, found.high_c, found.above
    (-40.0, 48.9, ('total_blur_px',))
    """
    if sensor.thermal is None:
        at_temperature(sensor, coldest_c)  # raises an error with the missing properties
    reference = sensor.thermal.reference_c  # type: ignore[union-attr]  # refused above
    if not coldest_c <= reference <= warmest_c:
        raise InvalidParameter(
            f"temperatures from {coldest_c:g} to {warmest_c:g} C are not valid; they must hold the reference of the "
            f"sensor's [thermal], {reference:g} C"
        )
    if missed := _missed(requirements, sensor, reference):
        return TemperatureRange(np.nan, np.nan, missed, missed)
    (low, below), (high, above) = (_end(requirements, sensor, reference, end) for end in (coldest_c, warmest_c))
    return TemperatureRange(low, high, below, above)


def _end(requirements: Requirements, sensor: Sensor, met: float, end: float) -> tuple[float, tuple[str, ...]]:
    """Return the last temperature with all requirements met, and those missed beyond."""
    missed: tuple[str, ...] = ()
    step = float(np.copysign(STEP_K, end - met))
    while met != end:
        tried = end if abs(end - met) <= STEP_K else met + step
        if missed := _missed(requirements, sensor, tried):
            break
        met = tried
    else:
        return end, ()
    while abs(tried - met) > CLOSE_K:
        middle = (met + tried) / 2
        if found := _missed(requirements, sensor, middle):
            tried, missed = middle, found
        else:
            met = middle
    return round(met, 1), missed


def _missed(requirements: Requirements, sensor: Sensor, temperature_c: float) -> tuple[str, ...]:
    """Return the requirements missed at a temperature. Given sizes (rim, focal length) refer to
    manufacture and may expand.
    """
    try:
        rows = judge(replace(requirements, temperatures_c=None), at_temperature(sensor, temperature_c)).rows
    except OmnimirrorError as e:  # invalid sensor
        return (str(e),)
    return tuple(row.label for row in rows if not row.is_met and (row.is_limit or row.at_least != row.at_most))
