"""Transparent tubes and domes around a sensor: refraction, transmission losses and ghosts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.colour import Light
from ..base.typing import Array
from ..cameras.camera import Camera
from ..cameras.frames import turned
from ..optics.housing import FlatWindow, Shell
from ..optics.sensor import Sensor
from ..optics.tracing.walls import Passage, passage
from .scenes.contract import Scene

GHOSTS = 2  # higher-order ghosts have less than 0.001 of the light
START_MM = 1e-4  # tolerance of a ray origin on a surface: single precision
LIFT_MM = 1e-6  # offset of a ray origin from the surface that it leaves


def meets_lid(shell: Shell, lids_mm: tuple[float, ...], points: Array, directions: Array) -> NDArray[np.bool_]:
    """Return the mask of rays (n, 3), (n, 3) from inside that end at opaque parts of a shell before
    its wall.

    Opaque parts are the discs that close it at heights; for a window, all except its opening.
    """
    if isinstance(shell, FlatWindow):
        return ~_meets_disc(points, directions, shell.heights_mm[0], (shell.diameter_mm or np.inf) / 2)
    meets = np.zeros(len(points), dtype=bool)
    for height in lids_mm:
        meets |= _meets_disc(points, directions, height, shell.inner_radius_mm(height))
        # Reflected exactly in the corner
        meets |= (points[:, 2] - height) * np.sign(height) > -START_MM
    return meets


def _meets_disc(points: Array, directions: Array, height: float, radius: float) -> NDArray[np.bool_]:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (height - points[:, 2]) / directions[:, 2]
        across = points[:, :2] + t[:, None] * directions[:, :2]
        meets: NDArray[np.bool_] = (t * np.abs(directions[:, 2]) > START_MM) & (np.hypot(*across.T) < radius)
    return meets


class _Ghosts(NamedTuple):
    """Rays reflected by a wall."""

    points: Array
    directions: Array
    alive: NDArray[np.bool_]


@dataclass(frozen=True)
class ThroughShell:
    """Scene seen by a sensor through a tube or a dome.

    Rays are refracted at both sides of the wall by Snell's law and attenuated by Fresnel's
    equations. The light reflected by the wall is the ghost: at the mirror it is reflected again, at
    the back of the mirror or a lid it ends, and otherwise it passes the wall to another part of the
    scene, or is reflected again. Ghosts have no absorption at the mirror. Lids are black.

    Parameters
    ----------
    scene
    shell : Tube or Dome
        Shell with known dimensions.
    sensor
        Sensor inside; rays start from its mirror.
    lids_mm
        Heights over the mirror vertex (away from the lens) of opaque discs that close it.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.optics.housing import Tube
    >>> from omnimirror import Environment
    >>> sensor = om.load_sensor("paper-spherical")
    >>> white = ThroughShell(Environment(np.ones((4, 8, 3), np.float32)), Tube(120.0), sensor)
    >>> white.radiance(np.array([[0, 0, -20.0]]), np.array([[1.0, 0, 0]])).round(4)  # all but a ghost's ghost's ghost
    array([[0.9996, 0.9996, 0.9996]], dtype=float32)
    """

    scene: Scene
    shell: Shell
    sensor: Sensor
    lids_mm: tuple[float, ...] = ()

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) of rays (n, 3) of the sensor world frame that start inside.

        Raises
        ------
        InvalidParameter
            If a ray starts outside.
        """
        turn = self.sensor.mount.rotation()
        points, towards = (turned(v, turn) for v in (origins_mm, directions))
        light = np.zeros(points.shape)
        left = np.flatnonzero(~meets_lid(self.shell, self.lids_mm, points, towards))
        points, towards, share = points[left], towards[left], np.ones(len(left))
        for _ in range(1 + GHOSTS):
            left_by = passage(self.shell, points, towards)
            seen = self.scene.radiance(turned(left_by.points, turn.T), turned(left_by.directions, turn.T))
            light[left] += (share * left_by.passed)[:, None] * seen
            ghosts = self._ghosts(left_by)
            left, share = left[ghosts.alive], (share * (1 - left_by.passed))[ghosts.alive]
            points, towards = ghosts.points[ghosts.alive], ghosts.directions[ghosts.alive]
        return light.astype(np.float32)

    def _ghosts(self, passage: Passage) -> _Ghosts:
        """Return the continuation of reflected rays."""
        mirror = self.sensor.optical_train.posed_mirror
        points, directions = passage.met + LIFT_MM * passage.thrown_back, passage.thrown_back
        again = mirror.trace(points, directions)
        points = np.where(again.valid[:, None], again.points + LIFT_MM * again.directions, points)
        directions = np.where(again.valid[:, None], again.directions, directions)
        rim = self.sensor.mirror.rim_radius_mm
        back = float(self.sensor.mirror.sag(np.array(rim))) + self.sensor.mirror_pose.displacement_mm
        alive = ~(_meets_disc(points, directions, back, rim) | meets_lid(self.shell, self.lids_mm, points, directions))
        return _Ghosts(points, directions, alive)


def seen_through(camera: Camera, scene: Scene) -> Scene:
    """Return the scene through the tube or dome of the housing of a camera; unchanged without one."""
    if not isinstance(camera, Sensor) or camera.housing.shell is None:
        return scene
    standing = camera.obstructions
    assert standing.housing.shell is not None
    return ThroughShell(scene, standing.housing.shell, camera, tuple(lid.height_mm for lid in standing.lids))
