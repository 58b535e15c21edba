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
        widen, _ = _imaged(states, tangents)
        spread = widen @ found.vergences
        vergence = states.vergence if refocus == "none" else _focused(states, widen, spread, refocus)
        f = states.breathing_mm
        breath = (1 - f * states.vergence) / (1 - f * vergence)
        widen, offsets = _imaged(states, tangents, breath)
        blur = states.aperture_mm[:, None, None, None] * (
            vergence[:, None, None, None] * widen - widen @ found.vergences
        )
        return Picture(offsets, blur, widen @ found.by_direction, vergence)


def _imaged(states: States, tangents: Array, breath: Array | None = None) -> tuple[Array, Array]:
    """Derivatives (t, n, 2, 2) px per unit of the tangents, and offsets (t, n, 2) px."""
    moved, (xx, xy, yy) = _distorted(tangents, states.brown)
    if breath is not None:
        moved, xx, xy, yy = moved * breath[:, None, None], *(d * breath[:, None] for d in (xx, xy, yy))
    h = states.imager[:, None]
    flat = np.concatenate([moved, np.ones((*moved.shape[:-1], 1))], axis=-1)
    u, v, w = np.moveaxis(np.einsum("tnij,tnj->tni", np.broadcast_to(h, (*flat.shape, 3)), flat), -1, 0)
    offsets = np.stack([u, v], axis=-1) / w[..., None]
    plane = (h[..., :2, :2] - offsets[..., None] * h[..., 2:, :2]) / w[..., None, None]
    lens = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    return plane @ lens, offsets


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


def _focused(states: States, widen: Array, spread: Array, refocus: Refocus) -> Array:
    """Vergences (t,) of the best focus.

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
