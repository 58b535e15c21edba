"""The rim of built sensors: how far its image reaches over the imager, and up to which field angle they look."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .....errors import OmnimirrorError
from .....sensor import Sensor
from ...errors import perturbed
from ..picture import imaged_at
from ..states import Values, states_of

Array = NDArray[np.float64]

AZIMUTHS = 72
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
    around, rim = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS), states.surfaces.rim_radius_mm
    x, y = (np.broadcast_to(rim * c, (len(states), AZIMUTHS)) for c in (np.cos(around), np.sin(around)))
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
    found = np.full((2, len(focus_mm), AZIMUTHS), np.nan)
    for k, focus in enumerate(focus_mm):
        try:
            built = perturbed(sensor, {name: float(of[k]) for name, of in values.items()})
            found[:, k] = _rim_of(sensor, built.with_lens(built.lens.focused_at(float(focus))))
        except OmnimirrorError:
            continue
    return RimView(*found)


def _rim_of(meant: Sensor, built: Sensor) -> tuple[Array, Array]:
    """Reaches (k,) in px and field angles (k,) in deg of one sensor, on an imager that is large enough."""
    around = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    towards = np.stack([np.cos(around), np.sin(around)], axis=-1)
    size = 4 * int(np.ceil(meant.rim_radius_px))
    wide = replace(built, imager=replace(built.imager, width_px=size, height_px=size, centre_px=None))
    middle = (size - 1) / 2
    low, high = np.full(AZIMUTHS, 0.5 * meant.rim_radius_px), np.full(AZIMUTHS, 1.6 * meant.rim_radius_px)
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
