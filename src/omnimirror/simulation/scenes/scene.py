"""Scene interface (radiance along rays), and the pose of a sensor in a scene."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import check_fields, vectors
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.typing import Array
from ...cameras.camera import pan_tilt_rotation, rotate_vectors

# -- Scene interface -------------------------------------------------------------------------------


@runtime_checkable
class Scene(Protocol):
    """Scene in the world frame (x forward, y left, z up, origin at the mirror vertex).

    Results must not depend on the grouping of rays: images are rendered in tiles by several
    threads.
    """

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3), white at 1 and lamps above, of rays from origins (n, 3) mm in
        directions (n, 3).
        """
        ...


@runtime_checkable
class MeasurableScene(Protocol):
    """Scene with distances, for ground truth."""

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return distances (n,) of rays from origins (n, 3) mm in directions (n, 3) of any length;
        infinite without a surface.
        """
        ...


def rays_from(origins_mm: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Return validated rays for scenes: origins (n, 3) and directions (n, 3).

    >>> rays_from([[0, 0, 0]], [[0, 0, -2]])
    (array([[0., 0., 0.]]), array([[ 0.,  0., -2.]]))

    Raises
    ------
    InvalidParameter
        If the arguments are not vectors, differ in number, or a direction is zero or not finite.
    """
    origins = vectors("origins_mm", origins_mm, 3, is_list=True)
    towards = vectors("directions", directions, 3, is_list=True)
    if len(origins) != len(towards):
        raise InvalidParameter(
            f"origins_mm must have one origin per direction; got {len(origins)} for {len(towards)} directions"
        )
    usable = ~np.isnan(towards).any(axis=1) & towards.any(axis=1)
    if not usable.all():
        invalid = np.asarray(directions, float)[~usable][0].tolist()
        raise InvalidParameter(f"directions must be finite and nonzero; got {invalid}")
    return origins, towards


def distances_mm(scene: Scene, origins_mm: Array, directions: Array) -> Array:
    """Return distances (n,) of rays in a scene.

    Raises
    ------
    InvalidParameter
        If the scene provides no distances.
    """
    if not isinstance(scene, MeasurableScene):
        raise InvalidParameter(
            f"the scene must have the method distance_mm() for depth; got a {type(scene).__name__}"
        )
    return scene.distance_mm(origins_mm, directions)


@dataclass(frozen=True)
class DistantScene:
    """Scene moved to infinity: every ray has the radiance at the world origin in its direction.

    Images of it have no parallax, independent of the viewpoints of the mirror.

    >>> from omnimirror import Room
    >>> room = DistantScene(Room(texel_mm=40.0))
    >>> towards = np.array([[1.0, 0.2, 0.1]])
    >>> bool(np.all(room.radiance(np.full((1, 3), 999.0), towards) == room.radiance(np.zeros((1, 3)), towards)))
    True
    """

    scene: Scene

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) in directions (n, 3), independent of the origins."""
        return self.scene.radiance(np.zeros_like(origins_mm), directions)

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return infinite distances (n,)."""
        return np.full(len(directions), np.inf)


# -- Pose of the sensor ----------------------------------------------------------------------------


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
        "x_mm": Parameter("mm", -1e7, 1e7, "position, forward"),
        "y_mm": Parameter("mm", -1e7, 1e7, "position, left"),
        "z_mm": Parameter("mm", -1e7, 1e7, "position, up"),
        "pan_deg": Parameter("deg", -1e4, 1e4, "pan of the forward axis, right"),
        "tilt_deg": Parameter("deg", -90.0, 90.0, "tilt of the forward axis, up"),
        "roll_deg": Parameter("deg", -1e4, 1e4, "roll about the forward axis, clockwise"),
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
        return pan_tilt_rotation(self.pan_deg, self.tilt_deg, self.roll_deg)

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
        return rotate_vectors(points_mm, self.rotation().T) + self.shift_mm

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
        points: Array = rotate_vectors(
            np.asarray(points_mm, dtype=float) - self.shift_mm, self.rotation()
        )
        return points


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
        return self.pose.to_scene(origins), rotate_vectors(directions, turn)
