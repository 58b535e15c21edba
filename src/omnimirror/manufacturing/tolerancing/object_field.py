"""Pictures of sensors with errors that are built and traced one by one, of whatever kind they are.

What :mod:`.tracing` traces by the thousand is a perspective lens before one bare mirror. Any other sensor, behind a
tube or a dome, with a telecentric or a real lens or with two mirrors, is made with its errors as an ordinary one, and
asked in space where it shows each object: by the chief ray, and by rays through four points of the aperture close to
it, whose places on the imager are the blur's ellipse. A second traces fifty to some hundred.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import numbers
from ...errors import InvalidParameter, OmnimirrorError, SelfObstruction
from ...imagers import ImagerPose
from ...lenses import Perspective
from ...mirrors.pose import MirrorPose
from ...sensor import Sensor
from ...tracing.reflection import RIM_SLACK, Ends
from .perturbation import check_built_with, perturbed
from .perturbed_states import Values, are_traced_together, states_of
from .trial_images import Picture, Refocus, best_vergences, pictured, seen

Array = NDArray[np.float64]

EDGE_PX = 0.02
"""Of the aperture's radius, where rays beside the chief ray go through: aberrations add 4e-4 of theirs at its edge."""
SIDES = EDGE_PX * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
SEEN = 0.99
"""Of the rim radius: so much a second mirror shows that was made to show all of it, whatever errs."""
TANGENT = 1e-5  # steps of it tell how the picture widens


class ShownObjects(NamedTuple):
    """What one sensor shows of objects (n,)."""

    offsets_px: Array
    """(n, 2) from the centre that was meant, right and down in the unflipped picture; NaN where lost."""
    blur_px: Array
    """(n, 2, 2) as in :class:`~.picture.Picture`."""
    focus_mm: float
    """Where it is focused."""
    lost: NDArray[np.bool_]
    """(n,)"""


def pictured_one_by_one(
    sensor: Sensor,
    values: Mapping[str, Array],
    count: int,
    targets: Ends,
    *,
    refocus: Refocus = "none",
    rim_slack: float = RIM_SLACK,
) -> tuple[Picture, NDArray[np.bool_], Array]:
    """Pictures of trials (t,), what they lose (t, n), and the distances (t,) mm that they are focused at.

    A sensor that cannot be, its mirror in its tube for one, loses everything.
    """
    n, shown = len(targets.xyz), []
    check_built_with(sensor, values)
    for k in range(count):
        try:
            built = perturbed(sensor, {name: float(of[k]) for name, of in values.items()})
            shown.append(shown_within(built, sensor, targets, refocus, rim_slack))
        except OmnimirrorError:
            blank = np.full((n, 2), np.nan), np.full((n, 2, 2), np.nan), np.nan
            shown.append(ShownObjects(*blank, np.ones(n, dtype=bool)))
    offsets, blur = (np.stack([getattr(one, name) for one in shown]) for name in ("offsets_px", "blur_px"))
    focus = np.array([one.focus_mm for one in shown])
    by_direction = np.full((count, n, 2, 3), np.nan)
    return Picture(offsets, blur, by_direction, 1 / focus), np.stack([one.lost for one in shown]), focus


def shown_within(
    built: Sensor, meant: Sensor, targets: Ends, refocus: Refocus = "none", rim_slack: float = RIM_SLACK
) -> ShownObjects:
    """What a sensor shows; where a second mirror has come to show less than the whole first one, less its rim."""
    try:
        return shown_by(built, meant, targets, refocus, rim_slack)
    except SelfObstruction:
        if built.secondary is None:
            raise
        mirror: Any = built.mirror
        within = replace(mirror, rim_radius_mm=SEEN * mirror.rim_radius_mm)
        return shown_by(replace(built, mirror=within), meant, targets, refocus, rim_slack)


def shown_by(
    built: Sensor, meant: Sensor, targets: Ends, refocus: Refocus = "none", rim_slack: float = RIM_SLACK
) -> ShownObjects:
    """What a sensor shows of targets, in pixels from the centre of the one that was meant."""
    n, train = len(targets.xyz), built.optical_train
    found = train.chief_rays_to(targets)
    lost = ~(found.valid if rim_slack <= RIM_SLACK else found.reflects)
    pupils = train.entrance_pupil_points(np.tile(SIDES, (n, 1)), np.repeat(found.chief_slopes, 4, axis=0))
    each = Ends(np.repeat(targets.spread(n).xyz, 4, axis=0), targets.distant)
    beside = train.seen_mirror.specular(pupils, each, np.repeat(found.points, 4, axis=0))

    def imaged(sensor: Sensor) -> tuple[Array, Array]:
        """Offsets (n, 2) px, and the blur's matrices (n, 2, 2)."""
        lens, offset = sensor.lens, sensor.optical_train.lens_offset
        flat = lens.image_of(found.seen_at - offset, found.to_pupils)
        round_about = lens.image_of(beside.seen_at - offset, beside.to_pupils).reshape(n, 4, 2)
        at, sides = _on_imager(sensor, flat), _on_imager(sensor, round_about)
        blur = np.stack([sides[:, 0] - sides[:, 1], sides[:, 2] - sides[:, 3]], axis=-1) / EDGE_PX
        return at, blur + _by_leaning(sensor, flat, found.to_pupils)

    with np.errstate(all="ignore"):
        if refocus != "none":
            built = _focused(built, imaged, lost, refocus)
        offsets, blur = imaged(built)
    moved = np.subtract(built.imager.centre, meant.imager.centre)
    blank = np.where(lost, np.nan, 1.0)
    return ShownObjects(
        (offsets + moved) * blank[:, None], blur * blank[:, None, None], built.lens.focus_distance_mm, lost
    )


def _on_imager(sensor: Sensor, flat_mm: Array) -> Array:
    """Offsets (.., 2) px of places of a square imager."""
    pitch = sensor.imager.pitch_mm
    if sensor.imager_pose == ImagerPose():
        return flat_mm / pitch
    distance = sensor.lens.principal_distance if isinstance(sensor.lens, Perspective) else np.inf
    return sensor.imager_pose.tilted(flat_mm, distance) / pitch


def _by_leaning(sensor: Sensor, flat_mm: Array, to_pupils: Array) -> Array:
    """What a leaning imager adds to the blur (n, 2, 2), px: each place is in focus at its own distance."""
    lens, pose = sensor.lens, sensor.imager_pose
    if pose.is_square or not isinstance(lens, Perspective):
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
    widen = np.stack([(place(tangents + s) - place(tangents - s)) / (2 * TANGENT) for s in steps], axis=-1)
    added: Array = 2 * lens.aperture_radius * more[:, None, None] * widen
    return added


def _focused(built: Sensor, imaged: object, lost: NDArray[np.bool_], refocus: Refocus) -> Sensor:
    """The sensor at its best focus: in the lens's own coordinate of it, blur over the image's scale is straight."""
    lens = built.lens
    here = float(lens.focus_coordinate(lens.focus_distance_mm))
    near = 1.01 * here if here else 1e-3
    parts = []
    for coordinate in (here, near):
        at = built.with_lens(lens.focused_at(float(lens.distance_of(coordinate))))
        parts.append(imaged(at)[1][~lost] / lens.through_focus(coordinate).image_scale)  # type: ignore[operator]
    widen = (parts[1] - parts[0]) / (near - here)
    spread = here * widen - parts[0]
    best = float(best_vergences(widen[None], spread[None], refocus)[0])
    return built.with_lens(lens.focused_at(float(lens.distance_of(best))))


EDGE = 0.97
"""Of the largest field angle of a sensor, what is judged by default: at the rim itself every decentre loses rays."""
ANGLES, AZIMUTHS = 8, 12
STEP_DEG = 1e-3  # of objects, of differences
BEYOND = 0.05  # of the rim radius: objects seen at the rim itself move beyond it in the differences


@dataclass(frozen=True)
class Field:
    """Objects (n,) on circles of equal field angle.

    Attributes
    ----------
    sensor
        Without errors.
    targets : (n, 3)
        Unit directions, or points in mm, in the camera frame.
    distant
        Whether they are directions.
    start : (n, 2)
        Mirror points (x, y) mm in which it shows them.
    offsets_px : (n, 2)
        Where it shows them.
    px_per_deg : (n, 2, 2)
        How far a degree of the object moves its picture: columns along the field angle and round about.
    omega_deg, azimuth_deg : (n,)
        Of the objects; the axis, where it is in the field, comes first.
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

    def picture(self, values: Values, count: int | None = None, rim_slack: float = RIM_SLACK) -> Picture:
        """The picture of sensors with errors; see :func:`.states_of`."""
        return self.shown(values, count, rim_slack=rim_slack)[0]

    def shown(
        self, values: Values, count: int | None = None, *, refocus: Refocus = "none", rim_slack: float = RIM_SLACK
    ) -> tuple[Picture, NDArray[np.bool_], Array]:
        """Pictures of sensors with errors (t,), what they lose (t, n), and distances (t,) mm they are focused at."""
        if not are_traced_together(self.sensor, values):
            trials = next((len(v) for v in values.values()), 1) if count is None else count
            ends = Ends(self.targets, self.distant)
            return pictured_one_by_one(self.sensor, values, trials, ends, refocus=refocus, rim_slack=rim_slack)
        states = states_of(self.sensor, values, count)
        found = seen(states, self.targets, self.distant, self.start, rim_slack)
        shown = pictured(states, found, refocus)
        return shown, found.lost, 1 / shown.vergence + states.focal_mm - states.breathing_mm


def field_of(
    sensor: Sensor,
    *,
    field_deg: tuple[float, float] | None = None,
    angles: int = ANGLES,
    azimuths: int = AZIMUTHS,
    object_distance_mm: float = np.inf,
) -> Field:
    """Objects all over the field of a sensor.

    Parameters
    ----------
    sensor
        Without errors: its mirror on the lens's axis.
    field_deg : (2,), optional
        Field angles between which it is judged; from its smallest to .97 of its largest by default.
    angles, azimuths
        How many circles, and objects on each.
    object_distance_mm
        From the mirror points to the objects; infinite by default.

    Returns
    -------
    Field
        The objects.

    Raises
    ------
    InvalidParameter
        A field that the sensor does not have, or a mirror that is already decentred.

    Examples
    --------
    >>> import omnimirror as om
    >>> field = field_of(om.load_sensor("paper-spherical"))
    >>> len(field), field.omega_deg[[0, 1, -1]].round(1)
    (97, array([  0. ,  16.4, 131. ]))
    """
    if not sensor.is_axial:  # what is out of place in the file is an error that has happened: judged against its place
        displaced = MirrorPose(displacement_mm=sensor.mirror_pose.displacement_mm)
        sensor = replace(sensor.aligned(), mirror_pose=displaced)
    is_bare = sensor.secondary is None and sensor.housing.shell is None  # others have something in the middle
    smallest, largest = sensor.field_deg if is_bare else sensor.clear_field_deg
    inner = smallest if is_bare or not smallest else smallest + (1 - EDGE) * (largest - smallest)
    asked = (inner, EDGE * largest) if field_deg is None else numbers("field_deg", field_deg, "(it takes two)")
    low, high = (float(angle) for angle in asked)
    if not smallest - 1e-9 <= low < high <= largest + 1e-9:
        raise InvalidParameter(
            f"field_deg = {low:g} to {high:g} is not within the field of {sensor.name!r}, {smallest:.4g} to "
            f"{largest:.4g} deg"
        )
    if angles < 1 or azimuths < 3:
        raise InvalidParameter(f"{angles} angles and {azimuths} azimuths are too few; valid are 1 and 3, and more")
    if not object_distance_mm > 0:
        raise InvalidParameter(f"object_distance_mm = {object_distance_mm:g} is valid above 0, and inf")
    on_axis = low <= 0
    omega = np.linspace(low, high, angles + on_axis)[on_axis:]
    around = np.arange(azimuths) * (360.0 / azimuths)
    omega, azimuth = np.repeat(omega, azimuths), np.tile(around, angles)
    if on_axis:
        omega, azimuth = np.append(0.0, omega), np.append(0.0, azimuth)
    return field_at(sensor, omega, azimuth, object_distance_mm)


def directions_of(omega_deg: Array, azimuth_deg: Array) -> tuple[Array, Array]:
    """Directions (n, 3), and unit vectors (n, 3, 2) by which they turn along the field angle and round about.

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
    """Objects (n,) at field angles and azimuths of a sensor without errors."""
    away, turned = directions_of(omega_deg, azimuth_deg)  # a sensor without errors turns nothing: one frame for both
    azimuth = np.radians(azimuth_deg)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega_deg)))
    x, z = rays.last  # where light leaves mirror or cover
    points = np.stack([x * cos, x * sin, z + sensor.mirror_pose.displacement_mm], axis=-1)
    start = np.stack([rays.x * cos, rays.x * sin], axis=-1)
    distant = bool(np.isinf(distance))
    targets = away if distant else points + distance * away
    bare = Field(sensor, targets, distant, start, omega_deg, omega_deg, omega_deg, azimuth_deg)
    shown, lost, _ = bare.shown({}, count=1)
    if lost.any():
        raise InvalidParameter(
            f"without errors {sensor.name!r} shows nothing at {omega_deg[lost[0]][0]:.4g} deg; field_deg is valid "
            f"where nothing of its housing stands in the light, {sensor.clear_field_deg[0]:.4g} to "
            f"{sensor.clear_field_deg[1]:.4g} deg"
        )
    if are_traced_together(sensor):
        px_per_deg = np.radians(shown.by_direction[0] @ turned)
    else:
        px_per_deg = _px_per_deg(bare, points, distance, turned)
    return replace(bare, offsets_px=shown.offsets_px[0], px_per_deg=px_per_deg)


def _px_per_deg(field: Field, points: Array, distance: float, turned: Array) -> Array:
    """How far (n, 2, 2) a degree moves the picture, by differences, along tangents (n, 3, 2) of the objects' sphere."""
    columns = []
    for k in range(2):
        step, ends = np.radians(STEP_DEG) * turned[..., k], []
        for sign in (1, -1):
            moved = field.targets + sign * step * (1.0 if field.distant else distance)
            unit = np.linalg.norm(moved, axis=1, keepdims=True) if field.distant else 1.0
            ends.append(replace(field, targets=moved / unit).picture({}, 1, rim_slack=BEYOND).offsets_px[0])
        columns.append((ends[0] - ends[1]) / (2 * STEP_DEG))
    return np.stack(columns, axis=-1)
