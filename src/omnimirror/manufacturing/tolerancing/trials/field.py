"""What trials are judged by: objects all over the field, and where a sensor without errors shows them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ....arguments import numbers
from ....errors import InvalidParameter
from ....mirrors.pose import MirrorPose
from ....sensor import Sensor
from ....tracing.reflection import RIM_SLACK, Ends
from .ordinary import pictured_one_by_one
from .picture import Picture, Refocus, pictured
from .states import Values, are_traced_together, states_of
from .tracing import seen

Array = NDArray[np.float64]

EDGE = 0.97
"""Of the largest field angle of a sensor, what is judged by default: at the rim itself every decentre loses rays."""
ANGLES, AZIMUTHS = 8, 12
STEP_DEG = 1e-3  # of objects, of differences
BEYOND = 0.05  # of the rim radius: objects seen at the rim itself move beyond it in the differences


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
        """The picture of sensors with errors; see :func:`.states_of`."""
        return self.shown(values, count, rim_slack=rim_slack)[0]

    def shown(
        self, values: Values, count: int | None = None, *, refocus: Refocus = "none", rim_slack: float = RIM_SLACK
    ) -> tuple[Picture, NDArray[np.bool_], Array]:
        """Pictures of sensors with errors (t,), what they lose (t, n), and distances (t,) mm they are focused at."""
        if not are_traced_together(self.sensor, values):
            trials = next((len(v) for v in values.values()), 1) if count is None else count
            ends = Ends(self.targets, self.distant)
            return pictured_one_by_one(self.sensor, values, trials, ends, refocus=refocus, rim_slack=rim_slack)
        states = states_of(self.sensor, values, count)
        found = seen(states, self.targets, self.distant, self.start, rim_slack)
        shown = pictured(states, found, refocus)
        return shown, found.lost, 1 / shown.vergence + states.focal_mm - states.breathing_mm


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
    if not sensor.is_axial:  # what is out of place in the file is an error that has happened: judged against its place
        displaced = MirrorPose(displacement_mm=sensor.mirror_pose.displacement_mm)
        sensor = replace(sensor.aligned(), mirror_pose=displaced)
    is_bare = sensor.secondary is None and sensor.housing.shell is None  # others have something in the middle
    smallest, largest = sensor.field_deg if is_bare else sensor.clear_field_deg
    inner = smallest if is_bare or not smallest else smallest + (1 - EDGE) * (largest - smallest)
    asked = (inner, EDGE * largest) if field_deg is None else numbers("field_deg", field_deg, "(it takes two)")
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
    return field_at(sensor, omega, azimuth, object_distance_mm)


def directions_of(omega_deg: Array, azimuth_deg: Array) -> tuple[Array, Array]:
    """Directions (n, 3), and unit vectors (n, 3, 2) by which they turn along the field angle and round about.

    >>> [part.round(6).tolist() for part in directions_of(np.array([90.0]), np.array([0.0]))]
    [[[1.0, 0.0, -0.0]], [[[0.0, -0.0], [0.0, 1.0], [1.0, 0.0]]]]
    """
    omega, azimuth = np.radians(omega_deg), np.radians(azimuth_deg)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    away = np.stack([np.sin(omega) * cos, np.sin(omega) * sin, -np.cos(omega)], axis=-1)
    tangential = np.stack([np.cos(omega) * cos, np.cos(omega) * sin, np.sin(omega)], axis=-1)
    sagittal = np.stack([-sin, cos, np.zeros_like(cos)], axis=-1)
    return away, np.stack([tangential, sagittal], axis=-1)


def field_at(sensor: Sensor, omega_deg: Array, azimuth_deg: Array, distance: float) -> Field:
    """Objects (n,) at field angles and azimuths of a sensor without errors."""
    away, turned = directions_of(omega_deg, azimuth_deg)  # a sensor without errors turns nothing: one frame for both
    azimuth = np.radians(azimuth_deg)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega_deg)))
    x, z = rays.last  # where light leaves mirror or cover
    points = np.stack([x * cos, x * sin, z + sensor.mirror_pose.displacement_mm], axis=-1)
    start = np.stack([rays.x * cos, rays.x * sin], axis=-1)
    distant = bool(np.isinf(distance))
    targets = away if distant else points + distance * away
    bare = Field(sensor, targets, distant, start, omega_deg, omega_deg, omega_deg, azimuth_deg)
    shown, lost, _ = bare.shown({}, count=1)
    if lost.any():
        raise InvalidParameter(
            f"without errors {sensor.name!r} shows nothing at {omega_deg[lost[0]][0]:.4g} deg; field_deg is valid "
            f"where nothing of its housing stands in the light, {sensor.clear_field_deg[0]:.4g} to "
            f"{sensor.clear_field_deg[1]:.4g} deg"
        )
    if are_traced_together(sensor):
        px_per_deg = np.radians(shown.by_direction[0] @ turned)
    else:
        px_per_deg = _px_per_deg(bare, points, distance, turned)
    return replace(bare, offsets_px=shown.offsets_px[0], px_per_deg=px_per_deg)


def _px_per_deg(field: Field, points: Array, distance: float, turned: Array) -> Array:
    """How far (n, 2, 2) a degree moves the picture, by differences, along tangents (n, 3, 2) of the objects' sphere."""
    columns = []
    for k in range(2):
        step, ends = np.radians(STEP_DEG) * turned[..., k], []
        for sign in (1, -1):
            moved = field.targets + sign * step * (1.0 if field.distant else distance)
            unit = np.linalg.norm(moved, axis=1, keepdims=True) if field.distant else 1.0
            ends.append(replace(field, targets=moved / unit).picture({}, 1, rim_slack=BEYOND).offsets_px[0])
        columns.append((ends[0] - ends[1]) / (2 * STEP_DEG))
    return np.stack(columns, axis=-1)
