"""Projection of points by a mirror sensor, with derivatives by points and all its parameters.

Light follows a path of stationary length from a point via the mirror to the lens (Fermat). The
mirror point satisfies two equations ``g(x, y) = 0``, where g is the gradient of the path length.
By the implicit function theorem its derivatives are ``-H^-1 dg``, with the second derivatives H
of the length, for all quantities that g depends on: both ends of the path, and the shape of the
surface. The remainder is the chain rule through pose, lens and imager.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.typing import Array
from ...cameras.frames import turned
from ...cameras.models.base import Image
from ...optics.mirrors.pose import MirrorPose
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import Ends, Specular, Surface, specular_points
from .lens_rates import lens_image
from .names import DISTANCE, NamedNumber
from .shape_rates import profile_rates

PAST_THE_RIM = 1.25
"""Extension of the mirror surface beyond the rim, relative to the rim radius.

It retains points in estimates whose mirror is slightly too small.
"""
IDENTITY = np.eye(3)


class Way(NamedTuple):
    """Optical paths from n targets via the mirror to the lens, in the mirror frame.

    The gradient of the length has two components, with respect to x and y of the mirror point.
    """

    surface: Surface
    tangents: Array
    """Tangents (n, 2, 3) of the surface along x and y."""
    pull: Array
    """Sum (n, 3) of the unit vectors from both ends; its tangential components are the gradient."""
    by_pupil: Array
    """Derivative (n, 2, 3) of the gradient with respect to the pupil."""
    by_target: Array
    """Derivative (n, 2, 3) of the gradient with respect to the target."""
    by_point: Array
    """Derivative (n, 2, 3) of the gradient with respect to the mirror point at a constant normal.
    """

    def response(self) -> Array:
        """Return derivatives (n, 2, 2) of the mirror points with respect to the gradient."""
        second = self.by_point @ self.tangents.transpose(0, 2, 1) + self.pull[:, 2, None, None] * self.surface.bend
        a, b, c = second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]
        inverse = np.stack([np.stack([c, -b], axis=-1), np.stack([-b, a], axis=-1)], axis=1)
        moved: Array = -inverse / (a * c - b * b)[:, None, None]
        return moved


def image_of_points(sensor: Sensor, points: Array, distant: bool, places: tuple[NamedNumber, ...]) -> Image:
    """Compute the image of points (n, 3) mm, or directions, with derivatives by k parameters.

    Parameters
    ----------
    sensor
        Sensor with one mirror.
    points : (n, 3)
        Points in the camera frame, whose origin is the nominal vertex.
    distant
        Whether the points are directions.
    places
        Parameters of the derivatives.
    """
    pose = sensor.mirror_pose
    rotation = pose.rotation()
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
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
    """Return lens and targets in the mirror frame."""
    if sensor.lens.TELECENTRIC:
        pupils = Ends(pose.turned_to_mirror(np.array([[0.0, 0.0, -1.0]])), distant=True)
    else:
        pupils = Ends(pose.to_mirror(sensor.optical_train.pupil_offset[None]))
    return pupils, Ends.of(pose.turned_to_mirror(points) if distant else pose.to_mirror(points), distant)


def _way(sensor: Sensor, pupils: Ends, targets: Ends, found: Specular, directions: Array | None) -> Way:
    """Return the optical paths with the derivatives of their gradients."""
    surface = Surface(sensor.mirror, found.points[:, :2])
    from_pupil, by_pupil, pupil_on_point = _pull(pupils, surface.points)
    from_target, by_target, target_on_point = _pull(targets, surface.points)
    if directions is not None:  # of any length, inversely proportional to the rotation
        by_target = by_target / np.linalg.norm(directions, axis=1)[:, None, None]
    along = surface.tangents
    pull = from_pupil + from_target
    return Way(surface, along, pull, along @ by_pupil, along @ by_target, along @ (pupil_on_point + target_on_point))


def _pull(ends: Ends, points: Array) -> tuple[Array, Array, Array]:
    """Return unit vectors (n, 3) from ends to points, and derivatives (n, 3, 3) by ends and points."""
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
    """Return the effect of a pose or distance parameter on the optical path.

    The results are changes of the gradient and of a fixed mirror point.

    Shapes are (n, 2) and (n, 3).
    """
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
    """Add the effect of surface height and slope to the derivatives (n, 2, k)."""
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
    """Return derivatives of a pose's rotation (3, 3) per deg and translation (3,) per mm."""
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
