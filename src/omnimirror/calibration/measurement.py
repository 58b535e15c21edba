"""Angles between two image points, and distances on a floor or wall, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import finite, number, optional_number, validate_arguments
from ..base.errors import InvalidParameter
from ..base.parameters import Uncertainty
from ..base.results import Result
from ..base.typing import Array
from ..cameras.camera import Rays, perpendicular_axes, rotate_vectors, view_axes
from ..cameras.models.camera_model import (
    CameraModel,
    target_changes,
    within_field,
)
from ..optics.sensor import Sensor
from .uncertainty import MAX_FLOOR_DISTANCE, MAX_HEIGHT_MM, uncertain_model


@dataclass(frozen=True)
class Measurement(Result):
    """Angle between two image points, and their distance on a plane.

    Parameters
    ----------
    angle_deg
        Angle between the directions of the two points, deg.
    angle_sigma_deg
        Standard uncertainty of the angle, deg; None without calibration uncertainty, or outside the
        calibrated field.
    distance_mm
        Distance of the two points on the plane, mm; None without a plane.
    distance_sigma_mm
        Standard uncertainty of the distance, mm; None as for the angle.
    points_mm
        The two points (2, 3) in the world frame, mm; None without a plane.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> result = om.measure(sensor, [[711.5, 511.5], [511.5, 711.5]], height_mm=1500.0)
    >>> round(result.angle_deg, 2), round(result.distance_mm)
    (55.27, 1869)
    """

    angle_deg: float
    angle_sigma_deg: float | None
    distance_mm: float | None = None
    distance_sigma_mm: float | None = None
    points_mm: tuple[tuple[float, ...], ...] | None = None


@validate_arguments
def measure(
    camera: Sensor | CameraModel,
    pixels: ArrayLike,
    *,
    height_mm: float | None = None,
    wall_mm: float | None = None,
    wall_pan_deg: float = 0.0,
    plane_sigma_mm: float = 0.0,
    plane_sigma_deg: float = 0.0,
    pixel_sigma_px: float = 0.0,
    covariance: ArrayLike | Uncertainty | None = None,
    field_deg: float | None = None,
) -> Measurement:
    """Measure the angle between two pixels, and the distance of their points on a floor or wall.

    The orientation of the plane is relative to the mount of the camera: level the camera first. The
    contributions of calibration, plane and pixels are independent and propagated to first order.

    Parameters
    ----------
    camera
        Sensor or camera model; calibrated, if uncertainties are required.
    pixels : (2, 2)
        Pixels (u, v) of the two points, integers at their centres.
    height_mm : mm, optional
        Height of the world origin (for a sensor, the mirror vertex) above a horizontal floor;
        negative below a ceiling.
    wall_mm : mm, optional
        Distance of the world origin from a vertical wall.
    wall_pan_deg : deg
        Pan (to the right) of the point of the wall nearest to the camera.
    plane_sigma_mm : mm
        Standard uncertainty of ``height_mm`` or ``wall_mm``.
    plane_sigma_deg : deg
        Standard uncertainty of the orientation of the plane about each of two axes in it: of the
        level, and for a wall also of ``wall_pan_deg``.
    pixel_sigma_px : px
        Standard uncertainty of the pixels, per coordinate.
    covariance
        Covariance of the camera's parameters (n, n), in their order; by default that in its file.
    field_deg : deg, optional
        Maximum field angle from the viewing direction at the image centre for uncertainties; by
        default the calibrated field, if known.

    Returns
    -------
    Measurement
        Angle, distance and their standard uncertainties.

    Raises
    ------
    InvalidParameter
        If both planes are specified, a pixel is outside the field of view, or its ray does not
        reach the plane within 100 times the distance of the plane.

    Examples
    --------
    Length on the floor, with an uncertainty of the focal length of 0.1 %:

    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    >>> pixels = [[711.5, 511.5], [511.5, 711.5]]
    >>> result = om.measure(model, pixels, height_mm=1500.0, covariance=[[0.0116**2]])
    >>> print(f"{result.distance_mm:.0f} +- {result.distance_sigma_mm:.1f} mm")
    1869 +- 3.0 mm
    """
    points = finite("pixels", pixels)
    if points.shape != (2, 2):
        raise InvalidParameter(
            f"pixels must be two points (u, v), shape (2, 2); got shape {points.shape}"
        )
    plane = _plane(height_mm, wall_mm, wall_pan_deg)
    sigma_mm, sigma_deg, sigma_px = (
        number(name, value, low=0.0, high=high, unit=unit)
        for name, value, high, unit in (
            ("plane_sigma_mm", plane_sigma_mm, MAX_HEIGHT_MM, "mm"),
            ("plane_sigma_deg", plane_sigma_deg, 90.0, "deg"),
            ("pixel_sigma_px", pixel_sigma_px, 1e6, "px"),
        )
    )
    optional_number("field_deg", field_deg, above=0.0, high=180.0, unit="deg")
    is_calibrated = covariance is not None or camera.uncertainty is not None
    uncertain = uncertain_model(camera, covariance, field_deg) if is_calibrated else None
    rays = camera.backproject(points)
    for pixel, is_valid in zip(points, rays.valid, strict=True):
        if not is_valid:
            raise InvalidParameter(
                f"pixels must be inside the field of view; got ({pixel[0]:g}, {pixel[1]:g})"
            )
    world = camera.mount.rotation()
    to_camera = rotate_vectors(rays.directions, world)
    if uncertain and not within_field(uncertain.model, to_camera, uncertain.field_deg).all():
        uncertain = None

    def sigma(gradients: Array, targets: Array, axes: Array, *, distant: bool) -> float | None:
        """Return the uncertainty of a quantity with given gradients (2, 3) at the two targets."""
        if uncertain is None:
            return None
        model, matrix, _ = uncertain
        local = rotate_vectors(axes.transpose(0, 2, 1), world).transpose(0, 2, 1)
        changes = target_changes(model, rotate_vectors(targets, world), local, distant=distant)
        along = np.einsum("ni,nij->nj", gradients, axes)
        by_parameters, by_pixels = (np.einsum("nj,njp->np", along, change) for change in changes)
        total = by_parameters.sum(axis=0)  # both points share the errors of the parameters
        variance = total @ matrix @ total + sigma_px**2 * (by_pixels**2).sum()
        return float(np.sqrt(variance)) if np.isfinite(variance) else None

    first, second = rays.directions
    sine = np.linalg.norm(np.cross(first, second))
    angle = float(np.arctan2(sine, first @ second))
    # For unit vectors, d(angle) = -(t1 . d first + t2 . d second) with the unit tangents t towards
    # the other direction
    tangents = np.array([second - (first @ second) * first, first - (first @ second) * second])
    gradients = -tangents / max(sine, np.finfo(float).tiny)
    angle_sigma = sigma(
        gradients, rays.directions, perpendicular_axes(rays.directions), distant=True
    )
    result = Measurement(
        np.degrees(angle).item(), None if angle_sigma is None else np.degrees(angle_sigma).item()
    )
    if plane is None:
        return result
    targets = _intersections(rays, plane, points)
    between = targets[1] - targets[0]
    length = float(np.linalg.norm(between))
    unit = between / max(length, np.finfo(float).tiny)
    gradients = np.array([-unit, unit])
    axes = np.broadcast_to(plane.axes.T, (2, 3, 2))
    length_sigma = sigma(gradients, targets, axes, distant=False)
    if length_sigma is not None:
        # With P = o + L d and n . P = D: dL/dD = 1 / (n . d); a rotation dn = w x n of the plane
        # changes L by -(dn . P) / (n . d).
        along = (gradients * rays.directions).sum(axis=1) / (rays.directions @ plane.normal)
        by_distance = along.sum()
        by_rotation = along @ (targets @ plane.axes.T)
        length_sigma = float(
            np.sqrt(
                length_sigma**2
                + (sigma_mm * by_distance) ** 2
                + np.radians(sigma_deg) ** 2 * (by_rotation**2).sum()
            )
        )
    return Measurement(
        result.angle_deg,
        result.angle_sigma_deg,
        length,
        length_sigma,
        tuple(tuple(point) for point in targets.tolist()),
    )


class _Plane(NamedTuple):
    """Plane ``normal . P = distance_mm`` in the world frame, and two unit vectors (2, 3) in it."""

    normal: Array
    axes: Array
    distance_mm: float


def _plane(height_mm: float | None, wall_mm: float | None, wall_pan_deg: float) -> _Plane | None:
    """Return the specified floor, ceiling or wall; None without one."""
    pan = number("wall_pan_deg", wall_pan_deg, low=-360.0, high=360.0, unit="deg")
    if height_mm is not None and wall_mm is not None:
        raise InvalidParameter("height_mm and wall_mm must not be specified together")
    if height_mm is not None:
        height = number("height_mm", height_mm, low=-MAX_HEIGHT_MM, high=MAX_HEIGHT_MM, unit="mm")
        if height == 0:
            raise InvalidParameter(
                "height_mm must be above 0 mm for a floor or below 0 mm for a ceiling; got 0"
            )
        return _Plane(np.array([0.0, 0.0, -1.0]), np.eye(3)[:2], height)
    if wall_mm is None:
        return None
    wall = number("wall_mm", wall_mm, low=1e-6, high=MAX_HEIGHT_MM, unit="mm")
    forward, right, down = view_axes(pan, 0.0)
    return _Plane(forward, np.array([right, down]), wall)


def _intersections(rays: Rays, plane: _Plane, pixels: Array) -> Array:
    """Return the points (2, 3) of rays on a plane."""
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = (plane.distance_mm - rays.origins @ plane.normal) / (
            rays.directions @ plane.normal
        )
    limit = MAX_FLOOR_DISTANCE * abs(plane.distance_mm)
    for pixel, length in zip(pixels, lengths, strict=True):
        if not 0 < length < limit:
            raise InvalidParameter(
                f"the ray of pixel ({pixel[0]:g}, {pixel[1]:g}) must reach the plane within "
                f"{limit:g} mm, {MAX_FLOOR_DISTANCE:g} times its distance"
            )
    points: Array = rays.origins + lengths[:, None] * rays.directions
    return points
