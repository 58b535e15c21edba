"""What requirements look at, of sensors with errors: at every object of the field, in its own two directions.

Of an object, tangential is along the field angle and sagittal round about the axis that was meant. A degree of either
is a vector in the picture of a built sensor; its length is the resolution, the blur's width along it the blur. Without
errors these are Dh, Dw, Delta_t and Delta_s of the meridian (Eqs. 9, 10, 28).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...batch.optics import light_of
from ...design.criteria.merits import FieldValues
from ...errors import OmnimirrorError
from ...lenses import FieldLens, Perspective
from ...lenses.base import cos4
from ...sensor import Sensor
from ...tracing.reflection import Ends
from .compensation import Reference, compensators_of
from .object_field import BEYOND, STEP_DEG, Field, directions_of, field_at, shown_within
from .perturbation import perturbed
from .perturbed_states import Values, states_of
from .trial_images import Refocus, SeenObjects, States, imaged_at, pictured, seen

Array = NDArray[np.float64]

SAG_NODES = 65


class BuiltView(NamedTuple):
    """What trials (t,) do to the objects (n,) of a field."""

    values: FieldValues
    """Arrays (t, n), or (t, 1)."""
    viewpoint: Array
    """(t, 3) mm in the camera frame: the point that all rays pass at the least distance."""
    lost: NDArray[np.intp]
    """(t,) objects."""


class RaysOut(NamedTuple):
    """Where the sensors look, in the camera frame."""

    origins: Array
    """(t, n, 3) mm."""
    directions: Array
    """(t, n, 3)"""


def views_together(field: Field, values: Values, refocus: Refocus) -> tuple[BuiltView, Array]:
    """Of sensors that are traced by the thousand, and vergences (t,) in focus at their pupils, 1/mm."""
    lens = field.sensor.lens
    assert isinstance(lens, Perspective), "no other is traced by the thousand"
    states = states_of(field.sensor, values)
    found = seen(states, field.targets, field.distant, field.start)
    shown = pictured(states, found, refocus)
    _, turned = directions_of(field.omega_deg, field.azimuth_deg)
    turned = np.einsum("tji,njk->tnik", states.rotation, turned)
    distance = states.focal_mm / (1 - states.breathing_mm * shown.vergence)
    airy_px = lens.airy_diameter() / lens.image_f_number() * distance / states.aperture_mm / states.pitch_mm
    viewpoints, middle = seen_from(_rays_out(states, found, field), field.omega_deg)
    scale = np.radians(shown.by_direction @ turned)
    optics = Optics(airy_px, light_of(np.hypot(*np.moveaxis(found.tangents, -1, 0))), distance, *_sizes(states))
    view = looked_at(scale, shown.blur_px, optics, viewpoints)
    return BuiltView(view, middle, found.lost.sum(axis=1)), shown.vergence


class Optics(NamedTuple):
    """Of trials (t,): what is one number for the whole picture, but for the light and the lens's own blur."""

    airy_px: Array
    light: Array
    """(t, n)"""
    image_distance: Array
    length: Array
    sag: Array
    own_t_px: Array | float = 0.0
    own_s_px: Array | float = 0.0
    """(t, n), or 0 of an ideal lens."""


def looked_at(px_per_deg: Array, blur_px: Array, optics: Optics, viewpoints: Array) -> FieldValues:
    """What requirements look at, of a picture's derivatives (t, n, 2, 2) and its blur (t, n, 2, 2)."""
    lengths = np.linalg.norm(px_per_deg, axis=-2)
    along = px_per_deg / lengths[..., None, :]
    widths = np.linalg.norm(np.einsum("tnij,tnik->tnjk", blur_px, along), axis=-2)
    airy, distance, length, sag = (
        v[:, None] for v in (optics.airy_px, optics.image_distance, optics.length, optics.sag)
    )
    floor = 1 + airy**2
    own_t, own_s = (np.broadcast_to(v, lengths.shape[:2]) for v in (optics.own_t_px, optics.own_s_px))
    squares = (blur_px**2).sum(axis=(-2, -1))
    area_px2 = np.sqrt(np.linalg.det(blur_px) ** 2 + floor * squares + floor**2)
    log_area = np.log(area_px2 / np.abs(np.linalg.det(px_per_deg)))
    return FieldValues(
        widths[..., 0], widths[..., 1], lengths[..., 0], lengths[..., 1], log_area, viewpoints,
        np.ones_like(lengths[..., 0]), distance, length, sag, airy, optics.light, own_t, own_s,
    )  # fmt: skip


def seen_from(rays: RaysOut, omega_deg: Array) -> tuple[Array, Array]:
    """Heights (t, n) at which rays come nearest to the axis through the point (t, 3) that is nearest to all of them.

    What looks along the axis has no such height, and takes the mean of the others.
    """
    origins, d = rays
    across = np.eye(3) - d[..., :, None] * d[..., None, :]
    middle = np.linalg.solve(across.sum(axis=1), np.einsum("tnij,tnj->ti", across, origins)[..., None])[..., 0]
    from_middle = origins - middle[:, None]
    along = d[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        reach = (from_middle[..., 2] - along * np.einsum("tni,tni->tn", d, from_middle)) / (1 - along**2)
    heights = middle[:, 2:] + reach
    off_axis = omega_deg > 0
    heights[:, ~off_axis] = heights[:, off_axis].mean(axis=1, keepdims=True)
    return heights, middle


def _rays_out(states: States, found: SeenObjects, field: Field) -> RaysOut:
    x, y = np.moveaxis(found.mirror_points, -1, 0)
    points = np.stack([x, y, states.surfaces.heights(x, y).z], axis=-1)
    origins = np.einsum("tij,tnj->tni", states.rotation, points) + states.shift[:, None]
    if field.distant:
        return RaysOut(origins, np.broadcast_to(field.targets, origins.shape))
    towards = field.targets - origins
    return RaysOut(origins, towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def _sizes(states: States) -> tuple[Array, Array]:
    """Lengths (t,) from the lens to the far end of the mirror, and sags (t,), mm."""
    nodes = np.linspace(0.0, states.surfaces.rim_radius_mm, SAG_NODES)[None]
    heights = states.surfaces.meridian(nodes)
    top = heights.max(axis=1)
    lens = states.pupil[:, 2] - (states.focal_mm - states.breathing_mm)
    return states.shift[:, 2] + top - lens, top - heights.min(axis=1)


RIM_AZIMUTHS = 72
HALVINGS = 40


class RimView(NamedTuple):
    """Of trials (t,), at azimuths (k,) of the rim."""

    reach_px: Array
    """(t, k) from the middle of the imager to the image of the rim."""
    field_to_deg: Array
    """(t, k): the field angle at which the mirror ends."""


def rims_together(sensor: Sensor, values: Values, vergence: Array) -> RimView:
    """Of sensors that are traced by the thousand, focused at vergences (t,): chief rays to points of the rim."""
    states = states_of(sensor, values)
    around, rim = np.arange(RIM_AZIMUTHS) * (2 * np.pi / RIM_AZIMUTHS), states.surfaces.rim_radius_mm
    x, y = (np.broadcast_to(rim * c, (len(states), RIM_AZIMUTHS)) for c in (np.cos(around), np.sin(around)))
    h = states.surfaces.heights(x, y)
    points = np.einsum("tij,tnj->tni", states.rotation, np.stack([x, y, h.z], axis=-1)) + states.shift[:, None]
    normals = np.einsum("tij,tnj->tni", states.rotation, np.stack([h.gx, h.gy, -np.ones_like(x)], axis=-1))
    towards = points - states.pupil[:, None]
    turned = 2 * (towards * normals).sum(axis=-1) / (normals**2).sum(axis=-1)
    out = towards - turned[..., None] * normals
    omega = np.degrees(np.arctan2(np.hypot(out[..., 0], out[..., 1]), -out[..., 2]))
    offsets = imaged_at(states, towards[..., :2] / towards[..., 2:], vergence)
    return RimView(_reach(sensor, offsets), omega)


def rims_one_by_one(sensor: Sensor, values: Values, focus_mm: Array) -> RimView:
    """Of sensors of any kind, focused at (t,) mm: where rays of the lens begin to miss the mirror, by halving."""
    found = np.full((2, len(focus_mm), RIM_AZIMUTHS), np.nan)
    for k, focus in enumerate(focus_mm):
        try:
            built = perturbed(sensor, {name: float(of[k]) for name, of in values.items()})
            found[:, k] = _rim_of(sensor, built.with_lens(built.lens.focused_at(float(focus))))
        except OmnimirrorError:
            continue
    return RimView(*found)


def _rim_of(meant: Sensor, built: Sensor) -> tuple[Array, Array]:
    """Reaches (k,) in px and field angles (k,) in deg of one sensor, on an imager that is large enough."""
    around = np.arange(RIM_AZIMUTHS) * (2 * np.pi / RIM_AZIMUTHS)
    towards = np.stack([np.cos(around), np.sin(around)], axis=-1)
    size = 4 * int(np.ceil(meant.rim_radius_px))
    wide = replace(built, imager=replace(built.imager, width_px=size, height_px=size, centre_px=None))
    middle = (size - 1) / 2
    low, high = np.full(RIM_AZIMUTHS, 0.5 * meant.rim_radius_px), np.full(RIM_AZIMUTHS, 1.6 * meant.rim_radius_px)
    for _ in range(HALVINGS):
        radius = (low + high) / 2
        valid = wide.backproject(middle + radius[:, None] * towards).valid
        low, high = np.where(valid, radius, low), np.where(valid, high, radius)
    rays = wide.backproject(middle + low[:, None] * towards)
    out = rays.directions @ built._axes
    omega = np.degrees(np.arctan2(np.hypot(out[:, 0], out[:, 1]), -out[:, 2]))
    offsets = low[:, None] * towards + np.subtract(built.imager.centre, meant.imager.centre)
    return _reach(meant, offsets), omega


def _reach(sensor: Sensor, offsets_px: Array) -> Array:
    """How far (..) places (.., 2) from the optical axis that was meant are from the middle of the imager, px."""
    width, height = sensor.imager.size
    middle = np.subtract(((width - 1) / 2, (height - 1) / 2), sensor.imager.centre)
    distance: Array = np.linalg.norm(offsets_px - middle, axis=-1)
    return distance


class _Seen(NamedTuple):
    """Of one sensor: arrays over objects (n,), and single numbers."""

    px_per_deg: Array
    blur_px: Array
    origins: Array
    directions: Array
    optics: tuple[Array | float, ...]
    focus_mm: float
    lost: int


def views_one_by_one(field: Field, values: Values, refocus: Refocus) -> tuple[BuiltView, Array]:
    """Of trials (t,) of a field, and the distances (t,) mm that they are focused at; one that cannot be loses all."""
    trials = len(next(iter(values.values())))
    seen = [_seen_by(field, {name: float(of[k]) for name, of in values.items()}, refocus) for k in range(trials)]
    scale, blur, origins, out = (np.stack(arrays) for arrays in list(zip(*seen, strict=True))[:4])
    optics = Optics(*(np.array(numbers) for numbers in zip(*(one.optics for one in seen), strict=True)))
    with np.errstate(all="ignore"):  # what is lost is not a number
        heights, middle = seen_from(RaysOut(origins, out), field.omega_deg)
        view = looked_at(scale, blur, optics, heights)
    return BuiltView(view, middle, np.array([one.lost for one in seen])), np.array([one.focus_mm for one in seen])


def _seen_by(field: Field, errors: dict[str, float], refocus: Refocus) -> _Seen:
    n, targets = len(field), Ends(field.targets, field.distant)
    try:
        built = perturbed(field.sensor, errors)
        shown = shown_within(built, field.sensor, targets, refocus)
        built = built.with_lens(built.lens.focused_at(shown.focus_mm))
        with np.errstate(all="ignore"):
            scale = _px_per_deg(built, field)
            return _Seen(
                scale,
                shown.blur_px,
                *_rays(built, field),
                _optics(built, targets),
                shown.focus_mm,
                int(shown.lost.sum()),
            )
    except OmnimirrorError:
        blank, pair, lens = np.full((n, 3), np.nan), np.full((n, 2, 2), np.nan), np.full(n, np.nan)
        return _Seen(pair, pair, blank, blank, (np.nan, lens, np.nan, np.nan, np.nan, lens, lens), np.nan, n)


def _px_per_deg(built: Sensor, field: Field) -> Array:
    """How far (n, 2, 2) a degree of an object moves its picture, by differences."""
    _, turned = directions_of(field.omega_deg, field.azimuth_deg)
    distance = 1.0 if field.distant else np.linalg.norm(field.targets - _mirror_points(built, field), axis=1)[:, None]
    columns = []
    for k in range(2):
        step, ends = np.radians(STEP_DEG) * distance * turned[..., k], []
        for sign in (1, -1):
            moved = field.targets + sign * step
            moved = moved / np.linalg.norm(moved, axis=1, keepdims=True) if field.distant else moved
            ends.append(shown_within(built, field.sensor, Ends(moved, field.distant), rim_slack=BEYOND).offsets_px)
        columns.append((ends[0] - ends[1]) / (2 * STEP_DEG))
    return np.stack(columns, axis=-1)


def _mirror_points(built: Sensor, field: Field) -> Array:
    return built.optical_train.chief_rays_to(Ends(field.targets, field.distant)).points


def _rays(built: Sensor, field: Field) -> tuple[Array, Array]:
    """Origins and directions (n, 3) of the rays that leave the sensor towards the objects, in the camera frame.

    The way back from the picture: it goes through covers too.
    """
    wide = replace(built, imager=replace(built.imager, width_px=100_000, height_px=100_000, centre_px=None))
    targets = field.targets @ built._axes.T
    rays = wide.backproject((wide.project_directions(targets) if field.distant else wide.project(targets)).pixels)
    return rays.origins @ built._axes, rays.directions @ built._axes


def _optics(built: Sensor, targets: Ends) -> tuple[Array | float, ...]:
    """As :class:`.values.Optics` has them, of one sensor."""
    lens, pitch = built.lens, built.imager.pitch_mm
    slopes = built.optical_train.chief_rays_to(targets).chief_slopes
    tangent = np.hypot(*slopes.T)
    none = np.zeros_like(tangent)
    light, own_t, own_s = none + 1 if lens.TELECENTRIC else cos4(slopes), none, none
    if isinstance(lens, FieldLens):
        light = lens.field.at(tangent).illumination
        own_t, own_s = (blur / pitch for blur in lens.own_blur(lens.principal_distance * tangent))
    (_, _), (bottom, top) = built.mirror.bounds
    away = built.mirror_distance_mm if np.isfinite(built.mirror_distance_mm) else 0.0
    length = top + away + built.mirror_pose.displacement_mm
    distance = lens.image_distance if isinstance(lens, Perspective) else 0.0
    return lens.airy_diameter() / pitch, light, distance, length, top - bottom, own_t, own_s


Motions = Callable[[Reference, Values], Array]
"""Motions (t, 2 n) px of the objects of a reference."""

LINE_DEG = 60.0
LINE_POINTS = 7
LINE_CENTRES, LINE_AZIMUTHS = 4, 8


@dataclass(frozen=True)
class StraightLines:
    """Lines (l,) of objects (p,), and what takes their departure from a motion.

    Attributes
    ----------
    reference
        Of all objects, line by line.
    across : (l, p, 2)
        Unit vectors across the lines, over field angle and round about.
    rest : (p, p)
        What a fit of a great circle leaves of departures, by points.
    """

    reference: Reference
    across: Array
    rest: Array

    @classmethod
    def of(cls, field: Field, refocus: Refocus, distance_mm: float, floor_px2: float) -> StraightLines:
        """Over the part of the field that is judged."""
        low, high = field.omega_deg.min(), field.omega_deg.max()
        omega, azimuth, across = lines_over(float(low), float(high))
        objects = field_at(field.sensor, omega.ravel(), azimuth.ravel(), distance_mm)
        shown = objects.shown({}, 1, refocus=refocus)[0].offsets_px[0]
        reference = Reference(objects, compensators_of(objects), shown, refocus, floor_px2)
        tau = np.radians(np.linspace(-0.5, 0.5, LINE_POINTS) * line_length(low, high))
        fit = np.stack([np.cos(tau), np.sin(tau)], axis=-1)
        return cls(reference, across, np.eye(LINE_POINTS) - fit @ np.linalg.pinv(fit))

    def departures(self, moved: Array) -> Array:
        """Departures (calibrations, t, l, p) in deg of motions (t, 2 n) px, and of what calibrations leave."""
        left = self.reference.compensators.left(moved)
        vectors = np.stack(np.split(left, 2, axis=-1), axis=-1)
        turned = np.einsum("nij,ctnj->ctni", np.linalg.inv(self.reference.field.px_per_deg), vectors)
        lines, points, _ = self.across.shape
        across = np.einsum("lpi,ctlpi->ctlp", self.across, turned.reshape(*turned.shape[:2], lines, points, 2))
        departures: Array = across @ self.rest
        return departures


def line_length(low_deg: float, high_deg: float) -> float:
    """Of lines within a field; where it is narrower than they are, as long as it is."""
    return min(LINE_DEG, high_deg - low_deg)


def lines_over(low_deg: float, high_deg: float) -> tuple[Array, Array, Array]:
    """Field angles and azimuths (l, p) of points of lines, and unit vectors (l, p, 2) across them.

    Lines along the field angle first; then those across, as many of them as are within the field.
    """
    length = line_length(low_deg, high_deg)
    tau = np.linspace(-0.5, 0.5, LINE_POINTS) * length
    around = np.arange(LINE_AZIMUTHS) * (360.0 / LINE_AZIMUTHS)
    omega, azimuth, across = [], [], []
    for centre in np.linspace(low_deg + length / 2, high_deg - length / 2, LINE_CENTRES):
        for phi in around:
            omega.append(centre + tau)
            azimuth.append(np.full(LINE_POINTS, phi))
            across.append(np.tile([0.0, 1.0], (LINE_POINTS, 1)))
    for centre in np.linspace(low_deg, high_deg, LINE_CENTRES):
        bent, aside, vectors = _across_at(centre, tau)
        if bent.min() < low_deg - 1e-9 or bent.max() > high_deg + 1e-9 or centre == 0:
            continue
        for phi in around:
            omega.append(bent)
            azimuth.append(phi + aside)
            across.append(vectors)
    return np.array(omega), np.array(azimuth), np.array(across)


def _across_at(omega_deg: float, tau_deg: Array) -> tuple[Array, Array, Array]:
    """Field angles, azimuths and unit vectors across, of the great circle that crosses a meridian squarely."""
    middle, tau = np.radians(omega_deg), np.radians(tau_deg)
    towards = np.array([np.sin(middle), 0.0, -np.cos(middle)])
    d = np.cos(tau)[:, None] * towards + np.sin(tau)[:, None] * np.array([0.0, 1.0, 0.0])
    normal = np.cross(towards, [0.0, 1.0, 0.0])
    omega = np.arctan2(np.hypot(d[:, 0], d[:, 1]), -d[:, 2])
    azimuth = np.arctan2(d[:, 1], d[:, 0])
    tangential = np.stack([np.cos(omega) * np.cos(azimuth), np.cos(omega) * np.sin(azimuth), np.sin(omega)], axis=-1)
    sagittal = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
    return np.degrees(omega), np.degrees(azimuth), np.stack([tangential @ normal, sagittal @ normal], axis=-1)
