"""Evaluated field angles of a sensor, and the reasons for excluded ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...optics.sensor import Sensor
from .requirements import FieldRequirements

POINTED_CENTRE = 0.1  # relative to the image radius; the azimuthal scale vanishes at the point
NO_PART = 1e-6  # deg; smaller exclusions are not reported


class JudgedRange(NamedTuple):
    """Evaluated field angles in degrees, and descriptions of the excluded ones."""

    low_deg: float
    high_deg: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Counted:
    """Field of a sensor and its evaluable part.

    Attributes
    ----------
    low_deg, high_deg
        Field of view of the mirror.
    required_deg
        Required field.
    hidden_deg
        Upper end of the central obscuration by the housing; 0 without one.
    hidden_from_deg
        Lower end of the outer obscuration; the end of the field without one.
    point_deg
        Upper end of the excluded centre of a pointed mirror; 0 for a smooth mirror.
    hides
        Part that causes the central obscuration.
    """

    low_deg: float
    high_deg: float
    required_deg: tuple[float, float]
    hidden_deg: float
    hidden_from_deg: float
    point_deg: float
    hides: str

    def part(self, asked_deg: tuple[float, float] | None = None) -> JudgedRange:
        """Return the evaluated range of a part of the field, or of the whole required field.

        Raises
        ------
        InvalidParameter
            Empty range.
        """
        begins = [(self.low_deg, "the mirror shows nothing there"), (self.hidden_deg, f"the {self.hides} hides it")]
        begins += [(self.point_deg, "a pointed mirror shrinks it to nothing")]
        if asked_deg is None:
            begins += [(self.required_deg[0], "it is inside omega_min_deg")]
        first, last = asked_deg or (0.0, self.required_deg[1])
        begin, why = max(begins, key=lambda b: b[0])
        low, high = max(first, begin), min(last, self.hidden_from_deg)
        if high < low <= high + NO_PART:  # the end of the field, shifted by rounding
            low = high
        if asked_deg is None and begin > self.required_deg[0]:
            first = self.required_deg[0]  # angles below are not required
        left_out = [f"{first:.4g} to {low:.4g} deg is not judged: {why}"] if low > first + NO_PART else []
        if high < last - NO_PART:
            left_out.append(f"{high:.4g} to {last:.4g} deg is not judged: {self._end}")
        if low > high or (low == high and first < last):
            part = f"from {first:g} to {last:g} deg" if asked_deg else "of the field"
            reason = (
                f"{why}, up to {begin:.4g} deg" if low > first else f"the field ends at {self.hidden_from_deg:.4g} deg"
            )
            raise InvalidParameter(f"nothing {part} can be judged: {reason}")
        return JudgedRange(low, high, tuple(left_out))

    @property
    def _end(self) -> str:
        """Return the reason for the upper end of the evaluated field."""
        hidden = self.hidden_from_deg < self.high_deg
        return "what stands around the mirror hides it" if hidden else "the mirror's field ends there"


def counted_field(field: FieldRequirements, sensor: Sensor) -> Counted:
    """Return the evaluable field of a sensor, limited by the obscurations of its housing.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import CameraBody, Housing
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> sensor = replace(load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    >>> round(counted_field(FieldRequirements(omega_max_deg=135), sensor).hidden_deg, 2)
    8.43
    """
    low, high = sensor.field_deg
    clear, hidden_from = sensor.clear_field_deg
    point = 0.0
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px]))
        point = float(np.degrees(edge.omega[0]))
    inner = [ring for ring in sensor.obscurations if ring.omega_deg[0] <= low]
    hides = max(inner, key=lambda ring: ring.omega_deg[1], default=None)
    return Counted(
        low, high, (field.omega_min_deg, field.omega_max_deg), clear if hides else 0.0, hidden_from, point,
        hides.part if hides else "camera",
    )  # fmt: skip
