"""Options that the commands of the whole aperture share."""

from __future__ import annotations

from dataclasses import dataclass

import click
import numpy as np
from numpy.typing import NDArray

from ....analysis.aperture.point_spread import KINDS, Kind
from ....analysis.evaluation import field_angles
from ....analysis.meridional.focus import best_focus
from ....optics.sensor import Sensor
from .common import angle, distance, focus, values
from .declared import Options, option

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObjectOptions(Options):
    """Which objects are looked at."""

    omega_deg: Array | None = option(
        type=values, metavar="A:B:STEP", help="Field angles.  [default: every 15 deg seen]"
    )
    azimuth_deg: float = option(
        type=angle, default=0.0, metavar="DEG",
        help="Direction in the picture, from right towards bottom; matters when the mirror is misaligned.",
    )  # fmt: skip
    object_distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="From the mirror to the object."
    )

    def angles(self, sensor: Sensor) -> Array:
        """The field angles (n,) asked for, or every 15 deg of an aligned sensor's field."""
        return angles_of(sensor, self.omega_deg)


@dataclass(frozen=True)
class ImageOptions(ObjectOptions):
    """Which objects are looked at, and how their images are computed."""

    focus_mm: float | str | None = option(
        type=focus, metavar="MM|auto", help="Object distance in focus; the sensor's by default."
    )
    kind: Kind = option(
        type=click.Choice(KINDS), default="diffraction", help="By waves with all aberrations, or by rays alone."
    )

    def focused_at(self, sensor: Sensor) -> float:
        """The focus distance asked for, that of the sensor, or the best of the aligned one for ``auto``."""
        if self.focus_mm is None:
            return sensor.lens.focus_distance_mm
        if self.focus_mm == "auto":
            return best_focus(sensor.aligned(), object_distance_mm=self.object_distance_mm).focus_mm
        return float(self.focus_mm)


def angles_of(sensor: Sensor, omega_deg: Array | None) -> Array:
    """The field angles (n,) asked for, or every 15 deg of an aligned sensor's field."""
    if omega_deg is not None:
        return omega_deg
    if not sensor.is_axial:
        raise click.UsageError(
            f"mirror or cover of {sensor.name!r} is decentred or tilted; say which --omega-deg to look at"
        )
    return field_angles(sensor, 15.0)
