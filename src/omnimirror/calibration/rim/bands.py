"""What is seen in bands round a ring: a mirror squeezes what it shows towards its rim, a frame has one colour, and what
is behind both knows of neither."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .cues import PARTS, SHARES, STEP_SHARE, TURNS, between, detail, unrolled
from .edges import LEAST_STEP, USUAL_STEP, Working, strongest
from .ellipses import Ellipse

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

BANDS = (
    (0.1, 0.3), (0.3, 0.6), (0.6, 0.8), (0.8, 0.9), (0.9, 0.95), (0.945, 0.985),
    (1.02, 1.055), (1.05, 1.1), (1.1, 1.2), (1.2, 1.4),
)  # fmt: skip
"""Shares of the radius."""
CAMERA, MIDDLE, WITHIN, INNER, OUTER, BEYOND, FAR = 0, 2, 3, 5, 6, 7, 8
CONTRASTS = ((INNER, OUTER), (MIDDLE, INNER), (OUTER, FAR), (MIDDLE, FAR), (CAMERA, 1), (4, BEYOND))
CALMS = BANDS[2:9]  # of which it is told how much of the way round is calm
RINGS = (
    (0.55, 0.8), (0.8, 0.92), (0.92, 0.965), (0.965, 0.99), (1.01, 1.035), (1.035, 1.08), (1.08, 1.2), (1.2, 1.4),
)  # fmt: skip
"""Shares of the radius between which another ring is looked for."""
SIDES = ((0.94, 0.97), (0.965, 0.985), (0.86, 0.89), (1.03, 1.06), (1.015, 1.035), (1.1, 1.13))
ALIKE = ((0, 3), (1, 4), (0, 2), (3, 5))  # of the sides, across the ring at two distances, inside, and outside
CALM, FAINT, FAINT_LEVELS = 0.03, 0.004, 2.0
LEAST_TURNS = 5  # of the samples once round, from which a mean is one


def numbers_round(working: Working, ellipse: Ellipse) -> Array:
    """What is seen round an ellipse (67,), NaN where the picture does not reach.

    Band by band: logarithms of what changes along the way round and of how much more changes across it, in shares of a
    usual edge, and of the spread of the colours, levels. Then the clearest ring of each distance and this one; how
    bands differ in colour, and how bright they are; how both sides go on across the ring; how much of bands is calm.
    """
    polar, inside = unrolled(working, ellipse)
    half, seen = polar[::2], inside[::2]
    least = max(LEAST_STEP / 2, 2.5 * working.noise)
    along, across = (_counted(steps, least) for steps in _steps(polar, ellipse.radius))
    count = seen.sum(axis=0)
    turning, crossing = _mean(along[..., None], seen, count)[:, 0], _mean(across[..., None], seen, count)[:, 0]
    level = _mean(half, seen, count)
    spread = np.sqrt(np.maximum(_mean(half * half, seen, count) - level**2, 0.0)).max(axis=1)
    turn, cross, spreads, colours = (_banded(x) for x in (turning, crossing, spread, level))
    texture = np.log(turn + FAINT)
    clear = [_above(crossing[between(*ring)]) for ring in RINGS]
    differences = [float(np.log(np.abs(colours[a] - colours[b]).max() + FAINT_LEVELS)) for a, b in CONTRASTS]
    grey = colours.mean(axis=1)
    return np.concatenate([
        texture, np.log(cross + FAINT) - texture, np.log(spreads + FAINT_LEVELS),
        clear, [_most(crossing[between(1 - STEP_SHARE, 1 + 1.5 * STEP_SHARE)])], differences,
        [(grey[INNER] - grey[OUTER]) / 64, (grey[WITHIN] - grey[FAR]) / 64], grey[[INNER, OUTER, FAR, CAMERA]] / 128,
        np.array(_going_on(polar, inside)), np.array(_calm(along, seen)),
    ])  # fmt: skip


def _steps(polar: Image, radius: float) -> tuple[Image, Image]:
    """Levels a pixel along the way round and across it, at every other turn, of the steepest channel."""
    length = SHARES.astype(np.float32) * np.float32(radius * (2 * np.pi / TURNS) * 2)
    along = strongest(np.abs(np.roll(polar, -1, axis=0)[::2] - np.roll(polar, 1, axis=0)[::2])) / length
    half = polar[::2]
    across = np.zeros_like(along)
    across[:, 1:-1] = strongest(np.abs(half[:, 2:] - half[:, :-2])) / np.float32(radius * 2 * STEP_SHARE)
    return along, across


def _counted(steps: Image, least: float) -> Image:
    counted: Image = np.clip((steps - np.float32(least)) / np.float32(max(USUAL_STEP - least, least)), 0, 1)
    return counted


def _mean(values: Image, seen: Mask, count: NDArray[np.int_]) -> Array:
    """Mean (shares, channels) along the way round, as far as it is in the picture."""
    sums = np.einsum("tsc,ts->sc", values, seen.astype(np.float32))
    return np.where((count >= LEAST_TURNS)[:, None], sums / np.maximum(count, 1)[:, None], np.nan)


def _banded(values: Array) -> Array:
    """Means of the bands, of what is known of them."""
    means = np.full((len(BANDS), *values.shape[1:]), np.nan)
    for k, band in enumerate(BANDS):
        part = values[between(*band)]
        known = part[np.isfinite(part.reshape(len(part), -1)).all(axis=1)]
        if len(known):
            means[k] = known.mean(axis=0)
    return means


def _above(values: Array) -> float:
    """By how much the most lies above the middle."""
    known = values[np.isfinite(values)]
    return float(known.max() - np.median(known)) if len(known) else np.nan


def _most(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else np.nan


def _going_on(polar: Image, inside: Mask) -> list[float]:
    """How alike both sides of the ring are along the way round, in detail and as a whole; how surely one is brighter;
    and logarithms of the middle and of a small step across it."""
    known = inside[:, between(0.95, 1.05)].all(axis=1)
    if known.sum() < TURNS // 10:
        return [np.nan] * 9
    sides = [polar[:, between(*side)].mean(axis=1) for side in SIDES]
    fine = [detail(side)[known] for side in sides]
    alike = [_correlation(fine[a], fine[b]) for a, b in ALIKE]
    whole = [side[known] - side[known].mean(axis=0) for side in sides]
    alike += [_correlation(whole[a], whole[b]) for a, b in ALIKE[:2]]
    step = (sides[1] - sides[4])[known]
    sizes = strongest(np.abs(step))
    steps = [float(np.log(np.percentile(sizes, share) + 1)) for share in (50, 20)]
    return [*alike, abs(float(np.sign(step.mean(axis=1)).mean())), *steps]


def _correlation(one: Image, other: Image) -> float:
    a, b = one.ravel(), other.ravel()
    return float(a @ b) / float(np.sqrt((a @ a + 1.0) * (b @ b + 1.0)))


def _calm(along: Image, seen: Mask) -> list[float]:
    """Shares of the way round, as far as it is in the picture, in which next to nothing changes along it."""
    shares = []
    for band in CALMS:
        cells = between(*band)
        known = seen[:, cells].reshape(PARTS, -1)
        sums = (along[:, cells].reshape(PARTS, -1) * known).sum(axis=1)
        count = known.sum(axis=1)
        shares.append(float(np.mean(sums[count > 0] < CALM * count[count > 0])) if count.any() else np.nan)
    return shares
