"""Meridional imaging: image size and aspect ratio (Eqs. 9-13), virtual images (Eqs. 14-21)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import InvalidParameter
from ..base.typing import Array
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
