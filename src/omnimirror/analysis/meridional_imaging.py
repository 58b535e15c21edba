"""Meridional imaging: image size and aspect ratio (Eqs. 9-13), virtual images (Eqs. 14-21), and
viewpoints (Eqs. 6 and 23).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import image_radius, number, row
from ..base.errors import InvalidParameter
from ..base.results import FieldResult, Fields, column_fields
from ..base.typing import Array
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.meridian import ChiefRays

# -- Image of an object of 1 deg x 1 deg (Eqs. 9-13) -----------------------------------------------


class ImagingCharacteristics(NamedTuple):
    """Image of an object of 1 deg x 1 deg at n field angles; each array (n,)."""

    height: Array
    """Radial extent Dh, px per deg (Eq. 9)."""
    width: Array
    """Azimuthal extent Dw, px per deg (Eq. 10)."""
    area: Array
    """Area Ds = Dh Dw, px^2 per square degree (Eq. 11; erratum 5)."""
    aspect: Array
    """Aspect ratio Dw / Dh (Eq. 12)."""


def imaging_characteristics(
    omega: Array,
    h_px: Array,
    dh_domega_px: Array,
    parallax_t: Array | float = 1.0,
    parallax_s: Array | float = 1.0,
) -> ImagingCharacteristics:
    """Compute image-forming characteristics from the mapping.

    Parameters
    ----------
    omega : (n,) radians
    h_px : (n,) px
        Image height.
    dh_domega_px : (n,) px per radian
    parallax_t, parallax_s : (n,)
        Image motion of a finite object relative to a distant one, seen from the mirror point at its
        distance p: perpendicular to the ray ``1 + cos(gamma)/(cos(beta) p dOmega/dx)``, around the
        axis ``1 + x/(p sin(Omega))``.

    Notes
    -----
    On the axis of a smooth mirror, ``h / sin(Omega)`` is 0/0 and tends to ``dh/dOmega``: aspect 1.

    Examples
    --------
    The mapping h = 100 tan(Omega/2) is conformal, with an aspect of 1 at all field angles:

    >>> omega = np.radians([0.0, 90.0, 120.0])
    >>> c = imaging_characteristics(omega, 100 * np.tan(omega / 2), 50 / np.cos(omega / 2) ** 2)
    >>> c.aspect.round(12)
    array([1., 1., 1.])
    """
    degree = np.pi / 180
    height = dh_domega_px * degree
    with np.errstate(divide="ignore", invalid="ignore"):
        # Dh = dh/dOmega (Eq. 9). One degree perpendicular to the meridian subtends the azimuth
        # 1 deg / sin(Omega), which is an arc of h / sin(Omega) per radian in the image (Eq. 10).
        width = np.where(omega == 0.0, height, h_px * degree / np.sin(omega)) / parallax_s
        height = height / parallax_t
        return ImagingCharacteristics(height, width, height * width, width / height)


# -- Tangential and sagittal virtual images behind the mirror (Eqs. 14-21) -------------------------


class VirtualImages(NamedTuple):
    """Virtual images of an object point in a mirror; each array (n,), mm.

    ``q`` is measured from the mirror point along the chief ray, positive behind the mirror. (x, z)
    is the image position in the meridional plane, z from the vertex.
    """

    q_t: Array
    q_s: Array
    x_t: Array
    z_t: Array
    x_s: Array
    z_s: Array
    object_distance: Array = np.array(np.inf)
    """Distance p of the objects from the mirror points, () or (n,), mm."""


def virtual_images(rays: ChiefRays, object_distance: ArrayLike = np.inf) -> VirtualImages:
    """Compute tangential and sagittal images of objects at a distance p (mm).

    ``-1/p + 1/q_t = 2/(R_t cos gamma)`` and ``-1/p + 1/q_s = 2 cos gamma / R_s`` (Eqs. 15, 19).
    With a cover, p is measured along the chief ray, and each side of the cover refracts the
    wavefront first (Coddington).

    Raises
    ------
    InvalidParameter
        If the distance is not positive, or inside a cover; infinity is permitted.

    Examples
    --------
    On the axis of a sphere of radius 50 mm, the image distance of distant objects is half the
    radius:

    >>> from omnimirror.optics.mirrors import Sphere
    >>> from omnimirror.optics.tracing.meridian import trace_chief_rays
    >>> rays = trace_chief_rays(Sphere(50.0, 44.0), 180.0, [0.0])
    >>> virtual_images(rays).q_t
    array([25.])
    """
    p = np.asarray(object_distance, dtype=float)
    if not np.all(p > 0):
        bad = np.atleast_1d(p)[np.atleast_1d(~(p > 0))][0]
        raise InvalidParameter(f"object_distance_mm must be greater than 0, or inf; got {bad:g}")
    images = _images(
        rays, *((p, p) if rays.outside is None else rays.outside.apparent_distances(p))
    )
    return images._replace(object_distance=p)


def distances_from_lens(rays: ChiefRays, images: VirtualImages) -> tuple[Array, Array]:
    """Return axial image distances L_t and L_s (n,), mm, from the lens (Eqs. 34, 35).

    With a second mirror, the images in the first are its objects, at ``q + |P1 P2|`` along the
    chief rays, and the same equations apply again.
    """
    if rays.secondary_rays is not None:
        images = _images(rays.secondary_rays, images.q_t + rays.path, images.q_s + rays.path)
    lens = 0.0 if np.isinf(rays.first.m) else rays.first.m
    return lens + images.z_t, lens + images.z_s


def _images(rays: ChiefRays, p_t: Array, p_s: Array) -> VirtualImages:
    """Return images of tangential and sagittal objects; distances may be negative."""
    # Coddington equations (Eqs. 15, 19), solved for q.
    cos_gamma = np.cos(rays.gamma)
    with np.errstate(divide="ignore"):
        q_t = 1 / (2 / (rays.radius_t() * cos_gamma) + 1 / p_t)
        q_s = 1 / (2 * cos_gamma / rays.radius_s() + 1 / p_s)
    sin, cos = np.sin(rays.theta), np.cos(rays.theta)
    return VirtualImages(
        q_t,
        q_s,
        rays.x + _finite_product(q_t, sin),
        rays.z + q_t * cos,
        rays.x + _finite_product(q_s, sin),
        rays.z + q_s * cos,
    )


def _finite_product(q: Array, s: Array) -> Array:
    """Return q s, and 0 for an infinite image exactly on the axis."""
    with np.errstate(invalid="ignore"):
        return np.where(s == 0.0, 0.0, q * s)


# -- Viewpoints, and the error of the single-viewpoint approximation (Eqs. 6 and 23) ---------------


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
class SingleViewpoint(FieldResult):
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

    def _fields(self) -> Fields:
        names = ("z_mm", "worst_px", "worst_deg")
        return column_fields(self._table(), {name: getattr(self, name) for name in names})


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
