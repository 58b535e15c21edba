"""Where pixels look and what stands in their way: rays off the mirror, past rod, camera and rim, through a wall."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InvalidParameter
from ...cameras.camera import Camera, Projection, inside_image
from ...cameras.frames import turned
from ...optics.sensor import Sensor
from ...optics.tracing.walls import passage
from ..radiometry import Radiometry, camera_front
from ..scenes.contract import Measured, Scene
from ..shells import ThroughShell

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Fates = NDArray[np.uint8]

LOST, REFLECTED, DIRECT, HIDDEN = range(4)  # what becomes of a ray; numbers of the compiled kernels
LINES = 64  # from the vertex to the rim


class Followed(NamedTuple):
    """Rays (n,) from the lens on, in the camera frame; where the mirror is missed, as they left the lens."""

    points: Array
    """(n, 3) mm: where they leave the mirror."""
    directions: Array
    """(n, 3): whereto."""
    from_lens: Array
    """(n, 3): directions in which they left the lens."""
    hit: Mask
    """(n,): whether they meet the mirror."""
    fate: Fates
    """(n,): ``LOST``, ``REFLECTED``, ``DIRECT`` past the mirror, or ``HIDDEN`` by camera, rod or rim."""


def follow(sensor: Sensor, pixels: Array, pupil: Array, radiometry: Radiometry) -> Followed:
    """Rays of pixels (n, 2) through points (n, 2) of the aperture's unit disk, in double precision."""
    start, towards = sensor.lens_rays(pixels, pupil)
    found = sensor.optical_train.posed_mirror.trace(start, towards)
    hit = found.valid
    points, directions = np.where(hit[:, None], found.points, start), np.where(hit[:, None], found.directions, towards)
    fate = np.where(hit, REFLECTED, DIRECT if radiometry.sees_past else LOST).astype(np.uint8)
    fate[~np.isfinite(towards[:, 2])] = LOST  # where distortion folds the picture over
    if pupil.any():  # chief rays alone take the vignetting of the lens as a weight
        fate[~sensor.optical_train.passes_lens(start, towards)] = LOST
    standing = sensor.obstructions
    fate[hit & standing.meets_front(points, directions, -towards)] = HIDDEN
    fate[standing.meets_rim(points, directions, sensor.mirror_pose)] = HIDDEN
    return Followed(points, directions, towards, hit, fate)


def front_shade(sensor: Sensor, points: Array, directions: Array, towards_lens: Array) -> Array:
    """How light (n,) what mirrored rays (n, 3) meet is, against grey: the camera's front has parts, all else is 1."""
    standing = sensor.obstructions
    if standing.camera is None:
        return np.ones(len(points))
    meets, across = standing.camera.met_by(points, directions)
    if standing.rod is not None:
        meets &= ~(standing.rod.met_by(points, directions) | standing.rod.met_by(points, towards_lens))
    return np.where(meets, camera_front(2 * across / standing.front_ring_mm), 1.0)


def check_housing_is_shown(sensor: Sensor) -> None:
    """Raise InvalidParameter for a housing that pictures do not show: one around two mirrors."""
    if sensor.secondary is not None and not sensor.housing.is_empty:
        raise InvalidParameter(
            f"pictures and their truth show the housing of one mirror, and {sensor.name!r} has two; take it without: "
            "replace(sensor, housing=Housing())"
        )


def mirror_net(sensor: Sensor) -> Array:
    """Points (lines from the vertex, lines around, 3) of the mirror in the world, mm, the rim's among them."""
    x = np.linspace(0.0, sensor.mirror.rim_radius_mm, LINES // 2 + 1)
    turn = np.linspace(0, 2 * np.pi, LINES + 1)
    across = np.stack([x[:, None] * np.cos(turn), x[:, None] * np.sin(turn)], axis=-1)
    sag = np.broadcast_to(sensor.mirror.sag(x)[:, None, None], (*across.shape[:2], 1))
    rotation = sensor.mount.rotation()
    points = sensor.mirror_pose.to_camera(np.concatenate([across, sag], axis=-1).reshape(-1, 3))
    points[:, 2] *= np.sign(-sensor.axis @ rotation[:, 2])  # a lens that sees it in a second mirror looks the other way
    return turned(points, rotation.T).reshape(*across.shape[:2], 3)


def check_clear(sensor: Sensor, scene: Scene) -> None:
    """Raise InvalidParameter if something of a scene cuts the mirror: lines from its vertex to its rim, and around.

    Scenes that tell no distances are taken at their word.
    """
    scene = scene.scene if isinstance(scene, ThroughShell) else scene
    if not isinstance(scene, Measured):
        return
    net = mirror_net(sensor)
    start = np.concatenate([net[:-1].reshape(-1, 3), net[1:, :-1].reshape(-1, 3)])
    end = np.concatenate([net[1:].reshape(-1, 3), net[1:, 1:].reshape(-1, 3)])
    if (scene.distance_mm(start, end - start) < np.linalg.norm(end - start, axis=1)).any():
        raise InvalidParameter(
            "the mirror stands in something of the scene; give it another pose, or look at the unit of a mesh"
        )


class Sights(NamedTuple):
    """What pixels (n,) look along, in the sensor's world frame; NaN where not valid."""

    origins: Array
    """(n, 3) mm: where they leave the sensor: its mirror, the outer side of its tube or dome, or, past the mirror,
    its lens."""
    directions: Array
    """(n, 3) unit vectors, from there on."""
    valid: Mask
    """(n,) whether they leave it at all."""
    hidden: Mask
    """(n,) whether they end at camera, rod, rim or a lid, or at the secondary or the bore of two mirrors."""


def sights(camera: Camera, pixels: ArrayLike, radiometry: Radiometry | None = None) -> Sights:
    """Where the chief rays of pixels (n, 2) look, past what stands in the light and through a tube or a dome.

    Parameters
    ----------
    camera
    pixels
    radiometry
        Of a sensor of one mirror: whether it sees past its mirror.

    Raises
    ------
    InvalidParameter
        For radiometry of another camera, or the housing of two mirrors.

    Examples
    --------
    In the middle the sensor sees its own camera:

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import CameraBody, Housing
    >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    >>> seen = sights(sensor, [[511.5, 511.5], [900.0, 511.5]])
    >>> seen.valid, seen.hidden
    (array([False,  True]), array([ True, False]))
    """
    pixels = np.asarray(pixels, dtype=float)
    if not isinstance(camera, Sensor) or camera.secondary is not None:
        if radiometry is not None:
            raise InvalidParameter("only a sensor of one mirror has radiometry")
        if isinstance(camera, Sensor):
            check_housing_is_shown(camera)
        rays, hidden = camera.backproject(pixels), np.zeros(len(pixels), dtype=bool)
        if isinstance(camera, Sensor):
            hidden |= np.logical_or.reduce([*camera.hidden_by(pixels).values()])
            hidden &= inside_image(pixels, camera.image_size) & ~rays.valid
        return Sights(rays.origins, _unit(rays.directions), rays.valid, hidden)
    followed, standing = follow(camera, pixels, np.zeros_like(pixels), radiometry or Radiometry()), camera.obstructions
    points, directions, hidden = followed.points, _unit(followed.directions), followed.fate == HIDDEN
    valid = (followed.fate == REFLECTED) | (followed.fate == DIRECT)
    if (shell := standing.housing.shell) is not None:
        for disc in standing.discs:  # lids and the frame of a window
            hidden |= valid & (disc.clearance(points, directions) < 0)
        left_by = passage(shell, points[valid], directions[valid])
        points[valid], directions[valid] = left_by.points, left_by.directions
        valid &= ~hidden
    points[~valid] = directions[~valid] = np.nan
    rotation = camera.mount.rotation().T
    return Sights(turned(points, rotation), turned(directions, rotation), valid, hidden)


def seen_at(camera: Camera, points_mm: ArrayLike) -> Projection:
    """Pixels (n, 2) in whose chief rays points (n, 3) mm of the camera's world lie, of a sensor by way of its mirror.

    Not valid are points that the housing hides.

    Raises
    ------
    InvalidParameter
        As :func:`sights`.
    """
    points = np.asarray(points_mm, dtype=float)
    pixels, valid = camera.project(points)
    if isinstance(camera, Sensor) and not camera.housing.is_empty:
        valid[valid] = ~sights(camera, pixels[valid]).hidden
    pixels[~valid] = np.nan
    return Projection(pixels, valid)


def _unit(directions: Array) -> Array:
    unit: Array = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return unit
