"""Images of object points in the meridional plane: virtual images, viewpoints and best focus.

Image size and aspect ratio follow from Eqs. 9-13, virtual images from Eqs. 14-21 and viewpoints
from Eqs. 6 and 23. The imager captures the virtual images with a blur that depends on the focus.

Signed blur diameters are positive for images beyond the focus. In angle they are ``Delta_t / Dh``
and ``Delta_s / Dw`` (Eqs. 36, 37; Eq. 37 contains L_t instead of L_s, erratum 7).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import choice, distances, image_radius, number, row
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..base.optimisation import minimise_with_derivative
from ..base.results import FieldResult, Fields, Result, column_fields
from ..base.typing import Array
from ..optics.lenses import BLUR_MODES, BlurMode, Lens
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


# -- Through-focus blur and best focus -------------------------------------------------------------
#
# Signed blur diameters are positive for images beyond the focus. In angle they are ``Delta_t / Dh``
# and ``Delta_s / Dw`` (Eqs. 36, 37; Eq. 37 contains L_t instead of L_s, erratum 7).
#
# On the coordinate v of linear blur (1/L0; for a telecentric lens L0), a field angle with images at
# v_t and v_s has the blurs ``s w_t (v - v_t)`` and ``s w_s (v - v_s)``, where w is the magnification
# by lens distortion, and one degree of the object has the image size ``g Dh`` by ``g Dw``; s, g and
# the Airy disc depend on v alone. Therefore the square of each merit is a sum of a few functions of
# v, common to all field angles, with focus-independent coefficients.


@dataclass(frozen=True)
class FocusedBlur:
    """Blur at n field angles for one focus.

    Attributes
    ----------
    t_px, s_px : (n,) px
        Signed tangential and sagittal blur diameters.
    imaging
        Image-forming characteristics for the conversion of pixels to degrees.
    omega : (n,) radians
    airy_px
        Diameter of the Airy disc.
    own_t_px, own_s_px : (n,) px
        Blur of the lens alone.
    """

    t_px: Array
    s_px: Array
    imaging: ImagingCharacteristics
    omega: Array
    airy_px: float
    own_t_px: Array | float = 0.0
    own_s_px: Array | float = 0.0

    @property
    def t_deg(self) -> Array:
        """Tangential blur (n,) in degrees of the object (Eq. 36)."""
        return self.t_px / self.imaging.height

    @property
    def s_deg(self) -> Array:
        """Sagittal blur (n,) in degrees of the object (Eq. 37)."""
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # a degree has no width at the tip of a cone
            return np.where(
                self.imaging.width == 0.0,
                np.copysign(np.inf, self.s_px),
                self.s_px / self.imaging.width,
            )

    def product(self) -> Array:
        """Return the blur area of the paper (n,), deg^2: signed product without pi/4 (Fig. 9c)."""
        with np.errstate(invalid="ignore"):
            area = self.t_deg * self.s_deg
        return np.where(self.imaging.width == 0.0, np.copysign(np.inf, self.t_px * self.s_px), area)

    def floored_area(self) -> Array:
        """Return the blur area (n,), deg^2, with pixel, Airy disc and lens blur in quadrature.

        In contrast to the product of the blurs, it does not vanish with one of its factors.
        """
        # Sum of squares per direction, px^2; division by Ds converts to square degrees (Eq. 11).
        floor = 1 + self.airy_px**2
        with np.errstate(divide="ignore", invalid="ignore"):
            t, s = self.t_px**2 + floor + self.own_t_px**2, self.s_px**2 + floor + self.own_s_px**2
            return np.sqrt(t * s) / self.imaging.area


# -- merits as functions of the focus --------------------------------------------------------------


class Sides(NamedTuple):
    """Focus-independent quantities of n field angles, with lengths along v in units of a range."""

    t: Array
    """Focus coordinates of the tangential images (n,)."""
    s: Array
    w_t: Array
    """Magnification of the tangential blur by distortion (n,)."""
    w_s: Array
    Dh: Array
    """Radial resolution (n,), px per deg, at the scale g = 1."""
    Dw: Array
    lens_blur2: tuple[Array, Array] | None = None
    """Squared lens blur (n,), (n,), px^2, nearly independent of the focus; None if ideal."""


class Scales(NamedTuple):
    """Focus-dependent quantities: numbers, or arrays for m focus values."""

    u: Any
    """Focus coordinate."""
    s: Any
    """Blur, px, per unit of defocus."""
    g: Any
    """Image scale."""
    floor: Any
    """Sum of the squares of pixel and Airy disc, px^2."""
    has_lens_blur: bool = False
    """True if the lens itself blurs the image, in addition to defocus."""


@dataclass(frozen=True)
class FocusMerit:
    """Merit that a best focus can minimise over the field."""

    size: Callable[[FocusedBlur], Array]
    """Function that returns the local merit at each field angle (n,)."""
    coefficients: Callable[[Sides], Array]
    """Function that returns the coefficients (terms, k) of its square; k is n or 2 n."""
    functions: Callable[[Scales], list[Any]]
    """Function that returns the corresponding functions of the focus."""
    is_mean: bool = False
    """True for the mean over the solid angle instead of the maximum."""

    def value(self, blur: FocusedBlur) -> float:
        """Return the merit of n field angles."""
        size = self.size(blur)
        return float(size @ solid_angle_weights(blur.omega)) if self.is_mean else float(size.max())


def _square(coordinate: Array, weight: Array) -> Array:
    """Return the coefficients (3, n) of ``weight^2 (u - coordinate)^2`` for u^2, u, 1."""
    return weight**2 * np.stack([np.ones_like(coordinate), -2 * coordinate, coordinate**2])


def _product(x: Array, y: Array) -> Array:
    """Return the coefficients (5, n) of the product of two quadratics (3, n)."""
    return np.stack(
        [
            x[0] * y[0],
            x[0] * y[1] + x[1] * y[0],
            x[0] * y[2] + x[1] * y[1] + x[2] * y[0],
            x[1] * y[2] + x[2] * y[1],
            x[2] * y[2],
        ]
    )


def _product_area(c: Sides) -> Array:
    return _product(_square(c.t, c.w_t / c.Dh), _square(c.s, c.w_s / c.Dw))


def _floored_area(c: Sides) -> Array:
    # A^2 = (T + F + own_t^2)(S + F + own_s^2)/(Dh Dw)^2 with squared blurs T, S and the floor F of pixel
    # and Airy disc: products of T, S, F and 1, sorted by their dependence on the focus
    t, s = _square(c.t, c.w_t), _square(c.s, c.w_s)
    ones = np.ones((1, len(c.t)))
    terms = [t + s, ones]
    if c.lens_blur2 is not None:
        lens_t, lens_s = c.lens_blur2
        terms += [t * lens_s + s * lens_t, ones * (lens_t + lens_s), ones * lens_t * lens_s]
    return np.concatenate([_product_area(c), np.concatenate(terms) / (c.Dh * c.Dw) ** 2])


def _powers(scale: Any, u: Any, degree: int) -> list[Any]:
    powers = [scale]
    for _ in range(degree):
        powers.append(powers[-1] * u)
    return powers[::-1]


def _floored_functions(f: Scales) -> list[Any]:
    s, g = f.s * f.s, f.g * f.g
    s, floor = s / g, f.floor / g
    functions = [*_powers(s * s, f.u, 4), *_powers(s * floor, f.u, 2), floor * floor]
    return (
        [*functions, *_powers(s / g, f.u, 2), floor / g, 1 / (g * g)]
        if f.has_lens_blur
        else functions
    )


def _degrees(f: Scales) -> list[Any]:
    s = f.s / f.g
    return _powers(s * s, f.u, 2)


FOCUS_MERITS: dict[str, FocusMerit] = {
    "worst_floored_area_deg2": FocusMerit(
        FocusedBlur.floored_area, _floored_area, _floored_functions
    ),
    "mean_floored_area_deg2": FocusMerit(
        FocusedBlur.floored_area, _floored_area, _floored_functions, is_mean=True
    ),
    "worst_blur_area_deg2": FocusMerit(  # merit of the paper
        lambda b: np.abs(b.product()),
        _product_area,
        lambda f: _powers((f.s * f.s / (f.g * f.g)) ** 2, f.u, 4),
    ),
    "worst_blur_px": FocusMerit(
        lambda b: np.maximum(np.abs(b.t_px), np.abs(b.s_px)),
        lambda c: np.concatenate([_square(c.t, c.w_t), _square(c.s, c.w_s)], axis=1),
        lambda f: _powers(f.s * f.s, f.u, 2),
    ),
    "worst_blur_deg": FocusMerit(
        lambda b: np.maximum(np.abs(b.t_deg), np.abs(b.s_deg)),
        lambda c: np.concatenate([_square(c.t, c.w_t / c.Dh), _square(c.s, c.w_s / c.Dw)], axis=1),
        _degrees,
    ),
    "worst_blur_rss_deg": FocusMerit(
        lambda b: np.hypot(b.t_deg, b.s_deg),
        lambda c: _square(c.t, c.w_t / c.Dh) + _square(c.s, c.w_s / c.Dw),
        _degrees,
    ),
}
"""Focus merits by name."""

MAX_SINGLE_THREAD_PRODUCTS = 150_000  # multiplications, below the threshold for BLAS threads
IMAGINARY_STEP = 1e-100  # imaginary step, without cancellation error


@dataclass(frozen=True)
class FocusFunction:
    """Merit of n field angles as a function of the focus."""

    merit: FocusMerit
    sides: Sides
    omega: Array
    scales: Callable[[Any], Scales]
    """Focus-dependent quantities at focus coordinates u."""

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients (terms, k)."""
        with np.errstate(divide="ignore", invalid="ignore"):  # at the tip of a cone
            return self.merit.coefficients(self.sides)

    @cached_property
    def _weights(self) -> Array:
        return solid_angle_weights(self.omega)

    def __call__(self, u: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return the merit (squared for a maximum), its derivative and the worst angle; (m,)."""
        moved = self._functions(u + 1j * IMAGINARY_STEP)
        functions, rates = moved.real.T.copy(), moved.imag.T / IMAGINARY_STEP
        squares = self._squares(functions)
        if self.merit.is_mean:
            roots = np.sqrt(squares)
            slope = (
                _matrix_product(
                    _matrix_product(rates, self.coefficients) / roots, self._weights[:, None]
                )[:, 0]
                / 2
            )
            return (
                _matrix_product(roots, self._weights[:, None])[:, 0],
                slope,
                np.zeros(len(u), dtype=np.intp),
            )
        max_index = squares.argmax(axis=1)
        slope = np.einsum("mt,tm->m", rates, self.coefficients[:, max_index])
        return squares[np.arange(len(u)), max_index], slope, max_index

    def _squares(self, functions: Array) -> Array:
        """Return the squares at all angles, (m, k), in blocks too small for BLAS threads."""
        squares = np.empty((len(functions), self.coefficients.shape[1]))
        block = max(1, MAX_SINGLE_THREAD_PRODUCTS // self.coefficients.size)
        for i in range(0, len(functions), block):
            np.matmul(functions[i : i + block], self.coefficients, out=squares[i : i + block])
        return squares

    def _functions(self, u: NDArray[Any]) -> NDArray[Any]:
        """Return the functions of the coefficients, (terms, m), with scalars for one focus."""
        focus: Any = complex(u[0]) if len(u) == 1 else u
        functions = [f + 0 * focus for f in self.merit.functions(self.scales(focus))]
        return np.array(functions).reshape(-1, len(u))


def _matrix_product(a: Array, b: Array) -> Array:
    """Return the product of two small matrices without starting BLAS threads."""
    product: Array = np.einsum("mt,tk->mk", a, b)
    return product


def solid_angle_weights(omega: Array) -> Array:
    """Return normalised weights (n,) of a mean over the solid angle at field angles (n,).

    Linear interpolation in the angle is assumed between neighbours; equal angles share their
    weight.

    >>> omega = np.sort(np.random.default_rng(1).uniform(0, 2, 200))
    >>> omega[[0, -1]] = 0, 2
    >>> exact = (4 * np.sin(2) - 2 * np.cos(2) - 2) / (1 - np.cos(2))  # mean of omega^2
    >>> bool(abs(solid_angle_weights(omega) @ omega**2 / exact - 1) < 1e-3)
    True
    """
    angles, inverse, count = np.unique(omega, return_inverse=True, return_counts=True)
    if len(angles) == 1:
        return np.full(len(omega), 1 / len(omega))
    a, b = angles[:-1], angles[1:]
    step = b - a
    # integrals of sin(omega) (omega - a)/step and of sin(omega) (b - omega)/step over each step
    midpoint, half = (a + b) / 2, step / 2
    even = np.sin(midpoint) * np.sin(half)
    odd = np.cos(midpoint) * (np.sin(half) / half - np.cos(half))
    weights = np.zeros(len(angles))
    weights[1:] += even + odd
    weights[:-1] += even - odd
    weights /= weights.sum()
    mean: Array = (weights / count)[inverse]
    return mean


# -- Through-focus blur and best focus -------------------------------------------------------------

POINTED_CENTRE = 0.1  # relative to the image radius


@dataclass(frozen=True)
class FocusStudy:
    """Focus-independent quantities at n field angles."""

    sensor: Sensor
    rays: ChiefRays
    images: VirtualImages
    mode: BlurMode
    image_radius_px: float | None
    wavelength_nm: float

    def __post_init__(self) -> None:
        choice("mode", self.mode, BLUR_MODES)
        if self.image_radius_px is not None:
            image_radius(self.image_radius_px)

    @cached_property
    def distances(self) -> tuple[Array, Array]:
        """L_t and L_s (n,), mm: image distances from the lens (Eqs. 34, 35)."""
        L_t, L_s = distances_from_lens(self.rays, self.images)
        displaced = self.sensor.mirror_pose.displacement_mm if self.sensor.lens.TELECENTRIC else 0.0
        return L_t + displaced, L_s + displaced  # already included in m for a perspective lens

    def heights(self, sensor: Sensor) -> tuple[Array, Array]:
        """Return h (px) and dh/dOmega (px per radian), (n,), of a focused sensor."""
        scale = 1.0 if self.image_radius_px is None else self.image_radius_px / sensor.rim_radius_px
        return sensor.image_height_px(self.rays) * scale, sensor.image_height_rate_px(
            self.rays
        ) * scale

    def imaging(self, sensor: Sensor) -> ImagingCharacteristics:
        """Return the image (n,) of one object degree, seen from the mirror points."""
        return imaging_characteristics(self.rays.omega, *self.heights(sensor), *self._parallax)

    @cached_property
    def _parallax(self) -> tuple[Array, Array]:
        """Image motion (n,), (n,) of a finite object relative to a distant one.

        At a distance D from the start of the ray, ``spread + D Omega'`` and ``x + D sin(Omega)``
        per motion of the mirror point and per radian of azimuth, both divided by the distance p
        from the mirror point.
        """
        rays, p = self.rays, self.images.object_distance
        inverse_distance = 1 / p
        offset = 0.0 if rays.outside is None else rays.outside.reach - rays.outside.inside
        further = 1 + inverse_distance * offset
        with np.errstate(divide="ignore", invalid="ignore"):
            t = further + inverse_distance * rays.spread() / rays.domega_dx()
            s = further + inverse_distance * rays.start[0] / np.sin(rays.omega)
        return t, np.where(rays.omega == 0.0, t, s)

    def ideal_height(self, lens: Lens) -> Array:
        """Return image heights (n,) mm for a lens without distortion."""
        return lens.ideal_height(self.rays.first.x, self.rays.first.w)

    def stretch(self, lens: Lens) -> tuple[Array, Array]:
        """Return the off-axis magnification (n,), (n,) of the blur by a focused lens, nearly
        independent of the focus.
        """
        return lens.blur_stretch(self.ideal_height(lens))

    def lens_blur_px(self, lens: Lens) -> tuple[Array, Array]:
        """Return the blur (n,), (n,) px of the lens alone."""
        pitch = self.sensor.imager.pitch_mm
        t, s = lens.own_blur(self.ideal_height(lens))
        return t / pitch, s / pitch

    def coordinates(self, lens: Lens) -> tuple[Array, Array]:
        """Return the focus coordinates (n,), (n,) of the images."""
        return lens.image_coordinates(*self.distances, self.ideal_height(lens))

    @cached_property
    def current_coordinates(self) -> Array:
        """Focus coordinates (2, n) of the images for the lens at its current focus."""
        return np.stack(self.coordinates(self.sensor.lens))

    def scales(self, centre: float, unit: float) -> Callable[[Any], Scales]:
        """Return the focus-dependent quantities as a function of normalised focus coordinates u."""
        lens, pitch = self.sensor.lens, self.sensor.imager.pitch_mm
        current = lens.through_focus(lens.focus_coordinate(lens.focus_distance_mm))
        airy2 = (lens.airy_diameter(self.wavelength_nm) / pitch / current.f_number) ** 2

        def scales_at(u: Any) -> Scales:
            focused = lens.through_focus(centre + unit * u, self.mode)
            scale = (
                focused.image_scale / current.image_scale if self.image_radius_px is None else 1.0
            )
            floor = 1 + airy2 * focused.f_number**2
            return Scales(u, focused.blur_rate * (unit / pitch), scale, floor, not lens.IS_THIN)

        return scales_at

    def at(self, focus_mm: float) -> FocusedBlur:
        """Return the blur with the lens focused at an object distance in mm."""
        sensor = self.sensor
        if focus_mm != sensor.lens.focus_distance_mm:
            sensor = sensor.with_lens(sensor.lens.focused_at(focus_mm))
        pitch = sensor.imager.pitch_mm
        lens = sensor.lens
        focused = lens.focus_coordinate(focus_mm)
        rate = lens.through_focus(focused, self.mode).blur_rate / pitch
        t, s = (
            w * rate * (focused - v)
            for w, v in zip(self.stretch(lens), self.coordinates(lens), strict=True)
        )
        imaging, airy = self.imaging(sensor), lens.airy_diameter(self.wavelength_nm) / pitch
        return FocusedBlur(t, s, imaging, self.rays.omega, airy, *self.lens_blur_px(lens))


@dataclass(frozen=True)
class BestFocus(Result):
    """Optimal focus and value of the merit."""

    focus_mm: float
    value: float
    merit: str


def best_focus(
    sensor: Sensor,
    merit: str = "worst_floored_area_deg2",
    *,
    omega_deg: ArrayLike | None = None,
    object_distance_mm: ArrayLike = np.inf,
    mode: BlurMode = "exact",
    image_radius_px: float | None = None,
    wavelength_nm: float = 550.0,
) -> BestFocus:
    """Compute the focus distance L0 of minimum merit, over the whole field or given angles.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    merit
        Name of a merit in :data:`FOCUS_MERITS`.
    omega_deg : (n,), optional
        Field angles in any order and spacing; by default 1001 over the whole field. For a pointed
        mirror, the central 10 % of the image radius are excluded because the azimuthal image scale
        vanishes there.
    object_distance_mm : scalar or (n,)
        Distance from the reflection point to the object.
    mode, image_radius_px
        ``"paper"`` and 500 reproduce the method of the paper.
    wavelength_nm
        Wavelength of the Airy disc, nm.

    Returns
    -------
    BestFocus
        Focus L0 in mm, and the merit at this focus.

    Raises
    ------
    InvalidParameter
        If merit or mode are unknown, numbers invalid, or the mirror has no virtual images.
    OutsideField
        If the field angle is outside the field of view.

    Examples
    --------
    Focus of the spherical mirror in the paper, L0 = 212 mm:

    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> best = best_focus(load_sensor("paper-spherical"), "worst_blur_area_deg2", mode="paper", image_radius_px=500)
    >>> round(best.focus_mm, 1), round(best.value, 4)
    (212.4, 0.0751)
    """
    check_sensor(sensor)
    choice("merit", merit, FOCUS_MERITS)
    omega = _focusable(sensor) if omega_deg is None else row("omega_deg", omega_deg)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    p = distance_per_angle(object_distance_mm, rays.x)
    study = FocusStudy(sensor, rays, virtual_images(rays, p), mode, image_radius_px, wavelength_nm)
    focus = _best_focus_mm(study, FOCUS_MERITS[merit])
    return BestFocus(focus, FOCUS_MERITS[merit].value(study.at(focus)), merit)


def distance_per_angle(object_distance_mm: ArrayLike, angles: Array) -> Array:
    """Return object distances as an array, one for all field angles or one for each (n,)."""
    p = distances("object_distance_mm", object_distance_mm)
    if p.shape not in ((), (1,), angles.shape):
        raise InvalidParameter(
            f"object_distance_mm must have one value, or one for each of the {angles.size} "
            f"field angles; got {p.size}"
        )
    return p


def _best_focus_mm(study: FocusStudy, merit: FocusMerit) -> float:
    """Return the focus (mm) of minimum merit."""
    lens = study.sensor.lens
    low, high = _search_range(lens, study.current_coordinates)
    centre, half = (low + high) / 2, (high - low) / 2 or 1.0
    function = focus_function(study, merit, centre, half)
    if not np.isfinite(function.coefficients).all():
        bad = int(np.argmin(np.isfinite(function.coefficients).all(axis=0))) % len(study.rays.omega)
        raise InvalidParameter(
            f"omega_deg = {np.degrees(study.rays.omega[bad]):.6g} has no finite blur at any "
            "focus (an object of 1 deg has no extent in the image there, or no image); "
            "remove this angle"
        )
    coordinate = centre + half * minimise_with_derivative(
        function, (low - centre) / half, (high - centre) / half
    )
    limits = lens.PARAMETERS["focus_distance_mm"]
    return float(
        np.clip(lens.distance_of(coordinate), max(limits.low, lens.nearest_focus_mm), limits.high)
    )


def focus_function(
    study: FocusStudy, merit: FocusMerit, centre: float, unit: float
) -> FocusFunction:
    """Return a merit as a function of normalised :meth:`Lens.focus_coordinate` values."""
    sensor = study.sensor
    imaging = study.imaging(sensor)
    t, s = (study.current_coordinates - centre) / unit
    lens_t, lens_s = study.lens_blur_px(sensor.lens)
    lens_blur2 = None if sensor.lens.IS_THIN else (lens_t**2, lens_s**2)
    sides = Sides(t, s, *study.stretch(sensor.lens), imaging.height, imaging.width, lens_blur2)
    return FocusFunction(merit, sides, study.rays.omega, study.scales(centre, unit))


def _search_range(lens: Lens, coordinates: Array) -> tuple[float, float]:
    """Return the search range of focus coordinates: those of all images, with a margin."""
    limits = lens.PARAMETERS["focus_distance_mm"]
    if lens.TELECENTRIC:
        return _focusable_interval(coordinates, limits.low, limits.high)
    # vergences keep the range bounded for distant images; converging images are beyond infinity
    far_coordinate, near_coordinate = lens.focus_coordinate(
        [limits.high, max(limits.low, lens.nearest_focus_mm)]
    )
    return _focusable_interval(
        np.maximum(coordinates, 0.0), float(far_coordinate), float(near_coordinate)
    )


def _focusable_interval(coordinates: Array, low: float, high: float) -> tuple[float, float]:
    """Return an interval of the focus coordinates of all focusable images, with a margin.

    Coordinates above the upper bound are excluded unless there are no others; those below the lower
    bound are clipped.
    """
    coordinates = coordinates[~np.isnan(coordinates)]
    if not coordinates.size:
        raise InvalidParameter("best focus requires virtual images; got none")
    within = coordinates[coordinates < high] if (coordinates < high).any() else coordinates
    within = np.clip(within, low, high)
    margin = 0.05 * (float(np.ptp(within)) or abs(float(within[0])))
    return max(float(within.min()) - margin, low), min(float(within.max()) + margin, high)


def _focusable(sensor: Sensor) -> Array:
    """Return the field angles (n,), deg, used for focusing."""
    low, high = sensor.field_deg
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(
            sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px])
        )
        low = float(np.degrees(edge.omega[0]))
    return np.linspace(low, high, 1001)
