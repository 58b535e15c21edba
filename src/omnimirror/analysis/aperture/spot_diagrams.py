"""Spot diagrams: where the rays of one object land, at one focus or through many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import row
from ...optics.sensor import Sensor, check_sensor
from ..evaluation import field_angles
from .bundles import Bundles, trace_bundles
from .pupil import Pupil, hexapolar
from .records import Recorded

Array = NDArray[np.float64]

RINGS = 12


@dataclass(frozen=True)
class Spots(Recorded):
    """Spots of k objects at m focuses, n rays each, in pixels from where the chief ray lands.

    Tangential is away from the optical axis in the picture, sagittal across it; their signs are those of
    the unflipped picture turned so that the spot lies to the right of its axis.
    """

    bundles: Bundles
    focus_mm: Array
    """(m,) object distances L0 in focus."""
    t_px: Array
    """(k, m, n)"""
    s_px: Array
    """(k, m, n)"""
    weights: Array
    """(k, n) share of the light in each ray, together 1; 0 for blocked rays, so that an object whose rays are all
    blocked has weights, radii and extents of 0."""
    chief_px: Array
    """(k, m) distance from the optical axis of where the chief ray lands."""

    def __repr__(self) -> str:
        k, m, n = self.t_px.shape
        return f"Spots({k} field angles, {m} focuses, {n} rays each)"

    @property
    def omega_deg(self) -> Array:
        """Field angles (k,)."""
        return self.bundles.omega_deg

    @property
    def filled(self) -> Array:
        """Unvignetted share (k,) of the aperture: of rays that mirror, lens and housing let through."""
        share: Array = self.bundles.passes @ self.bundles.pupil.weights
        return share

    def centroid_px(self) -> tuple[Array, Array]:
        """Tangential and sagittal centroids (k, m) from the chief ray."""
        return self._mean(self.t_px), self._mean(self.s_px)

    def rms_px(self) -> tuple[Array, Array]:
        """Root-mean-square tangential and sagittal radii (k, m) about the centroid."""
        t, s = (self._mean((a - self._mean(a)[..., None]) ** 2) for a in (self.t_px, self.s_px))
        return np.sqrt(t), np.sqrt(s)

    def rms_radius_px(self) -> Array:
        """Root-mean-square radius (k, m) about the centroid."""
        return np.hypot(*self.rms_px())

    def extent_px(self) -> tuple[Array, Array]:
        """Full tangential and sagittal widths (k, m) of all rays that pass; 0 where none does."""
        passes = self.bundles.passes[:, None, :]
        t, s = (
            np.max(a, axis=-1, where=passes, initial=-np.inf) - np.min(a, axis=-1, where=passes, initial=np.inf)
            for a in (self.t_px, self.s_px)
        )
        return np.maximum(t, 0.0), np.maximum(s, 0.0)

    def encircled_energy(self, radius_px: ArrayLike) -> Array:
        """Share (k, m, r) of the light within radii (r,) of the centroid, by rays alone.

        :meth:`omnimirror.analysis.Psf.encircled_energy` has diffraction too.
        """
        t, s = (a - c[..., None] for a, c in zip((self.t_px, self.s_px), self.centroid_px(), strict=True))
        within = np.hypot(t, s)[..., None] <= np.asarray(radius_px, dtype=float)
        energy: Array = np.einsum("kn,kmnr->kmr", self.weights, within)
        return energy

    def records(self) -> list[dict[str, float]]:
        """One record per object and focus: widths, radii and centroids."""
        shape = len(self.omega_deg), len(self.focus_mm)
        (ct, cs), (rt, rs), (et, es) = self.centroid_px(), self.rms_px(), self.extent_px()
        columns = {
            "omega_deg": self.omega_deg[:, None], "azimuth_deg": self.bundles.azimuth_deg[:, None],
            "focus_mm": self.focus_mm, "chief_px": self.chief_px, "filled": self.filled[:, None],
            "centroid_t_px": ct, "centroid_s_px": cs, "rms_t_px": rt, "rms_s_px": rs,
            "rms_radius_px": self.rms_radius_px(), "extent_t_px": et, "extent_s_px": es,
        }  # fmt: skip
        rows = zip(*(np.broadcast_to(c, shape).ravel().tolist() for c in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in rows]

    def _mean(self, values: Array) -> Array:
        # rays that miss a surface of the lens land nowhere and have no weight
        mean: Array = np.einsum("kn,kmn->km", self.weights, np.where(self.bundles.passes[:, None], values, 0.0))
        return mean


def spots(
    sensor: Sensor,
    omega_deg: ArrayLike | None = None,
    *,
    focus_mm: ArrayLike | None = None,
    azimuth_deg: ArrayLike = 0.0,
    object_distance_mm: ArrayLike = np.inf,
    pupil: Pupil | None = None,
) -> Spots:
    """Spot diagrams of point objects, by real rays through the whole aperture.

    Parameters
    ----------
    sensor
        Its mirror may be decentred and tilted.
    omega_deg : (n,), optional
        Field angles, deg; every 15 deg seen by default.
    focus_mm : (m,)
        Object distances L0 in focus, for spots through focus; the sensor's own by default.
    azimuth_deg : scalar or (k,)
        Directions of the objects, from image right towards image bottom.
    object_distance_mm : scalar or (k,)
        From the chief ray's mirror point to the object.
    pupil
        From :mod:`omnimirror.analysis.aperture.pupil`; a hexapolar one of 12 rings by default.

    Returns
    -------
    Spots
        Where every ray meets the imager, (n, k, rays, 2) px, for k focus distances.

    Raises
    ------
    OutsideField
        A field angle that is not seen.
    InvalidParameter
        A distance or focus that is not valid, or no field angles for a misaligned sensor.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.spots(om.load_sensor("paper-spherical"), [0, 60, 120])
    >>> found.rms_radius_px().round(2).ravel()  # of a blur disk, .35 of its diameter
    array([0.37, 0.25, 1.51])
    """
    check_sensor(sensor)
    bundles = trace_bundles(
        sensor,
        field_angles(sensor, 15.0) if omega_deg is None else omega_deg,
        hexapolar(RINGS) if pupil is None else pupil,
        azimuth_deg,
        object_distance_mm,
    )
    focus = row("focus_mm", sensor.lens.focus_distance_mm if focus_mm is None else focus_mm)
    axes, pitch = bundles.axes(), sensor.imager.pitch_mm
    across, heights = [], []
    for L0 in focus:
        focused = bundles.focused_at(float(L0))
        chief = bundles.chief_mm(focused)
        across.append(np.einsum("knc,kac->akn", bundles.image_mm(focused) - chief[:, None], axes) / pitch)
        heights.append(np.hypot(*chief.T) / pitch)
    t, s = np.stack(across, axis=2)
    weights = bundles.density * bundles.pupil.weights * bundles.passes
    light = weights.sum(axis=1, keepdims=True)
    weights = np.divide(weights, light, out=np.zeros_like(weights), where=light > 0)
    return Spots(bundles, focus, t, s, weights, np.stack(heights, axis=1))
