"""Pictures of sensors with errors that are built and traced one by one, of whatever kind they are.

What :mod:`.tracing` traces by the thousand is a perspective lens before one bare mirror. Any other sensor, behind a
tube or a dome, with a telecentric or a real lens or with two mirrors, is made with its errors as an ordinary one, and
asked in space where it shows each object: by the chief ray, and by rays through four points of the aperture close to
it, whose places on the imager are the blur's ellipse. A second traces fifty to some hundred.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....errors import OmnimirrorError, SelfObstruction
from ....imagers import ImagerPose
from ....lenses import Perspective
from ....sensor import Sensor
from ....tracing.reflection import RIM_SLACK, Ends
from ..errors import check_built_with, perturbed
from .picture import Picture, Refocus, best_vergences

Array = NDArray[np.float64]

EDGE = 0.02
"""Of the aperture's radius, where rays beside the chief ray go through: aberrations add 4e-4 of theirs at its edge."""
SIDES = EDGE * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
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
        blur = np.stack([sides[:, 0] - sides[:, 1], sides[:, 2] - sides[:, 3]], axis=-1) / EDGE
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
