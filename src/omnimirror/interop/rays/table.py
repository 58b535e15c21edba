"""The ray of each pixel of a camera, as a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arguments import instance, whole
from ...cameras import Camera
from ...errors import OutsideField
from ...sensor import Sensor
from ..formats import Deviation
from ..hiding import hidden_pixels

Array = NDArray[np.float64]

AT_ONCE = 1 << 17  # rays


@dataclass(frozen=True)
class RayTable:
    """Where the rays of pixels start, where they go, and how much each weighs.

    World frame of the camera's mount: x forward, y left, z up, lengths in mm, the origin at the mirror's vertex (or
    the centre of a camera that is no mirror sensor). Row i and column j belong to the pixel (j ``step``, i ``step``),
    whole numbers at pixel centres.

    Attributes
    ----------
    origins
        (rows, columns, 3) mm; of a mirror sensor on its mirror, or outside on its tube or dome; 0 where no ray is.
    directions
        (rows, columns, 3) unit vectors towards what is seen; 0 where no ray is.
    weights
        (rows, columns): 1 where something is seen, 0 outside the field and where a part of the sensor stands before it.
    image_size
        (width, height) of the pictures, px.
    step
        Pixels from one to the next.
    name
        Of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> table = om.ray_table(om.Unified(0.9, (30.0, 30.0), (31.5, 23.5), (64, 48)))
    >>> table.size, table.has_ray.all(), table.weights[24, 32]
    ((64, 48), np.True_, np.float64(1.0))
    """

    origins: Array
    directions: Array
    weights: Array
    image_size: tuple[int, int]
    step: int = 1
    name: str = "camera"

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows)."""
        return self.weights.shape[1], self.weights.shape[0]

    @property
    def has_ray(self) -> NDArray[np.bool_]:
        """(rows, columns) True where there is a ray, hidden or not."""
        return np.asarray(self.directions.any(axis=-1))


def in_axes(table: RayTable, axes: Array) -> tuple[Array, Array]:
    """Origins (mm) and directions of a table in another frame, whose axes are the rows (3, 3) of a rotation."""
    return table.origins @ axes.T, table.directions @ axes.T


def ray_table(camera: Camera, step: int = 1) -> RayTable:
    """The rays of a camera's pixels, each traced by itself, for programs that take explicit rays.

    Parameters
    ----------
    camera
        A sensor, aligned or not, or a calibrated camera.
    step
        Every n-th pixel only, across and down.

    Returns
    -------
    RayTable
        Origins in mm, directions and weights, in the world frame of the camera's mount.

    Raises
    ------
    InvalidParameter
        A step that is no whole number of pixels of the picture.
    OutsideField
        The picture shows nothing of the field.

    Examples
    --------
    >>> import omnimirror as om
    >>> table = om.ray_table(om.load_sensor("paper-spherical"), step=8)
    >>> table.size, int(table.weights.sum())
    ((128, 128), 12351)
    >>> table.origins[64, 96].round(2), table.directions[64, 96].round(3)  # right of the centre: to the left
    (array([-0.04, 20.07,  4.21]), array([-0.002,  0.805, -0.594]))
    """
    instance("camera", camera, Camera, "a camera, such as om.load_sensor gives")
    width, height = camera.image_size
    step = whole("step", step, 1, min(width, height))
    columns, rows = np.arange(0, width, step), np.arange(0, height, step)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
    found = [_rays(camera, pixels[i : i + AT_ONCE]) for i in range(0, len(pixels), AT_ONCE)]
    origins, directions, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    if not weights.any():
        raise OutsideField(f"none of the {len(columns)} x {len(rows)} pixels sees anything of the camera's field")
    shape = len(rows), len(columns)
    name = getattr(camera, "name", "camera")
    return RayTable(
        origins.reshape(*shape, 3), directions.reshape(*shape, 3), weights.reshape(shape), (width, height), step, name
    )


def _rays(camera: Camera, pixels: Array) -> tuple[Array, Array, Array]:
    """Origins, directions and weights of pixels (n, 2)."""
    rays = camera.backproject(pixels)
    weights = rays.valid.astype(float)
    if isinstance(camera, Sensor):
        weights[hidden_pixels(camera, pixels, rays)] = 0.0
    none = ~rays.valid[:, None]
    return np.where(none, 0.0, rays.origins), np.where(none, 0.0, rays.directions), weights


def between_rays_deg(table: RayTable) -> float:
    """How far off at most, deg, a direction is that is taken between those of four neighbours in the table.

    Found from directions that are in the table, beside those that twice the step would give in their places: the error
    grows with the square of the step.
    """
    d, worst = table.directions, 0.0
    for ends, middle in (((d[:, :-2], d[:, 2:]), d[:, 1:-1]), ((d[:-2], d[2:]), d[1:-1])):
        mean = ends[0] + ends[1]
        all_there = ends[0].any(-1) & ends[1].any(-1) & middle.any(-1)
        across = np.linalg.norm(np.cross(mean[all_there], middle[all_there]), axis=-1)
        if across.size:
            worst += float(np.degrees(np.arctan2(across, 2.0)).max()) / 4
    return worst


def deviation_between(table: RayTable) -> Deviation:
    """Of programs that look between the rays of the table: what they take between four of them."""
    return Deviation(between_rays_deg(table), "deg", "directions between those of the table")
