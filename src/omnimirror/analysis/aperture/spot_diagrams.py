"""Spot diagrams: ray intersections with the imager for one object, in focus or through focus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import row
from ...base.typing import Array
from ...optics.sensor import Sensor, check_sensor
from ..evaluation import field_angles
from .bundles import Bundles, trace_bundles
from .pupil import Pupil, hexapolar
from .records import Recorded

RINGS = 12


@dataclass(frozen=True)
class Spots(Recorded):
    """Spot diagrams of k objects at m foci with n rays each, in pixels from the chief ray.

    Tangential is radially outwards in the image, sagittal perpendicular to it; signs refer to the
    unflipped image, rotated to place the spot to the right of the axis.
    """

    bundles: Bundles
    focus_mm: Array
    """Object distances L0 in focus (m,)."""
    t_px: Array
    """Tangential offsets (k, m, n)."""
    s_px: Array
    """Sagittal offsets (k, m, n)."""
    weights: Array
    """Relative light of each ray (k, n), with sum 1; 0 for blocked rays. An object with only
    blocked rays has weights, radii and extents of 0.
    """
    chief_px: Array
    """Distance of the chief ray from the optical axis (k, m)."""

    def __repr__(self) -> str:
        k, m, n = self.t_px.shape
        return f"Spots({k} field angles, {m} focuses, {n} rays each)"

    @property
    def omega_deg(self) -> Array:
        """Return the field angles (k,)."""
        return self.bundles.omega_deg

    @property
    def filled(self) -> Array:
        """Return the unvignetted share (k,) of the aperture."""
        share: Array = self.bundles.passes @ self.bundles.pupil.weights
        return share

    def centroid_px(self) -> tuple[Array, Array]:
        """Return tangential and sagittal centroids (k, m) relative to the chief ray."""
        return self._mean(self.t_px), self._mean(self.s_px)

    def rms_px(self) -> tuple[Array, Array]:
        """Return RMS tangential and sagittal radii (k, m) about the centroid."""
        t, s = (self._mean((a - self._mean(a)[..., None]) ** 2) for a in (self.t_px, self.s_px))
        return np.sqrt(t), np.sqrt(s)

    def rms_radius_px(self) -> Array:
        """Return the RMS radius (k, m) about the centroid."""
        return np.hypot(*self.rms_px())

    def extent_px(self) -> tuple[Array, Array]:
        """Return the full tangential and sagittal widths (k, m) of unvignetted rays, 0 if none."""
        passes = self.bundles.passes[:, None, :]
        t, s = (
            np.max(a, axis=-1, where=passes, initial=-np.inf) - np.min(a, axis=-1, where=passes, initial=np.inf)
            for a in (self.t_px, self.s_px)
        )
        return np.maximum(t, 0.0), np.maximum(s, 0.0)

    def encircled_energy(self, radius_px: ArrayLike) -> Array:
        """Return the encircled energy (k, m, r) within radii (r,) of the centroid, from rays only.

        :meth:`omnimirror.analysis.Psf.encircled_energy` includes diffraction.
        """
        t, s = (a - c[..., None] for a, c in zip((self.t_px, self.s_px), self.centroid_px(), strict=True))
        within = np.hypot(t, s)[..., None] <= np.asarray(radius_px, dtype=float)
        energy: Array = np.einsum("kn,kmnr->kmr", self.weights, within)
        return energy

    def records(self) -> list[dict[str, float]]:
        """Return one record per object and focus: widths, radii and centroids."""
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
        # rays that miss a lens surface have no position and no weight
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
    """Compute spot diagrams of point objects, from real rays through the whole aperture.

    Parameters
    ----------
    sensor
        Sensor; its mirror may be decentred and tilted.
    omega_deg : (n,), optional
        Field angles, deg; by default every 15 deg of the field.
    focus_mm : (m,)
        Object distances L0 in focus, for through-focus spots; by default that of the sensor.
    azimuth_deg : scalar or (k,)
        Directions of the objects, from image right towards image bottom.
    object_distance_mm : scalar or (k,)
        Object distance from the mirror point of the chief ray.
    pupil
        Pupil from :mod:`omnimirror.analysis.aperture.pupil`; by default hexapolar with 12 rings.

    Returns
    -------
    Spots
        Intersections of all rays with the imager, (n, k, rays, 2) px, for k focus distances.

    Raises
    ------
    OutsideField
        Field angle outside the field of view.
    InvalidParameter
        Invalid distance or focus, or missing field angles for a misaligned sensor.

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
