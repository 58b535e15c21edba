"""Options shared by the commands that trace the whole aperture."""

from __future__ import annotations

from dataclasses import dataclass

import click
import numpy as np

from ...analysis.evaluation import field_angles
from ...analysis.focus import best_focus
from ...analysis.psf_mtf import KINDS, Kind
from ...base.typing import Array
from ...optics.sensor import Sensor
from ._declarations import Options, angle, distance, focus, option, setting, values


@dataclass(frozen=True)
class ObjectOptions(Options):
    """Objects."""

    omega_deg: Array | None = option(
        type=values, metavar="A:B:STEP", help="Field angles.  [default: every 15 deg of the field]"
    )
    object_distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="Object distance from the mirror."
    )
    azimuth_deg: float = setting("field", 0.0, type=angle)

    def angles(self, sensor: Sensor) -> Array:
        """Return the field angles (n,), or every 15 deg of the field of an aligned sensor."""
        return angles_of(sensor, self.omega_deg)


@dataclass(frozen=True)
class ImageOptions(ObjectOptions):
    """Objects and images, with focus and method of computation."""

    focus_mm: float | str | None = option(
        type=focus,
        metavar="MM|auto",
        help="Object distance in focus.  [default: the focus of the sensor]",
    )
    kind: Kind = option(
        type=click.Choice(KINDS),
        default="diffraction",
        help="Wave-optical computation with all aberrations, or geometrical computation by rays.",
    )

    def focused_at(self, sensor: Sensor) -> float:
        """Return the focus distance: as given, of the sensor, or the optimum of the aligned sensor
        for ``auto``.
        """
        if self.focus_mm is None:
            return sensor.lens.focus_distance_mm
        if self.focus_mm == "auto":
            return best_focus(sensor.aligned(), object_distance_mm=self.object_distance_mm).focus_mm
        return float(self.focus_mm)


def angles_of(sensor: Sensor, omega_deg: Array | None) -> Array:
    """Return the field angles (n,), or every 15 deg of the field of an aligned sensor."""
    if omega_deg is not None:
        return omega_deg
    if not sensor.is_axial:
        raise click.UsageError(
            f"mirror or cover of {sensor.name!r} is decentred or tilted; specify --omega-deg"
        )
    return field_angles(sensor, 15.0)
