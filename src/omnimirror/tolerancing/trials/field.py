"""What trials are judged by: objects all over the field, and where a sensor without errors shows them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...arguments import numbers
from ...errors import InvalidParameter
from ...mirrors.pose import MirrorPose
from ...sensor import Sensor
from ...tracing.reflection import RIM_SLACK
from .picture import Picture, pictured
from .states import Values, states_of
from .tracing import seen

Array = NDArray[np.float64]

EDGE = 0.97
"""Of the largest field angle of a sensor, what is judged by default: at the rim itself every decentre loses rays."""
ANGLES, AZIMUTHS = 8, 12


@dataclass(frozen=True)
class Field:
    """Objects (n,) on circles of equal field angle.

    Attributes
    ----------
    sensor
        Without errors.
    targets : (n, 3)
        Unit directions, or points in mm, in the camera frame.
    distant
        Whether they are directions.
    start : (n, 2)
        Mirror points (x, y) mm in which it shows them.
    offsets_px : (n, 2)
        Where it shows them.
    px_per_deg : (n, 2, 2)
        How far a degree of the object moves its picture: columns along the field angle and round about.
    omega_deg, azimuth_deg : (n,)
        Of the objects; the axis, where it is in the field, comes first.
    """

    sensor: Sensor
    targets: Array
    distant: bool
    start: Array
    offsets_px: Array
    px_per_deg: Array
    omega_deg: Array
    azimuth_deg: Array

    def __len__(self) -> int:
        return len(self.targets)

    def picture(self, values: Values, count: int | None = None, rim_slack: float = RIM_SLACK) -> Picture:
        """The picture of sensors with errors; see :func:`~omnimirror.tolerancing.trials.states.states_of`."""
        states = states_of(self.sensor, values, count)
        return pictured(states, seen(states, self.targets, self.distant, self.start, rim_slack))


def field_of(
    sensor: Sensor,
    *,
    field_deg: tuple[float, float] | None = None,
    angles: int = ANGLES,
    azimuths: int = AZIMUTHS,
    object_distance_mm: float = np.inf,
) -> Field:
    """Objects all over the field of a sensor.

    Parameters
    ----------
    sensor
        Without errors: its mirror on the lens's axis.
    field_deg : (2,), optional
        Field angles between which it is judged; from its smallest to .97 of its largest by default.
    angles, azimuths
        How many circles, and objects on each.
    object_distance_mm
        From the mirror points to the objects; infinite by default.

    Returns
    -------
    Field
        The objects.

    Raises
    ------
    InvalidParameter
        A field that the sensor does not have, or a mirror that is already decentred.

    Examples
    --------
    >>> import omnimirror as om
    >>> field = field_of(om.load_sensor("paper-spherical"))
    >>> len(field), field.omega_deg[[0, 1, -1]].round(1)
    (97, array([  0. ,  16.4, 131. ]))
    """
    if not sensor.mirror_pose.is_axial:
        sensor = replace(sensor, mirror_pose=MirrorPose(displacement_mm=sensor.mirror_pose.displacement_mm))
    smallest, largest = sensor.field_deg
    asked = (smallest, EDGE * largest) if field_deg is None else numbers("field_deg", field_deg, "(it takes two)")
    low, high = (float(angle) for angle in asked)
    if not smallest - 1e-9 <= low < high <= largest + 1e-9:
        raise InvalidParameter(
            f"field_deg = {low:g} to {high:g} is not within the field of {sensor.name!r}, {smallest:.4g} to "
            f"{largest:.4g} deg"
        )
    if angles < 1 or azimuths < 3:
        raise InvalidParameter(f"{angles} angles and {azimuths} azimuths are too few; valid are 1 and 3, and more")
    if not object_distance_mm > 0:
        raise InvalidParameter(f"object_distance_mm = {object_distance_mm:g} is valid above 0, and inf")
    on_axis = low <= 0
    omega = np.linspace(low, high, angles + on_axis)[on_axis:]
    around = np.arange(azimuths) * (360.0 / azimuths)
    omega, azimuth = np.repeat(omega, azimuths), np.tile(around, angles)
    if on_axis:
        omega, azimuth = np.append(0.0, omega), np.append(0.0, azimuth)
    return _field(sensor, omega, azimuth, object_distance_mm)


def _field(sensor: Sensor, omega_deg: Array, azimuth_deg: Array, distance: float) -> Field:
    omega, azimuth = np.radians(omega_deg), np.radians(azimuth_deg)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(omega))
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    away = np.stack([np.sin(omega) * cos, np.sin(omega) * sin, -np.cos(omega)], axis=-1)
    tangential = np.stack([np.cos(omega) * cos, np.cos(omega) * sin, np.sin(omega)], axis=-1)
    sagittal = np.stack([-sin, cos, np.zeros_like(cos)], axis=-1)
    points = np.stack([rays.x * cos, rays.x * sin, rays.z + sensor.mirror_pose.displacement_mm], axis=-1)
    distant = bool(np.isinf(distance))
    targets = away if distant else points + distance * away
    bare = Field(sensor, targets, distant, points[:, :2], omega, omega, omega_deg, azimuth_deg)
    shown = bare.picture({}, count=1)
    turned = np.stack([tangential, sagittal], axis=-1)  # a sensor without errors turns nothing: one frame for both
    px_per_deg = np.radians(shown.by_direction[0] @ turned)
    return replace(bare, offsets_px=shown.offsets_px[0], px_per_deg=px_per_deg)
