"""Viewpoints, and the error of the single-viewpoint approximation (Eqs. 6 and 23)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import image_radius, number, row
from ..base.results import Result
from ..base.typing import Array
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.meridian import ChiefRays


def viewpoint_z(rays: ChiefRays) -> Array:
    """Return the height z_v (mm from the vertex, (n,)) of the intersection of each chief ray's
    object side with the axis (Eq. 6).
    """
    return rays.z + rays.viewpoint_offset()


def viewpoint_angle_error(rays: ChiefRays, viewpoint: float, distance: ArrayLike) -> Array:
    """Return the angular error (radians, (n,)) of a single-viewpoint model (Eq. 23).

    Parameters
    ----------
    viewpoint : mm
        Height V0 of the assumed viewpoint above the vertex.
    distance : mm
        Object distance from the reflection point; the error vanishes for distant objects.

    Notes
    -----
    ``tan eps = v sin(Omega) / (n + x/sin(Omega) + v cos(Omega))``, ``v = V0 - z_v``: from V0, the
    object at the field angle Omega has the apparent angle ``Omega - eps``.
    """
    # Triangle of the object, V0 and the viewpoint z_v on the axis (Eq. 23): the ray from z_v to the
    # object has the length d + x/sin(Omega).
    v = viewpoint - viewpoint_z(rays)
    x, z = rays.start
    to_axis = np.hypot(x, viewpoint_z(rays) - z)  # x / sin(Omega), without the singularity 0/0
    d = np.asarray(distance, dtype=float)
    if rays.outside is not None:
        d = rays.outside.from_start(d)
    with np.errstate(invalid="ignore"):
        error = np.arctan2(v * np.sin(rays.omega), d + to_axis + v * np.cos(rays.omega))
    return np.where(np.isinf(d), 0.0, error)


@dataclass(frozen=True)
class SingleViewpoint(Result):
    """Best single viewpoint for one object distance, and its error."""

    z_mm: float
    """Height V0 above the mirror vertex."""
    worst_px: float
    """Largest image error, px."""
    worst_deg: float
    """Largest angular error."""
    omega_deg: Array
    """Evaluated field angles (n,)."""
    error_px: Array
    """Signed image error (n,): radial position of an object relative to its predicted position."""
    error_deg: Array
    """Signed angular error (n,)."""


def best_viewpoint(
    sensor: Sensor,
    object_distance_mm: float,
    *,
    omega_deg: ArrayLike | None = None,
    image_radius_px: float | None = None,
    linearised: bool = False,
) -> SingleViewpoint:
    """Compute the viewpoint with the minimum of the largest error in pixels.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    object_distance_mm
        Object distance from the reflection point (n M in the paper), finite.
    omega_deg : (n,), optional
        Field angles; by default 1001 over the whole field.
    image_radius_px
        Radius of the rim image to which the image is scaled, 500 in the paper.
    linearised
        Use the angular error (Eq. 23) times dh/dOmega, as in the paper. Otherwise the error is the
        image distance between an object and a distant object in the same direction from the
        viewpoint; beyond the ends of the field the mapping is extrapolated linearly.

    Returns
    -------
    SingleViewpoint
        Height above the mirror vertex in mm, and the largest resulting error in px and deg.

    Raises
    ------
    InvalidParameter
        If the numbers are invalid.
    OutsideField
        If the field angle is outside the field of view.

    Notes
    -----
    All errors increase with the height of the viewpoint; therefore the largest outward and the
    largest inward error of the best viewpoint are equal.

    Examples
    --------
    Error of "+-1 pixel at 40 M" in the paper, exact and linearised:

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
    omega = (
        np.linspace(*sensor.field_deg, 1001) if omega_deg is None else row("omega_deg", omega_deg)
    )
    scale = 1.0
    if image_radius_px is not None:
        scale = image_radius(image_radius_px) / sensor.rim_radius_px
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    image_error = _linearised(sensor, rays) if linearised else _displacement(sensor, rays)

    def error_px(v0: float) -> Array:
        return scale * image_error(viewpoint_angle_error(rays, v0, distance))

    def imbalance(v0: float) -> float:
        error = error_px(v0)
        return float(error.max() + error.min())

    z = viewpoint_z(rays)
    low, high = float(z.min()), float(z.max())
    v0 = low
    if imbalance(low) < 0 < imbalance(high):
        from scipy.optimize import brentq

        v0 = float(brentq(imbalance, low, high, xtol=1e-12 * (high - low), rtol=1e-14))
    error, degrees = error_px(v0), np.degrees(viewpoint_angle_error(rays, v0, distance))
    return SingleViewpoint(
        v0, float(np.abs(error).max()), float(np.abs(degrees).max()), omega, error, degrees
    )


def _linearised(sensor: Sensor, rays: ChiefRays) -> Callable[[Array], Array]:
    """Return a function from angular errors (n,), radians, to image errors (n,) px by dh/dOmega."""
    rate = sensor.image_height_rate_px(rays)
    return lambda angle: angle * rate


def _displacement(sensor: Sensor, rays: ChiefRays) -> Callable[[Array], Array]:
    """Return a function that converts angular errors (n,), radians, to image errors (n,) px,
    relative to distant objects at the apparent angles.
    """
    meridian = sensor.meridian
    first, last = meridian.omega_min, meridian.omega_max
    end_rates = sensor.image_height_rate_px(
        meridian.trace(meridian.x_from_omega(np.array([first, last])))
    )
    end_rates = np.where(
        np.isfinite(end_rates), end_rates, 0.0
    )  # a mapping with a singular start is not extrapolated
    h = sensor.image_height_px(rays)

    def image_error(angle: Array) -> Array:
        apparent = rays.omega - angle
        inside = np.clip(apparent, first, last)
        there = sensor.image_height_px(meridian.trace(meridian.x_from_omega(inside)))
        extrapolated = np.where(apparent < first, end_rates[0], end_rates[1]) * (apparent - inside)
        error: Array = h - there - extrapolated
        return error

    return image_error
