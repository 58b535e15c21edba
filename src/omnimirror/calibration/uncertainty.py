"""Propagation of a calibration's covariance to directions and to points on a floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import (
    finite,
    instance,
    integer,
    number,
    optional_number,
    validate_arguments,
    vectors,
)
from ..base.errors import InvalidParameter
from ..base.parameters import Uncertainty
from ..base.results import Columns, Result, pixel_grid
from ..base.typing import Array
from ..cameras.camera import Rays, rotate_vectors
from ..cameras.models.camera_model import (
    CameraModel,
    direction_covariance_at,
    direction_sigma_deg,
    major_sigma,
    within_field,
)
from ..optics.sensor import Sensor
from .sensor_model import SensorModel

MAX_GRID_STEPS = 2000  # points per side of a map, whose rows are computed together
MAX_HEIGHT_MM = 1e9  # height of a camera above a floor
MAX_FLOOR_DISTANCE = 100.0  # multiple of the height; rays beyond are treated as horizontal


@validate_arguments
def direction_uncertainty(
    camera: Sensor | CameraModel,
    pixels: ArrayLike,
    *,
    covariance: ArrayLike | Uncertainty | None = None,
    field_deg: float | None = None,
) -> Array:
    """Return the standard deviation (n,) in deg of the directions of pixels, along the larger axis.

    Formula: :func:`omnimirror.cameras.models.camera_model.direction_covariance`. The orientation of the
    camera in the world, its mount, is assumed exact.

    Parameters
    ----------
    camera
        Calibrated sensor or camera model.
    pixels : (n, 2)
        Pixels (u, v), integers at their centres.
    covariance
        Covariance of the camera's parameters (n, n), in their order; by default that in its file.
    field_deg : deg, optional
        Maximum field angle from the viewing direction at the image centre; by default the
        calibrated field, if known.

    Returns
    -------
    (n,) array
        Standard deviation in deg; NaN for pixels outside the image field or the calibrated field.

    Raises
    ------
    InvalidParameter
        If there is no covariance, or its size does not match the parameters of the camera.

    Examples
    --------
    Focal length with an uncertainty of 0.1 %: the error of directions grows off the axis.

    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> pixels = [[811.5, 511.5], [961.5, 511.5]]
    >>> om.direction_uncertainty(model, pixels, covariance=[[0.0116**2]]).round(3)
    array([0.078, 0.189])
    >>> om.direction_uncertainty(model, pixels, covariance=[[0.0116**2]], field_deg=90.0).round(3)
    array([0.078,   nan])
    """
    uncertain = uncertain_model(camera, covariance, field_deg)
    rays = uncertain.model.backproject(vectors("pixels", pixels, 2, is_list=True))
    directions = rotate_vectors(rays.directions, uncertain.model.mount.rotation())
    return direction_sigma_deg(
        uncertain.model, uncertain.covariance, directions, uncertain.field_deg
    )


@validate_arguments
def floor_uncertainty(
    camera: Sensor | CameraModel,
    pixels: ArrayLike,
    *,
    height_mm: float,
    covariance: ArrayLike | Uncertainty | None = None,
    field_deg: float | None = None,
) -> Array:
    """Return the standard deviation (n,) in mm of floor points along the larger axis.

    Parameters
    ----------
    camera
        Calibrated sensor or camera model.
    pixels : (n, 2)
        Pixels (u, v), integers at their centres.
    height_mm
        Height of the world origin (for a sensor, the mirror vertex) above the floor; negative for a
        ceiling.
    covariance
        Covariance of the camera's parameters (n, n), in their order; by default that in its file.
    field_deg : deg, optional
        Maximum field angle from the viewing direction at the image centre; by default the
        calibrated field, if known.

    Returns
    -------
    (n,) array
        Standard deviation in mm; NaN for pixels outside the field and for rays that do not reach
        the floor within 100 heights.

    Raises
    ------
    InvalidParameter
        If there is no covariance, or its size does not match the parameters of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> pixels = [[711.5, 511.5], [811.5, 511.5], [961.5, 511.5]]
    >>> om.floor_uncertainty(model, pixels, height_mm=1500.0, covariance=[[0.0116**2]]).round(1)
    array([ 2.1, 10.6,  nan])
    """
    height = number("height_mm", height_mm, low=-MAX_HEIGHT_MM, high=MAX_HEIGHT_MM, unit="mm")
    if height == 0:
        raise InvalidParameter(
            "height_mm must be above 0 mm for a floor or below 0 mm for a ceiling; got 0"
        )
    uncertain = uncertain_model(camera, covariance, field_deg)
    model, rays = (
        uncertain.model,
        uncertain.model.backproject(vectors("pixels", pixels, 2, is_list=True)),
    )
    lengths = _to_floor(rays, height)
    points = rays.origins + lengths[:, None] * rays.directions
    world = model.mount.rotation()
    horizontal = np.broadcast_to(world[:2].T, (len(points), 3, 2))  # world x and y in camera frame
    sigma = major_sigma(
        direction_covariance_at(
            model, uncertain.covariance, rotate_vectors(points, world), horizontal, distant=False
        )
    )
    return np.where(
        within_field(model, rotate_vectors(rays.directions, world), uncertain.field_deg),
        sigma,
        np.nan,
    )


@dataclass(frozen=True)
class UncertaintyMap(Result):
    """Standard deviations over the image, on a grid of pixels.

    Parameters
    ----------
    columns, rows
        Coordinates of the grid, px.
    sigma
        Standard deviations (rows, columns); NaN outside the image field and the calibrated field.
    unit
        ``"deg"`` or ``"mm"``.
    field_deg
        Field angle (deg) to which the map is restricted; None without restriction.
    is_restricted
        Whether the image extends beyond that field.
    """

    columns: Array
    rows: Array
    sigma: Array
    unit: str
    field_deg: float | None = None
    is_restricted: bool = False

    def _table(self) -> Columns:
        sigma = {f"sigma_{self.unit}": self.sigma.ravel()}
        return pixel_grid(self.columns, self.rows) | sigma

    def summary(self) -> dict[str, float]:
        """Return the median, the 95th percentile and the maximum of all finite values."""
        values = self.sigma[np.isfinite(self.sigma)]
        if not values.size:
            return {}
        return {
            f"median_{self.unit}": float(np.median(values)),
            f"percentile_95_{self.unit}": float(np.percentile(values, 95)),
            f"largest_{self.unit}": float(values.max()),
        }


@validate_arguments
def uncertainty_map(
    camera: Sensor | CameraModel,
    *,
    height_mm: float | None = None,
    covariance: ArrayLike | Uncertainty | None = None,
    steps: int = 96,
    field_deg: float | None = None,
) -> UncertaintyMap:
    """Compute the standard deviations of directions, or of points on a floor, over the whole image.

    Parameters
    ----------
    camera
        Calibrated sensor or camera model.
    height_mm
        Height of the camera above the floor; None for directions.
    covariance
        Covariance of the camera's parameters (n, n), in their order; by default that in its file.
    steps
        Number of grid points along the longer side of the image.
    field_deg : deg, optional
        Maximum field angle from the viewing direction at the image centre; by default the
        calibrated field, if known.

    Returns
    -------
    UncertaintyMap
        Standard deviations on a grid.

    Raises
    ------
    InvalidParameter
        If there is no covariance, or its size does not match the parameters of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> om.uncertainty_map(model, covariance=[[0.0116**2]], steps=16).summary()["median_deg"] < 0.2
    True
    """
    integer("steps", steps, 1, MAX_GRID_STEPS)
    width, height = camera.image_size
    step = max(width, height) / steps
    columns, rows = (np.arange(step / 2 - 0.5, size - 0.5, step) for size in (width, height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    if height_mm is None:
        sigma, unit = (
            direction_uncertainty(camera, pixels, covariance=covariance, field_deg=field_deg),
            "deg",
        )
    else:
        sigma = floor_uncertainty(
            camera, pixels, height_mm=height_mm, covariance=covariance, field_deg=field_deg
        )
        unit = "mm"
    uncertain = uncertain_model(camera, covariance, field_deg)
    rays = uncertain.model.backproject(pixels)
    is_inside = within_field(
        uncertain.model,
        rotate_vectors(rays.directions, uncertain.model.mount.rotation()),
        uncertain.field_deg,
    )
    is_restricted = bool((rays.valid & ~is_inside).any())
    return UncertaintyMap(
        columns,
        rows,
        sigma.reshape(len(rows), len(columns)),
        unit,
        uncertain.field_deg,
        is_restricted,
    )


def _to_floor(rays: Rays, height_mm: float) -> Array:
    """Return the lengths (n,) in mm of rays to the floor; NaN beyond 100 heights."""
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = (-height_mm - rays.origins[:, 2]) / rays.directions[:, 2]
        return np.where(
            (lengths > 0) & (lengths < MAX_FLOOR_DISTANCE * abs(height_mm)), lengths, np.nan
        )


class UncertainModel(NamedTuple):
    """Camera model with the covariance of its parameters and its field of validity."""

    model: CameraModel
    covariance: Array
    field_deg: float | None


def uncertain_model(
    camera: Sensor | CameraModel,
    covariance: ArrayLike | Uncertainty | None,
    field_deg: float | None,
) -> UncertainModel:
    """Return the model, its covariance, and the given or calibrated field."""
    instance("camera", camera, (Sensor, CameraModel), "a sensor or a camera model")
    field = optional_number("field_deg", field_deg, above=0.0, high=180.0, unit="deg")
    specified = camera.uncertainty if covariance is None else covariance
    if specified is None:
        raise InvalidParameter(
            "covariance must be specified for a camera without uncertainty; a calibration "
            "writes it into the table [uncertainty] of the camera file"
        )
    if isinstance(specified, Uncertainty):
        field = specified.field_deg if field is None else field
        if isinstance(camera, Sensor | SensorModel):
            sensor = camera if isinstance(camera, Sensor) else camera.sensor
            return UncertainModel(
                SensorModel(sensor, specified.names), specified.of(specified.names), field
            )
        return UncertainModel(camera, specified.of([p.name for p in camera.parameters]), field)
    model = SensorModel(camera) if isinstance(camera, Sensor) else camera
    names = [p.name for p in model.parameters]
    matrix = finite("covariance", specified)
    if matrix.shape != (len(names), len(names)):
        raise InvalidParameter(
            f"covariance must have the shape {len(names), len(names)} for the parameters "
            f"{', '.join(names)}; got {matrix.shape}"
        )
    return UncertainModel(model, matrix, field)
