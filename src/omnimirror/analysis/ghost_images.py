"""Ghost images in a tube or a dome: direction and relative brightness of wall reflections."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import row, validate_arguments
from ..base.errors import InvalidParameter
from ..base.results import Columns, FieldResult, Fields, column_fields
from ..base.typing import Array
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.shell_transmission import transmit_rays
from .evaluation import field_angles

ORIGIN_OFFSET_MM = 1e-6  # offset of a ray start from the surface


@dataclass(frozen=True)
class Ghosts(FieldResult):
    """First ghost image at n field angles; each array (n,).

    A pixel with the field angle ``omega_deg`` also receives weaker light from ``ghost_omega_deg``
    in the same meridian, negative on the other side of the axis; NaN if the ghost path is blocked
    by the camera, a lid or the back of the mirror.
    """

    omega_deg: Array
    passed_percent: Array
    """Direct transmittance of the wall."""
    ghost_omega_deg: Array
    """Field angle of the ghost source."""
    ghost_percent: Array
    """Brightness relative to the direct image of an equally bright object; 0 for a blocked path."""
    by_mirror: NDArray[np.bool_]
    """True if the ghost path includes another reflection by the mirror."""

    def _table(self) -> Columns:
        return self.columns()

    def _fields(self) -> Fields:
        return column_fields(self.columns(), {})

    def __len__(self) -> int:
        return len(self.omega_deg)

    def columns(self) -> dict[str, Array]:
        """Return the columns by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


@validate_arguments
def ghosts(sensor: Sensor, omega_deg: ArrayLike | None = None) -> Ghosts:
    """Compute the first ghost image of a sensor in a tube or under a dome, at field angles.

    The reflected part of each chief ray, with Fresnel coefficients and summed reflections between
    both sides of the wall, is traced to the mirror or another part of the wall. Losses of ghosts at
    the mirror are neglected.

    Parameters
    ----------
    sensor
        Aligned sensor with one mirror and a tube or a dome.
    omega_deg : (n,), optional
        Field angles; by default every 5 deg of the unobscured field.

    Returns
    -------
    Ghosts
        Source direction and relative brightness of each ghost.

    Raises
    ------
    InvalidParameter
        If the sensor has no tube or dome, has two mirrors, or is misaligned.
    OutsideField
        If the field angle is outside the field of view.

    Examples
    --------
    The reflection at 60 deg leaves through the opposite wall; at 110 deg it ends at the back of the
    mirror:

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import Housing, Tube
    >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(shell=Tube(120.0)))
    >>> found = ghosts(sensor, [60.0, 110.0])
    >>> found.ghost_omega_deg.round(1), found.ghost_percent.round(1)
    (array([-60.,  nan]), array([7.7, 0. ]))
    """
    check_sensor(sensor)
    sensor.check("ghosts", "single mirror")
    obstructions = sensor.obstructions
    shell = obstructions.housing.shell
    if shell is None:
        raise InvalidParameter(f"ghosts require a tube or a dome; {sensor.name!r} has none")
    omega = _clear_angles(sensor) if omega_deg is None else row("omega_deg", omega_deg)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    height = rays.z + sensor.mirror_pose.displacement_mm
    zeros = np.zeros_like(omega)
    points = np.stack([rays.x, zeros, height], axis=-1)
    first = transmit_rays(
        shell, points, np.stack([np.sin(rays.reflected), zeros, -np.cos(rays.reflected)], axis=-1)
    )

    start, direction = first.met + ORIGIN_OFFSET_MM * first.reflected, first.reflected
    again = sensor.optical_train.posed_mirror.trace(start, direction)
    by_mirror = again.valid
    start = np.where(by_mirror[:, None], again.points + ORIGIN_OFFSET_MM * again.directions, start)
    direction = np.where(by_mirror[:, None], again.directions, direction)
    is_blocked = np.logical_or.reduce(
        [
            *obstructions.blocks(start, direction, direction, sensor.mirror_pose).values(),
            _meets_back(sensor, start, direction),
        ]
    )
    second = transmit_rays(shell, start, direction)
    out = second.directions
    angle = np.degrees(np.arctan2(np.hypot(out[:, 0], out[:, 1]), -out[:, 2])) * np.where(
        out[:, 0] < 0, -1.0, 1.0
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        # reflected at the wall, transmitted by the opposite one, relative to the direct light; absorption
        # and further reflections are neglected
        ratio = (1 - first.passed) * second.passed / first.passed
    return Ghosts(
        omega,
        100 * first.passed,
        np.where(is_blocked, np.nan, angle),
        np.where(is_blocked, 0.0, 100 * ratio),
        by_mirror & ~is_blocked,
    )


def _clear_angles(sensor: Sensor) -> Array:
    low, high = sensor.clear_field_deg
    angles = field_angles(sensor)
    return angles[(angles >= low) & (angles <= high)]


def _meets_back(sensor: Sensor, points: Array, directions: Array) -> NDArray[np.bool_]:
    """Return the mask of rays (n, 3), (n, 3) that end at the back of the mirror."""
    rim = sensor.mirror.rim_radius_mm
    edge = float(sensor.mirror.sag(np.array(rim))) + sensor.mirror_pose.displacement_mm
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = (edge - points[:, 2]) / directions[:, 2]
        across = points[:, :2] + steps[:, None] * directions[:, :2]
    return np.asarray((steps > ORIGIN_OFFSET_MM) & (np.hypot(across[:, 0], across[:, 1]) < rim))
