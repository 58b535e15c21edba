"""Ground truth of an image: origin, direction and depth of each pixel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked
from ...base.colour import Light
from ...base.typing import Array, Mask
from ...cameras.camera import Camera
from ..radiometry import Radiometry
from ..rendering.sight import sights
from ..scenes.contract import Scene, distances_mm

ROWS_AT_ONCE = 64


class Truth(NamedTuple):
    """Scene points of the chief rays of pixel centres (rows, columns); NaN for pixels without
    scene.

    A chief ray passes through the centre of the lens aperture. If the housing blocks it, the pixel
    is hidden, even if adjacent rays pass: blur makes the image fade at edges, but not the ground
    truth. Ghosts are ignored.
    """

    origins_mm: Array
    """Origins (h, w, 3) of the rays leaving the sensor, in its world frame: on the mirror, on the
    outer side of a tube or a dome, or at the lens for rays that miss the mirror.
    """
    directions: Array
    """Unit direction vectors (h, w, 3) in the world frame of the sensor."""
    depth_mm: Array
    """Distances (h, w) along the ray from its origin to the scene point; infinite for points at
    infinity.
    """
    hidden: Mask
    """Mask (h, w) of pixels that image camera, rod, rim or a lid, or a part of two mirrors
    themselves.
    """

    @property
    def points_mm(self) -> Array:
        """Scene points (h, w, 3) in the world frame of the sensor."""
        return self.origins_mm + self.depth_mm[..., None] * self.directions

    def channels(self, light: Light) -> dict[str, NDArray[np.float32]]:
        """Return channels (h, w) of an image file: R G B of the light (h, w, 3), A, H, Z, DX DY DZ
        and OX OY OZ.

        A is 1 if the pixel centre images the scene and otherwise 0, H is 1 if the housing hides it;
        Z is the depth, D the direction and O the origin.
        """
        planes: dict[str, NDArray[Any]] = {name: light[..., i] for i, name in enumerate("RGB")}
        planes |= {"A": np.isfinite(self.directions[..., 0]), "H": self.hidden, "Z": self.depth_mm}
        planes |= {f"D{axis}": self.directions[..., i] for i, axis in enumerate("XYZ")}
        planes |= {f"O{axis}": self.origins_mm[..., i] for i, axis in enumerate("XYZ")}
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}


@checked
def ground_truth(camera: Camera, scene: Scene, radiometry: Radiometry | None = None) -> Truth:
    """Return the ground truth of each pixel centre by its chief ray.

    Parameters
    ----------
    camera
    scene
    radiometry
        As in :func:`~omnimirror.expose`: determines the visibility past the mirror.

    Returns
    -------
    Truth
        Origin, direction, depth and visibility for each pixel.

    Raises
    ------
    InvalidParameter
        If the scene provides no distances, or radiometry or housing are not supported for the
        camera.

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
