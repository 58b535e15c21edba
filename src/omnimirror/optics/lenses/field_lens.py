"""Real lenses described by field functions, from a table or from surfaces."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from ...base.typing import Array
from .field import LensField, LensValues
from .gaussian import GaussianLens
from .pupil import EntrancePupil

STEPS = 40
CLOSE = 1e-14


class FieldLens(GaussianLens):
    """Lens with moving entrance pupil, field curvature, astigmatism and its own blur.

    To first order in the aperture, the rays of an image point pass the entrance pupil with the
    slopes defined in :mod:`.field`.
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
        seen = tangent <= self.field.end * (1 + 1e-12)
        return ideal * np.where(seen, ratio(height, tangent, rate), np.nan)[..., None] / self.principal_distance

    def undistorted(self, image: Array) -> Array:
        height = np.hypot(image[..., 0], image[..., 1])
        tangent = self.field.tangent_of(height)
        rate = self.field.height(np.zeros(1))[1][0]
        return image * ratio(tangent, height, np.asarray(1 / rate))[..., None] * self.principal_distance

    def stretch(self, ideal: Array) -> tuple[Array, Array]:
        tangent, c = ideal / self.principal_distance, self.principal_distance
        height, rate = self.field.height(tangent)
        return rate / c, ratio(height, tangent, rate) / c

    def blur_stretch(self, ideal: Array) -> tuple[Array, Array]:
        found, c = self.field.at(ideal / self.principal_distance), self.principal_distance
        return found.scale_t * found.width_t / c, found.scale_s * found.width_s / c

    def image_coordinates(self, L_t: Array, L_s: Array, ideal: Array) -> tuple[Array, Array]:
        found, on_axis = self.field.at(ideal / self.principal_distance), 1 / self.from_pupil
        with np.errstate(divide="ignore"):
            t, s = (1 / (L - found.pupil) for L in (L_t, L_s))
        return t - (found.vergence_t - on_axis), s - (found.vergence_s - on_axis)

    def own_blur(self, ideal: Array) -> tuple[Array, Array]:
        found = self.field.at(ideal / self.principal_distance)
        return np.maximum(found.own_t, 0.0), np.maximum(found.own_s, 0.0)

    def falloff(self, image: Array, pupil: Array | None = None) -> Array:
        found = self.field.at(self.field.tangent_of(np.hypot(image[..., 0], image[..., 1])))
        return found.illumination if pupil is None else found.illumination / found.openness

    # -- rays ---------------------------------------------------------------------------------------------

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Array:
        slopes = np.zeros((1, 2)) if chief is None else chief
        tangent = np.hypot(slopes[:, 0], slopes[:, 1])
        found, shift = self.field.at(tangent), self.field.odd(tangent)["stop_shift"]
        t, s = axes(slopes)
        along = shift + found.stop_t * np.einsum("ni,ni->n", *np.broadcast_arrays(pupil, t))
        across = found.stop_s * np.einsum("ni,ni->n", *np.broadcast_arrays(pupil, s))
        places = self.aperture_radius * (along[:, None] * t + across[:, None] * s)
        depth = np.broadcast_to(found.pupil, len(places))
        return np.concatenate([places, depth[:, None]], axis=1)

    def entrance_pupil_motion(self, pupil: Array, chief: Array | None = None) -> Array:
        slopes = np.zeros((1, 2)) if chief is None else chief
        found = self.field.at(np.hypot(slopes[:, 0], slopes[:, 1]))
        motion = np.zeros((max(len(slopes), len(pupil)), 2, 3))
        for axis, width in zip(axes(slopes), (found.stop_t, found.stop_s), strict=True):
            motion[:, :, :2] += (self.aperture_radius * width[:, None, None]) * axis[:, :, None] * axis[:, None, :]
        return motion

    def rays(self, image: Array, pupil: Array) -> tuple[Array, Array]:
        chief = self.undistorted(image) / self.principal_distance
        origins = self.entrance_pupil_points(pupil, chief)
        found = self.field.at(np.hypot(chief[:, 0], chief[:, 1]))
        slopes = chief - _focused(origins[:, :2], chief, found)
        return origins, np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)

    def image_of(self, points: Array, directions: Array) -> Array:
        """Return the image points of rays by the inverse of :meth:`rays`."""
        chief, _, _ = self._belonging(points, directions)
        return self.distorted(self.principal_distance * chief).reshape(directions[..., :2].shape)

    def image_cosines(self, points: Array, directions: Array) -> Array:
        """Return direction cosines (.., 2) of rays at the imager, for an upright image.

        Chief rays have 0. To first order in the aperture, by the Lagrange invariant:
        ``dy cos^3(theta) du = dh dL`` in the meridian and ``dy cos(theta) du = dh dL`` in the
        sagittal direction. A change of the slope u through a pupil point y moves the image point by
        dh; a change of y rotates the ray at the imager by dL.
        """
        chief, places, found = self._belonging(points, directions)
        t, s = axes(chief)
        cos = (1 + (chief**2).sum(axis=1)) ** -0.5
        along, across = (np.einsum("ni,ni->n", places, axis) for axis in (t, s))
        cosines: Array = (along * cos**3 / found.scale_t)[:, None] * t + (across * cos / found.scale_s)[:, None] * s
        return cosines.reshape(directions[..., :2].shape)

    def stop_points(self, points: Array, directions: Array) -> Array:
        """Return the stop points (.., 2) of rays, in stop radii and as in the upright image.

        The inverse of :meth:`entrance_pupil_points`.
        """
        chief, places, found = self._belonging(points, directions)
        shift = self.field.odd(np.hypot(chief[:, 0], chief[:, 1]))["stop_shift"]
        t, s = axes(chief)
        along, across = (np.einsum("ni,ni->n", places, axis) / self.aperture_radius for axis in (t, s))
        crossed: Array = ((along - shift) / found.stop_t)[:, None] * t + (across / found.stop_s)[:, None] * s
        return crossed.reshape(directions[..., :2].shape)

    def _belonging(self, points: Array, directions: Array) -> tuple[Array, Array, LensValues]:
        """Return chief-ray slopes (n, 2), pupil points (n, 2), mm, and field functions."""
        slopes = directions[..., :2] / directions[..., 2:]
        at_reference = (points[..., :2] - points[..., 2:] * slopes).reshape(-1, 2)
        slopes = slopes.reshape(-1, 2)
        chief = slopes
        for _ in range(STEPS):
            found = self.field.at(np.hypot(chief[:, 0], chief[:, 1]))
            places = at_reference + found.pupil[:, None] * slopes
            better = slopes + _focused(places, chief, found)
            step, chief = np.abs(better - chief), better
            if not (step > CLOSE).any():
                break
        return chief, places, found


def axes(slopes: Array) -> tuple[Array, Array]:
    """Return unit vectors (n, 2), (n, 2), radial and tangential, of slopes (n, 2)."""
    length = np.hypot(slopes[:, 0], slopes[:, 1])
    away = length > 0
    t = np.where(away[:, None], slopes / np.where(away, length, 1.0)[:, None], np.array([1.0, 0.0]))
    return t, np.stack([-t[:, 1], t[:, 0]], axis=-1)


def _focused(places: Array, chief: Array, found: LensValues) -> Array:
    """Return slope differences (n, 2) to the chief rays for rays in focus."""
    t, s = axes(chief)
    along, across = np.einsum("ni,ni->n", places, t), np.einsum("ni,ni->n", places, s)
    bent: Array = (along * found.vergence_t)[:, None] * t + (across * found.vergence_s)[:, None] * s
    return bent


def ratio(value: Array, by: Array, limit: Array) -> Array:
    """Return quotients (n,), with a limit for division by 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(by == 0.0, limit, value / by)
