"""Viewpoints, and the error of assuming a single one (Eqs. 6 and 23)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..sensor import Sensor
from ..tracing.meridian import ChiefRays
from .minimise import lowest

Array = NDArray[np.float64]


def viewpoint_z(rays: ChiefRays) -> Array:
    """Height z_v (mm from the vertex, (n,)) at which each chief ray's object side meets the axis (Eq. 6)."""
    return rays.z + rays.viewpoint_offset()


def viewpoint_angle_error(rays: ChiefRays, viewpoint: float, distance: ArrayLike) -> Array:
    """Angle (radians, (n,)) by which objects seem displaced when all rays are taken from one viewpoint (Eq. 23).

    Parameters
    ----------
    viewpoint : mm
        Height V0 of the assumed viewpoint over the vertex.
    distance : mm
        Distance of the object from the reflection point; the error vanishes as it grows.

    Notes
    -----
    ``tan eps = v sin(Omega) / (n + x/sin(Omega) + v cos(Omega))``, ``v = V0 - z_v``: the object at field
    angle Omega seems to stand at ``Omega - eps`` as seen from V0.
    """
    v = viewpoint - viewpoint_z(rays)
    to_axis = np.hypot(rays.x, rays.viewpoint_offset())  # x / sin(Omega), without its 0/0
    d = np.asarray(distance, dtype=float)
    with np.errstate(invalid="ignore"):
        error = np.arctan2(v * np.sin(rays.omega), d + to_axis + v * np.cos(rays.omega))
    return np.where(np.isinf(d), 0.0, error)


class SingleViewpoint(NamedTuple):
    """The best single viewpoint for one object distance, and what it costs."""

    z_mm: float
    """Its height V0 over the mirror vertex."""
    worst_px: float
    """Largest error in the image, px."""
    worst_deg: float
    """Largest error in angle."""
    omega_deg: Array
    """Field angles (n,) examined."""
    error_px: Array
    """Signed error (n,) in the image."""
    error_deg: Array
    """Signed error (n,) in angle."""


def best_viewpoint(
    sensor: Sensor,
    object_distance_mm: float,
    omega_deg: ArrayLike | None = None,
    image_radius_px: float | None = None,
) -> SingleViewpoint:
    """The viewpoint whose largest error in pixels is least, over the field or the angles given.

    Parameters
    ----------
    object_distance_mm
        Distance from the reflection point to the object (the paper's n M), finite.
    omega_deg : (n,), optional
        Field angles; 1001 over the whole field by default.
    image_radius_px
        Scales the image so that the rim has this radius, as the paper does with 500.

    Examples
    --------
    The paper's "+-1 pixel at 40 M":

    >>> from omnimirror.specs import load_sensor
    >>> best = best_viewpoint(load_sensor("paper-spherical"), 40 * 43.9, image_radius_px=500)
    >>> round(best.worst_px, 2), round(best.z_mm / 43.9, 4)
    (0.91, 0.2541)
    """
    if not (np.isfinite(object_distance_mm) and object_distance_mm > 0):
        raise InvalidParameter(
            f"object_distance_mm = {object_distance_mm:g} has no best viewpoint; it is valid above 0 and finite"
        )
    omega = np.linspace(*sensor.field_deg, 1001) if omega_deg is None else np.asarray(omega_deg, dtype=float)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    scale = 1.0 if image_radius_px is None else image_radius_px / sensor.rim_radius_px
    px_per_radian = sensor.image_height_rate_px(rays) * scale

    def worst(v0: float) -> float:
        return float(np.abs(viewpoint_angle_error(rays, v0, object_distance_mm) * px_per_radian).max())

    z = viewpoint_z(rays)
    v0 = lowest(worst, float(z.min()), float(z.max()))
    error = viewpoint_angle_error(rays, v0, object_distance_mm)
    error_px, error_deg = error * px_per_radian, np.degrees(error)
    return SingleViewpoint(
        v0, float(np.abs(error_px).max()), float(np.abs(error_deg).max()), omega, error_px, error_deg
    )
