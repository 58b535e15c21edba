"""The best focus of many designs at once: the vergence that makes the worst floored blur area least.

Over the vergence v = 1/L0 the square of the floored area of a mirror point is

    A^2 = D(v) ((v - v_t)^2 + r(v)) ((v - v_s)^2 + r(v)) / (radial around)^2

with v_t = 1/L_t, v_s = 1/L_s, and two functions r and D of the camera alone (a pixel and the Airy disk
over the blur of the aperture; the scale of the image). Its maximum over the field is scanned; in the
best valley the tangents of the worst points on either side are made to meet until they meet at the
bottom. The compiled evaluator goes through the same steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .optics import DEGREE, Camera

Array = NDArray[np.float64]

SCAN = 17  # vergences at which valleys are looked for
MARGIN = 0.05  # of the range of vergences, on either side
MOST_STEPS = 60
CLOSE = 1e-12  # of the scanned range: a bracket so narrow holds the focus
EDGE = 1e-3  # of a bracket, which every step cuts off at least
HALVING = 4  # every so many steps the bracket is halved, whatever the tangents say


@dataclass(frozen=True)
class AreaModel:
    """r and D of n designs, from b = 1/b0 = 1/f - v: ``r = scale (b^2 + a^2)``, over b^2 in the paper's mode,
    and ``D = delta b^(4 power)``. Arrays (n, 1)."""

    inverse_f: Array
    airy2: Array
    scale: Array
    delta: Array
    paper: bool
    power: int

    @classmethod
    def of(cls, camera: Camera, count: int) -> AreaModel:
        """The model of ``count`` designs, whose camera holds numbers or arrays (count,)."""
        f, F, pitch = camera.focal_length_mm, camera.f_number, camera.pitch_mm
        paper, scaled = camera.mode == "paper", camera.image_radius_px is not None
        blur = f / (F * pitch) * (f if paper else 1.0)
        image = camera.image_radius_px / camera.rim_tangent if camera.image_radius_px is not None else 1 / pitch
        airy = 2.44e-6 * camera.wavelength_nm * F / (f * pitch)
        columns = (1 / f, airy**2, 1 / blur**2, (blur / (image * DEGREE)) ** 4)
        a, b, c, d = (np.broadcast_to(np.asarray(v, dtype=float), count)[:, None] for v in columns)
        return cls(a, b, c, d, paper, int(paper) - int(scaled))

    def at(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """r, dr/dv, D and d ln D/dv at vergences (n, 1)."""
        b = self.inverse_f - v
        b2 = b * b
        if self.paper:
            r, dr = self.scale * (1 + self.airy2 / b2), 2 * self.scale * self.airy2 / (b2 * b)
        else:
            r, dr = self.scale * (b2 + self.airy2), -2 * self.scale * b
        D = self.delta * (b2 * b2) ** self.power if self.power else self.delta
        return r, dr, D, -4 * self.power / b

    def squares(self, v: Array, near_t: Array, near_s: Array, density: Array) -> Array:
        """A^2 over D (n, k) at vergences (n, 1)."""
        r, _, _, _ = self.at(v)
        t = v - near_t
        t *= t
        t += r
        s = v - near_s
        s *= s
        s += r
        t *= s
        t *= density
        return t


def best_vergences(near_t: Array, near_s: Array, density: Array, model: AreaModel) -> tuple[Array, Array]:
    """Vergence (n,), 1/mm, of the least worst floored area, and that area (n,), square degrees.

    Parameters
    ----------
    near_t, near_s : (n, k) 1/mm
        1/L_t and 1/L_s of k field angles of n designs.
    density : (n, k)
        (radial around)^-2 of the same, 0 for angles that do not count.
    """
    low, high = vergence_range(near_t, near_s, model.inverse_f)
    step = (high - low) / (SCAN - 1)
    worst = np.empty((len(near_t), SCAN))
    for i in range(SCAN):
        v = low + i * step
        worst[:, i] = model.squares(v, near_t, near_s, density).max(axis=1)
        worst[:, i] *= model.at(v)[2][:, 0]
    k = np.clip(worst.argmin(axis=1), 1, SCAN - 2)[:, None]
    a, b = low + (k - 1) * step, low + (k + 1) * step
    v = _bottom(a, b, CLOSE * (high - low), lambda v: _worst(v, near_t, near_s, density, model))
    return v[:, 0], np.sqrt(_worst(v, near_t, near_s, density, model)[0][:, 0])


def vergence_range(near_t: Array, near_s: Array, inverse_f: Array) -> tuple[Array, Array]:
    """Ends (n, 1) of the vergences worth a look: those of the images, with a margin, in front of the lens."""
    low = np.minimum(near_t.min(axis=1), near_s.min(axis=1))[:, None]
    high = np.maximum(near_t.max(axis=1), near_s.max(axis=1))[:, None]
    margin = MARGIN * (high - low)
    least, most = 1e-7 * inverse_f, 0.999 * inverse_f
    return np.clip(low - margin, least, most), np.clip(high + margin, least, most)


def _worst(v: Array, near_t: Array, near_s: Array, density: Array, model: AreaModel) -> tuple[Array, Array, Array]:
    """Largest A^2, its derivative by v, and which angle has it; (n, 1) each."""
    squares = model.squares(v, near_t, near_s, density)
    j = squares.argmax(axis=1)
    at = j + np.arange(len(j)) * squares.shape[1]
    r, dr, D, d_log_D = model.at(v)
    t, s = v - near_t.take(at)[:, None], v - near_s.take(at)[:, None]
    value = D * squares.take(at)[:, None]
    return value, value * (d_log_D + (2 * t + dr) / (t * t + r) + (2 * s + dr) / (s * s + r)), j[:, None]


def _bottom(a: Array, b: Array, close: Array, worst: Callable[[Array], tuple[Array, Array, Array]]) -> Array:
    """Where a function that falls at a and rises at b is least, to within ``close``; (n, 1) each.

    The function is the largest of many smooth ones. Where the tangents at both ends meet is a good guess
    for the kink between two of them; where one is the largest at both ends, the zero of its derivative is.
    """
    (fa, ga, ja), (fb, gb, jb) = worst(a), worst(b)
    for step in range(1, MOST_STEPS + 1):
        open_ = b - a > close
        if not open_.any():
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            c = np.where(ja == jb, a - ga * (b - a) / (gb - ga), a + (fb - fa - gb * (b - a)) / (ga - gb))
        middle = (a + b) / 2
        edge = EDGE * (b - a)
        good = np.isfinite(c) & (ga < 0) & (gb > 0) if step % HALVING else np.zeros_like(open_)
        c = np.where(good, np.clip(c, a + edge, b - edge), middle)
        f, g, j = worst(c)
        rises, falls = open_ & (g > 0), open_ & ~(g > 0)
        a, fa, ga, ja = (np.where(falls, new, old) for new, old in ((c, a), (f, fa), (g, ga), (j, ja)))
        b, fb, gb, jb = (np.where(rises, new, old) for new, old in ((c, b), (f, fb), (g, gb), (j, jb)))
    return (a + b) / 2
