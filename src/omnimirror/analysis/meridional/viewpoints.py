"""Viewpoints, and the error of assuming a single one (Eqs. 6 and 23)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import image_radius, number, row
from ...optics.sensor import Sensor, check_sensor
from ...optics.tracing.meridian import ChiefRays

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
    x, z = rays.start
    to_axis = np.hypot(x, viewpoint_z(rays) - z)  # x / sin(Omega), without its 0/0
    d = np.asarray(distance, dtype=float)
    if rays.outside is not None:
        d = rays.outside.from_start(d)
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
    """Signed error (n,) in the image: how much farther out an object really is than it is looked for."""
    error_deg: Array
    """Signed error (n,) in angle."""


def best_viewpoint(
    sensor: Sensor,
    object_distance_mm: float,
    *,
    omega_deg: ArrayLike | None = None,
    image_radius_px: float | None = None,
    linearised: bool = False,
) -> SingleViewpoint:
    """The viewpoint whose largest error in pixels is least, over the field or the angles given.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives.
    object_distance_mm
        Distance from the reflection point to the object (the paper's n M), finite.
    omega_deg : (n,), optional
        Field angles; 1001 over the whole field by default.
    image_radius_px
        Scales the image so that the rim has this radius, as the paper does with 500.
    linearised
        Whether to take the error for its angle (Eq. 23) times dh/dOmega, as the paper does. Without it the error
        is the distance in the image of where the object is and where a distant one would be that lies in the same
        direction from the viewpoint; beyond the ends of the field the image goes on as steeply as it ends.

    Returns
    -------
    SingleViewpoint
        Its height over the mirror vertex in mm, and the worst error that assuming it makes, in px and deg.

    Raises
    ------
    InvalidParameter
        Numbers that are not valid.
    OutsideField
        A field angle that is not seen.

    Notes
    -----
    Every error grows with the height of the viewpoint, so at the best one the largest error outwards is as large as
    the largest inwards.

    Examples
    --------
    The paper's "+-1 pixel at 40 M", and as it would reckon:

    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> sphere = load_sensor("paper-spherical")
    >>> best = best_viewpoint(sphere, 40 * 43.9, image_radius_px=500)
    >>> round(best.worst_px, 3), round(best.z_mm / 43.9, 4)
    (0.917, 0.2525)
    >>> round(best_viewpoint(sphere, 40 * 43.9, image_radius_px=500, linearised=True).worst_px, 3)
    0.91
    """
    check_sensor(sensor)
    distance = number("object_distance_mm", object_distance_mm, above=0.0, unit="mm")
    omega = np.linspace(*sensor.field_deg, 1001) if omega_deg is None else row("omega_deg", omega_deg)
    scale = 1.0
    if image_radius_px is not None:
        scale = image_radius(image_radius_px) / sensor.rim_radius_px
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    in_picture = _linearised(sensor, rays) if linearised else _displacement(sensor, rays)

    def error_px(v0: float) -> Array:
        return scale * in_picture(viewpoint_angle_error(rays, v0, distance))

    def outwards_less_inwards(v0: float) -> float:
        error = error_px(v0)
        return float(error.max() + error.min())

    z = viewpoint_z(rays)
    low, high = float(z.min()), float(z.max())
    v0 = low
    if outwards_less_inwards(low) < 0 < outwards_less_inwards(high):
        from scipy.optimize import brentq

        v0 = float(brentq(outwards_less_inwards, low, high, xtol=1e-12 * (high - low), rtol=1e-14))
    error, degrees = error_px(v0), np.degrees(viewpoint_angle_error(rays, v0, distance))
    return SingleViewpoint(v0, float(np.abs(error).max()), float(np.abs(degrees).max()), omega, error, degrees)


def _linearised(sensor: Sensor, rays: ChiefRays) -> Callable[[Array], Array]:
    """Errors (n,) px of errors in angle (n,), radians, by dh/dOmega."""
    rate = sensor.image_height_rate_px(rays)
    return lambda angle: angle * rate


def _displacement(sensor: Sensor, rays: ChiefRays) -> Callable[[Array], Array]:
    """Errors (n,) px of errors in angle (n,), radians: from where distant objects of the apparent angle are."""
    meridian = sensor.meridian
    first, last = meridian.omega_min, meridian.omega_max
    ends = sensor.image_height_rate_px(meridian.trace(meridian.x_from_omega(np.array([first, last]))))
    ends = np.where(np.isfinite(ends), ends, 0.0)  # a mapping that starts square starts nowhere else
    h = sensor.image_height_px(rays)

    def of(angle: Array) -> Array:
        apparent = rays.omega - angle
        inside = np.clip(apparent, first, last)
        there = sensor.image_height_px(meridian.trace(meridian.x_from_omega(inside)))
        past = np.where(apparent < first, ends[0], ends[1]) * (apparent - inside)
        error: Array = h - there - past
        return error

    return of
