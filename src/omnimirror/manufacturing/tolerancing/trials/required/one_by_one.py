"""What requirements look at, of sensors of any kind with errors, built and asked one by one."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .....errors import OmnimirrorError
from .....lenses import FieldLens, Perspective
from .....lenses.base import cos4
from .....sensor import Sensor
from .....tracing.reflection import Ends
from ...errors import perturbed
from ..field import BEYOND, STEP_DEG, Field, directions_of
from ..ordinary import shown_within
from ..picture import Refocus
from ..states import Values
from .values import BuiltView, Optics, RaysOut, looked_at, seen_from

Array = NDArray[np.float64]


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
