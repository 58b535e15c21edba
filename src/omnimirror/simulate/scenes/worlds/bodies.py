"""Boxes that move in a scene, and the scene as it is with them at a moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ....arguments import check_fields, finite
from ....frames import turned
from ....media.keyframes import Keyframes
from ...colour import Light, hex_colour
from ..boxes import TINY
from ..contract import Array, Scene, distances_mm
from ..posed import Pose

SHADES = np.array([0.75, 0.55, 1.0])
"""How light sides, fronts and tops are: enough to tell them apart."""
NOTHING, BACKGROUND = 0, 1


@runtime_checkable
class Labelled(Protocol):
    """A scene that tells what rays meet."""

    @property
    def label_names(self) -> tuple[str, ...]:
        """Of labels from 1 on."""
        ...

    def labels(self, origins_mm: Array, directions: Array) -> NDArray[np.int64]:
        """What rays (n,) meet: from 1 on; 0 is nothing."""
        ...


@dataclass(frozen=True)
class MovingBox:
    """A box that moves in a scene.

    Parameters
    ----------
    size_mm : (3,)
        Its length ahead, width and height; its pose is that of its middle.
    path
        Poses over time, as of :func:`omnimirror.load_path`.
    colour
        As ``"#c0392b"``.
    name
        Of its label.

    Raises
    ------
    InvalidParameter
        A size that is none, or a colour that is not known.

    Examples
    --------
    >>> cart = MovingBox((400.0, 300.0, 200.0), Keyframes({"x_mm": ((0.0, 1000.0), (1.0, 2000.0))}, "linear"))
    >>> cart.pose_at(0.5).x_mm
    1500.0
    """

    size_mm: tuple[float, float, float]
    path: Keyframes
    colour: str = "#c0392b"
    name: str = "box"

    def __post_init__(self) -> None:
        check_fields(self)
        finite("size_mm", self.size_mm, 1e-3)
        hex_colour(self.colour)

    def pose_at(self, time_s: float) -> Pose:
        """Where it is at a time.

        Parameters
        ----------
        time_s
            s

        Returns
        -------
        Pose
            Of its middle, in the scene.
        """
        return Pose(**self.path.at(time_s))


@dataclass(frozen=True)
class SceneWithBodies:
    """A scene with boxes in it, at a moment.

    Parameters
    ----------
    scene
        Whatever tells distances.
    bodies
        What moves in it.
    time_s
        The moment.

    Examples
    --------
    >>> from omnimirror import Room
    >>> ball = MovingBox((200.0, 200.0, 200.0), Keyframes({"x_mm": ((0.0, 1000.0), (1.0, 2000.0))}, "linear"))
    >>> scene = SceneWithBodies(Room(texel_mm=40.0), (ball,), 0.5)
    >>> scene.distance_mm(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]))
    array([1400.])
    """

    scene: Scene
    bodies: tuple[MovingBox, ...] = ()
    time_s: float = 0.0

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3)."""
        light = self.scene.radiance(origins_mm, directions)
        _, body, axis = self._first(origins_mm, directions)
        for number, box in enumerate(self.bodies):
            on = body == number
            light[on] = hex_colour(box.colour) * SHADES[axis[on], None].astype(np.float32)
        return light

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """How far (n,) rays go, mm."""
        return self._first(origins_mm, directions)[0]

    @property
    def label_names(self) -> tuple[str, ...]:
        """Of labels from 1 on: the scene's own, and those of the bodies after them."""
        own = self.scene.label_names if isinstance(self.scene, Labelled) else ("scene",)
        return own + tuple(box.name for box in self.bodies)

    def labels(self, origins_mm: Array, directions: Array) -> NDArray[np.int64]:
        """What rays (n,) meet."""
        distance, body, _ = self._first(origins_mm, directions)
        if isinstance(self.scene, Labelled):
            labels = self.scene.labels(origins_mm, directions)
        else:
            labels = np.where(np.isfinite(distance), BACKGROUND, NOTHING)
        first = 1 + len(self.label_names) - len(self.bodies)
        return np.where(body >= 0, first + body, labels)

    def _first(self, origins: Array, directions: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
        """How far (n,) rays go, which body they meet, -1 for none of them, and across which axis of that."""
        nearest = distances_mm(self.scene, origins, directions).copy()
        body, axis = np.full(len(nearest), -1), np.zeros(len(nearest), np.int64)
        length = np.linalg.norm(directions, axis=1)
        for number, box in enumerate(self.bodies):
            pose = box.pose_at(self.time_s)
            towards = turned(directions / length[:, None], pose.rotation())
            towards = np.where(towards == 0, TINY, towards)
            start = pose.to_sensor(origins)
            half = np.asarray(box.size_mm) / 2
            entries = (-np.sign(towards) * half - start) / towards
            exits = (np.sign(towards) * half - start) / towards
            near = entries.max(axis=1)
            met = (near > 0) & (near < exits.min(axis=1)) & (near < nearest)
            nearest[met], body[met], axis[met] = near[met], number, entries.argmax(axis=1)[met]
        return nearest, body, axis
