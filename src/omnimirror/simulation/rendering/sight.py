"""Pixel rays and obstructions: reflection at the mirror, past rod, camera and rim, through a wall."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InvalidParameter
from ...base.typing import Array, Mask
from ...cameras.camera import Camera, Projection, inside_image
from ...cameras.frames import turned
from ...optics.sensor import Sensor
from ...optics.tracing.walls import passage
from ..radiometry import Radiometry, camera_front
from ..scenes.contract import Measured, Scene
from ..shells import ThroughShell

Fates = NDArray[np.uint8]

LOST, REFLECTED, DIRECT, HIDDEN = range(4)  # fate of a ray; values of the compiled kernels
LINES = 64  # lines from the vertex to the rim


class Followed(NamedTuple):
    """Rays (n,) traced from the lens, in the camera frame; as they leave the lens for rays that
    miss the mirror.
    """

    points: Array
    """Points (n, 3) on the mirror, mm."""
    directions: Array
    """Directions (n, 3)."""
    from_lens: Array
    """Directions (n, 3) at the lens."""
    hit: Mask
    """Mask (n,) of rays that meet the mirror."""
    fate: Fates
    """Fate (n,): ``LOST``, ``REFLECTED``, ``DIRECT`` past the mirror, or ``HIDDEN`` by camera, rod
    or rim.
    """


def follow(sensor: Sensor, pixels: Array, pupil: Array, radiometry: Radiometry) -> Followed:
    """Trace rays of pixels (n, 2) through points (n, 2) of the unit disk of the aperture, in double
    precision.
    """
    start, towards = sensor.lens_rays(pixels, pupil)
    found = sensor.optical_train.posed_mirror.trace(start, towards)
    hit = found.valid
    points, directions = np.where(hit[:, None], found.points, start), np.where(hit[:, None], found.directions, towards)
    fate = np.where(hit, REFLECTED, DIRECT if radiometry.sees_past else LOST).astype(np.uint8)
    fate[~np.isfinite(towards[:, 2])] = LOST  # beyond the fold of the distortion
    if pupil.any():  # chief rays alone use the vignetting of the lens as a weight
        fate[~sensor.optical_train.passes_lens(start, towards)] = LOST
    standing = sensor.obstructions
    fate[hit & standing.meets_front(points, directions, -towards)] = HIDDEN
    fate[standing.meets_rim(points, directions, sensor.mirror_pose)] = HIDDEN
    return Followed(points, directions, towards, hit, fate)


def front_shade(sensor: Sensor, points: Array, directions: Array, towards_lens: Array) -> Array:
    """Return the relative brightness (n,) of the targets of mirrored rays (n, 3): parts of the
    camera front; 1 elsewhere.
    """
    standing = sensor.obstructions
    if standing.camera is None:
        return np.ones(len(points))
    meets, across = standing.camera.met_by(points, directions)
    if standing.rod is not None:
        meets &= ~(standing.rod.met_by(points, directions) | standing.rod.met_by(points, towards_lens))
    return np.where(meets, camera_front(2 * across / standing.front_ring_mm), 1.0)


def check_housing_is_shown(sensor: Sensor) -> None:
    """Raise InvalidParameter for housings that are not rendered: those around two mirrors."""
    if sensor.secondary is not None and not sensor.housing.is_empty:
        raise InvalidParameter(
            f"pictures and their truth show the housing of one mirror, and {sensor.name!r} has two; take it without: "
            "replace(sensor, housing=Housing())"
        )


def mirror_net(sensor: Sensor) -> Array:
    """Return world points (lines from the vertex, lines around, 3) of the mirror, mm, including the
    rim.
    """
    x = np.linspace(0.0, sensor.mirror.rim_radius_mm, LINES // 2 + 1)
    turn = np.linspace(0, 2 * np.pi, LINES + 1)
    across = np.stack([x[:, None] * np.cos(turn), x[:, None] * np.sin(turn)], axis=-1)
    sag = np.broadcast_to(sensor.mirror.sag(x)[:, None, None], (*across.shape[:2], 1))
    rotation = sensor.mount.rotation()
    points = sensor.mirror_pose.to_camera(np.concatenate([across, sag], axis=-1).reshape(-1, 3))
    # A lens that views it via a second mirror has the opposite direction
    points[:, 2] *= np.sign(-sensor.axis @ rotation[:, 2])
    return turned(points, rotation.T).reshape(*across.shape[:2], 3)


def check_clear(sensor: Sensor, scene: Scene) -> None:
    """Raise InvalidParameter if a scene intersects the mirror, tested along lines from the vertex
    to the rim and around it.

    Scenes without distances are not tested.
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
    """Lines of sight of pixels (n,) in the world frame of the sensor; NaN if not valid."""

    origins: Array
    """Origins (n, 3), mm: on the mirror, on the outer side of a tube or dome, or, past the mirror,
    at the lens.
    """
    directions: Array
    """Unit vectors (n, 3) of the directions."""
    valid: Mask
    """Mask (n,) of rays that leave the sensor."""
    hidden: Mask
    """Mask (n,) of rays that end at camera, rod, rim or a lid, or at the secondary or the bore of
    two mirrors.
    """


def sights(camera: Camera, pixels: ArrayLike, radiometry: Radiometry | None = None) -> Sights:
    """Return the chief rays of pixels (n, 2) past obstructions and through a tube or a dome.

    Parameters
    ----------
    camera
    pixels
    radiometry
        Radiometry of a single-mirror sensor, which determines the visibility past its mirror.

    Raises
    ------
    InvalidParameter
        For radiometry of another camera, or the housing of two mirrors.

    Examples
    --------
    In the centre, the sensor images its own camera:

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
    """Return pixels (n, 2) of points (n, 3) mm in the camera world; for a sensor, via its mirror.

    Points hidden by the housing are not valid.

    Raises
    ------
    InvalidParameter
        As in :func:`sights`.
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
