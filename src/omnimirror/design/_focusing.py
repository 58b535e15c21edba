"""Focus optimisation: the vergence with the largest margin of the focus-dependent limits.

As functions of the vergence v in focus (1/L0; for a telecentric lens -L0), blur, Airy disc and
image scale have closed forms, and many vergences are evaluated at once: first a scan over the
vergences of all images, then repeated refinement around the minimum. The cost is

    the largest relative violation of a limit of blur (negative if all are met),

or, without limits of blur, the worst floored blur area. The other focus-dependent requirements,
image size and resolution, are constraints if they are feasible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..base.caching import cached_property
from ..base.typing import Array
from ..optics.batch.best_focus import RealAreas
from ..optics.batch.closed_forms import (
    MIN_FOCUS_DISTANCE,
    LensTables,
    MirrorPointOptics,
    PerspectiveCamera,
    RealCamera,
    TelecentricCamera,
    aim_of,
    built_optics,
    node_optics,
    tables_of,
    telecentric_optics,
    walls_around,
)
from ..optics.lenses import FieldLens, Lens, Perspective
from ..optics.sensor import Sensor
from .evaluated_field import distances_mm, evaluable_field, inverse_distances
from .limits import Limit
from .merits import OF_THE_WHOLE, FieldValues, values_at, with_whole
from .requirements import MAX_FOCUS, FieldRequirements

POINTS = 181  # mirror points in each evaluated part of the field
SCAN, AGAIN = 33, 9  # vergences of the first scan, and of each refinement
APERTURES, REFINEMENTS = 7, 3  # F-numbers for each vergence, and number of refinements
CLOSE = 1e-7  # final interval relative to the range of vergences
MARGIN = 0.05  # extension at either end, relative to the range of vergences
VIOLATION_TOLERANCE = 1e-6  # tolerance of relative violations
INFEASIBLE = 1e6  # penalty above any relative violation or blur area


class Focus(NamedTuple):
    """Best focus with its cost."""

    focus_mm: float
    cost: float


@dataclass(frozen=True)
class Focusing:
    """Sensor with a free focus, and its focus-dependent properties.

    Attributes
    ----------
    field
        Field angles and object distances.
    image_radius_px
        Largest radius of the rim image; infinite if lens and mirror depend on the focus.
    span_mm
        Range of focus distances; None for unlimited.
    points
        Number of mirror points in each evaluated part of the field.
    """

    sensor: Sensor
    field: FieldRequirements
    limits: tuple[Limit, ...]
    image_radius_px: float = np.inf
    span_mm: tuple[float, float] | None = None
    points: int = POINTS

    def best_aperture(self, span: tuple[float, float]) -> tuple[float, Focus]:
        """Return F-number within a span and focus of minimum cost, by joint scans with refinement.

        A real lens has a fixed aperture.
        """
        if isinstance(self.camera, RealCamera):
            return self.sensor.lens.stop_number, self.best()
        (low, high), (F_low, F_high) = self.range, (float(np.log(F)) for F in span)
        steps = APERTURES if F_high > F_low else 1
        for narrower in range(REFINEMENTS + 1):
            v, F = np.meshgrid(
                np.linspace(low, high, SCAN if not narrower else AGAIN),
                np.linspace(F_low, F_high, steps),
            )
            refined = replace(self)
            refined.__dict__.update(
                _nodes=self._nodes,
                _fields=self._fields,
                camera=self._with_apertures(np.exp(F.ravel())[:, None]),
            )
            with np.errstate(all="ignore"):
                cost = np.nan_to_num(refined._cost(v.ravel()[:, None], True), nan=np.inf)
            i = int(cost.argmin())
            half_v, half_F = (high - low) / (v.shape[1] - 1), (F_high - F_low) / max(steps - 1, 1)
            best_v, best_F = float(v.ravel()[i]), float(F.ravel()[i])
            low, high = max(low, best_v - half_v), min(high, best_v + half_v)
            F_low, F_high = max(F_low, best_F - half_F), min(F_high, best_F + half_F)
        return float(np.exp(best_F)), Focus(self.camera.focus_mm(best_v), float(cost[i]))

    def best(self) -> Focus:
        """Return the best focus for the limits that depend on it."""
        low, high = self.range
        whole, v = high - low, np.linspace(*self.range, SCAN)
        with np.errstate(all="ignore"):
            can_be_kept = bool((self._missed(v[:, None]) <= VIOLATION_TOLERANCE).any())
            while True:
                cost = self._cost(v[:, None], can_be_kept)
                i = int(np.nanargmin(cost)) if np.isfinite(cost).any() else 0
                low, high = v[max(i - 1, 0)], v[min(i + 1, v.size - 1)]
                if not high - low > CLOSE * whole:
                    break
                v = np.linspace(low, high, AGAIN)
        vergence = float(v[i])
        return Focus(self.camera.focus_mm(vergence), float(cost[i]))

    def _cost(self, v: Array, keeping: bool) -> Array:
        """Return costs (b,) at vergences v (b, 1), optionally with a penalty.

        ``keeping`` penalises violations of the other feasible requirements.
        """
        of_blur = [
            limit.missed(self.at(v, limit)) for limit in self.limits if limit.of.is_sharpness
        ]
        if of_blur:
            worst: Array = np.maximum.reduce(of_blur)
        else:
            worst = np.exp(self.at(v).log_area).max(axis=-1)
        if not keeping:
            return worst
        missed = self._missed(v)
        return worst + np.where(missed > VIOLATION_TOLERANCE, INFEASIBLE * (1 + missed), 0.0)

    def _missed(self, v: Array) -> Array:
        """Return violations (b,) of other focus-dependent requirements at vergences v (b, 1)."""
        if np.isinf(
            self.image_radius_px
        ):  # the rim fills the imager, and the image size is constant
            return np.full(len(v), -1.0)
        others = [limit.missed(self.at(v, limit)) for limit in self.limits if limit.of.is_scale]
        image = self.camera.height_px(self._rim_ray, v)[:, 0] / self.image_radius_px - 1
        missed: Array = np.maximum.reduce([*others, image])
        return missed

    # -- focus-independent quantities --------------------------------------------------------------

    @property
    def _is_telecentric(self) -> bool:
        return self.sensor.lens.TELECENTRIC

    @cached_property
    def camera(self) -> PerspectiveCamera | TelecentricCamera | RealCamera:
        """Model of lens and pixels."""
        if self._tables is not None:
            return RealCamera(self._tables, self.sensor.imager.pitch_mm)
        return self._with_apertures(self.sensor.lens.stop_number)

    @cached_property
    def _tables(self) -> LensTables | None:
        lens = self.sensor.lens
        return tables_of(lens) if isinstance(lens, FieldLens) else None

    def _with_apertures(self, f_number: Any) -> PerspectiveCamera | TelecentricCamera:
        """Return the model of lens and pixels with one F-number or several (b, 1)."""
        lens, pitch = self.sensor.lens, self.sensor.imager.pitch_mm
        if isinstance(lens, Perspective):
            return PerspectiveCamera(lens.focal_length_mm, f_number, self._rim_ray, pitch)
        return TelecentricCamera(lens.magnification, f_number, self._rim_ray, pitch)  # type: ignore[attr-defined]  # orthographic

    @cached_property
    def _rim(self) -> tuple[float, float]:
        """Radius and sag of the rim."""
        radius = self.sensor.mirror.rim_radius_mm
        return radius, float(self.sensor.mirror.sag(radius))

    @cached_property
    def _rim_ray(self) -> Array:
        radius, sag = self._rim
        if self._is_telecentric:
            return np.array([[radius]])
        return aim_of(
            np.array([[radius]]), np.array([[self.sensor.mirror_distance_mm + sag]]), self._tables
        ).tangent

    @cached_property
    def _parts(self) -> dict[tuple[float, float] | None, slice]:
        """Slices of points of the parts of the field."""
        requested = {limit.omega_deg: None for limit in self.limits}
        if not any(limit.of.is_sharpness for limit in self.limits):
            requested |= {None: None}
        return {
            part: slice(i * self.points, (i + 1) * self.points) for i, part in enumerate(requested)
        }

    @property
    def distances(self) -> int:
        """Number of object distances evaluated at each field angle."""
        return 1 if self.field.has_surfaces else len(distances_mm(self.field))

    @cached_property
    def _nodes(self) -> MirrorPointOptics:
        """Optics (d, k) of all points for each relevant object."""
        sensor, mirror = self.sensor, self.sensor.mirror
        counted = evaluable_field(self.field, sensor)
        omega = np.radians([counted.part(part)[:2] for part in self._parts])
        first, last = sensor.meridian.x_from_omega(omega.ravel()).reshape(-1, 2).T
        x = (first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, self.points)).ravel()
        z, slope, curvature = mirror.profile(x)
        over_x = np.where(x > 0, slope / np.where(x > 0, x, 1.0), curvature)
        near: Any = 1 / np.array(distances_mm(self.field))[:, None]
        if self.field.has_surfaces:
            near = partial(inverse_distances, self.field)
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # the tangential images of a cone are at infinity
            if self._tables is not None or sensor.housing.shell is not None:
                m = np.inf if self._is_telecentric else sensor.mirror_distance_mm
                aim, walls = aim_of(x, m + z, self._tables), walls_around(sensor.obstructions)
                return built_optics(x, z, slope, curvature, over_x, aim, near, walls)
            if self._is_telecentric:
                return telecentric_optics(x, z, slope, curvature, over_x, near)
            return node_optics(x, z, slope, curvature, over_x, sensor.mirror_distance_mm, near)  # type: ignore[arg-type]

    @cached_property
    def _fields(self) -> dict[tuple[float, float] | None, MirrorPointOptics]:
        """Optics (k,) of each part, concatenated over object distances."""
        shape = (self.distances, self.points * len(self._parts))
        nodes = [np.broadcast_to(column, shape) for column in self._nodes]
        return {
            part: MirrorPointOptics(*(n[:, where].ravel() for n in nodes))
            for part, where in self._parts.items()
        }

    def at(self, v: Array, limit: Limit | None = None) -> FieldValues:
        """Return field values at vergences v (b, 1), for a limit or the whole evaluated field."""
        (_, sag), m = self._rim, self.sensor.mirror_distance_mm
        reach = np.array([sag if self._is_telecentric else m + sag])
        part = self._fields[None if limit is None else limit.omega_deg]
        values = values_at(part, self.camera, v, reach, np.array([sag]))
        if limit is not None and limit.quantity in OF_THE_WHOLE:
            return with_whole(values, self.sensor, (limit.quantity,))
        return values

    @property
    def range(self) -> tuple[float, float]:
        """Search range of vergences: the virtual images with a margin."""
        camera = self.camera
        minimum, maximum = (
            camera.bounds if isinstance(camera, RealCamera) else vergences_of(self.sensor.lens)
        )
        vergences = self._vergences
        vergences = vergences[np.isfinite(vergences)]
        within = vergences[vergences < maximum] if (vergences < maximum).any() else vergences
        within = np.clip(within, minimum, maximum)
        margin = MARGIN * (float(np.ptp(within)) or abs(float(within[0])))
        low, high = (
            max(float(within.min()) - margin, minimum),
            min(float(within.max()) + margin, maximum),
        )
        if self.span_mm is None:
            return low, high
        span = sorted(
            np.clip([camera.vergence(min(mm, MAX_FOCUS)) for mm in self.span_mm], minimum, maximum)
        )
        return float(np.clip(low, *span)), float(np.clip(high, *span))

    @property
    def _vergences(self) -> Array:
        """Vergences of zero tangential or sagittal blur, approximate for a real lens."""
        o = self._nodes
        if isinstance(self.camera, RealCamera):
            rows = MirrorPointOptics(*(np.atleast_2d(column) for column in o))
            areas = RealAreas.of(rows, self.camera, np.ones_like(rows.omega))
            return np.concatenate([areas.middle_t.ravel(), areas.middle_s.ravel()])
        return np.concatenate([o.vergence_t.ravel(), o.vergence_s.ravel()])


def vergences_of(lens: Lens) -> tuple[float, float]:
    """Return the range of vergences of a lens: 1/L0, or -L0 for a telecentric lens."""
    limits = lens.PARAMETERS["focus_distance_mm"]
    if lens.TELECENTRIC:
        return -limits.high, -limits.low
    nearest = (
        MIN_FOCUS_DISTANCE * lens.focal_length_mm
        if isinstance(lens, FieldLens)
        else lens.nearest_focus_mm
    )
    return 1 / limits.high, 1 / max(limits.low, nearest)
