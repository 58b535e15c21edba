"""Ground truth of a picture: where each pixel looks from, whereto, and how far it sees."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked
from ...base.colour import Light
from ...cameras.camera import Camera
from ..radiometry import Radiometry
from ..rendering.sight import sights
from ..scenes.contract import Scene, distances_mm

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROWS_AT_ONCE = 64


class Truth(NamedTuple):
    """What the chief rays of pixel centres (rows, columns) meet; NaN where a pixel sees nothing of the scene.

    A chief ray goes through the middle of the lens's aperture. Where the housing stands in its way, a pixel is hidden,
    even if rays beside it pass: at edges blur makes the picture fade, and the truth does not. Ghosts are left out.
    """

    origins_mm: Array
    """(h, w, 3): where they leave the sensor, in its world frame: on the mirror, on the outer side of a tube or a dome,
    or, if they pass beside the mirror, at the lens."""
    directions: Array
    """(h, w, 3), unit vectors from there on, in the sensor's world frame."""
    depth_mm: Array
    """(h, w): along the ray, from its origin to what it meets; infinite for what is infinitely far."""
    hidden: Mask
    """(h, w): whether camera, rod, rim or a lid is what the pixel sees, or a part of two mirrors themselves."""

    @property
    def points_mm(self) -> Array:
        """What is met (h, w, 3), in the sensor's world frame."""
        return self.origins_mm + self.depth_mm[..., None] * self.directions

    def channels(self, light: Light) -> dict[str, NDArray[np.float32]]:
        """Channels (h, w) of a picture file: R G B of the light (h, w, 3), A, H, Z, DX DY DZ and OX OY OZ.

        A is 1 where a pixel's centre sees the scene and else 0, H is 1 where the housing hides it; Z is the depth, D
        the direction and O the origin.
        """
        planes: dict[str, NDArray[Any]] = {name: light[..., i] for i, name in enumerate("RGB")}
        planes |= {"A": np.isfinite(self.directions[..., 0]), "H": self.hidden, "Z": self.depth_mm}
        planes |= {f"D{axis}": self.directions[..., i] for i, axis in enumerate("XYZ")}
        planes |= {f"O{axis}": self.origins_mm[..., i] for i, axis in enumerate("XYZ")}
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}


@checked
def ground_truth(camera: Camera, scene: Scene, radiometry: Radiometry | None = None) -> Truth:
    """What the centre of each pixel sees, by its chief ray.

    Parameters
    ----------
    camera
    scene
    radiometry
        As for :func:`~omnimirror.expose`: whether a sensor sees past its mirror.

    Returns
    -------
    Truth
        Of each pixel: where its ray begins and leads, how far it goes, and whether something hides what it would see.

    Raises
    ------
    InvalidParameter
        If the scene cannot tell distances, or the camera cannot have such radiometry or housing.

    Examples
    --------
    >>> import omnimirror as om
    >>> truth = om.ground_truth(om.load_sensor("paper-spherical"), om.Room(texel_mm=40.0))
    >>> truth.points_mm[11, 512].round()  # ahead and 44 deg up: a beam under the ceiling
    array([1840.,    2., 1773.])
    """
    width, height = camera.image_size
    origins, directions = np.full((2, height, width, 3), np.nan)
    depth, hidden = np.full((height, width), np.nan), np.zeros((height, width), dtype=bool)
    for top in range(0, height, ROWS_AT_ONCE):
        rows = np.arange(top, min(top + ROWS_AT_ONCE, height))
        pixels = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).reshape(-1, 2)
        seen = sights(camera, pixels, radiometry)
        band, shape = slice(rows[0], rows[-1] + 1), (len(rows), width)
        origins[band], directions[band] = seen.origins.reshape(*shape, 3), seen.directions.reshape(*shape, 3)
        hidden[band] = seen.hidden.reshape(shape)
        valid = seen.valid
        depth[band][valid.reshape(shape)] = distances_mm(scene, seen.origins[valid], seen.directions[valid])
    return Truth(origins, directions, depth, hidden)
