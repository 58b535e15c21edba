"""Over which field angles a sensor is judged, what is left out of that, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from ...sensor import Sensor
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
    wanted_deg
        From where to where it matters.
    hidden_deg
        Up to where the camera hides the view; 0 where nothing is known of its size.
    point_deg
        Up to where a pointed mirror shows too little to count; 0 of a smooth one.
    """

    low_deg: float
    high_deg: float
    wanted_deg: tuple[float, float]
    hidden_deg: float
    point_deg: float

    def part(self, asked_deg: tuple[float, float] | None = None) -> JudgedRange:
        """What is judged of a part of the field that is asked for, or of all of it that matters.

        Raises
        ------
        InvalidParameter
            Nothing is.
        """
        begins = [(self.low_deg, "the mirror shows nothing there"), (self.hidden_deg, "the camera hides it")]
        begins += [(self.point_deg, "a pointed mirror shrinks it to nothing")]
        if asked_deg is None:
            begins += [(self.wanted_deg[0], "it is inside omega_min_deg")]
        first, last = asked_deg or (0.0, self.wanted_deg[1])
        begin, why = max(begins, key=lambda b: b[0])
        low, high = max(first, begin), min(last, self.high_deg)
        if asked_deg is None and begin > self.wanted_deg[0]:
            first = self.wanted_deg[0]  # what is inside of that is not asked for
        left_out = [f"{first:.4g} to {low:.4g} deg is not judged: {why}"] if low > first + NO_PART else []
        if high < last - NO_PART:
            left_out.append(f"{high:.4g} to {last:.4g} deg is not judged: the mirror's field ends there")
        if low > high or (low == high and first < last):
            part = f"from {first:g} to {last:g} deg" if asked_deg else "of the field"
            reason = f"{why}, up to {begin:.4g} deg" if low > first else f"the field ends at {self.high_deg:.4g} deg"
            raise InvalidParameter(f"nothing {part} can be judged: {reason}")
        return JudgedRange(low, high, tuple(left_out))


def counted_field(field: FieldRequirements, sensor: Sensor) -> Counted:
    """What counts of a sensor's field."""
    low, high = sensor.field_deg
    radius, point = field.camera_radius_mm, 0.0
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px]))
        point = float(np.degrees(edge.omega[0]))
    hidden = 0.0 if radius is None else hidden_deg(sensor, radius)
    return Counted(low, high, (field.omega_min_deg, field.omega_max_deg), hidden, point)


def hidden_deg(sensor: Sensor, camera_radius_mm: float) -> float:
    """Field angle up to which a round camera at the lens hides the view; that of the rim where it hides all.

    The chief ray of mirror point x goes through the plane of the lens at ``x + (m + z) tan(Omega)``.

    >>> from omnimirror.specs import load_sensor
    >>> round(hidden_deg(load_sensor("paper-spherical"), 30.0), 2)
    8.43
    """
    rays = sensor.meridian.trace(np.linspace(0.0, sensor.mirror.rim_radius_mm, 1025))
    with np.errstate(invalid="ignore"):
        radius = np.where(np.cos(rays.omega) > 0, rays.x + rays.w * np.tan(rays.omega), np.inf)
    is_clear = radius >= camera_radius_mm
    if not is_clear.any():
        return sensor.field_deg[1]
    clear = int(np.argmax(is_clear))
    if clear == 0:
        return 0.0
    a, b = radius[clear - 1], radius[clear]
    share = (camera_radius_mm - a) / (b - a) if np.isfinite(b) else 1.0
    omega = rays.omega[clear - 1] + share * (rays.omega[clear] - rays.omega[clear - 1])
    return float(np.degrees(omega))
