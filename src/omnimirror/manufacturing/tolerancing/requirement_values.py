"""Quantities of requirement files for sensors with errors, at every object of the field.

Directions at an object are tangential (along the field angle) and sagittal (along the azimuth about
the nominal axis). One degree along either is a vector in the image of the as-built sensor; its
length is the resolution, and the width of the blur along it is the blur. For the nominal sensor,
these are Dh, Dw, Delta_t and Delta_s of the meridian (Eqs. 9, 10, 28). Straightness is the maximum
distance of the points of a line from the best-fit great circle after dewarping with the nominal or
calibrated sensor; lines of 60 deg along and across field angles are evaluated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...base.typing import Array
from ...design.merits import FieldValues
from ...optics.batch.closed_forms import light_of
from ...optics.lenses import FieldLens, Perspective
from ...optics.lenses.lens import cos4
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import RayEndpoints
from .compensation import Reference, fit_compensators
from .perturbed_states import States, Values, states_of
from .tolerances import perturbed
from .trial_images import (
    RIM_MARGIN,
    STEP_DEG,
    Field,
    Refocus,
    TracedObjects,
    directions_of,
    field_at,
    form_images,
    imaged_at,
    images_within_rim,
    trace_objects,
)

SAG_NODES = 65


class TrialView(NamedTuple):
    """Quantities of trials (t,) at objects (n,)."""

    values: FieldValues
    """Arrays (t, n) or (t, 1)."""
    viewpoint: Array
    """Points (t, 3) in mm in the camera frame with minimum distance from all rays."""
    lost: NDArray[np.intp]
    """Number (t,) of lost objects."""


class ExitRays(NamedTuple):
    """Object-side rays in the camera frame."""

    origins: Array
    """Origins (t, n, 3) in mm."""
    directions: Array
    """Directions (t, n, 3)."""


def vectorised_views(field: Field, values: Values, refocus: Refocus) -> tuple[TrialView, Array]:
    """Evaluate trials vectorised; also return focus vergences (t,) at the pupils, 1/mm."""
    lens = field.sensor.lens
    assert isinstance(lens, Perspective), "vectorised evaluation requires a perspective lens"
    states = states_of(field.sensor, values)
    result = trace_objects(states, field.targets, field.distant, field.start)
    images = form_images(states, result, refocus)
    _, turned = directions_of(field.omega_deg, field.azimuth_deg)
    turned = np.einsum("tji,njk->tnik", states.rotation, turned)
    distance = states.focal_mm / (1 - states.breathing_mm * images.vergence)
    airy_px = (
        lens.airy_diameter()
        / lens.image_f_number()
        * distance
        / states.aperture_mm
        / states.pitch_mm
    )
    rays = _rays_out(states, result, field)
    viewpoints, middle = viewpoint_heights(rays, field.omega_deg)
    scale = np.radians(images.by_direction @ turned)
    optics = Optics(
        airy_px, light_of(np.hypot(*np.moveaxis(result.tangents, -1, 0))), distance, *_sizes(states)
    )
    view = field_values(scale, images.blur_px, optics, viewpoints, field, rays.origins)
    return TrialView(view, middle, result.lost.sum(axis=1)), images.vergence


class Optics(NamedTuple):
    """Parameters of trials (t,) that are constant over the image, except light and lens blur."""

    airy_px: Array
    light: Array
    """Relative illumination (t, n)."""
    image_distance: Array
    length: Array
    sag: Array
    own_t_px: Array | float = 0.0
    own_s_px: Array | float = 0.0
    """Blur of the lens itself (t, n); 0 for an ideal lens."""


def field_values(
    px_per_deg: Array,
    blur_px: Array,
    optics: Optics,
    viewpoints: Array,
    field: Field,
    origins: Array,
) -> FieldValues:
    """Compute quantities from image derivatives (t, n, 2, 2) and blur matrices (t, n, 2, 2).

    ``origins`` (t, n, 3) are the points at which rays leave the sensor, mm. They determine the object
    distances, which quantities per millimetre of the object require.
    """
    lengths = np.linalg.norm(px_per_deg, axis=-2)
    along = px_per_deg / lengths[..., None, :]
    widths = np.linalg.norm(np.einsum("tnij,tnik->tnjk", blur_px, along), axis=-2)
    airy, distance, length, sag = (
        v[:, None] for v in (optics.airy_px, optics.image_distance, optics.length, optics.sag)
    )
    floor = 1 + airy**2
    own_t, own_s = (
        np.broadcast_to(v, lengths.shape[:2]) for v in (optics.own_t_px, optics.own_s_px)
    )
    squares = (blur_px**2).sum(axis=(-2, -1))
    area_px2 = np.sqrt(np.linalg.det(blur_px) ** 2 + floor * squares + floor**2)
    log_area = np.log(area_px2 / np.abs(np.linalg.det(px_per_deg)))
    return FieldValues(
        widths[..., 0],
        widths[..., 1],
        lengths[..., 0],
        lengths[..., 1],
        log_area,
        viewpoints,
        np.ones_like(lengths[..., 0]),
        distance,
        length,
        sag,
        airy,
        optics.light,
        own_t,
        own_s,
        omega=np.broadcast_to(np.radians(field.omega_deg), lengths.shape[:2]),
        near=_inverse_distances(field, origins),
    )


def _inverse_distances(field: Field, origins: Array) -> Array:
    """Return inverse object distances (t, n) in 1/mm; 0 for objects at infinity."""
    if field.distant:
        return np.zeros(origins.shape[:2])
    return np.asarray(1 / np.linalg.norm(field.targets - origins, axis=-1))


def viewpoint_heights(rays: ExitRays, omega_deg: Array) -> tuple[Array, Array]:
    """Return heights (t, n) of the rays' closest approach to the axis, and the viewpoints (t, 3).

    The axis passes through the point of minimum distance from all rays. Axial rays receive the mean of
    the other heights.
    """
    origins, d = rays
    across = np.eye(3) - d[..., :, None] * d[..., None, :]
    middle = np.linalg.solve(
        across.sum(axis=1), np.einsum("tnij,tnj->ti", across, origins)[..., None]
    )[..., 0]
    from_middle = origins - middle[:, None]
    along = d[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        reach = (from_middle[..., 2] - along * np.einsum("tni,tni->tn", d, from_middle)) / (
            1 - along**2
        )
    heights = middle[:, 2:] + reach
    off_axis = omega_deg > 0
    heights[:, ~off_axis] = heights[:, off_axis].mean(axis=1, keepdims=True)
    return heights, middle


def _rays_out(states: States, result: TracedObjects, field: Field) -> ExitRays:
    x, y = np.moveaxis(result.mirror_points, -1, 0)
    points = np.stack([x, y, states.surfaces.heights(x, y).z], axis=-1)
    origins = np.einsum("tij,tnj->tni", states.rotation, points) + states.shift[:, None]
    if field.distant:
        return ExitRays(origins, np.broadcast_to(field.targets, origins.shape))
    towards = field.targets - origins
    return ExitRays(origins, towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def _sizes(states: States) -> tuple[Array, Array]:
    """Return lengths (t,) from lens to mirror end, and sags (t,), mm."""
    nodes = np.linspace(0.0, states.surfaces.rim_radius_mm, SAG_NODES)[None]
    heights = states.surfaces.meridian(nodes)
    top = heights.max(axis=1)
    lens = states.pupil[:, 2] - (states.focal_mm - states.breathing_mm)
    return states.shift[:, 2] + top - lens, top - heights.min(axis=1)


RIM_AZIMUTHS = 72
HALVINGS = 40


class RimView(NamedTuple):
    """Rim of trials (t,) at azimuths (k,)."""

    reach_px: Array
    """Distance (t, k) from the image centre to the image of the rim."""
    field_to_deg: Array
    """Field angle (t, k) at the rim."""


def vectorised_rims(sensor: Sensor, values: Values, vergence: Array) -> RimView:
    """Trace chief rays to rim points of vectorised trials, focused at vergences (t,)."""
    states = states_of(sensor, values)
    around, rim = (
        np.arange(RIM_AZIMUTHS) * (2 * np.pi / RIM_AZIMUTHS),
        states.surfaces.rim_radius_mm,
    )
    x, y = (
        np.broadcast_to(rim * c, (len(states), RIM_AZIMUTHS))
        for c in (np.cos(around), np.sin(around))
    )
    h = states.surfaces.heights(x, y)
    points = (
        np.einsum("tij,tnj->tni", states.rotation, np.stack([x, y, h.z], axis=-1))
        + states.shift[:, None]
    )
    normals = np.einsum(
        "tij,tnj->tni", states.rotation, np.stack([h.gx, h.gy, -np.ones_like(x)], axis=-1)
    )
    towards = points - states.pupil[:, None]
    turned = 2 * (towards * normals).sum(axis=-1) / (normals**2).sum(axis=-1)
    out = towards - turned[..., None] * normals
    omega = np.degrees(np.arctan2(np.hypot(out[..., 0], out[..., 1]), -out[..., 2]))
    offsets = imaged_at(states, towards[..., :2] / towards[..., 2:], vergence)
    return RimView(_reach(sensor, offsets), omega)


def sequential_rims(sensor: Sensor, values: Values, focus_mm: Array) -> RimView:
    """Find the rims of arbitrary sensors, focused at (t,) mm, by bisection of back-projected rays."""
    result = np.full((2, len(focus_mm), RIM_AZIMUTHS), np.nan)
    for k, focus in enumerate(focus_mm):
        try:
            built = perturbed(sensor, {name: float(of[k]) for name, of in values.items()})
            result[:, k] = _rim_of(sensor, built.with_lens(built.lens.focused_at(float(focus))))
        except OmnimirrorError:
            continue
    return RimView(*result)


def _rim_of(nominal: Sensor, built: Sensor) -> tuple[Array, Array]:
    """Return rim distances (k,) in px and field angles (k,) in deg of one sensor on an enlarged
    imager.
    """
    around = np.arange(RIM_AZIMUTHS) * (2 * np.pi / RIM_AZIMUTHS)
    towards = np.stack([np.cos(around), np.sin(around)], axis=-1)
    size = 4 * int(np.ceil(nominal.rim_radius_px))
    wide = replace(
        built, imager=replace(built.imager, width_px=size, height_px=size, centre_px=None)
    )
    middle = (size - 1) / 2
    low, high = (
        np.full(RIM_AZIMUTHS, 0.5 * nominal.rim_radius_px),
        np.full(RIM_AZIMUTHS, 1.6 * nominal.rim_radius_px),
    )
    for _ in range(HALVINGS):
        radius = (low + high) / 2
        valid = wide.backproject(middle + radius[:, None] * towards).valid
        low, high = np.where(valid, radius, low), np.where(valid, high, radius)
    rays = wide.backproject(middle + low[:, None] * towards)
    out = rays.directions @ built._axes
    omega = np.degrees(np.arctan2(np.hypot(out[:, 0], out[:, 1]), -out[:, 2]))
    offsets = low[:, None] * towards + np.subtract(built.imager.centre, nominal.imager.centre)
    return _reach(nominal, offsets), omega


def _reach(sensor: Sensor, offsets_px: Array) -> Array:
    """Convert offsets (..., 2) from the nominal axis to distances (...) from the imager centre, px."""
    width, height = sensor.imager.size
    middle = np.subtract(((width - 1) / 2, (height - 1) / 2), sensor.imager.centre)
    distance: Array = np.linalg.norm(offsets_px - middle, axis=-1)
    return distance


class _Seen(NamedTuple):
    """Evaluation of one sensor: arrays over objects (n,) and scalars."""

    px_per_deg: Array
    blur_px: Array
    origins: Array
    directions: Array
    optics: tuple[Array | float, ...]
    focus_mm: float
    lost: int


def sequential_views(field: Field, values: Values, refocus: Refocus) -> tuple[TrialView, Array]:
    """Evaluate trials one at a time; also return focus distances (t,) in mm.

    Physically impossible sensors lose all objects.
    """
    trials = len(next(iter(values.values())))
    visible = [
        _seen_by(field, {name: float(of[k]) for name, of in values.items()}, refocus)
        for k in range(trials)
    ]
    scale, blur, origins, out = (
        np.stack(arrays) for arrays in list(zip(*visible, strict=True))[:4]
    )
    optics = Optics(
        *(np.array(numbers) for numbers in zip(*(one.optics for one in visible), strict=True))
    )
    with np.errstate(all="ignore"):  # NaN for lost rays
        heights, middle = viewpoint_heights(ExitRays(origins, out), field.omega_deg)
        view = field_values(scale, blur, optics, heights, field, origins)
    return TrialView(view, middle, np.array([one.lost for one in visible])), np.array(
        [one.focus_mm for one in visible]
    )


def _seen_by(field: Field, errors: dict[str, float], refocus: Refocus) -> _Seen:
    n, targets = len(field), RayEndpoints(field.targets, field.distant)
    try:
        built = perturbed(field.sensor, errors)
        images = images_within_rim(built, field.sensor, targets, refocus)
        built = built.with_lens(built.lens.focused_at(images.focus_mm))
        with np.errstate(all="ignore"):
            scale = _px_per_deg(built, field)
            return _Seen(
                scale,
                images.blur_px,
                *_rays(built, field),
                _optics(built, targets),
                images.focus_mm,
                int(images.lost.sum()),
            )
    except OmnimirrorError:
        blank, pair, lens = np.full((n, 3), np.nan), np.full((n, 2, 2), np.nan), np.full(n, np.nan)
        return _Seen(
            pair, pair, blank, blank, (np.nan, lens, np.nan, np.nan, np.nan, lens, lens), np.nan, n
        )


def _px_per_deg(built: Sensor, field: Field) -> Array:
    """Return image derivatives (n, 2, 2) in px per degree of object direction, by central
    differences.
    """
    _, turned = directions_of(field.omega_deg, field.azimuth_deg)
    distance = (
        1.0
        if field.distant
        else np.linalg.norm(field.targets - _mirror_points(built, field), axis=1)[:, None]
    )
    columns = []
    for k in range(2):
        step, ends = np.radians(STEP_DEG) * distance * turned[..., k], []
        for sign in (1, -1):
            displaced = field.targets + sign * step
            displaced = (
                displaced / np.linalg.norm(displaced, axis=1, keepdims=True)
                if field.distant
                else displaced
            )
            ends.append(
                images_within_rim(
                    built,
                    field.sensor,
                    RayEndpoints(displaced, field.distant),
                    rim_slack=RIM_MARGIN,
                ).offsets_px
            )
        columns.append((ends[0] - ends[1]) / (2 * STEP_DEG))
    return np.stack(columns, axis=-1)


def _mirror_points(built: Sensor, field: Field) -> Array:
    return built.optical_train.chief_rays_to(RayEndpoints(field.targets, field.distant)).points


def _rays(built: Sensor, field: Field) -> tuple[Array, Array]:
    """Return origins and directions (n, 3) of object-side rays in the camera frame."""
    wide = replace(
        built, imager=replace(built.imager, width_px=100_000, height_px=100_000, centre_px=None)
    )
    targets = field.targets @ built._axes.T
    rays = wide.backproject(
        (wide.project_directions(targets) if field.distant else wide.project(targets)).pixels
    )
    return rays.origins @ built._axes, rays.directions @ built._axes


def _optics(built: Sensor, targets: RayEndpoints) -> tuple[Array | float, ...]:
    """Return the parameters of :class:`Optics` for one sensor."""
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
"""Function that computes motions (t, 2 n) in px of the objects of a reference."""

LINE_DEG = 60.0
LINE_POINTS = 7
LINE_CENTRES, LINE_AZIMUTHS = 4, 8


@dataclass(frozen=True)
class StraightLines:
    """Straight lines (l,) of object points (p,) and their departure after image motions.

    Attributes
    ----------
    reference
        Reference of all points, line by line.
    across : (l, p, 2)
        Unit vectors perpendicular to the lines, in field angle and azimuth.
    rest : (p, p)
        Residual projection of a great-circle fit.
    """

    reference: Reference
    across: Array
    rest: Array

    @classmethod
    def of(
        cls, field: Field, refocus: Refocus, distance_mm: float, floor_px2: float
    ) -> StraightLines:
        """Create lines over the evaluated field."""
        low, high = field.omega_deg.min(), field.omega_deg.max()
        omega, azimuth, across = lines_over(float(low), float(high))
        objects = field_at(field.sensor, omega.ravel(), azimuth.ravel(), distance_mm)
        offsets_px = objects.images_and_focus({}, 1, refocus=refocus)[0].offsets_px[0]
        reference = Reference(objects, fit_compensators(objects), offsets_px, refocus, floor_px2)
        tau = np.radians(np.linspace(-0.5, 0.5, LINE_POINTS) * line_length(low, high))
        fit = np.stack([np.cos(tau), np.sin(tau)], axis=-1)
        return cls(reference, across, np.eye(LINE_POINTS) - fit @ np.linalg.pinv(fit))

    def departures(self, displaced: Array) -> Array:
        """Return departures (calibrations, t, l, p) in deg of motions (t, 2 n) in px after
        calibrations.
        """
        residuals = self.reference.compensators.left(displaced)
        vectors = np.stack(np.split(residuals, 2, axis=-1), axis=-1)
        turned = np.einsum(
            "nij,ctnj->ctni", np.linalg.inv(self.reference.field.px_per_deg), vectors
        )
        lines, points, _ = self.across.shape
        across = np.einsum(
            "lpi,ctlpi->ctlp", self.across, turned.reshape(*turned.shape[:2], lines, points, 2)
        )
        departures: Array = across @ self.rest
        return departures


def line_length(low_deg: float, high_deg: float) -> float:
    """Return the line length, limited to the field."""
    return min(LINE_DEG, high_deg - low_deg)


def lines_over(low_deg: float, high_deg: float) -> tuple[Array, Array, Array]:
    """Return field angles and azimuths (l, p) of line points, and unit vectors (l, p, 2) across the lines.

    Lines along the field angle come first, then those across it that are within the field.
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
    """Return field angles, azimuths and transverse unit vectors of a great circle across a
    meridian.
    """
    middle, tau = np.radians(omega_deg), np.radians(tau_deg)
    towards = np.array([np.sin(middle), 0.0, -np.cos(middle)])
    d = np.cos(tau)[:, None] * towards + np.sin(tau)[:, None] * np.array([0.0, 1.0, 0.0])
    normal = np.cross(towards, [0.0, 1.0, 0.0])
    omega = np.arctan2(np.hypot(d[:, 0], d[:, 1]), -d[:, 2])
    azimuth = np.arctan2(d[:, 1], d[:, 0])
    tangential = np.stack(
        [np.cos(omega) * np.cos(azimuth), np.cos(omega) * np.sin(azimuth), np.sin(omega)], axis=-1
    )
    sagittal = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
    return (
        np.degrees(omega),
        np.degrees(azimuth),
        np.stack([tangential @ normal, sagittal @ normal], axis=-1),
    )
