"""Ghosts in a tube or a dome: what its wall throws back, where that comes from, and how bright it is."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import checked, row
from ..base.errors import InvalidParameter
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.walls import let_out
from .evaluation import field_angles

Array = NDArray[np.float64]

LIFT_MM = 1e-6  # by which a ray starts off the surface that it leaves


@dataclass(frozen=True)
class Ghosts:
    """The first ghost at n field angles; every array (n,).

    A pixel that looks at ``omega_deg`` sees besides, fainter, what lies at ``ghost_omega_deg`` in the same meridian,
    below 0 on the other side of the axis; NaN where the ghost ends at the camera, a lid or the mirror's back.
    """

    omega_deg: Array
    passed_percent: Array
    """Share of the light that passes the wall straight away."""
    ghost_omega_deg: Array
    """Where the ghost comes from."""
    ghost_percent: Array
    """How bright it is against the direct image of something equally bright; 0 where it ends."""
    by_mirror: NDArray[np.bool_]
    """Whether the mirror reflects it once more on its way."""

    def __len__(self) -> int:
        return len(self.omega_deg)

    def columns(self) -> dict[str, Array]:
        """The columns by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


@checked
def ghosts(sensor: Sensor, omega_deg: ArrayLike | None = None) -> Ghosts:
    """The first ghost of a sensor in a tube or under a dome, at field angles.

    Fresnel's formulas, the reflections between both sides of the wall summed, follow one chief ray: what the wall
    throws back meets the mirror again or the wall elsewhere. Of ghosts the mirror swallows nothing.

    Parameters
    ----------
    sensor
        Aligned, of one mirror, with a tube or a dome.
    omega_deg : (n,), optional
        Field angles; every 5 deg of what is not hidden by default.

    Returns
    -------
    Ghosts
        Where each comes from, and its share of the light.

    Raises
    ------
    InvalidParameter
        A sensor without tube or dome, of two mirrors, or misaligned.
    OutsideField
        A field angle that is not seen.

    Examples
    --------
    What the tube throws back at 60 deg passes on the other side; at 110 deg it ends at the mirror's back:

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import Housing, Tube
    >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(shell=Tube(120.0)))
    >>> found = ghosts(sensor, [60.0, 110.0])
    >>> found.ghost_omega_deg.round(1), found.ghost_percent.round(1)
    (array([-60.,  nan]), array([7.7, 0. ]))
    """
    check_sensor(sensor)
    sensor.check("ghosts", "one mirror")
    standing = sensor.obstructions
    shell = standing.housing.shell
    if shell is None:
        raise InvalidParameter(f"{sensor.name!r} has no tube and no dome, so it has no ghosts of their walls")
    omega = _clear_angles(sensor) if omega_deg is None else row("omega_deg", omega_deg)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    height = rays.z + sensor.mirror_pose.displacement_mm
    nothing = np.zeros_like(omega)
    points = np.stack([rays.x, nothing, height], axis=-1)
    first = let_out(shell, points, np.stack([np.sin(rays.reflected), nothing, -np.cos(rays.reflected)], axis=-1))

    start, way = first.met + LIFT_MM * first.thrown_back, first.thrown_back
    again = sensor.optical_train.posed_mirror.trace(start, way)
    by_mirror = again.valid
    start = np.where(by_mirror[:, None], again.points + LIFT_MM * again.directions, start)
    way = np.where(by_mirror[:, None], again.directions, way)
    ends = np.logical_or.reduce(
        [*standing.met_by(start, way, way, sensor.mirror_pose).values(), _meets_back(sensor, start, way)]
    )
    second = let_out(shell, start, way)
    out = second.directions
    angle = np.degrees(np.arctan2(np.hypot(out[:, 0], out[:, 1]), -out[:, 2])) * np.where(out[:, 0] < 0, -1.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (1 - first.passed) * second.passed / first.passed
    return Ghosts(
        omega, 100 * first.passed, np.where(ends, np.nan, angle), np.where(ends, 0.0, 100 * share), by_mirror & ~ends
    )


def _clear_angles(sensor: Sensor) -> Array:
    low, high = sensor.clear_field_deg
    angles = field_angles(sensor)
    return angles[(angles >= low) & (angles <= high)]


def _meets_back(sensor: Sensor, points: Array, directions: Array) -> NDArray[np.bool_]:
    """Which rays (n, 3), (n, 3) from beside or below it end at the back of the mirror's body."""
    rim = sensor.mirror.rim_radius_mm
    edge = float(sensor.mirror.sag(np.array(rim))) + sensor.mirror_pose.displacement_mm
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = (edge - points[:, 2]) / directions[:, 2]
        across = points[:, :2] + steps[:, None] * directions[:, :2]
    return np.asarray((steps > LIFT_MM) & (np.hypot(across[:, 0], across[:, 1]) < rim))
