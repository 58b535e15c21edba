"""Images of objects over the field, nominal and with errors, and their blur.

The objects of all trials are the same. Vectorised sensors are traced together, arbitrary sensors one
after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import numbers
from ...base.errors import InvalidParameter, OmnimirrorError, SelfObstruction
from ...base.typing import Array
from ...optics.image_sensor import ImagerPose
from ...optics.lenses import Perspective
from ...optics.mirrors.mirror import MirrorPose
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import REFLECTION_TOLERANCE, RIM_SLACK, RayEndpoints
from .perturbed_states import MirrorSurfaces, States, Values, is_vectorised, states_of
from .tolerances import check_error_names, perturbed

STEPS = 8
"""Maximum number of Newton steps; three are sufficient from 0.1 mm and 0.1 deg."""
CLOSE = 1e-13  # convergence limit, in rim radii


class TracedObjects(NamedTuple):
    """Rays from objects (n,) to the lens in trials (t,)."""

    mirror_points: Array
    """Reflection points (t, n, 2) in mm, (x, y) in the mirror frame."""
    tangents: Array
    """Tangents (t, n, 2) of the viewing angle at the lens, right and down in the unmirrored image."""
    vergences: Array
    """Vergence matrices V (t, n, 2, 2) in 1/mm, right and down in the image."""
    by_direction: Array
    """Derivatives (t, n, 2, 3) of tangents with respect to the object direction in the mirror
    frame."""
    lost: NDArray[np.bool_]
    """Rays (t, n) that miss the mirror or do not converge."""


def trace_objects(
    states: States, targets: Array, distant: bool, start: Array, rim_slack: float = RIM_SLACK
) -> TracedObjects:
    """Trace rays from objects to the lens in all trials.

    Parameters
    ----------
    states
        Parameters of t trials.
    targets : (n, 3)
        Unit directions, or points in mm, in the camera frame with the nominal vertex as origin.
    distant
        Whether targets are directions.
    start : (n, 2)
        Reflection points (x, y) in mm of the nominal sensor.
    rim_slack
        Extension of the mirror beyond its rim, as a fraction of the rim radius.

    Returns
    -------
    TracedObjects
        Reflection points, tangents and vergences.
    """
    with np.errstate(all="ignore"):  # NaN for lost rays
        pupil = np.einsum("tji,tj->ti", states.rotation, states.pupil - states.shift)
        towards = targets if distant else targets - states.shift[:, None, :]
        towards = np.einsum(
            "tji,...nj->tni" if distant else "tji,tnj->tni", states.rotation, towards
        )
        xy = _mirror_points(states.surfaces, pupil, towards, distant, start)
        path = _path(states.surfaces, pupil, towards, distant, xy)
        return _seen(states, path, xy, rim_slack)


class _Path(NamedTuple):
    """Optical path via mirror points and its derivatives with respect to (x, y)."""

    step: Array
    """Vector (t, n, 3) from pupil to mirror, mm."""
    length: Array
    """Length (t, n) of ``step``."""
    gradient: Array
    """Gradient (t, n, 2)."""
    whole: Array
    """Components xx, xy, yy (t, n, 3) of H."""
    without_pupil: Array
    """Components xx, xy, yy (t, n, 3) of B."""
    slopes: Array
    """Slopes (t, n, 2) of the surface."""
    facing: Array
    """Sign (t, n): positive for a reflection, negative for a straight path."""


def _path(
    surfaces: MirrorSurfaces, pupil: Array, towards: Array, distant: bool, xy: Array
) -> _Path:
    x, y = xy[..., 0], xy[..., 1]
    h = surfaces.heights(x, y)
    point = np.stack([x, y, h.z], axis=-1)
    step = point - pupil[:, None, :]
    length, ux, uy, uz, from_pupil = _end(step, h.gx, h.gy)
    if distant:
        tx, ty, tz = np.moveaxis(towards, -1, 0)
        px, py, pull, from_target = -tx - h.gx * tz, -ty - h.gy * tz, -tz, np.zeros(1)
    else:
        _, px, py, pull, from_target = _end(point - towards, h.gx, h.gy)
    gradient = np.stack([ux + px, uy + py], axis=-1)
    bent = (uz + pull)[..., None] * np.stack([h.hxx, h.hxy, h.hyy], axis=-1) + from_target
    return _Path(
        step, length, gradient, bent + from_pupil, bent, np.stack([h.gx, h.gy], axis=-1), uz + pull
    )


def _end(step: Array, gx: Array, gy: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return the distance of surface points from an end, its x and y derivatives on the surface,
    the z component of the unit vector, and second derivatives (..., 3).
    """
    length = np.sqrt(np.einsum("tni,tni->tn", step, step))
    u = step / length[..., None]
    ux, uy = u[..., 0] + gx * u[..., 2], u[..., 1] + gy * u[..., 2]
    second = np.stack([1 + gx * gx - ux * ux, gx * gy - ux * uy, 1 + gy * gy - uy * uy], axis=-1)
    return length, ux, uy, u[..., 2], second / length[..., None]


def _mirror_points(
    surfaces: MirrorSurfaces, pupil: Array, towards: Array, distant: bool, start: Array
) -> Array:
    """Find reflection points (t, n, 2) in mm by Newton's method."""
    xy = np.broadcast_to(start, (len(pupil), *start.shape)).copy()
    for _ in range(STEPS):
        path = _path(surfaces, pupil, towards, distant, xy)
        a, b, c = np.moveaxis(path.whole, -1, 0)
        gx, gy = np.moveaxis(path.gradient, -1, 0)
        step = np.stack([c * gx - b * gy, a * gy - b * gx], axis=-1) / (a * c - b * b)[..., None]
        xy -= step
        if not np.nanmax(np.abs(step), initial=0.0) > CLOSE * surfaces.rim_radius_mm:
            break
    return xy


def _seen(states: States, path: _Path, xy: Array, rim_slack: float) -> TracedObjects:
    turn = states.rotation
    towards = np.einsum("tij,tnj->tni", turn, path.step)
    tangents = towards[..., :2] / towards[..., 2:]
    sideways = np.zeros((*xy.shape, 3))  # tangent vectors along x and y in the mirror frame
    sideways[..., 0, 0] = sideways[..., 1, 1] = 1.0
    sideways[..., 2] = path.slopes
    displaced = np.einsum("tij,tnkj->tnik", turn, sideways)
    spread = (displaced[..., :2, :] - tangents[..., None] * displaced[..., 2:, :]) / towards[
        ..., 2, None, None
    ]
    inverse = _inverse(_square(path.whole))
    cosine = towards[..., 2] / path.length
    vergence = inverse @ _square(path.without_pupil) / (path.length * cosine)[..., None, None]
    miss = np.hypot(*np.moveaxis(path.gradient, -1, 0)) / np.sqrt(1 + (path.slopes**2).sum(axis=-1))
    rim = states.surfaces.rim_radius_mm
    on_mirror = (miss <= REFLECTION_TOLERANCE) & (
        np.hypot(xy[..., 0], xy[..., 1]) <= rim * (1 + rim_slack)
    )
    on_mirror &= (path.facing > 0) & (towards[..., 2] > 0)
    return TracedObjects(
        xy,
        tangents,
        spread @ vergence @ _inverse(spread),
        spread @ inverse @ sideways,
        ~on_mirror,
    )


def _inverse(matrices: Array) -> Array:
    """Invert matrices (..., 2, 2); NaN for singular ones, which occur for rays that miss the
    mirror.
    """
    determinant = np.linalg.det(matrices)
    is_singular = ~np.isfinite(determinant) | (determinant == 0)
    inverse = np.linalg.inv(np.where(is_singular[..., None, None], np.eye(2), matrices))
    return np.where(is_singular[..., None, None], np.nan, inverse)


def _square(second: Array) -> Array:
    """Return symmetric matrices (..., 2, 2) from components xx, xy, yy."""
    return second[..., [[0, 1], [1, 2]]]


Refocus = Literal["none", "rms", "worst"]
"""Refocusing of each sensor: none, for minimum RMS blur, or for minimum worst-case blur."""
REFOCUS: tuple[Refocus, ...] = ("none", "rms", "worst")

HALVINGS = 32
"""Iterations of the golden-section search; relative accuracy 2e-7."""
GOLDEN = (np.sqrt(5.0) - 1) / 2


class TrialImages(NamedTuple):
    """Images of objects (n,) in trials (t,)."""

    offsets_px: Array
    """Offsets (t, n, 2) from the optical axis, right and down in the unmirrored image; NaN if lost."""
    blur_px: Array
    """Matrices (t, n, 2, 2) that map the unit circle of the aperture to the blur ellipse of
    diameters."""
    by_direction: Array
    """Derivatives (t, n, 2, 3) in px per rad of the object direction in the mirror frame."""
    vergence: Array
    """Vergence (t,) in focus at the entrance pupil, 1/mm."""


def form_images(states: States, result: TracedObjects, refocus: Refocus = "none") -> TrialImages:
    """Compute the images of traced objects.

    Parameters
    ----------
    states
        Parameters of t trials.
    result
        Traced objects.
    refocus
        Refocusing mode; focus breathing is included.

    Returns
    -------
    TrialImages
        Positions and blur.
    """
    with np.errstate(all="ignore"):
        tangents = np.where(result.lost[..., None], np.nan, result.tangents)
        widen, _, depth = _imaged(states, tangents)
        spread = widen @ _less(result.vergences, _tilt_vergence(states, depth))
        vergence = states.vergence if refocus == "none" else focus_vergences(widen, spread, refocus)
        f = states.breathing_mm
        breath = (1 - f * states.vergence) / (1 - f * vergence)
        widen, offsets, depth = _imaged(states, tangents, breath)
        vergences = _less(result.vergences, _tilt_vergence(states, depth))
        blur = states.aperture_mm[:, None, None, None] * (
            vergence[:, None, None, None] * widen - widen @ vergences
        )
        return TrialImages(offsets, blur, widen @ result.by_direction, vergence)


def imaged_at(states: States, tangents: Array, vergence: Array) -> Array:
    """Return image positions (t, n, 2) in px of viewing tangents (t, n, 2) at focus vergences (t,)."""
    f = states.breathing_mm
    return _imaged(states, tangents, (1 - f * states.vergence) / (1 - f * vergence))[1]


def _less(vergences: Array, part: Array) -> Array:
    """Subtract isotropic vergences (t, n) from vergence matrices (t, n, 2, 2)."""
    less: Array = vergences - part[..., None, None] * np.eye(2)
    return less


def _tilt_vergence(states: States, depth: Array) -> Array:
    """Return the difference (t, n) in 1/mm of the vergence in focus on a tilted imager from its centre.

    The depth of the image point behind the lens and the lens equation determine the focus distance.
    """
    tilted = (states.imager[:, 2, :2] != 0).any(axis=1)
    if not tilted.any():
        return np.zeros_like(depth)
    f, v = states.focal_mm[:, None], states.vergence[:, None]
    breathing = states.breathing_mm[:, None]
    middle = f / (1 - breathing * v)
    behind = middle * (1 + (f - breathing) * v) + depth - middle
    part = 1 / (f * behind / (behind - f) - (f - breathing)) - v
    return np.where(tilted[:, None], part, 0.0)


def _imaged(
    states: States, tangents: Array, breath: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return derivatives (t, n, 2, 2) in px per tangent, offsets (t, n, 2) in px, and depths (t, n)
    in mm.
    """
    displaced, (xx, xy, yy) = _distorted(tangents, states.brown)
    if breath is not None:
        displaced, xx, xy, yy = (
            displaced * breath[:, None, None],
            *(d * breath[:, None] for d in (xx, xy, yy)),
        )
    h = states.imager[:, None]
    flat = np.concatenate([displaced, np.ones((*displaced.shape[:-1], 1))], axis=-1)
    u, v, w = np.moveaxis(
        np.einsum("tnij,tnj->tni", np.broadcast_to(h, (*flat.shape, 3)), flat), -1, 0
    )
    offsets = np.stack([u, v], axis=-1) / w[..., None]
    plane = (h[..., :2, :2] - offsets[..., None] * h[..., 2:, :2]) / w[..., None, None]
    lens = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    return plane @ lens, offsets, 1 / w


def _distorted(tangents: Array, brown: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Apply the distortion of :mod:`omnimirror.optics.lenses.lens` per trial; also return xx, xy,
    yy.
    """
    x, y = tangents[..., 0], tangents[..., 1]
    k1, k2, k3, p1, p2 = brown.T[..., None]
    s = x * x + y * y
    radial, rate = 1 + s * (k1 + s * (k2 + s * k3)), 2 * (k1 + s * (2 * k2 + 3 * s * k3))
    displaced = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    xx = radial + x * x * rate + 2 * p1 * y + 6 * p2 * x
    xy = x * y * rate + 2 * p1 * x + 2 * p2 * y
    yy = radial + y * y * rate + 6 * p1 * y + 2 * p2 * x
    return displaced, (xx, xy, yy)


def focus_vergences(widen: Array, spread: Array, refocus: Refocus) -> Array:
    """Return vergences (t,) of best focus from matrices W and W V (t, n, 2, 2).

    The blur ``v W - W V`` is linear in the vergence v: its sum of squares is a parabola, and the
    worst-case blur is a convex function.
    """
    squares, mixed = np.nansum(widen**2, axis=(1, 2, 3)), np.nansum(widen * spread, axis=(1, 2, 3))
    middle: Array = mixed / squares
    if refocus == "rms":
        return middle
    size, turned = _squared_blur(widen, spread)
    half, product = turned[1] / turned[2] / -2, turned[0] / turned[2]
    apart = np.sqrt(np.abs(half**2 - product))
    low, high = np.nanmin(half - apart, axis=1), np.nanmax(half + apart, axis=1)

    def worst(v: Array) -> Array:
        v = v[:, None]
        square, det = (
            size[0] + v * (size[1] + v * size[2]),
            turned[0] + v * (turned[1] + v * turned[2]),
        )
        return np.asarray(
            np.nanmax(square + np.sqrt(np.maximum(square**2 - 4 * det**2, 0.0)), axis=1)
        )

    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_a, at_b = worst(a), worst(b)
    for _ in range(HALVINGS):
        is_left = at_a < at_b
        low, high = np.where(is_left, low, a), np.where(is_left, b, high)
        new = np.where(is_left, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        at_new = worst(new)
        a, b = np.where(is_left, new, b), np.where(is_left, a, new)
        at_a, at_b = np.where(is_left, at_new, at_b), np.where(is_left, at_a, at_new)
    return np.asarray((low + high) / 2)


def _squared_blur(widen: Array, spread: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return coefficients of 1, v and v^2 of the sum of squares and the determinant of ``v W - S``."""
    w, s = widen.reshape(*widen.shape[:-2], 4), spread.reshape(*spread.shape[:-2], 4)
    size = (s * s).sum(axis=-1), -2 * (w * s).sum(axis=-1), (w * w).sum(axis=-1)
    crossed = (
        w[..., 0] * s[..., 3]
        + s[..., 0] * w[..., 3]
        - w[..., 1] * s[..., 2]
        - s[..., 1] * w[..., 2]
    )
    return size, (s[..., 0] * s[..., 3] - s[..., 1] * s[..., 2], -crossed, np.linalg.det(widen))


def largest_diameter(blur: Array) -> Array:
    """Compute the major diameters (...) of ellipses given by matrices (..., 2, 2).

    >>> float(largest_diameter(np.array([[3.0, 0.0], [0.0, -4.0]])))
    4.0
    """
    (p, s), (q, r) = diameter_components(blur)
    diameter: Array = np.hypot(p, s) + np.hypot(q, r)
    return diameter


def diameter_components(blur: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return two vectors whose lengths add up to the major diameter: rotation-scaling and shear
    parts.
    """
    p, q = (blur[..., 0, 0] + blur[..., 1, 1]) / 2, (blur[..., 0, 0] - blur[..., 1, 1]) / 2
    r, s = (blur[..., 1, 0] + blur[..., 0, 1]) / 2, (blur[..., 1, 0] - blur[..., 0, 1]) / 2
    return (p, s), (q, r)


# -- Objects over the field and sequential tracing -------------------------------------------------
#
# Perspective lenses with one mirror are traced vectorised. Other sensors, with a
# cover, a secondary mirror, a telecentric or a tabulated lens, are built and traced one at a time by
# the general ray tracer. The blur follows from rays close to the chief ray.

RELATIVE_APERTURE_HEIGHT = 0.02
"""Relative aperture height of the rays for blur; aberrations contribute 4e-4 of their marginal
value."""
MARGINAL_RAYS = RELATIVE_APERTURE_HEIGHT * np.array(
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
)
IMAGED_FRACTION = 0.99
"""Fraction of the rim radius that a perturbed folded sensor with a nominally full aperture images."""
TANGENT = 1e-5  # step of differences for the image scale


class SensorImages(NamedTuple):
    """Images of objects (n,) in one sensor."""

    offsets_px: Array
    """Offsets (n, 2) from the nominal centre, right and down in the unmirrored image; NaN if lost."""
    blur_px: Array
    """Blur matrices (n, 2, 2) as in :class:`~.trial_images.TrialImages`."""
    focus_mm: float
    """Focus distance."""
    lost: NDArray[np.bool_]
    """Lost objects (n,)."""


def sequential_images(
    sensor: Sensor,
    values: Mapping[str, Array],
    count: int,
    targets: RayEndpoints,
    *,
    refocus: Refocus = "none",
    rim_slack: float = RIM_SLACK,
) -> tuple[TrialImages, NDArray[np.bool_], Array]:
    """Compute images of trials (t,), lost objects (t, n), and focus distances (t,) in mm, one at a time.

    Physically impossible sensors, for example with a mirror that intersects its tube, lose all objects.
    """
    n, images = len(targets.xyz), []
    check_error_names(sensor, values)
    for k in range(count):
        try:
            built = perturbed(sensor, {name: float(of[k]) for name, of in values.items()})
            images.append(images_within_rim(built, sensor, targets, refocus, rim_slack))
        except OmnimirrorError:
            blank = np.full((n, 2), np.nan), np.full((n, 2, 2), np.nan), np.nan
            images.append(SensorImages(*blank, np.ones(n, dtype=bool)))
    offsets, blur = (
        np.stack([getattr(one, name) for one in images]) for name in ("offsets_px", "blur_px")
    )
    focus = np.array([one.focus_mm for one in images])
    by_direction = np.full((count, n, 2, 3), np.nan)
    return (
        TrialImages(offsets, blur, by_direction, 1 / focus),
        np.stack([one.lost for one in images]),
        focus,
    )


def images_within_rim(
    built: Sensor,
    nominal: Sensor,
    targets: RayEndpoints,
    refocus: Refocus = "none",
    rim_slack: float = RIM_SLACK,
) -> SensorImages:
    """Compute the images of one sensor; reduce the aperture if a secondary mirror vignettes the
    rim.
    """
    try:
        return sensor_images(built, nominal, targets, refocus, rim_slack)
    except SelfObstruction:
        if built.secondary is None:
            raise
        mirror: Any = built.mirror
        smaller_mirror = replace(mirror, rim_radius_mm=IMAGED_FRACTION * mirror.rim_radius_mm)
        return sensor_images(
            replace(built, mirror=smaller_mirror), nominal, targets, refocus, rim_slack
        )


def sensor_images(
    built: Sensor,
    nominal: Sensor,
    targets: RayEndpoints,
    refocus: Refocus = "none",
    rim_slack: float = RIM_SLACK,
) -> SensorImages:
    """Compute the images of targets in one sensor, in px from the centre of the nominal sensor."""
    n, train = len(targets.xyz), built.optical_train
    result = train.chief_rays_to(targets)
    is_lost = ~(result.valid if rim_slack <= RIM_SLACK else result.reflects)
    pupils = train.entrance_pupil_points(
        np.tile(MARGINAL_RAYS, (n, 1)), np.repeat(result.chief_slopes, 4, axis=0)
    )
    each = RayEndpoints(np.repeat(targets.spread(n).xyz, 4, axis=0), targets.distant)
    beside = train.effective_mirror.specular(pupils, each, np.repeat(result.points, 4, axis=0))

    def imaged(sensor: Sensor) -> tuple[Array, Array]:
        """Return offsets (n, 2) in px and blur matrices (n, 2, 2)."""
        lens, offset = sensor.lens, sensor.lens_offset
        flat = lens.image_of(result.facing_points - offset, result.to_pupils)
        round_about = lens.image_of(beside.facing_points - offset, beside.to_pupils).reshape(
            n, 4, 2
        )
        at, sides = _on_imager(sensor, flat), _on_imager(sensor, round_about)
        blur = (
            np.stack([sides[:, 0] - sides[:, 1], sides[:, 2] - sides[:, 3]], axis=-1)
            / RELATIVE_APERTURE_HEIGHT
        )
        return at, blur + _tilt_blur(sensor, flat, result.to_pupils)

    with np.errstate(all="ignore"):
        if refocus != "none":
            built = _focused(built, imaged, is_lost, refocus)
        offsets, blur = imaged(built)
    moved = np.subtract(built.imager.centre, nominal.imager.centre)
    blank = np.where(is_lost, np.nan, 1.0)
    return SensorImages(
        (offsets + moved) * blank[:, None],
        blur * blank[:, None, None],
        built.lens.focus_distance_mm,
        is_lost,
    )


def _on_imager(sensor: Sensor, flat_mm: Array) -> Array:
    """Convert positions on an aligned imager to offsets (..., 2) in px on the actual imager."""
    pitch = sensor.imager.pitch_mm
    if sensor.imager_pose == ImagerPose():
        return flat_mm / pitch
    distance = sensor.lens.principal_distance if isinstance(sensor.lens, Perspective) else np.inf
    return sensor.imager_pose.tilted(flat_mm, distance) / pitch


def _tilt_blur(sensor: Sensor, flat_mm: Array, to_pupils: Array) -> Array:
    """Return the additional blur (n, 2, 2) in px due to the imager tilt."""
    lens, pose = sensor.lens, sensor.imager_pose
    if pose.is_perpendicular or not isinstance(lens, Perspective):
        return np.zeros((len(flat_mm), 2, 2))
    c, f = lens.principal_distance, lens.focal_length_mm
    _, depth = pose.flat(pose.tilted(flat_mm, c), c)
    behind = lens.image_distance + depth
    more = 1 / (f * behind / (behind - f) - lens.pupil.at_mm) - 1 / lens.from_pupil
    tangents = to_pupils[:, :2] / to_pupils[:, 2:]
    middle = np.broadcast_to([0.0, 0.0, lens.pupil.at_mm], (len(tangents), 3))

    def place(tangent: Array) -> Array:
        ahead = np.concatenate([tangent, np.ones((len(tangent), 1))], axis=1)
        return _on_imager(sensor, lens.image_of(middle, ahead))

    steps = TANGENT * np.eye(2)
    widen = np.stack(
        [(place(tangents + s) - place(tangents - s)) / (2 * TANGENT) for s in steps], axis=-1
    )
    added: Array = 2 * lens.aperture_radius * more[:, None, None] * widen
    return added


def _focused(
    built: Sensor,
    imaged: Callable[[Sensor], tuple[Array, Array]],
    is_lost: NDArray[np.bool_],
    refocus: Refocus,
) -> Sensor:
    """Return the sensor at best focus; blur over image scale is linear in the focus coordinate."""
    lens = built.lens
    here = float(lens.focus_coordinate(lens.focus_distance_mm))
    near = 1.01 * here if here else 1e-3
    parts = []
    for coordinate in (here, near):
        at = built.with_lens(lens.focused_at(float(lens.distance_of(coordinate))))
        parts.append(imaged(at)[1][~is_lost] / lens.through_focus(coordinate).image_scale)
    widen = (parts[1] - parts[0]) / (near - here)
    spread = here * widen - parts[0]
    best = float(focus_vergences(widen[None], spread[None], refocus)[0])
    return built.with_lens(lens.focused_at(float(lens.distance_of(best))))


EDGE = 0.97
"""Default upper field limit as a fraction of the maximum field angle; at the rim, any decentre loses
rays."""
ANGLES, AZIMUTHS = 8, 12
STEP_DEG = 1e-3  # step of differences of object directions
RIM_MARGIN = 0.05  # relative to the rim radius: differences at the rim extend beyond it


@dataclass(frozen=True)
class Field:
    """Objects (n,) on circles of constant field angle.

    Attributes
    ----------
    sensor
        Nominal sensor.
    targets : (n, 3)
        Unit directions, or points in mm, in the camera frame.
    distant
        Whether targets are directions.
    start : (n, 2)
        Nominal reflection points (x, y), mm.
    offsets_px : (n, 2)
        Nominal image positions.
    px_per_deg : (n, 2, 2)
        Image displacement per degree of object direction: columns along field angle and azimuth.
    omega_deg, azimuth_deg : (n,)
        Field angles and azimuths; the axis comes first if included.
    """

    sensor: Sensor
    targets: Array
    distant: bool
    start: Array
    offsets_px: Array
    px_per_deg: Array
    omega_deg: Array
    azimuth_deg: Array

    def __len__(self) -> int:
        return len(self.targets)

    def images(
        self, values: Values, count: int | None = None, rim_slack: float = RIM_SLACK
    ) -> TrialImages:
        """Compute the images of sensors with errors; see :func:`.states_of`."""
        return self.images_and_focus(values, count, rim_slack=rim_slack)[0]

    def images_and_focus(
        self,
        values: Values,
        count: int | None = None,
        *,
        refocus: Refocus = "none",
        rim_slack: float = RIM_SLACK,
    ) -> tuple[TrialImages, NDArray[np.bool_], Array]:
        """Compute images of sensors (t,), lost objects (t, n), and focus distances (t,) in mm."""
        if not is_vectorised(self.sensor, values):
            trials = next((len(v) for v in values.values()), 1) if count is None else count
            ends = RayEndpoints(self.targets, self.distant)
            return sequential_images(
                self.sensor, values, trials, ends, refocus=refocus, rim_slack=rim_slack
            )
        states = states_of(self.sensor, values, count)
        result = trace_objects(states, self.targets, self.distant, self.start, rim_slack)
        images = form_images(states, result, refocus)
        return images, result.lost, 1 / images.vergence + states.focal_mm - states.breathing_mm


def field_of(
    sensor: Sensor,
    *,
    field_deg: tuple[float, float] | None = None,
    angles: int = ANGLES,
    azimuths: int = AZIMUTHS,
    object_distance_mm: float = np.inf,
) -> Field:
    """Distribute objects over the field of a sensor.

    Parameters
    ----------
    sensor
        Nominal sensor; misalignments in its file are removed.
    field_deg : (2,), optional
        Range of field angles; by default from the minimum to 0.97 of the maximum.
    angles, azimuths
        Number of circles and of objects per circle.
    object_distance_mm
        Distance from the mirror points to the objects, infinite by default.

    Returns
    -------
    Field
        Objects with their nominal images.

    Raises
    ------
    InvalidParameter
        If the field range is not within the field of the sensor, or a number is out of range.

    Examples
    --------
    >>> import omnimirror as om
    >>> field = field_of(om.load_sensor("paper-spherical"))
    >>> len(field), field.omega_deg[[0, 1, -1]].round(1)
    (97, array([  0. ,  16.4, 131. ]))
    """
    if not sensor.is_axial:  # misalignments in the file are errors relative to the aligned sensor
        displaced = MirrorPose(displacement_mm=sensor.mirror_pose.displacement_mm)
        sensor = replace(sensor.aligned(), mirror_pose=displaced)
    is_bare = (
        sensor.secondary is None and sensor.housing.shell is None
    )  # other sensors are obscured in the centre
    smallest, largest = sensor.field_deg if is_bare else sensor.clear_field_deg
    inner = smallest if is_bare or not smallest else smallest + (1 - EDGE) * (largest - smallest)
    requested = (
        (inner, EDGE * largest)
        if field_deg is None
        else numbers("field_deg", field_deg, "two numbers")
    )
    low, high = (float(angle) for angle in requested)
    if not smallest - 1e-9 <= low < high <= largest + 1e-9:
        raise InvalidParameter(
            f"field_deg must be an ascending range within the field of {sensor.name!r}, "
            f"{smallest:.4g} to {largest:.4g} deg; got {low:g} to {high:g}"
        )
    if angles < 1 or azimuths < 3:
        raise InvalidParameter(
            f"angles must be at least 1 and azimuths at least 3; got {angles} and {azimuths}"
        )
    if not object_distance_mm > 0:
        raise InvalidParameter(f"object_distance_mm must be positive; got {object_distance_mm:g}")
    on_axis = low <= 0
    omega = np.linspace(low, high, angles + on_axis)[on_axis:]
    around = np.arange(azimuths) * (360.0 / azimuths)
    omega, azimuth = np.repeat(omega, azimuths), np.tile(around, angles)
    if on_axis:
        omega, azimuth = np.append(0.0, omega), np.append(0.0, azimuth)
    return field_at(sensor, omega, azimuth, object_distance_mm)


def directions_of(omega_deg: Array, azimuth_deg: Array) -> tuple[Array, Array]:
    """Return directions (n, 3) and unit vectors (n, 3, 2) along field angle and azimuth.

    >>> [part.round(6).tolist() for part in directions_of(np.array([90.0]), np.array([0.0]))]
    [[[1.0, 0.0, -0.0]], [[[0.0, -0.0], [0.0, 1.0], [1.0, 0.0]]]]
    """
    omega, azimuth = np.radians(omega_deg), np.radians(azimuth_deg)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    away = np.stack([np.sin(omega) * cos, np.sin(omega) * sin, -np.cos(omega)], axis=-1)
    tangential = np.stack([np.cos(omega) * cos, np.cos(omega) * sin, np.sin(omega)], axis=-1)
    sagittal = np.stack([-sin, cos, np.zeros_like(cos)], axis=-1)
    return away, np.stack([tangential, sagittal], axis=-1)


def field_at(sensor: Sensor, omega_deg: Array, azimuth_deg: Array, distance: float) -> Field:
    """Create objects (n,) at given field angles and azimuths."""
    away, turned = directions_of(
        omega_deg, azimuth_deg
    )  # mirror and camera frame coincide without errors
    azimuth = np.radians(azimuth_deg)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega_deg)))
    x, z = rays.last  # exit points on mirror or cover
    points = np.stack([x * cos, x * sin, z + sensor.mirror_pose.displacement_mm], axis=-1)
    start = np.stack([rays.x * cos, rays.x * sin], axis=-1)
    distant = bool(np.isinf(distance))
    targets = away if distant else points + distance * away
    bare = Field(sensor, targets, distant, start, omega_deg, omega_deg, omega_deg, azimuth_deg)
    images, is_lost, _ = bare.images_and_focus({}, count=1)
    if is_lost.any():
        raise InvalidParameter(
            f"field_deg must be within the unobscured field of {sensor.name!r}, "
            f"{sensor.clear_field_deg[0]:.4g} to {sensor.clear_field_deg[1]:.4g} deg; rays "
            f"at {omega_deg[is_lost[0]][0]:.4g} deg are lost"
        )
    if is_vectorised(sensor):
        px_per_deg = np.radians(images.by_direction[0] @ turned)
    else:
        px_per_deg = _px_per_deg(bare, points, distance, turned)
    return replace(bare, offsets_px=images.offsets_px[0], px_per_deg=px_per_deg)


def _px_per_deg(field: Field, points: Array, distance: float, turned: Array) -> Array:
    """Compute image derivatives (n, 2, 2) by central differences along tangents (n, 3, 2)."""
    columns = []
    for k in range(2):
        step, ends = np.radians(STEP_DEG) * turned[..., k], []
        for sign in (1, -1):
            moved = field.targets + sign * step * (1.0 if field.distant else distance)
            unit = np.linalg.norm(moved, axis=1, keepdims=True) if field.distant else 1.0
            ends.append(
                replace(field, targets=moved / unit)
                .images({}, 1, rim_slack=RIM_MARGIN)
                .offsets_px[0]
            )
        columns.append((ends[0] - ends[1]) / (2 * STEP_DEG))
    return np.stack(columns, axis=-1)
