"""Transparent tubes and domes around a sensor: what is seen through them, dimmed, bent, and with a ghost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.colour import Light
from ..cameras.camera import Camera
from ..cameras.frames import turned
from ..optics.housing import FlatWindow, Shell
from ..optics.sensor import Sensor
from ..optics.tracing.walls import Passage, passage
from .scenes.contract import Array, Scene

GHOSTS = 2  # ghosts of ghosts of ghosts are less than a thousandth
START_MM = 1e-4  # a ray starts on what is this near: single precision
LIFT_MM = 1e-6  # by which a ray starts off the surface that it leaves


def meets_lid(shell: Shell, lids_mm: tuple[float, ...], points: Array, directions: Array) -> NDArray[np.bool_]:
    """Which rays (n, 3), (n, 3) from inside end at what is opaque about a shell, before they come to its wall.

    Those are the discs that close it at heights; about a window, all but its opening.
    """
    if isinstance(shell, FlatWindow):
        return ~_meets_disc(points, directions, shell.heights_mm[0], (shell.diameter_mm or np.inf) / 2)
    meets = np.zeros(len(points), dtype=bool)
    for height in lids_mm:
        meets |= _meets_disc(points, directions, height, shell.inner_radius_mm(height))
        meets |= (points[:, 2] - height) * np.sign(height) > -START_MM  # thrown back in the very corner
    return meets


def _meets_disc(points: Array, directions: Array, height: float, radius: float) -> NDArray[np.bool_]:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (height - points[:, 2]) / directions[:, 2]
        across = points[:, :2] + t[:, None] * directions[:, :2]
        meets: NDArray[np.bool_] = (t * np.abs(directions[:, 2]) > START_MM) & (np.hypot(*across.T) < radius)
    return meets


class _Ghosts(NamedTuple):
    """What a wall throws back."""

    points: Array
    directions: Array
    alive: NDArray[np.bool_]


@dataclass(frozen=True)
class ThroughShell:
    """A scene as a sensor sees it from inside a tube or a dome.

    Rays are bent at both sides of the wall by Snell's law and dimmed by Fresnel's. What the wall throws back is the
    ghost: where it meets the mirror it is reflected once more, where it meets the mirror's back or a lid it ends,
    and else it passes the wall and shows another part of the scene, or is thrown back once more. Of ghosts the mirror
    swallows nothing. Lids are black.

    Parameters
    ----------
    scene
    shell : Tube or Dome
        Its sizes are known.
    sensor
        That stands inside; rays start from its mirror.
    lids_mm
        Heights over the mirror's vertex (away from the lens) of opaque discs that close it.

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
        """Linear RGB (n, 3) of rays (n, 3) of the sensor's world frame that start inside.

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
        """Where what was thrown back goes next."""
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
    """The scene as a camera sees it through the tube or the dome of its housing, or as it is where there is none."""
    if not isinstance(camera, Sensor) or camera.housing.shell is None:
        return scene
    standing = camera.obstructions
    assert standing.housing.shell is not None
    return ThroughShell(scene, standing.housing.shell, camera, tuple(lid.height_mm for lid in standing.lids))
