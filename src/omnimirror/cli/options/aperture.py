"""Options that the commands of the whole aperture share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from ...analysis import best_focus, field_angles
from ...errors import OmnimirrorError
from ...sensor import Sensor
from .common import angle, distance, values

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--omega-deg", type=values, metavar="A:B:STEP", help="Field angles.  [default: every 15 deg seen]"),
    click.option(
        "--azimuth-deg", type=angle, default="0", metavar="DEG", show_default=True,
        help="Direction in the picture, from right towards bottom; matters when the mirror is misaligned.",
    ),
    click.option("--object-distance-mm", type=distance, metavar="MM", default="inf", show_default=True,
                 help="From the mirror to the object."),
)  # fmt: skip


def object_options(command: Command) -> Command:
    """Give a click command the options that say which objects are looked at."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def angles_of(sensor: Sensor, omega_deg: Any) -> Any:
    """The field angles asked for, or every 15 deg of an aligned sensor's field."""
    if omega_deg is not None:
        return omega_deg
    if not sensor.mirror_pose.is_axial:
        raise OmnimirrorError(f"the mirror of {sensor.name!r} is decentred or tilted; say which --omega-deg to look at")
    return field_angles(sensor, 15.0)


def focus_of(sensor: Sensor, focus_mm: Any, object_distance_mm: float) -> float:
    """A focus distance, that of the sensor, or the best of the aligned one for ``auto``."""
    if focus_mm is None:
        return sensor.lens.focus_distance_mm
    if focus_mm == "auto":
        return best_focus(sensor.aligned(), object_distance_mm=object_distance_mm).focus_mm
    return float(focus_mm)
