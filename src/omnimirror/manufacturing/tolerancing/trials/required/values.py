"""What requirements look at, of sensors with errors: at every object of the field, in its own two directions.

Of an object, tangential is along the field angle and sagittal round about the axis that was meant. A degree of either
is a vector in the picture of a built sensor; its length is the resolution, the blur's width along it the blur. Without
errors these are Dh, Dw, Delta_t and Delta_s of the meridian (Eqs. 9, 10, 28).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .....batch.optics import light_of
from .....design.criteria.merits import FieldValues
from .....lenses import Perspective
from ..field import Field, directions_of
from ..picture import Refocus, pictured
from ..states import Values, states_of
from ..tracing import SeenObjects, States, seen

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
