"""Pose of a sensor in a scene, and the scene in the sensor frame."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from ...base.arguments import check_fields
from ...base.colour import Light
from ...base.parameters import Parameter
from ...base.typing import Array
from ...cameras.frames import turn_of, turned
from .contract import Scene, distances_mm


@dataclass(frozen=True)
class Pose:
    """Position of the mirror vertex in a scene, and orientation of the sensor world.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Mirror vertex in the scene frame: x forward, y left, z up.
    pan_deg, tilt_deg, roll_deg
        Forward direction of the sensor: pan to the right, tilt up, and then clockwise roll about
        it.

    Raises
    ------
    InvalidParameter
        If a number is out of range.

    Examples
    --------
    >>> pose = Pose(1000.0, 0.0, 0.0, pan_deg=90.0)
    >>> pose.to_scene([[200.0, 0.0, 50.0]])  # ahead of the sensor is right in the scene, -y
    array([[1000., -200.,   50.]])
    """

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "x_mm": Parameter("mm", -1e7, 1e7, "forward"),
        "y_mm": Parameter("mm", -1e7, 1e7, "to the left"),
        "z_mm": Parameter("mm", -1e7, 1e7, "up"),
        "pan_deg": Parameter("deg", -1e4, 1e4, "of forward, to the right"),
        "tilt_deg": Parameter("deg", -90.0, 90.0, "of forward, upwards"),
        "roll_deg": Parameter("deg", -1e4, 1e4, "about forward, clockwise"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))

    @property
    def shift_mm(self) -> Array:
        """Mirror vertex (3,) in the scene frame."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    def rotation(self) -> Array:
        """Return the rotation (3, 3) from the sensor world to the scene frame.

        Returns
        -------
        (3, 3) array
            Rotation of directions from the sensor world to the scene.
        """
        return turn_of(self.pan_deg, self.tilt_deg, self.roll_deg)

    def to_scene(self, points_mm: Array) -> Array:
        """Convert points (n, 3) of the sensor world to the scene frame.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in the sensor world, mm.

        Returns
        -------
        (n, 3) array
            Points in the scene, mm.
        """
        return turned(points_mm, self.rotation().T) + self.shift_mm

    def to_sensor(self, points_mm: Array) -> Array:
        """Convert points (n, 3) of the scene frame to the sensor world.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in the scene, mm.

        Returns
        -------
        (n, 3) array
            Points in the sensor world, mm.
        """
        moved: Array = turned(np.asarray(points_mm, dtype=float) - self.shift_mm, self.rotation())
        return moved


POSE_NAMES = tuple(f.name for f in fields(Pose))


@dataclass(frozen=True)
class PosedScene:
    """Scene in the frame of a sensor with a pose.

    Parameters
    ----------
    scene
        Scene to be rendered.
    pose
        Pose of the sensor in the scene.

    Examples
    --------
    >>> from omnimirror import Room
    >>> room, pose = Room(texel_mm=40.0), Pose(500.0, 0.0, 0.0, pan_deg=30.0)
    >>> wall = np.array([[3400.0, 0.0, 0.0]])
    >>> towards = pose.to_sensor(wall)
    >>> PosedScene(room, pose).distance_mm(np.zeros((1, 3)), towards)
    array([2900.])
    """

    scene: Scene
    pose: Pose

    def __post_init__(self) -> None:
        check_fields(self)

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) of rays of the sensor world.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.
        """
        return self.scene.radiance(*self._in_scene(origins_mm, directions))

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return distances (n,) of rays of the sensor world.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n,) array
            Distances, mm; infinite without a surface.
        """
        return distances_mm(self.scene, *self._in_scene(origins_mm, directions))

    def _in_scene(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        turn = self.pose.rotation().T
        return self.pose.to_scene(origins), turned(directions, turn)
