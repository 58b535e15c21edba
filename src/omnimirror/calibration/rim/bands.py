"""Statistics of bands around a ring.

A mirror compresses its surroundings towards its rim, a frame has a uniform colour, and the
background shows neither effect.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array, Mask
from .cues import PARTS, SHARES, STEP_SHARE, TURNS, between, detail, unrolled
from .edges import LEAST_STEP, USUAL_STEP, Working, strongest
from .ellipses import Ellipse

Image = NDArray[np.float32]

BANDS = (
    (0.1, 0.3), (0.3, 0.6), (0.6, 0.8), (0.8, 0.9), (0.9, 0.95), (0.945, 0.985),
    (1.02, 1.055), (1.05, 1.1), (1.1, 1.2), (1.2, 1.4),
)  # fmt: skip
"""Fractions of the radius."""
CAMERA, MIDDLE, WITHIN, INNER, OUTER, BEYOND, FAR = 0, 2, 3, 5, 6, 7, 8
CONTRASTS = ((INNER, OUTER), (MIDDLE, INNER), (OUTER, FAR), (MIDDLE, FAR), (CAMERA, 1), (4, BEYOND))
CALMS = BANDS[2:9]  # bands for which the fraction of calm parts is computed
RINGS = (
    (0.55, 0.8), (0.8, 0.92), (0.92, 0.965), (0.965, 0.99), (1.01, 1.035), (1.035, 1.08), (1.08, 1.2), (1.2, 1.4),
)  # fmt: skip
"""Fractions of the radius between which another ring is searched."""
SIDES = ((0.94, 0.97), (0.965, 0.985), (0.86, 0.89), (1.03, 1.06), (1.015, 1.035), (1.1, 1.13))
ALIKE = ((0, 3), (1, 4), (0, 2), (3, 5))  # pairs of sides: across at two distances, inside, outside
CALM, FAINT, FAINT_LEVELS = 0.03, 0.004, 2.0
LEAST_TURNS = 5  # minimum number of samples around the ring for a mean


def numbers_round(working: Working, ellipse: Ellipse) -> Array:
    """Return statistics (67,) around an ellipse; NaN outside the image.

    For each band: logarithms of the changes along the ring, of the ratio of changes across and
    along it, relative to a typical edge, and of the spread of colours in levels. Further: the
    clearest ring at each distance and this ring; differences in colour between bands, and their
    brightness; correlations across the ring; fractions of calm parts of bands.
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
    """Return changes along and across the ring in levels per px, for the steepest channel.

    Only every other sample along the ring is used.
    """
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
    """Return means (shares, channels) along the ring, over its visible part."""
    sums = np.einsum("tsc,ts->sc", values, seen.astype(np.float32))
    return np.where((count >= LEAST_TURNS)[:, None], sums / np.maximum(count, 1)[:, None], np.nan)


def _banded(values: Array) -> Array:
    """Return means over bands, ignoring unknown values."""
    means = np.full((len(BANDS), *values.shape[1:]), np.nan)
    for k, band in enumerate(BANDS):
        part = values[between(*band)]
        known = part[np.isfinite(part.reshape(len(part), -1)).all(axis=1)]
        if len(known):
            means[k] = known.mean(axis=0)
    return means


def _above(values: Array) -> float:
    """Return the difference of maximum and median."""
    known = values[np.isfinite(values)]
    return float(known.max() - np.median(known)) if len(known) else np.nan


def _most(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else np.nan


def _going_on(polar: Image, inside: Mask) -> list[float]:
    """Return statistics across the ring (9,).

    They are correlations of both sides along the ring, in detail and as a whole, the consistency of
    the sign of the brightness step, and logarithms of the median and a low percentile of the step.
    """
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
    """Return for each band the fraction of the visible ring with almost no change."""
    shares = []
    for band in CALMS:
        cells = between(*band)
        known = seen[:, cells].reshape(PARTS, -1)
        sums = (along[:, cells].reshape(PARTS, -1) * known).sum(axis=1)
        count = known.sum(axis=1)
        shares.append(float(np.mean(sums[count > 0] < CALM * count[count > 0])) if count.any() else np.nan)
    return shares
