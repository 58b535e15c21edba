"""Which pixels of a sensor show nothing but the sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..cameras import Rays
from ..sensor import Sensor

Array = NDArray[np.float64]


def hidden_pixels(sensor: Sensor, pixels: Array, rays: Rays) -> NDArray[np.bool_]:
    """Before which pixels (n, 2) a part of the sensor itself stands; two mirrors share an axis, and hide rings."""
    hidden = np.zeros(len(pixels), bool)
    if sensor.secondary is None:
        if not sensor.housing.is_empty:
            for mask in sensor.hidden_by(pixels).values():
                hidden |= mask
        return hidden
    with np.errstate(invalid="ignore"):
        omega_deg = np.degrees(np.arccos(np.clip(rays.directions @ sensor.axis, -1.0, 1.0)))
        for ring in sensor.obscured:
            low, high = ring.omega_deg
            hidden |= (omega_deg >= low) & (omega_deg <= high)
    return hidden
