"""Sequential real-ray tracing of lens prescriptions, and the field functions that result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array, Mask
from ._field_lens import FieldNodes

# -- Real rays through surfaces of revolution ------------------------------------------------------
#
# Coordinates are those of the lens: x and y across, s along the light from the first surface's
# vertex.

INTERSECTION_STEPS = 30
INTERSECTION_TOLERANCE = 1e-13  # mm


class Paraxial(NamedTuple):
    """Paraxial properties of a sequence; positions along s from the first vertex, mm."""

    focal_length: float
    front_principal: float
    entrance_pupil: float
    pupil_magnification: float
    """Diameter of the entrance pupil divided by that of the stop."""
    back: tuple[float, float, float, float]
    """The matrix (a, b, c, d) from height and slope at the first vertex to those at the last."""


class SequentialTrace(NamedTuple):
    """Intersections of rays (n,) with imager, stop and surfaces."""

    image: Array
    """(n, 2), mm, on the imager."""
    stop: Array
    """(n, 2), mm, on the stop."""
    clear: Mask
    """(n,) True if they pass all clear apertures."""
    on_glass: Mask
    """(n,) True if they are within the edges of all surfaces."""
    radii: Array
    """(surfaces, n), mm: distances from the axis on the surfaces."""
    cosines: Array
    """(n, 2) direction cosines perpendicular to the axis, at the imager."""

    def upright(self) -> SequentialTrace:
        """Convert to an upright image."""
        return self._replace(image=-self.image, cosines=-self.cosines)


@dataclass(frozen=True)
class Sequence:
    """Sequence of n surfaces, including the stop, and the media between them.

    Attributes
    ----------
    curvature, conic : (n,)
    aspheres : (n, k)
        Coefficients of r^2, r^4, ...
    thickness : (n,) mm
        Distance to the next surface; that of the last surface is to the imager.
    index : (n + 1,)
        Refractive index before the first surface, and after each.
    edge, clear : (n,) mm
        Radius of the surface, and of its clear aperture; infinite if unknown.
    stop
        Index of the stop surface, from 0.
    """

    curvature: Array
    conic: Array
    aspheres: Array
    thickness: Array
    index: Array
    edge: Array
    clear: Array
    stop: int

    def paraxial(self) -> Paraxial:
        """Compute Gaussian optics with ray transfer matrices; infinities for zero power."""
        matrix, to_stop = np.eye(2), np.eye(2)
        power = self.curvature + 2 * (self.aspheres[:, 0] if self.aspheres.shape[1] else 0.0)
        for i, c in enumerate(power):
            if i == self.stop:
                to_stop = matrix.copy()
            before, after = self.index[i], self.index[i + 1]
            # refraction: n' u' = n u - (n' - n) c y; transfer: y' = y + t u
            matrix = (
                np.array([[1.0, 0.0], [-(after - before) * c / after, before / after]]) @ matrix
            )
            if i < len(power) - 1:
                matrix = np.array([[1.0, self.thickness[i]], [0.0, 1.0]]) @ matrix
        (a, b), (c, d) = matrix
        with np.errstate(divide="ignore", invalid="ignore"):
            # pupil plane s = p: the stop height of rays (y, u) is independent of u
            p = to_stop[0, 1] / to_stop[0, 0]
            return Paraxial(-1 / c, (d - 1) / c, p, 1 / to_stop[0, 0], (a, b, c, d))

    def trace(self, points: Array, slopes: Array, to_imager: float) -> SequentialTrace:
        """Trace rays from points (n, 2) in the first vertex plane with slopes (n, 2).

        NaN if a ray misses a surface or is totally reflected.
        """
        p = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
        d = np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)
        d /= np.sqrt(np.einsum("ni,ni->n", d, d))[:, None]
        clear, on_glass, stop = np.ones(len(p), bool), np.ones(len(p), bool), np.empty((len(p), 2))
        radii = np.empty((len(self.curvature), len(p)))
        with np.errstate(invalid="ignore", divide="ignore"):
            for i in range(len(self.curvature)):
                p, normal = self._meet(i, p, d)
                r2 = p[:, 0] ** 2 + p[:, 1] ** 2
                radii[i] = np.sqrt(r2)
                clear &= r2 <= self.clear[i] ** 2
                on_glass &= r2 <= self.edge[i] ** 2
                if i == self.stop:
                    stop = p[:, :2].copy()
                if self.index[i] != self.index[i + 1]:
                    d = refracted(d, normal, self.index[i] / self.index[i + 1])
                p = p.copy()
                p[:, 2] -= self.thickness[i] if i < len(self.curvature) - 1 else to_imager
            image = p[:, :2] - (p[:, 2] / d[:, 2])[:, None] * d[:, :2]
        return SequentialTrace(image, stop, clear, on_glass, radii, d[:, :2])

    def _meet(self, i: int, p: Array, d: Array) -> tuple[Array, Array]:
        """Return intersections (n, 3) and normals (n, 3), in the surface's frame."""
        c, k, a = self.curvature[i], self.conic[i], self.aspheres[i]
        p = p - (p[:, 2] / d[:, 2])[:, None] * d
        # from the vertex plane, the conic c (r^2 + (1 + k) z^2) = 2 z is a quadratic in the distance t;
        # its smaller root is written without cancellation
        square = c * (p[:, 0] ** 2 + p[:, 1] ** 2)
        along = d[:, 2] - c * (p[:, 0] * d[:, 0] + p[:, 1] * d[:, 1])
        t = square / (along + np.sqrt(along**2 - c * (1 + k * d[:, 2] ** 2) * square))
        if not a.any():
            p = p + t[:, None] * d
            normal = np.stack([-c * p[:, 0], -c * p[:, 1], 1 - c * (1 + k) * p[:, 2]], axis=-1)
            return p, normal / np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None]
        for _ in range(INTERSECTION_STEPS):
            points = p + t[:, None] * d
            sag, slope = sag_and_slope(points[:, 0] ** 2 + points[:, 1] ** 2, c, k, a)
            normal = np.stack(
                [-slope * points[:, 0], -slope * points[:, 1], np.ones_like(t)], axis=-1
            )
            step = (sag - points[:, 2]) / np.einsum("ni,ni->n", normal, d)
            t = t + step
            if not (np.abs(step) > INTERSECTION_TOLERANCE).any():
                break
        return p + t[:, None] * d, normal / np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None]


def sag_and_slope(r2: Array, c: float, k: float, a: Array) -> tuple[Array, Array]:
    """Return sag (n,) of an even asphere, and slope divided by radius, from the squared radius."""
    root = np.sqrt(1 - (1 + k) * c * c * r2)
    sag, slope = c * r2 / (1 + root), c / root
    power = np.ones_like(r2)
    for j, coefficient in enumerate(a, start=1):
        slope = slope + 2 * j * coefficient * power
        power = power * r2
        sag = sag + coefficient * power
    return sag, slope


def refracted(d: Array, normal: Array, ratio: float) -> Array:
    """Return unit directions (n, 3) after refraction; NaN for total reflection."""
    cos = np.einsum("ni,ni->n", d, normal)
    # Snell's law in vectors: the tangential component scales with n/n'
    after = np.sqrt(1 - ratio**2 * (1 - cos**2))
    outgoing: Array = ratio * d + (after - ratio * cos)[:, None] * normal
    return outgoing


# -- Field functions from traced rays --------------------------------------------------------------
#
# Chief rays pass the centre of the stop, found for each viewing angle; T and S focus are those of
# adjacent rays. The pupil at an angle is the image of the unvignetted stop: its edge is found for 16
# azimuths.

NODES = 29
COLOUR_STEPS = 4  # each reduces the residual to 1 %
CHIEF_RAY_STEPS = 60
CHIEF_RAY_TOLERANCE = 1e-12  # mm on the stop
SEARCH_TANGENTS = np.tan(np.radians(np.arange(0.5, 80.5, 0.5)))
MIN_FIELD_DEG = 1.0
ADJACENT_OFFSET = 1e-3  # offset of adjacent rays, relative to the pupil radius
AZIMUTHS = 16
RINGS = 6
BISECTIONS = 24
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

    def trace_to_imager(
        self, tangent: Array, height: Array, across: Array | float = 0.0, slope: Array | float = 0.0
    ) -> SequentialTrace:
        """Trace rays (n,) by tangents and heights at the first vertex.

        The image is upright.
        """
        t, y, x, u = np.broadcast_arrays(tangent, height, across, slope)
        points, slopes = np.stack([y, x], axis=-1), -np.stack([t, u], axis=-1)
        return self.sequence.trace(points, slopes, self.to_imager).upright()


def stop_radius(traced: Traced) -> float:
    """Return the stop radius (mm) by a ray through the edge of the pupil."""
    slope = -traced.pupil_radius / (traced.focus_mm - traced.pupil)
    edge = traced.trace_to_imager(
        np.array([slope]), np.array([traced.pupil_radius - slope * traced.pupil])
    ).stop
    if not np.isfinite(edge[0, 0]):
        raise InvalidParameter(
            "the aperture must not exceed the surfaces of the lens; its diameter is "
            f"{2 * traced.pupil_radius:.4g} mm; increase f_number"
        )
    return abs(float(edge[0, 0]))


def chief_heights(traced: Traced, tangent: Array) -> Array:
    """Return the heights (n,) of chief rays at the first vertex; NaN if none."""
    y = -tangent * traced.pupil
    step = 1e-6 * traced.pupil_radius
    for _ in range(CHIEF_RAY_STEPS):
        stop_height = traced.trace_to_imager(tangent, y).stop[:, 0]
        rate = (traced.trace_to_imager(tangent, y + step).stop[:, 0] - stop_height) / step
        move = np.clip(-stop_height / rate, -traced.pupil_radius, traced.pupil_radius)
        y = y + move
        if not (np.abs(stop_height) > CHIEF_RAY_TOLERANCE).any():
            break
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(stop_height) <= 1e3 * CHIEF_RAY_TOLERANCE, y, np.nan)


def field_end(traced: Traced, largest_tangent: float) -> float:
    """Return the tangent up to which chief rays pass all surfaces with increasing image height.

    Raises
    ------
    InvalidParameter
        If the lens transmits no light.
    """
    tangents = SEARCH_TANGENTS[largest_tangent * EDGE >= SEARCH_TANGENTS]
    tangents = np.append(
        tangents[tangents < largest_tangent], min(largest_tangent, SEARCH_TANGENTS[-1])
    )
    traces = traced.trace_to_imager(tangents, chief_heights(traced, tangents))
    grows = np.diff(traces.image[:, 0], prepend=0.0) > 0
    is_transmitted = traces.on_glass & np.isfinite(traces.image[:, 0]) & grows & traces.clear
    count = len(is_transmitted) if is_transmitted.all() else int(np.argmin(is_transmitted))
    if not count or tangents[count - 1] < np.tan(np.radians(MIN_FIELD_DEG)):
        raise InvalidParameter(
            f"chief rays within {MIN_FIELD_DEG:g} deg of the axis must reach the imager; "
            "check stop, apertures and distances of the lens"
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
    height = traced.trace_to_imager(t, y).image[:, 0]
    height[0] = 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        pupil_position = np.where(t == 0.0, traced.pupil, -y / t)
    fan = _adjacent_ray_derivatives(traced, t, pupil_position)
    focus = fan[0] / fan[2], fan[1] / fan[3]
    unvignetted, edge = _edges(traced, t, pupil_position, focus)
    lens_blur = _own_blur(traced, t, pupil_position, focus, edge)
    area = (edge**2).mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        lateral = np.where(t == 0.0, fan[2], height / t)
    # flux: open pupil area times cos^4(theta) per area of the tangents; irradiance: divided by the
    # image area per area of the tangents, dh/dt tangentially times h/t sagittally
    light = area / area[0] * (1 + t**2) ** -2 * fan[2][0] ** 2 / (lateral * fan[2])
    width_t, width_s, shift = _ellipse(edge)
    stop_t, stop_s, stop_shift = _ellipse(unvignetted)
    unvignetted_fraction = area / (unvignetted**2).mean(axis=1)
    colours = [
        height * 0.0 if index is None else _height_at(traced, index, t, pupil_position) - height
        for index in (indices or (None, None))
    ]
    nodes = FieldNodes(
        t,
        height,
        pupil_position,
        *focus,
        fan[2],
        fan[3],
        width_t,
        width_s,
        shift,
        light,
        *lens_blur,
        colours[0],
        colours[1],
        stop_t,
        stop_s,
        stop_shift,
        unvignetted_fraction,
    )
    finite = np.isfinite(np.stack(nodes)).all(axis=0)
    if not finite.all():
        angle = float(np.degrees(np.arctan(t[np.argmin(finite)])))
        raise InvalidParameter(
            "rays through the edge of the pupil must pass all surfaces; some at "
            f"{angle:.4g} deg miss one; increase f_number or reduce field_max_deg"
        )
    return nodes


def _ellipse(edge: Array) -> tuple[Array, Array, Array]:
    """Return half widths (n,) and centre offset (n,) of edges (n, 16)."""
    ahead, behind, side = edge[:, 0], edge[:, AZIMUTHS // 2], edge[:, AZIMUTHS // 4]
    shift = (ahead - behind) / 2
    shift[0] = 0.0
    return (ahead + behind) / 2, side, shift


def _height_at(traced: Traced, index: Array, tangent: Array, pupil_position: Array) -> Array:
    """Return image heights (n,) of chief rays at another wavelength."""
    recoloured = traced._replace(sequence=replace(traced.sequence, index=index))
    point = tangent * (traced.focus_mm - pupil_position)
    for _ in range(COLOUR_STEPS):
        y = chief_heights(recoloured, tangent)
        tangent = (point - y) / traced.focus_mm
    return recoloured.trace_to_imager(tangent, chief_heights(recoloured, tangent)).image[:, 0]


def _adjacent_ray_derivatives(
    traced: Traced, t: Array, pupil_position: Array
) -> tuple[Array, Array, Array, Array]:
    """Return derivatives (n,) of the image with respect to pupil position and slope, tangential
    and sagittal.
    """
    y = ADJACENT_OFFSET * traced.pupil_radius
    u = y / 100.0

    def image(along: float, across: float, slope_change: float, lifted: float) -> Array:
        tangent = t + slope_change
        return traced.trace_to_imager(
            tangent, along - tangent * pupil_position, across - lifted * pupil_position, lifted
        ).image

    def rate(axis: int, step: float, *directions: float) -> Array:
        ahead, behind = (image(*(s * step * w for w in directions)) for s in (1.0, -1.0))
        return np.asarray((ahead - behind)[:, axis] / (2 * step))

    return (
        rate(0, y, 1, 0, 0, 0),
        rate(1, y, 0, 1, 0, 0),
        rate(0, u, 0, 0, 1, 0),
        rate(1, u, 0, 0, 0, 1),
    )


def _through(
    traced: Traced, t: Array, pupil_position: Array, focus: tuple[Array, Array], pupil: Array
) -> SequentialTrace:
    """Trace rays (n k,) through pupil points (n, k, 2), mm, aimed at their foci."""
    along, across = pupil[..., 0], pupil[..., 1]
    tangent = t[:, None] - along * focus[0][:, None]
    lifted = -across * focus[1][:, None]
    z = pupil_position[:, None]
    return traced.trace_to_imager(
        tangent.ravel(),
        (along - tangent * z).ravel(),
        (across - lifted * z).ravel(),
        lifted.ravel(),
    )


def _edges(
    traced: Traced, t: Array, pupil_position: Array, focus: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the edges (n, 16) of stop and open pupil, relative to the axial radius.

    Azimuths are measured from the upper side of the meridian.
    """
    turn = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    directions = np.stack([np.cos(turn), np.sin(turn)], axis=-1)

    def landed(radii: Array) -> SequentialTrace:
        return _through(
            traced, t, pupil_position, focus, traced.pupil_radius * radii[..., None] * directions
        )

    radii = np.ones((len(t), AZIMUTHS))
    for _ in range(8):  # the stop radius is almost proportional to the pupil radius
        stop = landed(radii).stop.reshape(len(t), AZIMUTHS, 2)
        with np.errstate(invalid="ignore"):
            factor = np.clip(traced.stop_radius / np.hypot(stop[..., 0], stop[..., 1]), 0.5, 2.0)
        radii = radii * np.where(np.isfinite(factor), factor, 0.9)
    open_ = landed(radii).clear.reshape(radii.shape)
    if open_.all():
        return radii, radii
    low, high = np.where(open_, radii, 0.0), radii
    for _ in range(BISECTIONS):
        midpoint = (low + high) / 2
        passes = landed(midpoint).clear.reshape(radii.shape)
        low, high = np.where(passes, midpoint, low), np.where(passes, high, midpoint)
    return radii, np.maximum(low, 1e-6)


def _own_blur(
    traced: Traced, t: Array, pupil_position: Array, focus: tuple[Array, Array], edge: Array
) -> tuple[Array, Array]:
    """Return four standard deviations (n,), (n,), mm, of all rays in their foci."""
    turn = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    radii = np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    lengths = traced.pupil_radius * radii[None, :, None] * edge[:, None, :]
    pupil = np.stack([lengths * np.cos(turn), lengths * np.sin(turn)], axis=-1).reshape(
        len(t), -1, 2
    )
    image = _through(traced, t, pupil_position, focus, pupil).image.reshape(*pupil.shape)
    # rings of equal area: each ray represents the sector area edge^2; a uniform disc has a standard
    # deviation of a quarter of its diameter
    weight = np.tile(edge**2, (1, RINGS))
    weight /= weight.sum(axis=1, keepdims=True)
    mean = np.einsum("nk,nka->na", weight, image)
    deviation = np.sqrt(np.einsum("nk,nka->na", weight, (image - mean[:, None]) ** 2))
    return 4 * deviation[:, 0], 4 * deviation[:, 1]
