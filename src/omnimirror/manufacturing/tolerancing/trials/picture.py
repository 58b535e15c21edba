"""From viewing angles to the picture: distortion and imager, blur, and the focus that each sensor is given."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .tracing import SeenObjects, States

Array = NDArray[np.float64]
Refocus = Literal["none", "rms", "worst"]
"""Whether each sensor is focused anew: not, for the least rms of its blur, or for the least worst one."""
REFOCUS: tuple[Refocus, ...] = ("none", "rms", "worst")

HALVINGS = 32
"""Of the golden section: to 2e-7 of where the best focus may lie."""
GOLDEN = (np.sqrt(5.0) - 1) / 2


class Picture(NamedTuple):
    """Of trials (t,) and objects (n,)."""

    offsets_px: Array
    """(t, n, 2) from the optical axis, right and down in the unflipped picture; NaN where lost."""
    blur_px: Array
    """(t, n, 2, 2): the unit circle of the aperture times this is the blur's ellipse of diameters, in px."""
    by_direction: Array
    """(t, n, 2, 3): px per rad of the object's direction in the mirror's frame."""
    vergence: Array
    """(t,) in focus at the entrance pupil, 1/mm."""


def pictured(states: States, found: SeenObjects, refocus: Refocus = "none") -> Picture:
    """The picture that trials show.

    Parameters
    ----------
    states
        Of t trials.
    found
        What they see.
    refocus
        How each is focused; its picture then breathes.

    Returns
    -------
    Picture
        Of the objects seen.
    """
    with np.errstate(all="ignore"):
        tangents = np.where(found.lost[..., None], np.nan, found.tangents)
        widen, _, depth = _imaged(states, tangents)
        spread = widen @ _less(found.vergences, _tilted_by(states, depth))
        vergence = states.vergence if refocus == "none" else best_vergences(widen, spread, refocus)
        f = states.breathing_mm
        breath = (1 - f * states.vergence) / (1 - f * vergence)
        widen, offsets, depth = _imaged(states, tangents, breath)
        vergences = _less(found.vergences, _tilted_by(states, depth))
        blur = states.aperture_mm[:, None, None, None] * (vergence[:, None, None, None] * widen - widen @ vergences)
        return Picture(offsets, blur, widen @ found.by_direction, vergence)


def imaged_at(states: States, tangents: Array, vergence: Array) -> Array:
    """Where (t, n, 2) px trials show what the lens sees under tangents (t, n, 2), focused at vergences (t,)."""
    f = states.breathing_mm
    return _imaged(states, tangents, (1 - f * states.vergence) / (1 - f * vergence))[1]


def _less(vergences: Array, part: Array) -> Array:
    """Vergences (t, n, 2, 2) seen from an imager that is in focus at others by a part (t, n)."""
    less: Array = vergences - part[..., None, None] * np.eye(2)
    return less


def _tilted_by(states: States, depth: Array) -> Array:
    """By how much (t, n) the vergence in focus on a tilted imager is that of its middle and more, 1/mm.

    The place of an object lies at a depth behind the lens, and the distance in focus follows from the lens equation.
    """
    tilted = (states.imager[:, 2, :2] != 0).any(axis=1)
    if not tilted.any():
        return np.zeros_like(depth)
    f, v = states.focal_mm[:, None], states.vergence[:, None]
    breathing = states.breathing_mm[:, None]
    middle = f / (1 - breathing * v)
    behind = middle * (1 + (f - breathing) * v) + depth - middle
    part = 1 / (f * behind / (behind - f) - (f - breathing)) - v
    return np.where(tilted[:, None], part, 0.0)


def _imaged(states: States, tangents: Array, breath: Array | None = None) -> tuple[Array, Array, Array]:
    """Derivatives (t, n, 2, 2) px per unit of tangents, offsets (t, n, 2) px, and depths (t, n) mm of their places."""
    moved, (xx, xy, yy) = _distorted(tangents, states.brown)
    if breath is not None:
        moved, xx, xy, yy = moved * breath[:, None, None], *(d * breath[:, None] for d in (xx, xy, yy))
    h = states.imager[:, None]
    flat = np.concatenate([moved, np.ones((*moved.shape[:-1], 1))], axis=-1)
    u, v, w = np.moveaxis(np.einsum("tnij,tnj->tni", np.broadcast_to(h, (*flat.shape, 3)), flat), -1, 0)
    offsets = np.stack([u, v], axis=-1) / w[..., None]
    plane = (h[..., :2, :2] - offsets[..., None] * h[..., 2:, :2]) / w[..., None, None]
    lens = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    return plane @ lens, offsets, 1 / w


def _distorted(tangents: Array, brown: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """As :mod:`omnimirror.lenses.distortion` says, each trial by its own coefficients; with derivatives xx, xy, yy."""
    x, y = tangents[..., 0], tangents[..., 1]
    k1, k2, k3, p1, p2 = brown.T[..., None]
    s = x * x + y * y
    radial, rate = 1 + s * (k1 + s * (k2 + s * k3)), 2 * (k1 + s * (2 * k2 + 3 * s * k3))
    moved = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    xx = radial + x * x * rate + 2 * p1 * y + 6 * p2 * x
    xy = x * y * rate + 2 * p1 * x + 2 * p2 * y
    yy = radial + y * y * rate + 6 * p1 * y + 2 * p2 * x
    return moved, (xx, xy, yy)


def best_vergences(widen: Array, spread: Array, refocus: Refocus) -> Array:
    """Vergences (t,) of the best focus, of W and of W V (t, n, 2, 2).

    The blur ``v W - W V`` is a straight function of the vergence v: the sum of its squares is a parabola, and the worst
    of the blurs a convex function.
    """
    squares, mixed = np.nansum(widen**2, axis=(1, 2, 3)), np.nansum(widen * spread, axis=(1, 2, 3))
    middle: Array = mixed / squares
    if refocus == "rms":
        return middle
    size, turned = _squared_blur(widen, spread)
    half, product = turned[1] / turned[2] / -2, turned[0] / turned[2]
    apart = np.sqrt(np.abs(half**2 - product))
    low, high = np.nanmin(half - apart, axis=1), np.nanmax(half + apart, axis=1)

    def worst(v: Array) -> Array:
        v = v[:, None]
        square, det = size[0] + v * (size[1] + v * size[2]), turned[0] + v * (turned[1] + v * turned[2])
        return np.asarray(np.nanmax(square + np.sqrt(np.maximum(square**2 - 4 * det**2, 0.0)), axis=1))

    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_a, at_b = worst(a), worst(b)
    for _ in range(HALVINGS):
        left = at_a < at_b
        low, high = np.where(left, low, a), np.where(left, b, high)
        new = np.where(left, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        at_new = worst(new)
        a, b = np.where(left, new, b), np.where(left, a, new)
        at_a, at_b = np.where(left, at_new, at_b), np.where(left, at_a, at_new)
    return np.asarray((low + high) / 2)


def _squared_blur(widen: Array, spread: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Coefficients of 1, v and v^2 of the sum of squares and of the determinant of ``v W - S``."""
    w, s = widen.reshape(*widen.shape[:-2], 4), spread.reshape(*spread.shape[:-2], 4)
    size = (s * s).sum(axis=-1), -2 * (w * s).sum(axis=-1), (w * w).sum(axis=-1)
    crossed = w[..., 0] * s[..., 3] + s[..., 0] * w[..., 3] - w[..., 1] * s[..., 2] - s[..., 1] * w[..., 2]
    return size, (s[..., 0] * s[..., 3] - s[..., 1] * s[..., 2], -crossed, np.linalg.det(widen))


def largest_diameter(blur: Array) -> Array:
    """Largest diameter (..) of the ellipses that matrices (.., 2, 2) make of the unit circle.

    >>> float(largest_diameter(np.array([[3.0, 0.0], [0.0, -4.0]])))
    4.0
    """
    (p, s), (q, r) = diameter_parts(blur)
    diameter: Array = np.hypot(p, s) + np.hypot(q, r)
    return diameter


def diameter_parts(blur: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Two vectors, the sum of whose lengths is the largest diameter: of what turns a circle, and what makes it oval."""
    p, q = (blur[..., 0, 0] + blur[..., 1, 1]) / 2, (blur[..., 0, 0] - blur[..., 1, 1]) / 2
    r, s = (blur[..., 1, 0] + blur[..., 0, 1]) / 2, (blur[..., 1, 0] - blur[..., 0, 1]) / 2
    return (p, s), (q, r)
