"""Spot diagrams in focus and through focus, and validation of the blur formula by real rays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import row
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..base.results import Columns, FieldResult, Fields, TabularResult
from ..base.typing import Array
from ..optics.lenses import GaussianLens
from ..optics.sensor import Sensor, check_sensor
from .evaluation import evaluate, field_angles
from .ray_bundles import Bundles, Pupil, hexapolar, trace_bundles, unvignetted_fraction

# -- Spot diagrams ---------------------------------------------------------------------------------

RINGS = 12


@dataclass(frozen=True)
class Spots(TabularResult, FieldResult):
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
    """Relative light of each ray (k, n), normalised to the sum 1; 0 for blocked rays. An object
    with only blocked rays has weights, radii and extents of 0.
    """
    chief_px: Array
    """Distance of the chief ray from the optical axis (k, m)."""

    def __repr__(self) -> str:
        k, m, n = self.t_px.shape
        return f"Spots({k} field angles, {m} focuses, {n} rays each)"

    @property
    def omega_deg(self) -> Array:
        """Field angles (k,)."""
        return self.bundles.omega_deg

    @cached_property
    def filled(self) -> Array:
        """Unvignetted fraction (k,) of the aperture, with an error below 0.003 for 12 rings."""
        bundles = self.bundles
        edges = [*bundles.clearances().values()]
        return np.array(
            [
                unvignetted_fraction(bundles.pupil, [edge[i] for edge in edges], passes)
                for i, passes in enumerate(bundles.passes)
            ]
        )

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
            np.max(a, axis=-1, where=passes, initial=-np.inf)
            - np.min(a, axis=-1, where=passes, initial=np.inf)
            for a in (self.t_px, self.s_px)
        )
        return np.maximum(t, 0.0), np.maximum(s, 0.0)

    def encircled_energy(self, radius_px: ArrayLike) -> Array:
        """Return the encircled energy (k, m, r) within radii (r,) of the centroid, from rays only.

        :meth:`omnimirror.analysis.Psf.encircled_energy` includes diffraction.
        """
        t, s = (
            a - c[..., None]
            for a, c in zip((self.t_px, self.s_px), self.centroid_px(), strict=True)
        )
        within = np.hypot(t, s)[..., None] <= np.asarray(radius_px, dtype=float)
        energy: Array = np.einsum("kn,kmnr->kmr", self.weights, within)
        return energy

    def records(self) -> list[dict[str, float]]:
        """Return one record per object and focus: widths, radii and centroids."""
        shape = len(self.omega_deg), len(self.focus_mm)
        columns = {
            "omega_deg": self.omega_deg[:, None],
            "azimuth_deg": self.bundles.azimuth_deg[:, None],
            "focus_mm": self.focus_mm,
            "chief_px": self.chief_px,
            "filled": self.filled[:, None],
            **self._sizes_px(),
        }
        rows = zip(
            *(np.broadcast_to(c, shape).ravel().tolist() for c in columns.values()), strict=True
        )
        return [dict(zip(columns, row, strict=True)) for row in rows]

    def _sizes_px(self) -> dict[str, Array]:
        """Return centroids, radii and widths (k, m) by name."""
        (ct, cs), (rt, rs), (et, es) = self.centroid_px(), self.rms_px(), self.extent_px()
        return {
            "centroid_t_px": ct,
            "centroid_s_px": cs,
            "rms_t_px": rt,
            "rms_s_px": rs,
            "rms_radius_px": self.rms_radius_px(),
            "extent_t_px": et,
            "extent_s_px": es,
        }

    def _fields(self) -> Fields:
        angle, focus = ("omega_deg",), ("focus_mm",)
        sizes = {"chief_px": self.chief_px, **self._sizes_px()}
        return Fields(
            {
                **{name: (angle + focus, values) for name, values in sizes.items()},
                "filled": (angle, self.filled),
            },
            {
                "omega_deg": (angle, self.omega_deg),
                "azimuth_deg": (angle, self.bundles.azimuth_deg),
                "object_distance_mm": (angle, self.bundles.object_distance_mm),
                "focus_mm": (focus, self.focus_mm),
            },
            {"sensor": self.bundles.sensor.name},
        )

    def _mean(self, values: Array) -> Array:
        # rays that miss a lens surface have no position and no weight
        mean: Array = np.einsum(
            "kn,kmn->km", self.weights, np.where(self.bundles.passes[:, None], values, 0.0)
        )
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
        Pupil from :mod:`omnimirror.analysis.ray_bundles`; by default hexapolar with 12 rings.

    Returns
    -------
    Spots
        Intersections of all rays with the imager, (n, k, rays, 2) px, for k focus distances.

    Raises
    ------
    OutsideField
        If the field angle is outside the field of view.
    InvalidParameter
        If distance or focus are invalid, or a misaligned sensor has no field angles.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.spots(om.load_sensor("paper-spherical"), [0, 60, 120])
    >>> found.rms_radius_px().round(2).ravel()  # of a blur disc, 0.35 of its diameter
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
        across.append(
            np.einsum("knc,kac->akn", bundles.image_mm(focused) - chief[:, None], axes) / pitch
        )
        heights.append(np.hypot(*chief.T) / pitch)
    t, s = np.stack(across, axis=2)
    weights = bundles.density * bundles.pupil.weights * bundles.passes
    light = weights.sum(axis=1, keepdims=True)
    weights = np.divide(weights, light, out=np.zeros_like(weights), where=light > 0)
    return Spots(bundles, focus, t, s, weights, np.stack(heights, axis=1))


# -- Validation of the blur formula by real rays ---------------------------------------------------

FAN_RAYS = 81  # rays across a fan
RIM_CLEARANCE_DEG = (
    0.5  # deg; distance of the field angles from the rim, which would vignette bundles
)


@dataclass(frozen=True)
class BlurCheck(FieldResult):
    """Blur of real rays minus the evaluation, k field angles, j F-numbers; arrays (j, k), px."""

    f_number: Array
    """F-numbers (j,)."""
    omega_deg: Array
    """Field angles (k,)."""
    blur_t_px: Array
    """Tangential blur of the evaluation, unsigned."""
    blur_s_px: Array
    edge_t_px: Array
    """Distance of the two marginal rays of the tangential fan minus the blur."""
    edge_s_px: Array
    extent_t_px: Array
    """Full width of the tangential fan minus the blur."""
    extent_s_px: Array

    def _table(self) -> Columns:
        shape = self.blur_t_px.shape
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        columns["f_number"] = self.f_number[:, None]
        return {name: np.broadcast_to(c, shape).ravel() for name, c in columns.items()}

    def _fields(self) -> Fields:
        dimensions = ("f_number", "omega_deg")
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        coordinates = {name: ((name,), values.pop(name)) for name in dimensions}
        return Fields({k: (dimensions, v) for k, v in values.items()}, coordinates, {})

    def max_abs(self, name: str) -> Array:
        """Return the largest magnitude (j,) of a column over the field."""
        maximum: Array = np.abs(getattr(self, name)).max(axis=1)
        return maximum


def check_blur(
    sensor: Sensor,
    f_numbers: ArrayLike,
    *,
    omega_deg: ArrayLike | None = None,
    object_distance_mm: float = np.inf,
) -> BlurCheck:
    """Compare the blur of Eq. 28 with real rays, for an aligned sensor and several F-numbers.

    The formula includes the two curvatures of the mirror at the chief ray only. The variation of
    the curvature across a larger aperture causes coma, then spherical aberration.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    f_numbers : (k,)
        F-numbers of the lens to evaluate.
    omega_deg : (n,), optional
        Field angles, deg; by default over the whole field.
    object_distance_mm
        Object distance from the mirror, mm.

    Returns
    -------
    BlurCheck
        Blur by Eq. 28 and differences of real rays from it, (k, n) px.

    Raises
    ------
    InvalidParameter, OutsideField
        If a field angle is outside the field of view, or a number is invalid.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.check_blur(om.load_sensor("paper-spherical"), [4.0])
    >>> bool(found.max_abs("edge_t_px")[0] < 0.002)
    True
    """
    check_sensor(sensor)
    numbers = row("f_numbers", f_numbers)
    name = "f_number" if isinstance(sensor.lens, GaussianLens) else "working_f_number"
    low, high = sensor.field_deg
    angles = field_angles(sensor) if omega_deg is None else row("omega_deg", omega_deg)
    angles = (
        angles[(angles >= low) & (angles <= high - RIM_CLEARANCE_DEG)]
        if omega_deg is None
        else angles
    )
    if not angles.size:
        raise InvalidParameter("omega_deg must contain at least one field angle; got none")
    u = np.linspace(-1, 1, FAN_RAYS)
    fans = Pupil(
        np.concatenate([np.outer(u, [1, 0]), np.outer(u, [0, 1])]),
        np.full(2 * FAN_RAYS, 0.5 / FAN_RAYS),
    )
    rows = []
    for F in numbers:
        changed = replace(sensor, lens=replace(sensor.lens, **{name: float(F)}))  # type: ignore[type-var]  # all implementations are dataclasses
        result = evaluate(changed, angles, object_distance_mm=object_distance_mm)
        spot = spots(changed, angles, pupil=fans, object_distance_mm=object_distance_mm)
        t, s = spot.t_px[:, 0, :FAN_RAYS], spot.s_px[:, 0, FAN_RAYS:]
        blur_t, blur_s = np.abs(result.blur_t_px), np.abs(result.blur_s_px)
        edges = (np.abs(a[:, -1] - a[:, 0]) for a in (t, s))
        rows.append([blur_t, blur_s, *edges, np.ptp(t, axis=1), np.ptp(s, axis=1)])
    blur_t, blur_s, edge_t, edge_s, extent_t, extent_s = np.array(rows).transpose(1, 0, 2)
    return BlurCheck(
        numbers,
        angles,
        blur_t,
        blur_s,
        edge_t - blur_t,
        edge_s - blur_s,
        extent_t - blur_t,
        extent_s - blur_s,
    )
