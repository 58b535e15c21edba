"""What a calibration's covariance means in the world: how far directions and points of a floor may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import checked, finite, instance, number, vectors, whole
from ..camera_models.base import CameraModel
from ..camera_models.spread import direction_sigma_deg, larger_sigma, spread_at
from ..errors import InvalidParameter
from ..frames import turned
from ..parameters import Uncertainty
from ..sensor import Sensor
from .physical import SensorModel

Array = NDArray[np.float64]

MOST_STEPS = 2000  # of a map, whose rows are computed at once
HIGHEST_MM = 1e9  # of a camera over a floor
FARTHEST_FLOOR = 100.0  # times the height: beyond, a ray is level for every purpose


@checked
def direction_uncertainty(
    camera: Sensor | CameraModel, pixels: ArrayLike, *, covariance: ArrayLike | Uncertainty | None = None
) -> Array:
    """Standard deviation (n,) in deg of the directions that pixels see, the way in which it is larger.

    Formula: :func:`omnimirror.camera_models.spread.direction_spread`. What the mount adds, how the camera stands in
    the world, is not in it.

    Parameters
    ----------
    camera
        A calibrated sensor, or a camera model.
    pixels : (n, 2)
        Pixels (u, v), integers at their centres.
    covariance
        Of the camera's parameters (n, n), in their order; by default what a sensor's file says of itself.

    Returns
    -------
    (n,) array
        Degrees; NaN where a pixel sees nothing.

    Raises
    ------
    InvalidParameter
        There is no covariance, or one of other parameters.

    Examples
    --------
    A focal length known to a thousandth: off the axis directions are off by so much of how fast they turn.

    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> om.direction_uncertainty(model, [[811.5, 511.5], [961.5, 511.5]], covariance=[[0.0116**2]]).round(3)
    array([0.078, 0.189])
    """
    model, matrix = _known(camera, covariance)
    rays = model.backproject(vectors("pixels", pixels, 2, is_list=True))
    return direction_sigma_deg(model, matrix, turned(rays.directions, model.mount.rotation()))


@checked
def floor_uncertainty(
    camera: Sensor | CameraModel,
    pixels: ArrayLike,
    *,
    height_mm: float,
    covariance: ArrayLike | Uncertainty | None = None,
) -> Array:
    """Standard deviation (n,) in mm of the points of a level floor that pixels see, the way in which it is larger.

    Parameters
    ----------
    camera
        A calibrated sensor, or a camera model.
    pixels : (n, 2)
        Pixels (u, v), integers at their centres.
    height_mm
        Of the world's origin, a sensor's mirror vertex, over the floor; below 0 for a ceiling.
    covariance
        Of the camera's parameters (n, n), in their order; by default what a sensor's file says of itself.

    Returns
    -------
    (n,) array
        Millimetres; NaN where a pixel sees no floor, or one farther away than a hundred heights.

    Raises
    ------
    InvalidParameter
        There is no covariance, or one of other parameters.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> pixels = [[711.5, 511.5], [811.5, 511.5], [961.5, 511.5]]
    >>> om.floor_uncertainty(model, pixels, height_mm=1500.0, covariance=[[0.0116**2]]).round(1)
    array([ 2.1, 10.6,  nan])
    """
    height = number("height_mm", height_mm, low=-HIGHEST_MM, high=HIGHEST_MM, unit="mm")
    if height == 0:
        raise InvalidParameter("height_mm = 0 is no height over a floor; it is valid above 0, and below for a ceiling")
    model, matrix = _known(camera, covariance)
    rays = model.backproject(vectors("pixels", pixels, 2, is_list=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (-height - rays.origins[:, 2]) / rays.directions[:, 2]
        along = np.where((along > 0) & (along < FARTHEST_FLOOR * abs(height)), along, np.nan)
    points = rays.origins + along[:, None] * rays.directions
    world = model.mount.rotation()
    level = np.broadcast_to(world[:2].T, (len(points), 3, 2))  # the world's x and y in the camera frame
    return larger_sigma(spread_at(model, matrix, turned(points, world), level, distant=False))


@dataclass(frozen=True)
class UncertaintyMap:
    """Errors over the picture, on a grid of pixels.

    Parameters
    ----------
    columns, rows
        Of the grid, px.
    sigma
        Standard deviations (rows, columns); NaN where nothing is seen.
    unit
        ``"deg"`` or ``"mm"``.
    """

    columns: Array
    rows: Array
    sigma: Array
    unit: str

    def summary(self) -> dict[str, float]:
        """Median, 95th percentile and largest of what is seen."""
        seen = self.sigma[np.isfinite(self.sigma)]
        if not seen.size:
            return {}
        return {
            f"median_{self.unit}": float(np.median(seen)),
            f"percentile_95_{self.unit}": float(np.percentile(seen, 95)),
            f"largest_{self.unit}": float(seen.max()),
        }


@checked
def uncertainty_map(
    camera: Sensor | CameraModel,
    *,
    height_mm: float | None = None,
    covariance: ArrayLike | Uncertainty | None = None,
    steps: int = 96,
) -> UncertaintyMap:
    """Errors of directions, or of points on a floor, all over the picture.

    Parameters
    ----------
    camera
        A calibrated sensor, or a camera model.
    height_mm
        Of the camera over the floor; without it the errors are those of directions.
    covariance
        Of the camera's parameters (n, n), in their order; by default what a sensor's file says of itself.
    steps
        Of the grid along the longer side of the picture.

    Returns
    -------
    UncertaintyMap
        On its grid.

    Raises
    ------
    InvalidParameter
        There is no covariance, or one of other parameters.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> om.uncertainty_map(model, covariance=[[0.0116**2]], steps=16).summary()["median_deg"] < 0.2
    True
    """
    whole("steps", steps, 1, MOST_STEPS)
    width, height = camera.image_size
    step = max(width, height) / steps
    columns, rows = (np.arange(step / 2 - 0.5, size - 0.5, step) for size in (width, height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    if height_mm is None:
        sigma, unit = direction_uncertainty(camera, pixels, covariance=covariance), "deg"
    else:
        sigma, unit = floor_uncertainty(camera, pixels, height_mm=height_mm, covariance=covariance), "mm"
    return UncertaintyMap(columns, rows, sigma.reshape(len(rows), len(columns)), unit)


def _known(camera: Sensor | CameraModel, covariance: ArrayLike | Uncertainty | None) -> tuple[CameraModel, Array]:
    """The model, and the covariance of its parameters."""
    instance("camera", camera, (Sensor, CameraModel), "a sensor or a camera model")
    given = camera.uncertainty if covariance is None else covariance
    if given is None:
        raise InvalidParameter(
            "nothing is known of the camera's uncertainty; it is valid with a covariance of its parameters, which "
            "calibration writes into the table [uncertainty] of its file"
        )
    if isinstance(given, Uncertainty):
        if isinstance(camera, Sensor | SensorModel):
            sensor = camera if isinstance(camera, Sensor) else camera.sensor
            return SensorModel(sensor, given.names), given.of(given.names)
        return camera, given.of([p.name for p in camera.parameters])
    model = SensorModel(camera) if isinstance(camera, Sensor) else camera
    names = [p.name for p in model.parameters]
    matrix = finite("covariance", given)
    if matrix.shape != (len(names), len(names)):
        raise InvalidParameter(
            f"covariance has shape {matrix.shape}; the camera's parameters are {', '.join(names)}, so that it is valid "
            f"as {len(names), len(names)}"
        )
    return model, matrix
