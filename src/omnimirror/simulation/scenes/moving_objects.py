"""Moving boxes in a scene, and the scene with them at one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import check_fields, file_name, finite, validate_arguments
from ...base.colour import Light, hex_colour
from ...base.errors import InvalidParameter, MediaError, SpecError
from ...base.files import read_tables
from ...base.typing import Array
from ...cameras.camera import rotate_vectors
from ...io.keyframes import Keyframes, keyframes_of
from ._painting import PaintedScene, Surroundings, surfaces_of_faces
from .scene import (
    FACES,
    POSE_NAMES,
    TINY,
    Box,
    Face,
    Pose,
    Scene,
    distances_mm,
    face_of,
    merge_surfaces,
)

SHADES = np.array([0.75, 0.55, 1.0])
"""Brightness of sides, fronts and tops, to make them distinguishable."""
NO_SURFACE, BACKGROUND = 0, 1
MAX_BODIES = 1000
"""Maximum number of bodies in a scene."""
MAX_REORDERED_SURFACES = 20_000
"""Maximum number of scene surfaces for rendering bodies with kernels, which reorder all surfaces
for each time.
"""


@runtime_checkable
class LabelledScene(Protocol):
    """Scene with labels of the surfaces."""

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the labels from 1 on."""
        ...

    def labels(self, origins_mm: Array, directions: Array) -> NDArray[np.int64]:
        """Return labels (n,) of rays, starting at 1; 0 without a surface."""
        ...


@dataclass(frozen=True)
class MovingBox:
    """Moving box in a scene.

    Parameters
    ----------
    size_mm : (3,)
        Length along forward, width and height; its pose is that of its centre.
    path
        Poses over time, as returned by :func:`omnimirror.load_path`.
    colour
        Colour such as ``"#c0392b"``.
    name
        Name of its label.

    Raises
    ------
    InvalidParameter
        If the size or the colour is invalid, or the path does not contain poses.

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
        if unknown := next((name for name in self.path.tracks if name not in POSE_NAMES), None):
            raise InvalidParameter(
                f"the tracks of path must be from {', '.join(POSE_NAMES)}; got {unknown!r}"
            )

    def pose_at(self, time_s: float) -> Pose:
        """Return the pose at a time.

        Parameters
        ----------
        time_s
            Time, s.

        Returns
        -------
        Pose
            Pose of its centre in the scene.
        """
        return Pose(**self.path.at(time_s))


@validate_arguments
def load_bodies(path: str | Path) -> tuple[MovingBox, ...]:
    """Read moving boxes from a TOML file with one table per name.

    A table contains ``size_mm``, an optional ``colour``, and poses over time as for
    :func:`omnimirror.load_path`: in ``[[name.keyframe]]`` tables, or as ``path``, a file in the
    same folder.

    Parameters
    ----------
    path
        File name.

    Returns
    -------
    tuple of MovingBox
        Boxes in the order of the file.

    Raises
    ------
    SpecError
        If the file does not exist or contains no bodies; the message names the body.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/bodies.toml").write_text(
    ...         "[cart]\\nsize_mm = [400, 300, 500]\\n"
    ...         "[[cart.keyframe]]\\ntime_s = 0\\nx_mm = 1500\\n[[cart.keyframe]]\\ntime_s = 2\\nx_mm = 900"
    ...     )
    ...     [(box.name, box.pose_at(1.0).x_mm) for box in om.load_bodies(f"{folder}/bodies.toml")]
    [('cart', 1200.0)]
    """
    path = file_name("path", path)
    return tuple(
        _body(name, table, path)
        for name, table in read_tables(path, "body", "bodies", MAX_BODIES).items()
    )


def _body(name: str, table: dict[str, Any], source: Path) -> MovingBox:
    location, remaining = f"[{name}] of {source}", dict(table)
    size = remaining.pop("size_mm", None)
    if not isinstance(size, list):
        raise SpecError(
            f"{location}: size_mm must be [length, width, height], for example [400, 300, 500]"
        )
    colour = {"colour": remaining.pop("colour")} if "colour" in remaining else {}
    try:
        if "path" in remaining:
            track = Keyframes.load(
                source.parent / file_name("path", remaining.pop("path")), POSE_NAMES
            )
            if remaining:
                raise InvalidParameter(f"{next(iter(remaining))} must be omitted with a path")
        else:
            track = keyframes_of(remaining, location, POSE_NAMES)
        return MovingBox(tuple(size), track, name=name, **colour)
    except MediaError as e:
        raise SpecError(str(e)) from None
    except InvalidParameter as e:
        raise SpecError(f"{location}: {e}") from None


@dataclass(frozen=True)
class SceneWithBodies:
    """Scene with boxes at one time.

    Parameters
    ----------
    scene
        Scene that provides distances.
    bodies
        Moving bodies.
    time_s
        Time.

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
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3)."""
        light = self.scene.radiance(origins_mm, directions)
        _, body, axis = self._nearest(origins_mm, directions)
        for number, box in enumerate(self.bodies):
            on = body == number
            light[on] = hex_colour(box.colour) * SHADES[axis[on], None].astype(np.float32)
        return light

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces of the scene and the bodies for rays that start in a box between
        corners (3,), (3,) mm.

        None if the scene contains more than surfaces, has too many surfaces to reorder for each
        time, or if rays may start in a body.
        """
        surroundings = (
            self.scene.surroundings_from(low_mm, high_mm)
            if isinstance(self.scene, PaintedScene)
            else None
        )
        if surroundings is None or not self.bodies:
            return surroundings
        poses = [box.pose_at(self.time_s) for box in self.bodies]
        starts = [np.clip(pose.shift_mm, low_mm, high_mm) - pose.shift_mm for pose in poses]
        reaches = [np.linalg.norm(box.size_mm) / 2 for box in self.bodies]
        is_inside = any(
            np.linalg.norm(start) <= reach for start, reach in zip(starts, reaches, strict=True)
        )
        if is_inside or len(surroundings.surfaces.records) > MAX_REORDERED_SURFACES:
            return None
        faces = [
            face
            for box, pose in zip(self.bodies, poses, strict=True)
            for face in _faces_of(box, pose)
        ]
        images = [_plain(box, number // 2) for box in self.bodies for number in FACES]
        return Surroundings(
            merge_surfaces(surroundings.surfaces, surfaces_of_faces(faces, images)),
            surroundings.background,
        )

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return distances (n,) of rays, mm."""
        return self._nearest(origins_mm, directions)[0]

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the labels from 1 on: those of the scene, followed by those of the bodies."""
        names = self.scene.label_names if isinstance(self.scene, LabelledScene) else ("scene",)
        return names + tuple(box.name for box in self.bodies)

    def labels(self, origins_mm: Array, directions: Array) -> NDArray[np.int64]:
        """Return labels (n,) of rays."""
        distance, body, _ = self._nearest(origins_mm, directions)
        if isinstance(self.scene, LabelledScene):
            labels = self.scene.labels(origins_mm, directions)
        else:
            labels = np.where(np.isfinite(distance), BACKGROUND, NO_SURFACE)
        first = 1 + len(self.label_names) - len(self.bodies)
        return np.where(body >= 0, first + body, labels)

    def _nearest(
        self, origins: Array, directions: Array
    ) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
        """Return distances (n,) of rays, body indices, -1 for none, and the axis of the intersected
        face.
        """
        nearest = distances_mm(self.scene, origins, directions).copy()
        body, axis = np.full(len(nearest), -1), np.zeros(len(nearest), np.int64)
        length = np.linalg.norm(directions, axis=1)
        for number, box in enumerate(self.bodies):
            pose = box.pose_at(self.time_s)
            towards = rotate_vectors(directions / length[:, None], pose.rotation())
            towards = np.where(towards == 0, TINY, towards)
            start = pose.to_sensor(origins)
            half = np.asarray(box.size_mm) / 2
            entries = (-np.sign(towards) * half - start) / towards
            exits = (np.sign(towards) * half - start) / towards
            near = entries.max(axis=1)
            is_hit = (near > 0) & (near < exits.min(axis=1)) & (near < nearest)
            nearest[is_hit], body[is_hit], axis[is_hit] = (
                near[is_hit],
                number,
                entries.argmax(axis=1)[is_hit],
            )
        return nearest, body, axis


def _faces_of(box: MovingBox, pose: Pose) -> list[Face]:
    """Return its faces in the scene, ordered by number."""
    length, width, height = (side / 2 for side in box.size_mm)
    local_box, turn, faces = (
        Box((-length, -width, -height), (length, width, height)),
        pose.rotation().T,
        [],
    )
    for face in (face_of(local_box, number, inside=False) for number in FACES):
        corner = pose.to_scene(face.corner[None])[0]
        right, up, normal = rotate_vectors(np.array([face.right, face.up, face.normal]), turn)
        faces.append(Face(corner, right, up, normal, face.width_mm, face.height_mm))
    return faces


def _plain(box: MovingBox, axis: int) -> Light:
    """Return the image (1, 1, 4) of an opaque side."""
    return np.array([[[*(hex_colour(box.colour) * SHADES[axis]), 0.0]]], np.float32)


def with_bodies(scene: Scene, bodies: Sequence[MovingBox], time_s: float) -> Scene:
    """Return a scene with bodies at a time (s); the scene itself if there are no bodies."""
    return SceneWithBodies(scene, tuple(bodies), time_s) if len(bodies) else scene
