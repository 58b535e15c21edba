"""Best focus of many designs: the vergence that minimises the maximum floored blur area.

As a function of the vergence v in focus (1/L0; -L0 for a telecentric lens), the squared floored
area of a mirror point is

    A^2 = D(v) ((v - v_t)^2 + r(v)) ((v - v_s)^2 + r(v)) / (M_t M_s)^2

with the vergences v_t and v_s of its images, its angular magnifications M_t and M_s, and functions
r and D of the camera (a pixel and the Airy disc relative to the aperture blur; the image scale),
which are constant for a telecentric lens. The maximum over the field is sampled; in the best
valley, the tangents of the worst points on both sides are intersected until convergence. Other
valleys are refined if the tangents at the samples indicate a comparable minimum. The compiled
evaluator executes the same steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.optimisation import (
    BISECTION_PERIOD,
    MAX_BRACKET_STEPS,
    MIN_BRACKET_REDUCTION,
    RowIndices,
    WorstValues,
    minimise_brackets,
)
from ...base.typing import Array
from .closed_forms import (
    DEGREE,
    MirrorPointOptics,
    PerspectiveCamera,
    RealCamera,
    TelecentricCamera,
    focus_powers,
)

SCAN = 17  # vergences sampled for valleys
MARGIN = 0.05  # fraction of the range of vergences, on both sides
# Tangents may intersect above a known minimum: areas are not convex; also in focus.hpp
TANGENT_MARGIN = 0.02
CLOSE = 1e-12  # width of the final bracket, relative to the scanned range
FOCUS_SEARCH = (SCAN, MARGIN, CLOSE, MAX_BRACKET_STEPS, MIN_BRACKET_REDUCTION, BISECTION_PERIOD)
"""The same constants for the compiled evaluator."""


@dataclass(frozen=True)
class AreaModel:
    """Functions r and D of n designs, from b = 1/b0 = 1/f - v.

    ``r = scale (b^2 + a^2)``, divided by b^2 in the paper's mode, and ``D = delta b^(4 power)``.
    Arrays are (n, 1); ``bounds`` are the vergences of the focus range. For a telecentric lens r and
    D are constant: the paper's mode without the Airy disc.
    """

    inverse_f: Array
    airy2: Array
    scale: Array
    delta: Array
    paper: bool
    power: int
    bounds: tuple[Array, Array]

    @classmethod
    def of(cls, camera: PerspectiveCamera | TelecentricCamera, count: int) -> AreaModel:
        """Create the model of ``count`` designs from a camera with numbers or arrays (count,)."""
        if isinstance(camera, TelecentricCamera):
            return cls._telecentric(camera, count)
        f, F, pitch = camera.focal_length_mm, camera.f_number, camera.pitch_mm
        paper, scaled = camera.mode == "paper", camera.image_radius_px is not None
        blur = f / (F * pitch) * (f if paper else 1.0)
        image = (
            camera.image_radius_px / camera.rim_ray
            if camera.image_radius_px is not None
            else 1 / pitch
        )
        airy = 2.44e-6 * camera.wavelength_nm * F / (f * pitch)
        a, b, c, d = _columns((1 / f, airy**2, 1 / blur**2, (blur / (image * DEGREE)) ** 4), count)
        return cls(a, b, c, d, paper, int(paper) - int(scaled), (1e-7 * a, 0.999 * a))

    @classmethod
    def _telecentric(cls, camera: TelecentricCamera, count: int) -> AreaModel:
        nowhere = np.zeros((1, 1))
        blur, image = camera.px_per_vergence(nowhere), camera.px_per_ray(nowhere)
        r = (1 + camera.airy_px(nowhere) ** 2) / blur**2
        none, c, d = _columns((np.inf, r, (blur / (image * DEGREE)) ** 4), count)
        return cls(none, np.zeros_like(c), c, d, True, 0, (-none, none))

    def part(self, rows: RowIndices) -> AreaModel:
        """Return the model of a subset of the designs."""
        a, b, c, d, *bounds = (
            x[rows] for x in (self.inverse_f, self.airy2, self.scale, self.delta, *self.bounds)
        )
        return AreaModel(a, b, c, d, self.paper, self.power, (bounds[0], bounds[1]))

    def at(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """Compute r, dr/dv, D and d ln D/dv at vergences (n, 1)."""
        b = self.inverse_f - v
        b2 = b * b
        if self.paper:
            r, dr = self.scale * (1 + self.airy2 / b2), 2 * self.scale * self.airy2 / (b2 * b)
        else:
            r, dr = self.scale * (b2 + self.airy2), -2 * self.scale * b
        D = self.delta * (b2 * b2) ** self.power if self.power else self.delta
        return r, dr, D, -4 * self.power / b


def _columns(values: tuple[Array | float, ...], count: int) -> list[Array]:
    return [np.broadcast_to(np.asarray(v, dtype=float).reshape(-1), count)[:, None] for v in values]


@dataclass(frozen=True)
class IdealAreas:
    """Floored areas of designs with ideal lenses, at any focus.

    Attributes
    ----------
    vergence_t, vergence_s : (n, k)
        Image vergences at k field angles of n designs.
    density : (n, k)
        (M_t M_s)^-2 of these, 0 for excluded angles.
    """

    vergence_t: Array
    vergence_s: Array
    density: Array
    model: AreaModel

    def part(self, rows: RowIndices) -> IdealAreas:
        """Return the areas of a subset of the designs."""
        model = self.model if isinstance(rows, slice) else self.model.part(rows)
        return IdealAreas(self.vergence_t[rows], self.vergence_s[rows], self.density[rows], model)

    @property
    def range(self) -> tuple[Array, Array]:
        """Ends (n, 1) of the vergences to scan."""
        return _range(self.vergence_t, self.vergence_s, self.model.bounds)

    def maximum(self, v: Array) -> WorstValues:
        """Return the largest A^2 at vergences (n, 1), its derivative and its angle, (n, 1)."""
        return _maximum(v, self.vergence_t, self.vergence_s, self.density, self.model)


@dataclass(frozen=True)
class RealAreas:
    """Floored areas of designs with one real lens, at any focus: parabolas of the lens's q.

    Attributes
    ----------
    t, s, own_t, own_s, dh, dw : (3, n, k)
        Signed blur and own blur, px, and resolution, px/deg, by powers of q (:class:`.closed_forms.LensTables`).
    middle_t, middle_s : (n, k)
        Vergences in focus at which single blurs are approximately 0.
    counts : (n, k)
        1 for included angles, 0 for others.
    """

    t: Array
    s: Array
    own_t: Array
    own_s: Array
    dh: Array
    dw: Array
    middle_t: Array
    middle_s: Array
    counts: Array
    camera: RealCamera

    @classmethod
    def of(cls, o: MirrorPointOptics, camera: RealCamera, counts: Array) -> RealAreas:
        """Create the areas of mirror points (n, k)."""
        lens = camera.tables
        lens_columns = lens.at(o.ray)
        _, _, far_t, spread_t, far_s, spread_s, own_t, own_s = (
            c / camera.pitch_mm for c in lens_columns[3:]
        )
        wide = lens.focal_length_mm / lens.f_number
        guess = np.clip(
            np.nanmean(o.vergence_t + o.vergence_s, axis=1, keepdims=True) / 2, *camera.bounds
        )
        q = lens.defocus(guess)
        at_t, at_s = (
            focus_powers(far, q) / focus_powers(spread, q)
            for far, spread in ((far_t, spread_t), (far_s, spread_s))
        )
        t, s = wide * (far_t - spread_t * o.vergence_t), wide * (far_s - spread_s * o.vergence_s)
        dh, dw = camera.resolution(o, lens_columns)
        return cls(
            t,
            s,
            own_t,
            own_s,
            dh,
            dw,
            o.vergence_t - at_t + guess,
            o.vergence_s - at_s + guess,
            counts,
            camera,
        )

    def part(self, rows: RowIndices) -> RealAreas:
        """Return the areas of a subset of the designs."""
        t, s, own_t, own_s, dh, dw = (
            c[:, rows] for c in (self.t, self.s, self.own_t, self.own_s, self.dh, self.dw)
        )
        rest = self.middle_t[rows], self.middle_s[rows], self.counts[rows], self.camera
        return RealAreas(t, s, own_t, own_s, dh, dw, *rest)

    @property
    def range(self) -> tuple[Array, Array]:
        """Ends (n, 1) of the vergences to scan."""
        return _range(self.middle_t, self.middle_s, self.camera.bounds)

    def maximum(self, v: Array) -> WorstValues:
        """Return the largest A^2, its derivative and its angle; see :meth:`IdealAreas.maximum`."""
        q, dq = self.camera.tables.defocus(v), self.camera.tables.defocus_rate(v)
        floor, dfloor = self.camera.floor(q)
        t, s, own_t, own_s, dh, dw = (
            focus_powers(c, q) for c in (self.t, self.s, self.own_t, self.own_s, self.dh, self.dw)
        )
        areas = (
            (t * t + own_t * own_t + floor)
            * (s * s + own_s * own_s + floor)
            / (dh * dw) ** 2
            * self.counts
        )
        j = areas.argmax(axis=1)[:, None]
        there = [
            np.take_along_axis(c, j[None], axis=2)
            for c in (self.t, self.s, self.own_t, self.own_s, self.dh, self.dw)
        ]
        (t, dt), (s, ds), (own_t, down_t), (own_s, down_s), (dh, ddh), (dw, ddw) = (
            (focus_powers(c, q), c[1] + 2 * q * c[2]) for c in there
        )
        # A^2 = (t^2 + own_t^2 + floor)(s^2 + own_s^2 + floor)/(Dh Dw)^2; its logarithmic
        # derivative with respect to q is the sum of those of its factors, and dq/dv is applied at
        # the end
        side_t, side_s = t * t + own_t * own_t + floor, s * s + own_s * own_s + floor
        rate = (2 * (t * dt + own_t * down_t) + dfloor) / side_t + (
            2 * (s * ds + own_s * down_s) + dfloor
        ) / side_s
        rate -= 2 * (ddh / dh + ddw / dw)
        value = np.take_along_axis(areas, j, axis=1)
        return value, value * rate * dq, j


def best_vergences(areas: IdealAreas | RealAreas) -> tuple[Array, Array]:
    """Return the best vergences (n,) in focus, and their maximum areas (n,), deg^2."""
    low, high = areas.range
    step = (high - low) / (SCAN - 1)
    samples = low + step * np.arange(SCAN)
    evaluations = [areas.maximum(v[:, None]) for v in samples.T]
    value, rate, angle = (np.hstack(parts) for parts in zip(*evaluations, strict=True))
    k = np.clip(value.argmin(axis=1), 1, SCAN - 2)[:, None]
    close = CLOSE * (high - low)
    a, b = low + (k - 1) * step, low + (k + 1) * step

    def maximum(v: Array, rows: RowIndices) -> WorstValues:
        return areas.part(rows).maximum(v)

    def bracket_end(v: Array, rows: RowIndices) -> Array:
        return np.stack([v, *maximum(v, rows)])

    everywhere = slice(None)
    v = minimise_brackets(bracket_end(a, everywhere), bracket_end(b, everywhere), close, maximum)
    minimum = areas.maximum(v)[0]
    design, cell, kink_offset = _other_valleys(value, rate, angle, step, k, minimum)
    if design.size:
        a, b = samples[design, cell][:, None], samples[design, cell + 1][:, None]
        c = bracket_end(a + kink_offset[:, None], design)
        rises = c[2] > 0
        a, b = (
            np.where(rises, bracket_end(a, design), c),
            np.where(rises, c, bracket_end(b, design)),
        )
        second_minimum = minimise_brackets(
            a, b, close[design], lambda v, rows: maximum(v, design[rows])
        )
        lower = maximum(second_minimum, design)[0]
        for n in np.flatnonzero(lower < minimum[design]):
            if lower[n] < minimum[design[n]]:  # one design may have two
                v[design[n]], minimum[design[n]] = second_minimum[n], lower[n]
    return v[:, 0], np.sqrt(minimum[:, 0])


def _other_valleys(
    value: Array,
    rate: Array,
    angle: NDArray[np.intp],
    step: Array,
    k: NDArray[np.intp],
    minimum: Array,
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return designs, cells of the scan, and distances to the intersections of their end tangents.

    These are cells with a possible valley below that near sample k (n, 1), whose minimum is known.
    Such a valley may be between two samples that both fall, or both rise, if other angles are the
    worst there.
    """
    fa, fb, ga, gb = value[:, :-1], value[:, 1:], rate[:, :-1], rate[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = (fb - fa - gb * step) / (ga - gb)
    kink = (offset > 0) & (offset < step) & (fa + ga * offset < minimum * (1 + TANGENT_MARGIN))
    between = (ga < 0) & (gb > 0)
    cell = np.arange(SCAN - 1)
    is_main_valley = between & ((cell == k - 1) | (cell == k))
    hidden = (angle[:, :-1] != angle[:, 1:]) & (ga * gb > 0)
    design, cell = np.nonzero(kink & (between | hidden) & ~is_main_valley)
    return design, cell, offset[design, cell]


def _range(vergence_t: Array, vergence_s: Array, bounds: tuple[Any, Any]) -> tuple[Array, Array]:
    """Return the ends (n, 1) of the vergences to scan, within the focus range."""
    low = np.minimum(np.nanmin(vergence_t, axis=1), np.nanmin(vergence_s, axis=1))[:, None]
    high = np.maximum(np.nanmax(vergence_t, axis=1), np.nanmax(vergence_s, axis=1))[:, None]
    margin = MARGIN * (high - low)
    return np.clip(low - margin, *bounds), np.clip(high + margin, *bounds)


def _maximum(
    v: Array, vergence_t: Array, vergence_s: Array, density: Array, model: AreaModel
) -> tuple[Array, Array, Array]:
    """Return the largest A^2, its derivative with respect to v, and its angle; (n, 1) each."""
    r, dr, D, d_log_D = model.at(v)
    areas = _areas(v, r, vergence_t, vergence_s, density)
    j = areas.argmax(axis=1)
    flat_index = j + np.arange(len(j)) * areas.shape[1]
    # A^2 = D (t^2 + r)(s^2 + r)/(M_t M_s)^2 with t = v - v_t, s = v - v_s and the floor r(v) of pixel
    # and Airy disc; its derivative is A^2 times the sum of the logarithmic derivatives
    t, s = v - vergence_t.take(flat_index)[:, None], v - vergence_s.take(flat_index)[:, None]
    value = D * areas.take(flat_index)[:, None]
    return (
        value,
        value * (d_log_D + (2 * t + dr) / (t * t + r) + (2 * s + dr) / (s * s + r)),
        j[:, None],
    )


def _areas(v: Array, r: Array, vergence_t: Array, vergence_s: Array, density: Array) -> Array:
    """Compute A^2 divided by D, (n, k)."""
    t = v - vergence_t
    t *= t
    t += r
    s = v - vergence_s
    s *= s
    s += r
    t *= s
    t *= density
    return t
