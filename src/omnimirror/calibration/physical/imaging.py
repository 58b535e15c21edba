"""Where a sensor shows points, and how that changes with them and with every parameter of its own.

Light goes the way of stationary length from a point by the mirror to the lens (Fermat). Where the mirror point is on
the surface follows from two equations, ``g(x, y) = 0``, the gradient of the length of that way; so by the theorem of
implicit functions its derivatives are ``-H^-1 dg``, H the second derivatives of the length, by whatever g depends on:
either end of the way, and the shape of the surface. The rest is the chain rule through pose, lens and imager.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...cameras.frames import turned
from ...cameras.models.base import Image
from ...optics.mirrors.pose import MirrorPose
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import Ends, Specular, Surface, specular_points
from .lens_rates import lens_image
from .names import DISTANCE, NamedNumber
from .shape_rates import profile_rates

Array = NDArray[np.float64]

PAST_THE_RIM = 1.25
"""Of the rim radius: so far the continued surface shows points, lest an estimate in which the mirror is a little too
small should lose them."""
IDENTITY = np.eye(3)


class Way(NamedTuple):
    """Light from n targets by the mirror to the lens, in the mirror's frame, and what disturbs its stationarity.

    The gradient of its length has two components, by x and by y of the mirror point.
    """

    surface: Surface
    tangents: Array
    """(n, 2, 3) of the surface, by x and by y"""
    pull: Array
    """(n, 3) sum of the unit vectors from both ends, whose components along the tangents are the gradient"""
    by_pupil: Array
    """(n, 2, 3) derivative of the gradient by the pupil"""
    by_target: Array
    """(n, 2, 3) derivative of the gradient by the target"""
    by_point: Array
    """(n, 2, 3) derivative of the gradient by a mirror point that moves without turning its surface"""

    def response(self) -> Array:
        """How mirror points move (n, 2, 2) under disturbances of the gradient."""
        second = self.by_point @ self.tangents.transpose(0, 2, 1) + self.pull[:, 2, None, None] * self.surface.bend
        a, b, c = second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]
        inverse = np.stack([np.stack([c, -b], axis=-1), np.stack([-b, a], axis=-1)], axis=1)
        moved: Array = -inverse / (a * c - b * b)[:, None, None]
        return moved


def image_of_points(sensor: Sensor, points: Array, distant: bool, places: tuple[NamedNumber, ...]) -> Image:
    """Image of points (n, 3) mm, or of directions, of the camera frame, with derivatives by k places.

    Parameters
    ----------
    sensor
        Of one mirror.
    points : (n, 3)
        In the camera frame, whose origin is the vertex as designed.
    distant
        Whether they are directions.
    places
        The parameters by which derivatives are wanted.
    """
    pose = sensor.mirror_pose
    rotation = pose.rotation()
    with np.errstate(all="ignore"):  # what is not finite is not valid
        pupils, targets = _ends(sensor, pose, points, distant)
        found = specular_points(sensor.mirror, pupils, targets)
        way = _way(sensor, pupils, targets, found, points if distant else None)
        pixels, valid, by_seen, by_place = lens_image(sensor, pose.to_camera(found.points), places)
        by_point = by_seen @ rotation
        by_gradient = by_point @ way.tangents.transpose(0, 2, 1) @ way.response()
        for k, place in enumerate(places):
            if place.section in ("mirror_pose", "mount"):
                disturbance, frame = _displaced(sensor, way, found, points, distant, place)
                by_place[:, :, k] += np.einsum("nij,nj->ni", by_gradient, disturbance)
                by_place[:, :, k] += np.einsum("nij,nj->ni", by_seen, frame)
        _add_shape(sensor, way, by_gradient, by_point, places, by_place)
        by_target = by_gradient @ (way.by_target @ rotation.T)
        r = np.hypot(found.points[:, 0], found.points[:, 1])
        valid = valid & found.reflects & (r <= PAST_THE_RIM * sensor.mirror.rim_radius_mm)
    for array in (pixels, by_target, by_place):
        array[~valid] = np.nan
    return Image(pixels, valid, by_target, by_place)


def _ends(sensor: Sensor, pose: MirrorPose, points: Array, distant: bool) -> tuple[Ends, Ends]:
    """Lens and targets in the mirror's frame."""
    if sensor.lens.TELECENTRIC:
        pupils = Ends(pose.turned_to_mirror(np.array([[0.0, 0.0, -1.0]])), distant=True)
    else:
        pupils = Ends(pose.to_mirror(sensor.optical_train.pupil_offset[None]))
    return pupils, Ends.of(pose.turned_to_mirror(points) if distant else pose.to_mirror(points), distant)


def _way(sensor: Sensor, pupils: Ends, targets: Ends, found: Specular, directions: Array | None) -> Way:
    """The ways of light, with the derivatives of their gradients."""
    surface = Surface(sensor.mirror, found.points[:, :2])
    from_pupil, by_pupil, pupil_on_point = _pull(pupils, surface.points)
    from_target, by_target, target_on_point = _pull(targets, surface.points)
    if directions is not None:  # of any length, which turns them the less
        by_target = by_target / np.linalg.norm(directions, axis=1)[:, None, None]
    along = surface.tangents
    pull = from_pupil + from_target
    return Way(surface, along, pull, along @ by_pupil, along @ by_target, along @ (pupil_on_point + target_on_point))


def _pull(ends: Ends, points: Array) -> tuple[Array, Array, Array]:
    """Unit vectors (n, 3) from ends to points, and their derivatives (n, 3, 3) by the ends and by the points."""
    if ends.distant:
        unit = np.broadcast_to(-ends.xyz, points.shape)
        across = IDENTITY - unit[:, :, None] * unit[:, None, :]
        return unit, -across, np.zeros_like(across)
    step = points - ends.xyz
    distance = np.sqrt(np.einsum("ni,ni->n", step, step))
    unit = step / distance[:, None]
    across = (IDENTITY - unit[:, :, None] * unit[:, None, :]) / distance[:, None, None]
    return unit, -across, across


def _displaced(
    sensor: Sensor, way: Way, found: Specular, points: Array, distant: bool, place: NamedNumber
) -> tuple[Array, Array]:
    """What a change of pose or distance does to the gradient (n, 2), and to a point (n, 3) that stays on its mirror."""
    rotation, shift = sensor.mirror_pose.rotation(), sensor.mirror_pose.shift
    nothing = np.zeros((len(points), 3))
    if place.name == DISTANCE:
        return way.by_pupil @ (rotation.T @ [0.0, 0.0, -1.0]), nothing
    turn, moved = _pose_rates(sensor.mirror_pose, place.key)
    pupil = np.array([0.0, 0.0, -1.0]) if sensor.lens.TELECENTRIC else sensor.optical_train.pupil_offset - shift
    d_pupil = turn.T @ pupil - (0.0 if sensor.lens.TELECENTRIC else rotation.T @ moved)
    d_target = turned(points if distant else points - shift, turn) - (0.0 if distant else rotation.T @ moved)
    disturbance = way.by_pupil @ d_pupil + np.einsum("nij,nj->ni", way.by_target, d_target)
    return disturbance, turned(found.points, turn.T) + moved


def _add_shape(
    sensor: Sensor, way: Way, by_gradient: Array, by_point: Array, places: tuple[NamedNumber, ...], by_place: Array
) -> None:
    """Add to derivatives (n, 2, k) what the surface does where it rises, and where it is tilted."""
    wanted = [k for k, place in enumerate(places) if place.section == "mirror"]
    if not wanted:
        return
    xy = way.surface.points[:, :2]
    r = np.hypot(xy[:, 0], xy[:, 1])
    sag, slope, _ = profile_rates(sensor.mirror, r, tuple(places[k] for k in wanted))
    radial = xy / np.where(r > 0, r, 1.0)[:, None]
    by_sag = np.einsum("nij,nj->ni", by_gradient, way.by_point[:, :, 2]) + by_point[:, :, 2]
    by_slope = way.pull[:, 2, None] * np.einsum("nij,nj->ni", by_gradient, radial)
    by_place[:, :, wanted] += by_sag[:, :, None] * sag[:, None] + by_slope[:, :, None] * slope[:, None]


def _pose_rates(pose: MirrorPose, key: str) -> tuple[Array, Array]:
    """Derivatives of a pose's rotation (3, 3), per degree, and of its shift (3,), per mm, by one of its numbers."""
    (cx, cy), (sx, sy) = (f(np.radians([pose.tilt_x_deg, pose.tilt_y_deg])) for f in (np.cos, np.sin))
    degree = np.pi / 180
    turn, shift = np.zeros((3, 3)), np.zeros(3)
    if key == "tilt_x_deg":
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        turn = about_y @ np.array([[0.0, 0.0, 0.0], [0.0, -sx, -cx], [0.0, cx, -sx]]) * degree
    elif key == "tilt_y_deg":
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        turn = np.array([[-sy, 0.0, cy], [0.0, 0.0, 0.0], [-cy, 0.0, -sy]]) @ about_x * degree
    else:
        shift[("decentre_x_mm", "decentre_y_mm", "displacement_mm").index(key)] = 1.0
    return turn, shift
