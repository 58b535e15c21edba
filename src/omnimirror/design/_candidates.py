"""Sensors with a mirror of a mapping or a family: construction of mirror, matching lens and focus.

Requirements are settled: all ranges that affect the mirror or the lens are numbers, and missing
lens parameters follow from the imager. A construction method is a function of these entries and the
rim; :data:`WAYS` contains the methods by the entry of ``[mirror]`` that selects them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
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
from ..optics.lenses import FieldLens, Lens, Orthographic, Perspective
from ..optics.mirrors.mappings import FiniteMapping
from ..optics.mirrors.prescribed_mapping import MappingMirror
from ..optics.sensor import Sensor
from ..optics.tracing.meridian import Meridian
from .limits import Limit
from .merits import OF_THE_WHOLE, FieldValues, values_at, with_whole
from .mirror_construction import (
    FAMILIES,
    LensAndCover,
    MountedMirror,
    RimRay,
    departure,
    generated_mirror,
    mapped_mirror,
)
from .mirror_fits import fit_mirror
from .requirement_check import distances_mm, evaluable_field, inverse_distances
from .requirements import (
    MAX_FOCUS,
    OF_MAPPINGS,
    FieldRequirements,
    MirrorRequirements,
    Requirements,
    ends,
    ends_or_none,
    is_free,
)

# -- Focus optimisation ----------------------------------------------------------------------------
#
# As functions of the vergence v in focus (1/L0; for a telecentric lens -L0), blur, Airy disc and
# image scale have closed forms, and many vergences are evaluated at once: first a scan over the
# vergences of all images, then repeated refinement around the minimum. The cost is
#
#     the largest relative violation of a limit of blur (negative if all are met),
#
# or, without limits of blur, the worst floored blur area. The other focus-dependent requirements,
# image size and resolution, are constraints if they are feasible.

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
            return node_optics(x, z, slope, curvature, over_x, sensor.mirror_distance_mm, near)  # type: ignore[arg-type]  # only None if telecentric

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


# -- Construction of mirror and lens ---------------------------------------------------------------
#
# Requirements are settled: all ranges that affect the mirror or the lens are numbers, and missing
# lens parameters follow from the imager. A construction method is a function of these entries and the
# rim; :data:`WAYS` contains the methods by the entry of ``[mirror]`` that selects them.

SETTLED, MAX_ROUNDS = 1e-5, 30  # relative tolerance, iterations of the coupled lens and focus
ANGLES = 1001  # field angles of the comparison with the requested mapping


@dataclass(frozen=True)
class Candidate:
    """Sensor for settled requirements, with notes on its mirror."""

    settled: Requirements
    sensor: Sensor
    notes: tuple[str, ...]


def make(settled: Requirements) -> Candidate:
    """Return the sensor for settled requirements, at the given focus or the best focus.

    Raises
    ------
    OmnimirrorError
        If the mirror does not exist or cannot be used.
    """
    return _telecentric(settled) if settled.lens.is_telecentric else _perspective(settled)


# -- mirrors ---------------------------------------------------------------------------------------


def _by_mapping(mirror: MirrorRequirements, rim: RimRay, omega_min_deg: float) -> MountedMirror:
    entries = {name: v for name in OF_MAPPINGS if (v := getattr(mirror, name)) is not None}
    assert mirror.mapping is not None
    return generated_mirror(
        mirror.mapping, rim, omega_min_deg if mirror.is_pointed else 0.0, **entries
    )


def _by_family(mirror: MirrorRequirements, rim: RimRay, omega_min_deg: float) -> MountedMirror:
    assert mirror.family is not None
    if mirror.family in FAMILIES:
        return FAMILIES[mirror.family](rim, None if mirror.conic is None else ends(mirror.conic)[0])
    equidistant = generated_mirror("equidistant", rim)
    return fit_mirror(equidistant, mirror.family).mounted


WAYS: dict[str, Callable[[MirrorRequirements, RimRay, float], MountedMirror]] = {
    "mapping": _by_mapping,
    "family": _by_family,
}
"""Construction methods by the entry of ``[mirror]`` that selects them."""


def _mirror(settled: Requirements, theta_max_deg: float, fitted: bool = True) -> MountedMirror:
    """Return the mirror for a viewing angle Theta at the rim, optionally fitted."""
    field, mirror = settled.field, settled.mirror
    rim = RimRay(field.omega_max_deg, theta_max_deg, ends(mirror.rim_radius_mm)[0])
    return _kept(mirror if fitted else replace(mirror, fit=None), rim, field.omega_min_deg)


def _mounted(
    settled: Requirements, theta_max_deg: float, nearness: float, fitted: bool = True
) -> MountedMirror:
    """Return the mirror for the lens, focused at 1/L0, and the cover; its distance refers to the
    reference point of the lens.
    """
    around = lens_and_cover(settled, _focus_at(settled, nearness))
    if around.are_ideal:
        return _mirror(settled, theta_max_deg, fitted)
    field, mirror = settled.field, settled.mirror
    rim = RimRay(field.omega_max_deg, theta_max_deg, ends(mirror.rim_radius_mm)[0])
    return _kept_built(mirror, rim, field.omega_min_deg, around, fitted)


@lru_cache(maxsize=128)
def _kept_built(
    mirror: MirrorRequirements,
    rim: RimRay,
    omega_min_deg: float,
    around: LensAndCover,
    fitted: bool,
) -> MountedMirror:
    """Return the mirror for a lens and a cover (cached)."""
    plain = replace(mirror, fit=None)
    if (exact := exact_mapping(mirror, rim, omega_min_deg)) is not None and around.keep_mapping:
        mounted = around.made_for_mapping(exact, rim)
    elif mirror.is_pointed:
        mounted = around.made_for_ends(
            lambda inside, low: _kept(plain, inside, low), rim, omega_min_deg
        )
    else:
        mounted = around.made_for_rim(lambda inside: _kept(plain, inside, omega_min_deg), rim)
    if mirror.fit is None or not fitted:
        return mounted
    distance_mm = around.mounted(MountedMirror(mounted.mirror, 0.0), rim.theta_max_deg).distance_mm
    as_pinhole = MountedMirror(mounted.mirror, mounted.distance_mm - distance_mm, mounted.notes)
    return around.mounted(fit_mirror(as_pinhole, mirror.fit).mounted, rim.theta_max_deg)


def lens_and_cover(settled: Requirements, focus_mm: float) -> LensAndCover:
    """Return the housing with the lens at a focus; an ideal lens is replaced by a pinhole."""
    optics = settled.lens.optics
    ideal = PARALLEL if settled.lens.is_telecentric else PINHOLE
    lens = ideal if optics is None else optics.focused_at(focus_mm)
    return LensAndCover(lens, settled.housing)


PINHOLE, PARALLEL = Perspective(1.0, 1.0, 10.0), Orthographic(1.0, 1.0, 0.0)


def exact_mapping(
    mirror: MirrorRequirements, rim: RimRay, omega_min_deg: float
) -> MappingMirror | None:
    """Return the mirror with an exact directional mapping for a pinhole; None for others."""
    if mirror.mapping is None:
        return None
    entries = {name: v for name in OF_MAPPINGS if (v := getattr(mirror, name)) is not None}
    exact = mapped_mirror(
        mirror.mapping, rim, omega_min_deg if mirror.is_pointed else 0.0, **entries
    )
    return None if isinstance(exact, FiniteMapping) else exact


def _focus_at(settled: Requirements, nearness: float) -> float:
    """Return the nearest attainable focus distance (mm)."""
    optics = settled.lens.optics
    if optics is None:
        return 1 / nearness if nearness else MAX_FOCUS
    return float(np.clip(1 / nearness if nearness else np.inf, optics.nearest_focus_mm, MAX_FOCUS))


@lru_cache(maxsize=128)
def _kept(mirror: MirrorRequirements, rim: RimRay, omega_min_deg: float) -> MountedMirror:
    """Return a mirror (cached); a search requires the same mirror for many lenses."""
    if mirror.fit is not None:
        return fit_mirror(_kept(replace(mirror, fit=None), rim, omega_min_deg), mirror.fit).mounted
    way = next(name for name in WAYS if getattr(mirror, name) is not None)
    return WAYS[way](mirror, rim, omega_min_deg)


def mapping_deviation_px(settled: Requirements, sensor: Sensor) -> float | None:
    """Return the largest deviation from the requested mapping, px; None without a fit.

    The reference mapping uses the viewing angle and the focused lens of the as-designed sensor.
    """
    mirror = settled.mirror
    around = LensAndCover(sensor.lens, sensor.housing)
    if not around.are_ideal and mirror.mapping is not None:
        theta = 0.0 if sensor.lens.TELECENTRIC else float(np.degrees(sensor.meridian.theta_max))
        rim = RimRay(settled.field.omega_max_deg, theta, sensor.mirror.rim_radius_mm)
        exact = exact_mapping(mirror, rim, settled.field.omega_min_deg)
        mounted = MountedMirror(sensor.mirror, sensor.mirror_distance_mm)
        return (
            None
            if exact is None
            else departure(around, mounted, exact, ANGLES) * sensor.rim_radius_px
        )
    is_polynomial = mirror.family is not None and ":" in mirror.family
    if mirror.fit is None and not is_polynomial:
        return None
    if is_polynomial:
        settled = replace(settled, mirror=replace(mirror, mapping="equidistant", family=None))
    pinhole = _mirror(settled, float(np.degrees(sensor.meridian.theta_max)), fitted=False)
    target = Meridian(pinhole.mirror, pinhole.distance_mm)
    omega = np.radians(np.linspace(0.0, settled.field.omega_max_deg, ANGLES)[1:])
    own, theirs = (
        m.trace(m.x_from_omega(np.minimum(omega, m.omega_max))) for m in (sensor.meridian, target)
    )
    h = [sensor.lens.image_height(r.x, r.w) / sensor.imager.pitch_mm for r in (own, theirs)]
    return float(np.abs(h[0] - h[1]).max())


# -- lens and focus --------------------------------------------------------------------------------


def _imager_radius_mm(settled: Requirements) -> float:
    """Return the largest radius of the rim image permitted by imager and lens."""
    return settled.largest_image_px * settled.imager.pitch_mm


def _telecentric(settled: Requirements) -> Candidate:
    return _focused(settled, _mounted(settled, 0.0, 0.0), _telecentric_lens(settled))


def _telecentric_lens(settled: Requirements) -> Orthographic:
    rim = ends(settled.mirror.rim_radius_mm)[0]
    focus = 0.0 if settled.lens.focus_mm is None else ends(settled.lens.focus_mm)[0]
    requested = ends_or_none(settled.lens.magnification)
    magnification = _imager_radius_mm(settled) / rim if requested is None else requested[0]
    return Orthographic(magnification, ends(settled.lens.f_number)[0], focus)


def _perspective(settled: Requirements) -> Candidate:
    """Solve rim angle, lens, fit and focus jointly.

    The best focus depends on the mirror and the lens; if the rim fills the imager, both depend on
    the focus. The exact mirror gives the initial focus for the fitted one, whose evaluation takes
    longer. The focus of the last iteration is then fixed, and the rim fills the imager exactly even
    without convergence.
    """
    nearness = _first_nearness(settled)
    for fitted in (False, True) if settled.mirror.fit is not None else (False,):
        candidate, nearness = _settled_focus(settled, nearness, fitted)
    if not settled.lens.fills_imager or not (
        settled.lens.focus_mm is None or is_free(settled.lens.focus_mm)
    ):
        return candidate
    fixed = settled.changed(focus_mm=candidate.sensor.lens.focus_distance_mm)
    return replace(
        _before_lens(fixed, 1 / candidate.sensor.lens.focus_distance_mm, fitted), settled=settled
    )


def _first_nearness(settled: Requirements) -> float:
    """Return the given 1/L0, or that of the rim: the virtual images are near the mirror."""
    requested = ends_or_none(settled.lens.focus_mm)
    if requested is not None and not is_free(requested):
        return 1 / requested[0]
    theta, _ = viewing(settled, 0.0)
    near = float(np.tan(np.radians(theta))) / ends(settled.mirror.rim_radius_mm)[0]
    return near if requested is None else float(np.clip(near, 1 / requested[1], 1 / requested[0]))


def _settled_focus(settled: Requirements, nearness: float, fitted: bool) -> tuple[Candidate, float]:
    """Iterate mirror and focus, with or without the fit, from an initial 1/L0."""
    steps = list[tuple[float, float]]()
    for _ in range(MAX_ROUNDS):
        candidate = _before_lens(settled, nearness, fitted)
        vergence = 1 / candidate.sensor.lens.focus_distance_mm
        steps.append((nearness, vergence - nearness))
        if abs(steps[-1][1]) <= SETTLED * vergence or not settled.lens.fills_imager:
            break
        nearness = _next(steps)
    return candidate, vergence


def _next(steps: list[tuple[float, float]]) -> float:
    """Return the next iterate by a secant or a fixed-point step."""
    (x, off) = steps[-1]
    if len(steps) > 1 and (bent := off - steps[-2][1]):
        secant = x - off * (x - steps[-2][0]) / bent
        if abs(secant - x) <= 2 * abs(off):
            return max(secant, 0.0)
    return x + off


def viewing(settled: Requirements, nearness: float) -> tuple[float, float]:
    """Return Theta (deg) and focal length (mm): given values, or values for a rim image that fills
    the imager at a focus 1/L0.

    A filling parameter with a range is limited to the high end of the range, for a smaller image.
    It may fall below the low end if the image would be too large; the requirement is then violated.
    """
    radius, lens = _imager_radius_mm(settled), settled.lens
    theta, focal = ends_or_none(lens.theta_max_deg), ends_or_none(lens.focal_length_mm)
    if focal is None or (is_free(focal) and not is_free(theta)):
        assert theta is not None
        # tan(Theta) = r / b0 with 1/b0 = 1/f - 1/L0 (Eqs. 7, 25), solved for f.
        filling = radius / (np.tan(np.radians(theta[0])) + radius * nearness)
        return theta[0], float(filling if focal is None else min(filling, focal[1]))
    if theta is not None and not is_free(theta):
        return theta[0], focal[0]
    if lens.optics is not None:
        field = lens.optics.focused_at(_focus_at(settled, nearness)).field
        tangent = float(field.tangent_of(np.array([radius]))[0])
        tangent = (
            field.end if np.isnan(tangent) else tangent
        )  # the imager is larger than the image field of the lens
    else:
        tangent = radius * (1 / focal[0] - nearness)
    filling = float(np.degrees(np.arctan(tangent)))
    return (filling if theta is None else min(filling, theta[1])), focal[0]


def sketched(settled: Requirements, nearness: float) -> Sensor:
    """Return the sensor before focusing, with the mirror for a focus 1/L0.

    Raises
    ------
    OmnimirrorError
        If the mirror does not exist or cannot be used.
    """
    if settled.lens.is_telecentric:
        return _unfocused(
            settled, _mounted(settled, 0.0, 0.0, fitted=False), _telecentric_lens(settled)
        )
    theta, focal = viewing(settled, nearness)
    mounted = _mounted(settled, theta, nearness, fitted=False)
    return _unfocused(settled, mounted, _lens(settled, focal, mounted.distance_mm))


def _before_lens(settled: Requirements, nearness: float, fitted: bool) -> Candidate:
    """Return the sensor for a lens focused at 1/L0, at the requested or the best focus."""
    theta, focal = viewing(settled, nearness)
    mounted = _mounted(settled, theta, nearness, fitted)
    requested = ends_or_none(settled.lens.focus_mm)
    return _focused(
        settled,
        mounted,
        _lens(settled, focal, mounted.distance_mm if requested is None else requested[1]),
    )


def _lens(settled: Requirements, focal: float, focus_mm: float) -> Lens:
    """Return the lens at a focus distance or the nearest attainable one."""
    if settled.lens.optics is not None:
        lens: Lens = settled.lens.optics.focused_at(_focus_at(settled, 1 / focus_mm))
        return lens
    return Perspective(focal, ends(settled.lens.f_number)[0], max(focus_mm, 1.001 * focal))


def _unfocused(settled: Requirements, mounted: MountedMirror, lens: Lens) -> Sensor:
    return Sensor(
        mounted.mirror,
        lens,
        settled.imager,
        settled.mount,
        mounted.distance_mm,
        settled.name,
        settled.notes,
        housing=settled.housing,
    )


def _focused(settled: Requirements, mounted: MountedMirror, lens: Lens) -> Candidate:
    """Return the sensor at its best focus, if the requirements leave the focus free."""
    sensor = _unfocused(settled, mounted, lens)
    if settled.lens.focus_mm is None or is_free(settled.lens.focus_mm):
        sensor = sensor.with_lens(lens.focused_at(focusing(settled, sensor).best().focus_mm))
    return Candidate(settled, sensor, mounted.notes)


def focusing(settled: Requirements, sensor: Sensor, points: int = POINTS) -> Focusing:
    """Return the focus-dependent properties of a sensor for settled requirements."""
    radius = np.inf if settled.lens.fills_imager else settled.largest_image_px
    return Focusing(
        sensor, settled.field, settled.limits, radius, ends_or_none(settled.lens.focus_mm), points
    )
