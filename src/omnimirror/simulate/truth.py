"""Ground truth of a picture: where each pixel looks from, whereto, and how far it sees."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from .colour import Light
from .scenes.contract import Scene, distances_mm

Array = NDArray[np.float64]

ROWS_AT_ONCE = 64


class Truth(NamedTuple):
    """What the chief rays of pixel centres (rows, columns) meet; NaN where a pixel sees nothing."""

    origins_mm: Array
    """(h, w, 3): where they leave the mirror, in the sensor's world frame."""
    directions: Array
    """(h, w, 3), unit vectors, in the sensor's world frame."""
    depth_mm: Array
    """(h, w): along the ray, from its origin to what it meets; infinite for what is infinitely far."""

    @property
    def points_mm(self) -> Array:
        """What is met (h, w, 3), in the sensor's world frame."""
        return self.origins_mm + self.depth_mm[..., None] * self.directions

    def channels(self, light: Light) -> dict[str, NDArray[np.float32]]:
        """Channels (h, w) of a picture file: R G B of the light (h, w, 3), A, Z, DX DY DZ and OX OY OZ.

        A is 1 where a pixel's centre sees the scene and else 0; Z is the depth, D the direction and O the origin.
        """
        planes: dict[str, NDArray[Any]] = {name: light[..., i] for i, name in enumerate("RGB")}
        planes |= {"A": np.isfinite(self.directions[..., 0]), "Z": self.depth_mm}
        planes |= {f"D{axis}": self.directions[..., i] for i, axis in enumerate("XYZ")}
        planes |= {f"O{axis}": self.origins_mm[..., i] for i, axis in enumerate("XYZ")}
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}


def ground_truth(camera: Camera, scene: Scene) -> Truth:
    """What the centre of each pixel sees, by its chief ray; hardware in the light is left out.

    Raises
    ------
    InvalidParameter
        If the scene cannot tell distances.

    Examples
    --------
    >>> import omnimirror as om
    >>> truth = ground_truth(om.load_sensor("paper-spherical"), om.Room(texel_mm=40.0))
    >>> truth.points_mm[11, 512].round()  # ahead and 44 deg up: a beam under the ceiling
    array([1840.,    2., 1773.])
    """
    width, height = camera.image_size
    origins, directions = np.full((2, height, width, 3), np.nan)
    depth = np.full((height, width), np.nan)
    for top in range(0, height, ROWS_AT_ONCE):
        rows = np.arange(top, min(top + ROWS_AT_ONCE, height))
        pixels = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).reshape(-1, 2)
        rays = camera.backproject(pixels)
        valid = rays.valid.reshape(len(rows), width)
        start = rays.origins[rays.valid]
        towards = rays.directions[rays.valid]
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        origins[rows[0] : rows[-1] + 1][valid], directions[rows[0] : rows[-1] + 1][valid] = start, towards
        depth[rows[0] : rows[-1] + 1][valid] = distances_mm(scene, start, towards)
    return Truth(origins, directions, depth)
