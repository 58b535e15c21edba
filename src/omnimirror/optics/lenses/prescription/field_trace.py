"""Field functions of a lens prescription by real ray tracing.

Chief rays pass the centre of the stop, found for each viewing angle; T and S focus are those of
adjacent rays. The pupil at an angle is the image of the unvignetted stop: its edge is found for 16
azimuths.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ....base.errors import InvalidParameter
from ....base.typing import Array
from ..field import FieldNodes
from .sequence import Landed, Sequence

NODES = 29
COLOUR_STEPS = 4  # each reduces the residual to 1 %
STEPS = 60
CLOSE = 1e-12  # mm on the stop
SEARCHED = np.tan(np.radians(np.arange(0.5, 80.5, 0.5)))
LEAST_FIELD_DEG = 1.0
NEXT = 1e-3  # offset of adjacent rays, relative to the pupil radius
AZIMUTHS = 16
RINGS = 6
HALVINGS = 24
EDGE = 1 + 1e-9


class Traced(NamedTuple):
    """Lens prescription with imager, pupil and stop."""

    sequence: Sequence
    to_imager: float
    pupil: float
    """Position of the paraxial entrance pupil, towards the mirror from the first vertex, mm."""
    pupil_radius: float
    stop_radius: float
    focus_mm: float
    """Object distance in focus, from the first vertex."""

    def land(self, tangent: Array, height: Array, across: Array | float = 0.0, slope: Array | float = 0.0) -> Landed:
        """Trace rays (n,) by tangents and heights at the first vertex.

        The image is upright.
        """
        t, y, x, u = np.broadcast_arrays(tangent, height, across, slope)
        places, slopes = np.stack([y, x], axis=-1), -np.stack([t, u], axis=-1)
        return self.sequence.trace(places, slopes, self.to_imager).upright()


def stop_radius(traced: Traced) -> float:
    """Return the stop radius (mm) by a ray through the edge of the pupil."""
    slope = -traced.pupil_radius / (traced.focus_mm - traced.pupil)
    edge = traced.land(np.array([slope]), np.array([traced.pupil_radius - slope * traced.pupil])).stop
    if not np.isfinite(edge[0, 0]):
        raise InvalidParameter(
            f"the opening, {2 * traced.pupil_radius:.4g} mm, is wider than the surfaces of the lens; a larger f_number "
            "is valid"
        )
    return abs(float(edge[0, 0]))


def chief_heights(traced: Traced, tangent: Array) -> Array:
    """Return the heights (n,) of chief rays at the first vertex; NaN if none."""
    y = -tangent * traced.pupil
    step = 1e-6 * traced.pupil_radius
    for _ in range(STEPS):
        at = traced.land(tangent, y).stop[:, 0]
        rate = (traced.land(tangent, y + step).stop[:, 0] - at) / step
        move = np.clip(-at / rate, -traced.pupil_radius, traced.pupil_radius)
        y = y + move
        if not (np.abs(at) > CLOSE).any():
            break
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(at) <= 1e3 * CLOSE, y, np.nan)


def field_end(traced: Traced, largest_tangent: float) -> float:
    """Return the tangent up to which chief rays pass all surfaces with increasing image height.

    Raises
    ------
    InvalidParameter
        If the lens transmits no light.
    """
    tangents = SEARCHED[largest_tangent * EDGE >= SEARCHED]
    tangents = np.append(tangents[tangents < largest_tangent], min(largest_tangent, SEARCHED[-1]))
    found = traced.land(tangents, chief_heights(traced, tangents))
    grows = np.diff(found.image[:, 0], prepend=0.0) > 0
    good = found.on_glass & np.isfinite(found.image[:, 0]) & grows & found.clear
    count = len(good) if good.all() else int(np.argmin(good))
    if not count or tangents[count - 1] < np.tan(np.radians(LEAST_FIELD_DEG)):
        raise InvalidParameter(
            "the lens lets no chief ray through to its imager; stop, apertures and distances are valid if light within "
            f"{LEAST_FIELD_DEG:g} deg of the axis passes"
        )
    return float(tangents[count - 1])


def traced_field(traced: Traced, end: float, indices: tuple[Array, Array] | None) -> FieldNodes:
    """Return the field functions of a lens from the axis to a tangent.

    Parameters
    ----------
    traced, end
    indices
        Refractive indices at the shortest and the longest wavelength.

    Raises
    ------
    InvalidParameter
        If rays through the edge of the pupil miss a surface.
    """
    t = np.linspace(0.0, end, NODES)
    y = chief_heights(traced, t)
    height = traced.land(t, y).image[:, 0]
    height[0] = 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        place = np.where(t == 0.0, traced.pupil, -y / t)
    fan = _next_to_chief(traced, t, place)
    focus = fan[0] / fan[2], fan[1] / fan[3]
    whole, edge = _edges(traced, t, place, focus)
    own = _own_blur(traced, t, place, focus, edge)
    area = (edge**2).mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        lateral = np.where(t == 0.0, fan[2], height / t)
    light = area / area[0] * (1 + t**2) ** -2 * fan[2][0] ** 2 / (lateral * fan[2])
    width_t, width_s, shift = _ellipse(edge)
    stop_t, stop_s, stop_shift = _ellipse(whole)
    openness = area / (whole**2).mean(axis=1)
    colours = [
        height * 0.0 if index is None else _height_at(traced, index, t, place) - height
        for index in (indices or (None, None))
    ]
    nodes = FieldNodes(
        t, height, place, *focus, fan[2], fan[3], width_t, width_s, shift, light, *own,
        colours[0], colours[1], stop_t, stop_s, stop_shift, openness,
    )  # fmt: skip
    finite = np.isfinite(np.stack(nodes)).all(axis=0)
    if not finite.all():
        angle = float(np.degrees(np.arctan(t[np.argmin(finite)])))
        raise InvalidParameter(
            f"rays through the edge of the pupil must pass all surfaces; some at {angle:.4g} deg miss one. "
            "Increase f_number or reduce field_max_deg"
        )
    return nodes


def _ellipse(edge: Array) -> tuple[Array, Array, Array]:
    """Return half widths (n,) and centre offset (n,) of edges (n, 16)."""
    ahead, behind, side = edge[:, 0], edge[:, AZIMUTHS // 2], edge[:, AZIMUTHS // 4]
    shift = (ahead - behind) / 2
    shift[0] = 0.0
    return (ahead + behind) / 2, side, shift


def _height_at(traced: Traced, index: Array, tangent: Array, place: Array) -> Array:
    """Return image heights (n,) of chief rays at another wavelength."""
    other = traced._replace(sequence=replace(traced.sequence, index=index))
    point = tangent * (traced.focus_mm - place)
    for _ in range(COLOUR_STEPS):
        y = chief_heights(other, tangent)
        tangent = (point - y) / traced.focus_mm
    return other.land(tangent, chief_heights(other, tangent)).image[:, 0]


def _next_to_chief(traced: Traced, t: Array, place: Array) -> tuple[Array, Array, Array, Array]:
    """Return derivatives (n,) of the image by pupil position and slope, tangential and sagittal."""
    y = NEXT * traced.pupil_radius
    u = y / 100.0

    def image(along: float, across: float, turned: float, lifted: float) -> Array:
        tangent = t + turned
        return traced.land(tangent, along - tangent * place, across - lifted * place, lifted).image

    def rate(axis: int, step: float, *which: float) -> Array:
        ahead, behind = (image(*(s * step * w for w in which)) for s in (1.0, -1.0))
        return np.asarray((ahead - behind)[:, axis] / (2 * step))

    return rate(0, y, 1, 0, 0, 0), rate(1, y, 0, 1, 0, 0), rate(0, u, 0, 0, 1, 0), rate(1, u, 0, 0, 0, 1)


def _through(traced: Traced, t: Array, place: Array, focus: tuple[Array, Array], pupil: Array) -> Landed:
    """Trace rays (n k,) through pupil points (n, k, 2), mm, aimed at their foci."""
    along, across = pupil[..., 0], pupil[..., 1]
    tangent = t[:, None] - along * focus[0][:, None]
    lifted = -across * focus[1][:, None]
    z = place[:, None]
    return traced.land(tangent.ravel(), (along - tangent * z).ravel(), (across - lifted * z).ravel(), lifted.ravel())


def _edges(traced: Traced, t: Array, place: Array, focus: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the edges (n, 16) of stop and open pupil, relative to the axial radius.

    Azimuths are measured from the upper side of the meridian.
    """
    turn = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    ways = np.stack([np.cos(turn), np.sin(turn)], axis=-1)

    def landed(reach: Array) -> Landed:
        return _through(traced, t, place, focus, traced.pupil_radius * reach[..., None] * ways)

    reach = np.ones((len(t), AZIMUTHS))
    for _ in range(8):  # the stop radius is almost proportional to the pupil radius
        stop = landed(reach).stop.reshape(len(t), AZIMUTHS, 2)
        with np.errstate(invalid="ignore"):
            share = np.clip(traced.stop_radius / np.hypot(stop[..., 0], stop[..., 1]), 0.5, 2.0)
        reach = reach * np.where(np.isfinite(share), share, 0.9)
    open_ = landed(reach).clear.reshape(reach.shape)
    if open_.all():
        return reach, reach
    low, high = np.where(open_, reach, 0.0), reach
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        passes = landed(middle).clear.reshape(reach.shape)
        low, high = np.where(passes, middle, low), np.where(passes, high, middle)
    return reach, np.maximum(low, 1e-6)


def _own_blur(traced: Traced, t: Array, place: Array, focus: tuple[Array, Array], edge: Array) -> tuple[Array, Array]:
    """Return four standard deviations (n,), (n,), mm, of all rays in their foci."""
    turn = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    radii = np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    reach = traced.pupil_radius * radii[None, :, None] * edge[:, None, :]
    pupil = np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=-1).reshape(len(t), -1, 2)
    image = _through(traced, t, place, focus, pupil).image.reshape(*pupil.shape)
    weight = np.tile(edge**2, (1, RINGS))
    weight /= weight.sum(axis=1, keepdims=True)
    mean = np.einsum("nk,nka->na", weight, image)
    spread = np.sqrt(np.einsum("nk,nka->na", weight, (image - mean[:, None]) ** 2))
    return 4 * spread[:, 0], 4 * spread[:, 1]
