"""Real lenses described by field functions, from a table or from traced surfaces."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import number
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.numerics import increasing_inverse
from ...base.typing import Array
from .lens import ChiefAim, EntrancePupil, GaussianLens

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


# -- Field functions of a lens ---------------------------------------------------------------------
#
# All are smooth functions of the tangent t of the viewing angle, odd or even about the axis: quintic
# splines with continuous fourth derivatives. Relative to the entrance pupil at a viewing angle, the
# rays of one image point pass a pupil point (y_t, y_s) with slopes ``t - y_t v_t`` and ``-y_s v_s``.
# The tangential and sagittal vergences in focus, v_t and v_s, differ from the axial one by field
# curvature and astigmatism.

DEGREE = 5
MIN_NODES = 4
MONOTONICITY_SAMPLES = 513  # points at which the image height is checked to be increasing
INVERSION_STEPS = 50
INVERSION_TOLERANCE = 1e-14


class FieldNodes(NamedTuple):
    """Lens properties at n field angles from the axis; in mm and 1/mm."""

    tangent: Array
    """(n,) tangents of the viewing angles, from 0."""
    height: Array
    """(n,) image heights."""
    pupil: Array
    """(n,) entrance-pupil positions, towards the mirror from the reference point."""
    vergence_t: Array
    """(n,) vergence in focus of the tangential fan, at the pupil, along the axis."""
    vergence_s: Array
    scale_t: Array
    """(n,) derivative of the image point with respect to the slope, through a fixed pupil point."""
    scale_s: Array
    width_t: Array
    """(n,) half width of the vignetted pupil in the meridian, relative to the axis."""
    width_s: Array
    shift_t: Array
    """(n,) offset of the vignetted pupil from the chief ray, over the axial radius."""
    illumination: Array
    """(n,) relative illumination of the imager."""
    own_t: Array
    """(n,) blur of the lens in its own focus, mm: four times the standard deviation of its rays."""
    own_s: Array
    short: Array
    """(n,) lateral colour: image height at the shortest minus the middle wavelength."""
    long: Array
    """(n,) lateral colour of the longest wavelength."""
    stop_t: Array
    """(n,) half width in the meridian of the unvignetted pupil, relative to the axis."""
    stop_s: Array
    stop_shift: Array
    """(n,) distance of its centre from the chief ray, relative to the axial radius."""
    unvignetted_fraction: Array
    """(n,) unvignetted fraction of its area."""


class LensValues(NamedTuple):
    """Even field functions at k tangents, (k,) each; names as in :class:`FieldNodes`."""

    pupil: Array
    vergence_t: Array
    vergence_s: Array
    scale_t: Array
    scale_s: Array
    width_t: Array
    width_s: Array
    illumination: Array
    own_t: Array
    own_s: Array
    stop_t: Array
    stop_s: Array
    unvignetted_fraction: Array


ODD = ("height", "shift_t", "short", "long", "stop_shift")


@dataclass(frozen=True)
class MovingPupil(EntrancePupil):
    """Entrance pupil that moves with the viewing angle; ``at_mm`` is its paraxial position."""

    tangents: tuple[float, ...] = ()
    positions_mm: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        return True

    @cached_property
    def _spline(self) -> tuple[BSpline, BSpline]:
        spline = even_spline(np.array(self.tangents), np.array(self.positions_mm)[:, None])
        return spline, spline.derivative()

    def position(self, tangent: Array) -> Array:
        return np.asarray(self._spline[0](self._inside(tangent))[..., 0])

    def _inside(self, tangent: Array) -> Array:
        return np.clip(tangent, -self.tangents[-1], self.tangents[-1])

    def aim(self, x: Array, depth: Array) -> ChiefAim:
        """Solve ``(depth - z(t)) t = x`` by Newton's method."""
        position, rate = self._spline
        tangent = x / (depth - self.at_mm)
        for _ in range(INVERSION_STEPS):
            t = self._inside(tangent)
            w, motion = depth - position(t)[..., 0], rate(t)[..., 0]
            step = (w * tangent - x) / (w - motion * tangent)
            tangent = tangent - step
            if not (np.abs(step) > INVERSION_TOLERANCE * (1 + np.abs(tangent))).any():
                break
        t = self._inside(tangent)
        return ChiefAim(depth - position(t)[..., 0], rate(t)[..., 0] * (1 + tangent**2))


def even_spline(tangent: Array, values: Array) -> BSpline:
    """Fit an even spline through values (n, m) at tangents (n,) from 0."""
    from scipy.interpolate import make_interp_spline

    both = np.concatenate([-tangent[:0:-1], tangent])
    return make_interp_spline(both, np.concatenate([values[:0:-1], values]), k=DEGREE)


def odd_spline(tangent: Array, values: Array) -> BSpline:
    """Fit an odd spline through values (n, m) at tangents (n,) from 0."""
    from scipy.interpolate import make_interp_spline

    both = np.concatenate([-tangent[:0:-1], tangent])
    return make_interp_spline(both, np.concatenate([-values[:0:-1], values]), k=DEGREE)


class LensField:
    """Field functions of a lens.

    Parameters
    ----------
    nodes
        Four or more nodes.
    name
        Name of the lens in errors.
    at_fold, at_end
        Hints in the errors for image heights that stop increasing at an angle, which replaces
        ``{angle}``, and for angles beyond the end of the field.

    Raises
    ------
    InvalidParameter
        If the image heights do not increase outwards.
    """

    def __init__(self, nodes: FieldNodes, name: str, at_fold: str, at_end: str) -> None:
        self.nodes, self.name, self.at_end = nodes, name, at_end
        self.end = float(nodes.tangent[-1])
        positions = tuple(nodes.pupil.tolist())
        self.entrance_pupil = MovingPupil(positions[0], tuple(nodes.tangent.tolist()), positions)
        self._even = even_spline(
            nodes.tangent, np.stack([getattr(nodes, f) for f in LensValues._fields], axis=1)
        )
        self._odd = odd_spline(nodes.tangent, np.stack([getattr(nodes, f) for f in ODD], axis=1))
        self._rate = self._odd.derivative()
        samples = np.linspace(0.0, self.end, MONOTONICITY_SAMPLES)
        falls = self._rate(samples)[:, 0] <= 0
        if falls.any():
            angle = float(np.degrees(np.arctan(samples[int(np.argmax(falls))])))
            raise InvalidParameter(
                f"{name}: image heights must increase with the viewing angle; they stop "
                f"increasing at {angle:.4g} deg from the axis; "
                f"{at_fold.format(angle=f'{angle:.4g}')}"
            )
        self._heights = self._odd(samples)[:, 0]
        self._tangents = samples

    def check(self, tangent: Array) -> None:
        """Check that tangents are within the field, with a rounding tolerance."""
        outside = tangent > self.end * (1 + 1e-12)
        if outside.any():
            last, required = (float(np.degrees(np.arctan(v))) for v in (self.end, np.max(tangent)))
            raise InvalidParameter(
                f"{self.name} must extend to {required:.4g} deg from the axis, as the mirror "
                f"does; it ends at {last:.4g} deg; use a smaller or more distant mirror, or "
                f"{self.at_end}"
            )

    def at(self, tangent: Array) -> LensValues:
        """Evaluate the even functions at tangents (k,)."""
        return LensValues(*np.moveaxis(self._even(np.minimum(tangent, self.end)), -1, 0))

    def odd(self, tangent: Array) -> dict[str, Array]:
        """Evaluate the odd functions at tangents (k,), by name."""
        values = np.where(
            np.asarray(tangent)[..., None] == 0.0, 0.0, self._odd(np.minimum(tangent, self.end))
        )
        return dict(zip(ODD, np.moveaxis(values, -1, 0), strict=True))

    def height(self, tangent: Array) -> tuple[Array, Array]:
        """Return image heights (k,), mm, and derivatives with respect to the tangent."""
        inside = np.minimum(tangent, self.end)
        rate = self._rate(inside)[..., 0]
        height = self._odd(inside)[..., 0] + rate * (tangent - inside)
        return np.where(tangent == 0.0, 0.0, height), rate  # removes the rounding of splines

    def tangent_of(self, height: Array) -> Array:
        """Return tangents (k,) of image heights; NaN beyond the end of the field."""
        height = np.asarray(height, dtype=float)
        flat = height.ravel()
        with np.errstate(invalid="ignore"):
            in_field = (flat >= 0) & (flat <= self._heights[-1] * (1 + 1e-12))
        tangents = np.full_like(flat, np.nan)
        tangents[in_field] = increasing_inverse(
            self.height, flat[in_field], self._tangents, self._heights
        )
        return tangents.reshape(height.shape)


# -- Interpolation over wavelength -----------------------------------------------------------------

FRAUNHOFER_NM = np.array([486.1327, 587.5618, 656.2725])
"""Fraunhofer lines F, d and C."""


def through_three(wavelength_nm: float, known_nm: ArrayLike, values: Array) -> Array:
    """Interpolate values (3, n) at three wavelengths to (n,) at another.

    The formula is a parabola in the inverse squared wavelength.

    Raises
    ------
    InvalidParameter
        If the wavelength is outside the visible and near-visible range, or two of the three are
        equal.

    Examples
    --------
    N-BK7, from its indices at these lines:

    >>> rows = np.array([[1.52238], [1.51680], [1.51432]])
    >>> through_three(546.07, FRAUNHOFER_NM, rows).round(4)  # n_e of the data sheet: 1.51872
    array([1.5187])
    """
    number("wavelength_nm", wavelength_nm, low=300.0, high=1100.0, unit="nm")
    x = np.asarray(known_nm, dtype=float) ** -2.0
    if len(set(x)) < len(x):
        raise InvalidParameter("wavelengths_nm must be three different wavelengths")
    # Lagrange interpolation about the middle value: n = n_1 + sum_i (n_i - n_1) l_i(lambda^-2)
    inverse_square = wavelength_nm**-2.0
    interpolated: Array = values[1]
    for i, j in ((0, 2), (2, 0)):  # equal values at all three stay equal
        weight = (inverse_square - x[1]) * (inverse_square - x[j]) / ((x[i] - x[1]) * (x[i] - x[j]))
        interpolated = interpolated + weight * (values[i] - values[1])
    return interpolated


# -- Field lens ------------------------------------------------------------------------------------

FIELD_LENS_STEPS = 40
FIELD_LENS_TOLERANCE = 1e-14


class FieldLens(GaussianLens):
    """Lens with moving entrance pupil, field curvature, astigmatism and its own blur.

    To first order in the aperture, the rays of an image point pass the entrance pupil at
    (y_t, y_s) with slopes ``t - y_t v_t`` and ``-y_s v_s``.
    """

    IS_THIN: ClassVar[bool] = False

    @property
    @abstractmethod
    def field(self) -> LensField:
        """Field functions at the current focus."""

    @property
    def pupil(self) -> EntrancePupil:
        return self.field.entrance_pupil

    # -- image -------------------------------------------------------------------------------------

    def distorted_height(self, ideal: Array) -> Array:
        tangent = ideal / self.principal_distance
        self.field.check(tangent)
        return self.field.height(tangent)[0]

    def undistorted_height(self, h: Array) -> Array:
        return self.principal_distance * self.field.tangent_of(h)

    def distorted(self, ideal: Array) -> Array:
        tangent = np.hypot(ideal[..., 0], ideal[..., 1]) / self.principal_distance
        height, rate = self.field.height(tangent)
        in_field = tangent <= self.field.end * (1 + 1e-12)
        return (
            ideal
            * np.where(in_field, ratio(height, tangent, rate), np.nan)[..., None]
            / self.principal_distance
        )

    def undistorted(self, image: Array) -> Array:
        height = np.hypot(image[..., 0], image[..., 1])
        tangent = self.field.tangent_of(height)
        rate = self.field.height(np.zeros(1))[1][0]
        return (
            image
            * ratio(tangent, height, np.asarray(1 / rate))[..., None]
            * self.principal_distance
        )

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        tangent, c = ideal / self.principal_distance, self.principal_distance
        height, rate = self.field.height(tangent)
        return rate / c, ratio(height, tangent, rate) / c

    def blur_stretch(self, ideal: Array) -> tuple[Array, Array]:
        values, c = self.field.at(ideal / self.principal_distance), self.principal_distance
        return values.scale_t * values.width_t / c, values.scale_s * values.width_s / c

    def image_coordinates(self, L_t: Array, L_s: Array, ideal: Array) -> tuple[Array, Array]:
        values, on_axis = self.field.at(ideal / self.principal_distance), 1 / self.from_pupil
        with np.errstate(divide="ignore"):
            t, s = (1 / (L - values.pupil) for L in (L_t, L_s))
        return t - (values.vergence_t - on_axis), s - (values.vergence_s - on_axis)

    def own_blur(self, ideal: Array) -> tuple[Array, Array]:
        values = self.field.at(ideal / self.principal_distance)
        return np.maximum(values.own_t, 0.0), np.maximum(values.own_s, 0.0)

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        values = self.field.at(self.field.tangent_of(np.hypot(image[..., 0], image[..., 1])))
        return (
            values.illumination
            if pupil is None
            else values.illumination / values.unvignetted_fraction
        )

    # -- rays --------------------------------------------------------------------------------------

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        slopes = np.zeros((1, 2)) if chief is None else chief
        tangent = np.hypot(slopes[:, 0], slopes[:, 1])
        values, shift = self.field.at(tangent), self.field.odd(tangent)["stop_shift"]
        t, s = axes(slopes)
        along = shift + values.stop_t * np.einsum("ni,ni->n", *np.broadcast_arrays(pupil, t))
        across = values.stop_s * np.einsum("ni,ni->n", *np.broadcast_arrays(pupil, s))
        points = self.aperture_radius * (along[:, None] * t + across[:, None] * s)
        depth = np.broadcast_to(values.pupil, len(points))
        return np.concatenate([points, depth[:, None]], axis=1)

    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        slopes = np.zeros((1, 2)) if chief is None else chief
        values = self.field.at(np.hypot(slopes[:, 0], slopes[:, 1]))
        motion = np.zeros((max(len(slopes), len(pupil)), 2, 3))
        for axis, width in zip(axes(slopes), (values.stop_t, values.stop_s), strict=True):
            motion[:, :, :2] += (
                (self.aperture_radius * width[:, None, None]) * axis[:, :, None] * axis[:, None, :]
            )
        return motion

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        chief = self.undistorted(image) / self.principal_distance
        origins = self.entrance_pupil_points(pupil, chief)
        values = self.field.at(np.hypot(chief[:, 0], chief[:, 1]))
        slopes = chief - _focused(origins[:, :2], chief, values)
        return origins, np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)

    def image_of(self, points: Array, directions: Array) -> Array:
        """Return the image points of rays by the inverse of :meth:`rays`."""
        chief, _, _ = self._chief_ray_of(points, directions)
        return self.distorted(self.principal_distance * chief).reshape(directions[..., :2].shape)

    def image_cosines(self, points: Array, directions: Array) -> Array:
        """Return direction cosines (..., 2) of rays at the imager, for an upright image.

        Chief rays have 0. To first order in the aperture, by the Lagrange invariant:
        ``dy cos^3(theta) du = dh dL`` in the meridian and ``dy cos(theta) du = dh dL`` in the
        sagittal direction. A change of the slope u through a pupil point y moves the image point by
        dh; a change of y rotates the ray at the imager by dL.
        """
        chief, pupil_points, values = self._chief_ray_of(points, directions)
        t, s = axes(chief)
        cos = (1 + (chief**2).sum(axis=1)) ** -0.5
        along, across = (np.einsum("ni,ni->n", pupil_points, axis) for axis in (t, s))
        cosines: Array = (along * cos**3 / values.scale_t)[:, None] * t + (
            across * cos / values.scale_s
        )[:, None] * s
        return cosines.reshape(directions[..., :2].shape)

    def stop_points(self, points: Array, directions: Array) -> Array:
        """Return the stop points (..., 2) of rays, in stop radii and as in the upright image.

        The inverse of :meth:`entrance_pupil_points`.
        """
        chief, pupil_points, values = self._chief_ray_of(points, directions)
        shift = self.field.odd(np.hypot(chief[:, 0], chief[:, 1]))["stop_shift"]
        t, s = axes(chief)
        along, across = (
            np.einsum("ni,ni->n", pupil_points, axis) / self.aperture_radius for axis in (t, s)
        )
        crossed: Array = ((along - shift) / values.stop_t)[:, None] * t + (across / values.stop_s)[
            :, None
        ] * s
        return crossed.reshape(directions[..., :2].shape)

    def _chief_ray_of(self, points: Array, directions: Array) -> tuple[Array, Array, LensValues]:
        """Return chief-ray slopes (n, 2), pupil points (n, 2), mm, and field functions."""
        slopes = directions[..., :2] / directions[..., 2:]
        at_reference = (points[..., :2] - points[..., 2:] * slopes).reshape(-1, 2)
        slopes = slopes.reshape(-1, 2)
        chief = slopes
        for _ in range(FIELD_LENS_STEPS):
            values = self.field.at(np.hypot(chief[:, 0], chief[:, 1]))
            pupil_points = at_reference + values.pupil[:, None] * slopes
            refined = slopes + _focused(pupil_points, chief, values)
            step, chief = np.abs(refined - chief), refined
            if not (step > FIELD_LENS_TOLERANCE).any():
                break
        return chief, pupil_points, values


def axes(slopes: Array) -> tuple[Array, Array]:
    """Return unit vectors (n, 2), (n, 2), radial and tangential, of slopes (n, 2)."""
    length = np.hypot(slopes[:, 0], slopes[:, 1])
    away = length > 0
    t = np.where(away[:, None], slopes / np.where(away, length, 1.0)[:, None], np.array([1.0, 0.0]))
    return t, np.stack([-t[:, 1], t[:, 0]], axis=-1)


def _focused(pupil_points: Array, chief: Array, values: LensValues) -> Array:
    """Return slope differences (n, 2) to the chief rays for rays in focus."""
    t, s = axes(chief)
    # rays in focus: tangential slope t - y_t v_t, sagittal slope -y_s v_s
    along, across = np.einsum("ni,ni->n", pupil_points, t), np.einsum("ni,ni->n", pupil_points, s)
    differences: Array = (along * values.vergence_t)[:, None] * t + (across * values.vergence_s)[
        :, None
    ] * s
    return differences


def ratio(value: Array, divisor: Array, limit: Array) -> Array:
    """Return quotients (n,), with a limit for division by 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(divisor == 0.0, limit, value / divisor)
