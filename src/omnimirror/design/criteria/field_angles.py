"""Over which field angles a sensor is judged, what is left out of that, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...optics.sensor import Sensor
from .requirements import FieldRequirements

Array = NDArray[np.float64]

POINTED_CENTRE = 0.1  # of the image radius; around a point a degree of azimuth shrinks to nothing
NO_PART = 1e-6  # degrees; less than this is not worth saying


class JudgedRange(NamedTuple):
    """Field angles that are judged, in degrees, and in words what of those asked for is not."""

    low_deg: float
    high_deg: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Counted:
    """The field of a sensor, and what of it can be judged.

    Attributes
    ----------
    low_deg, high_deg
        What the mirror shows.
    required_deg
        From where to where it matters.
    hidden_deg
        Up to where the housing hides the view; 0 where nothing does.
    hidden_from_deg
        From where on it does so again, up to the end; the end where nothing does.
    point_deg
        Up to where a pointed mirror shows too little to count; 0 of a smooth one.
    hides
        The part that hides the view up to ``hidden_deg``.
    """

    low_deg: float
    high_deg: float
    required_deg: tuple[float, float]
    hidden_deg: float
    hidden_from_deg: float
    point_deg: float
    hides: str

    def part(self, asked_deg: tuple[float, float] | None = None) -> JudgedRange:
        """What is judged of a part of the field that is asked for, or of all of it that matters.

        Raises
        ------
        InvalidParameter
            Nothing is.
        """
        begins = [(self.low_deg, "the mirror shows nothing there"), (self.hidden_deg, f"the {self.hides} hides it")]
        begins += [(self.point_deg, "a pointed mirror shrinks it to nothing")]
        if asked_deg is None:
            begins += [(self.required_deg[0], "it is inside omega_min_deg")]
        first, last = asked_deg or (0.0, self.required_deg[1])
        begin, why = max(begins, key=lambda b: b[0])
        low, high = max(first, begin), min(last, self.hidden_from_deg)
        if high < low <= high + NO_PART:  # the very end of the field, which rounding has moved past
            low = high
        if asked_deg is None and begin > self.required_deg[0]:
            first = self.required_deg[0]  # what is inside of that is not asked for
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
        """Why nothing is judged beyond the last angle that is."""
        hidden = self.hidden_from_deg < self.high_deg
        return "what stands around the mirror hides it" if hidden else "the mirror's field ends there"


def counted_field(field: FieldRequirements, sensor: Sensor) -> Counted:
    """What counts of a sensor's field, and what its housing hides of it.

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
