"""Objects over the field, their nominal images, and sequential tracing of arbitrary sensors.

:mod:`.trial_images` traces perspective lenses with one mirror vectorised. Other sensors, with a
cover, a secondary mirror, a telecentric or a tabulated lens, are built and traced one at a time by
the general ray tracer. The blur follows from rays close to the chief ray.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import numbers
from ...base.errors import InvalidParameter, OmnimirrorError, SelfObstruction
from ...base.typing import Array
from ...optics.image_sensor import ImagerPose
from ...optics.lenses import Perspective
from ...optics.mirrors.mirror import MirrorPose
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import RIM_SLACK, RayEndpoints
from .perturbation import check_error_names, perturbed
from .perturbed_states import Values, is_vectorised, states_of
from .trial_images import Refocus, TrialImages, focus_vergences, form_images, trace_objects

EDGE_PX = 0.02
"""Relative aperture height of the rays for blur; aberrations contribute 4e-4 of their marginal
value."""
MARGINAL_RAYS = EDGE_PX * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
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
        lens, offset = sensor.lens, sensor.optical_train.lens_offset
        flat = lens.image_of(result.facing_points - offset, result.to_pupils)
        round_about = lens.image_of(beside.facing_points - offset, beside.to_pupils).reshape(
            n, 4, 2
        )
        at, sides = _on_imager(sensor, flat), _on_imager(sensor, round_about)
        blur = np.stack([sides[:, 0] - sides[:, 1], sides[:, 2] - sides[:, 3]], axis=-1) / EDGE_PX
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


def _focused(built: Sensor, imaged: object, is_lost: NDArray[np.bool_], refocus: Refocus) -> Sensor:
    """Return the sensor at best focus; blur divided by image scale is linear in the focus
    coordinate.
    """
    lens = built.lens
    here = float(lens.focus_coordinate(lens.focus_distance_mm))
    near = 1.01 * here if here else 1e-3
    parts = []
    for coordinate in (here, near):
        at = built.with_lens(lens.focused_at(float(lens.distance_of(coordinate))))
        parts.append(imaged(at)[1][~is_lost] / lens.through_focus(coordinate).image_scale)  # type: ignore[operator]
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
