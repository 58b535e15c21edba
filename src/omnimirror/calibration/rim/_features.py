"""Features of a ring that indicate a mirror's rim.

They describe complete edges, texture that ends at the ring, bands around it, and its relation to
concentric rings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array, Mask
from ..edge_detection import (
    FULL_WEIGHT_STEP,
    MIN_STEP,
    EdgePoints,
    WorkingImage,
    revolution_angles,
    strongest,
)
from ._ellipses import NORMAL_SLACK, Ellipse

# -- Edge and texture features ---------------------------------------------------------------------

SECTORS = 72
CLOSE_PX, NEAR_PX = 0.7, 1.6  # maximum distance from the ring for its own edges
TURNS, PARTS = 216, 36  # samples around the ring, and parts for the count of texture
RADIUS_FRACTION_STEP = 0.0125
RADIUS_FRACTIONS = np.round(
    np.arange(0.05, 1.44, RADIUS_FRACTION_STEP), 4
)  # sampled fractions of the radius
MIN_SUPPORT = 0.35
SAME_RING = 0.012  # relative; closer rings are merged
FAMILY_OFFSET, FAMILY_STRETCH = 0.06, 0.03  # maximum differences of centre and shape in a frame
RADIUS_FRACTIONS32 = RADIUS_FRACTIONS.astype(np.float32)
MAX_CALM_TEXTURE = 0.03  # maximum texture of a calm part
NEGLIGIBLE_TEXTURE = 0.004  # negligible texture


@dataclass(frozen=True)
class RingFeatures:
    """Features of one ring.

    Texture is structure across the direction of the ring, relative to a typical edge, along the
    ring.
    """

    support: float
    """Fraction of the visible circumference with an edge on the ring."""
    close: float
    """The same for edges within :data:`CLOSE_PX`."""
    chance: float
    """The same for edges next to the ring, as a measure of chance."""
    step: float
    """Logarithm of the median step across the ring, relative to a typical step."""
    differs: float
    """Logarithm of the difference of both sides at larger distance, relative to their variation."""
    continues: float
    """Correlation of the adjacent inner and outer bands."""
    visible: float
    """Visible fraction of the circumference."""
    radius: float
    """Logarithm of the radius relative to the short image side."""
    texture: float
    """Logarithm of the texture inside."""
    ends: float
    """Logarithm of the ratio of texture inside and outside."""
    ends_near: float
    """The same next to the ring."""
    calm_inside: float
    """Fraction of the circumference with almost no texture next to the ring inside."""
    calm_outside: float
    """The same outside."""
    framed: float
    """Evidence for an inner ring and an empty band up to this one, as for a mirror in its frame."""
    frames: float
    """Evidence for an outer ring and an empty band between both."""
    within: float
    """Clarity of a concentric inner ring, independent of the band between both."""
    about: float
    """Clarity of a concentric outer ring."""


@dataclass(frozen=True)
class Ring:
    """Ellipse with the statistics around it."""

    ellipse: Ellipse
    support: float
    close: float
    chance: float
    visible: float
    step: float
    differs: float
    texture: Array
    """Texture (PARTS, len(SHARES)); NaN outside the image."""
    continues: float

    def band(self, low: float, high: float) -> float:
        """Return the mean texture between two fractions of the radius; NaN outside the image."""
        values = self.texture[:, between(low, high)]
        finite = values[np.isfinite(values)]
        return float(finite.mean()) if finite.size >= 0.15 * values.size else np.nan

    def calm(self, low: float, high: float) -> float:
        """Return the fraction of the visible circumference with almost no texture in a band."""
        values = self.texture[:, between(low, high)]
        is_finite = np.isfinite(values)
        is_visible = is_finite.any(axis=1)
        if not is_visible.any():
            return 0.0
        sums = (
            np.where(is_finite, values, 0.0).sum(axis=1)[is_visible]
            / is_finite.sum(axis=1)[is_visible]
        )
        return float(np.mean(sums < MAX_CALM_TEXTURE))


@dataclass(frozen=True)
class Finer:
    """Edges of a finer image, which resolves neighbouring rings."""

    edges: EdgePoints
    size: tuple[int, int]
    scale: float
    """Number of its pixels per pixel at working size."""


def ring_of(
    working: WorkingImage,
    edges: EdgePoints,
    ellipse: Ellipse,
    least_close: float = -1.0,
    finer: Finer | None = None,
) -> Ring | None:
    """Return the statistics on and around an ellipse; None for too few edges.

    Edges of a ring that is not resolved at working size are taken from the finer image.
    """
    support, close, chance, visible = _support(edges, working.size, ellipse)
    if support < MIN_SUPPORT and finer is not None:
        support, close, chance, visible = _support(
            finer.edges, finer.size, ellipse.scaled(finer.scale)
        )
    if support < MIN_SUPPORT or close <= least_close:
        return None
    polar, inside = unrolled(working, ellipse)
    texture = _texture(polar, inside, ellipse, working.noise)
    step, side_difference, correlation = _across(polar, inside)
    return Ring(
        ellipse, support, close, chance, visible, step, side_difference, texture, correlation
    )


def ring_features(rings: list[Ring], short_side: float) -> list[RingFeatures]:
    """Return the features of the rings of an image."""
    return [
        _features_of_ring(ring, among, short_side)
        for ring, among in zip(rings, _frames(rings), strict=True)
    ]


def _features_of_ring(ring: Ring, frame_evidence: Array, short_side: float) -> RingFeatures:
    framed, within, frames, about = (float(number) for number in frame_evidence)
    inner, inner_edge = ring.band(0.6, 0.97), ring.band(0.9, 0.97)
    outer, outer_edge = ring.band(1.03, 1.4), ring.band(1.03, 1.1)
    return RingFeatures(
        support=ring.support,
        close=ring.close,
        chance=ring.chance,
        step=float(np.log(ring.step / FULL_WEIGHT_STEP + 0.1)),
        differs=ring.differs,
        continues=ring.continues,
        visible=ring.visible,
        radius=float(np.log(ring.ellipse.radius / short_side)),
        texture=_log(inner),
        ends=_log(inner) - _log(outer),
        ends_near=_log(inner_edge) - _log(outer_edge),
        calm_inside=ring.calm(0.8, 0.97),
        calm_outside=ring.calm(1.03, 1.2),
        framed=framed,
        frames=frames,
        within=within,
        about=about,
    )


def _log(texture: float) -> float:
    return float(np.log(NEGLIGIBLE_TEXTURE + (0.0 if np.isnan(texture) else texture)))


def between(low: float, high: float) -> slice:
    """Return the range of a band, at least one sample."""
    first, last = np.searchsorted(RADIUS_FRACTIONS, [low, high])
    return slice(int(first), max(int(last), int(first) + 1))


def _frames(rings: list[Ring]) -> Array:
    """Return the evidence (n, 4) for concentric frames.

    The evidence is the maximum for a concentric inner and outer ring, both clear and with an empty
    band between them, and the same without the condition on the band.
    """
    radius = np.array([ring.ellipse.radius for ring in rings])
    centre = np.array([ring.ellipse.centre for ring in rings])
    shape = np.array([ring.ellipse.stretch for ring in rings])
    close = np.array([ring.close for ring in rings])
    radius_ratio = radius[:, None] / radius  # of the radius of the first to that of the second
    offset = np.hypot(*(centre[:, None] - centre).transpose(2, 0, 1)) / radius[:, None]
    shape_difference = np.hypot(*(shape[:, None] - shape).transpose(2, 0, 1))
    clarity = np.minimum(close[:, None], close)
    pairs = (
        (radius_ratio > 0.5)
        & (radius_ratio < 1 - SAME_RING)
        & (offset <= FAMILY_OFFSET)
        & (shape_difference <= FAMILY_STRETCH)
    )
    evidence = np.zeros((len(rings), 4))
    for i, j in zip(*np.nonzero(pairs & (clarity > 0.5)), strict=True):
        ratio = 1 / float(radius_ratio[i, j])
        gap = min(0.02, (ratio - 1) / 3)
        framed = (clarity[i, j] - 0.5) / 0.5 * rings[i].calm(1 + gap, ratio - gap) ** 2
        clear_evidence = max(0.0, (clarity[i, j] - 0.7) / 0.3)
        evidence[j, :2] = np.maximum(evidence[j, :2], [framed, clear_evidence])
        evidence[i, 2:] = np.maximum(evidence[i, 2:], [framed, clear_evidence])
    return evidence


def _support(
    edges: EdgePoints, size: tuple[int, int], ellipse: Ellipse
) -> tuple[float, float, float, float]:
    """Return fractions of the circumference with edges, and its visible fraction.

    Edges are counted on, close to, and next to the ring.
    """
    azimuth = revolution_angles(SECTORS) + np.pi / SECTORS
    points = ellipse.points(azimuth)
    is_visible = ((points >= 3) & (points <= np.subtract(size, 4))).all(axis=1)
    if not is_visible.any():
        return 0.0, 0.0, 0.0, 0.0
    candidates = ellipse.near(edges.points, 12 * NEAR_PX)
    circle, normals, weights = (
        ellipse.on_circle(edges.points[candidates]),
        edges.normals[candidates],
        edges.weights[candidates],
    )
    distances = (np.hypot(circle[:, 0], circle[:, 1]) - 1) * ellipse.radius
    angle = np.arctan2(circle[:, 1], circle[:, 0])
    aligned = np.abs(np.einsum("ij,ij->i", ellipse.outward(angle), normals)) > np.cos(NORMAL_SLACK)
    sector = np.minimum((angle % (2 * np.pi)) * (SECTORS / (2 * np.pi)), SECTORS - 1).astype(int)

    def fraction(selected: NDArray[np.bool_]) -> float:
        best = np.zeros(SECTORS)
        np.maximum.at(best, sector[selected], np.minimum(1.0, 2 * weights[selected]))
        return float(best[is_visible].mean())

    neighbouring = [
        fraction(aligned & (np.abs(distances - k * NEAR_PX) < NEAR_PX)) for k in (-9, -6, 6, 9)
    ]
    return (
        fraction(aligned & (np.abs(distances) < NEAR_PX)),
        fraction(aligned & (np.abs(distances) < CLOSE_PX)),
        float(np.mean(neighbouring)),
        float(is_visible.mean()),
    )


def unrolled(
    working: WorkingImage, ellipse: Ellipse
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the image (turns, shares, channels) around an ellipse, and its visibility."""
    import cv2

    offsets = (ellipse.points(revolution_angles(TURNS)) - np.asarray(ellipse.centre)).astype(
        np.float32
    )
    u = offsets[:, :1] * RADIUS_FRACTIONS32 + np.float32(ellipse.centre[0])
    v = offsets[:, 1:] * RADIUS_FRACTIONS32 + np.float32(ellipse.centre[1])
    width, height = working.size
    inside = (u >= 0) & (u <= width - 1) & (v >= 0) & (v <= height - 1)
    polar: Any = cv2.remap(working.image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return polar.reshape(*u.shape, -1), inside


def _texture(
    polar: NDArray[np.float32], inside: NDArray[np.bool_], ellipse: Ellipse, noise: float
) -> Array:
    """Return the texture around a ring for each part and fraction of the radius."""
    sample_spacing = RADIUS_FRACTIONS32 * np.float32(
        ellipse.radius * (2 * np.pi / TURNS) * 2
    )  # px, previous to next sample
    steps = (
        strongest(np.abs(np.roll(polar, -1, axis=0) - np.roll(polar, 1, axis=0))) / sample_spacing
    )
    min_step = max(MIN_STEP / 2, 2.5 * noise)
    significance = (
        np.clip((steps - min_step) / max(FULL_WEIGHT_STEP - min_step, min_step), 0, 1) * inside
    )
    visible_counts = inside.reshape(PARTS, -1, len(RADIUS_FRACTIONS)).sum(axis=1)
    with np.errstate(invalid="ignore"):
        texture: Array = np.where(
            visible_counts > 0,
            significance.reshape(PARTS, -1, len(RADIUS_FRACTIONS)).sum(axis=1) / visible_counts,
            np.nan,
        )
    return texture


def _across(polar: NDArray[np.float32], inside: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return the median step across the ring, and the difference and correlation of its sides."""
    (inner_band, outer_band), near_visible = _sides(polar, inside, (0.945, 0.975), (1.025, 1.055))
    (inner, outer), far_visible = _sides(polar, inside, (0.86, 0.93), (1.08, 1.15))
    if min(near_visible.sum(), far_visible.sum()) < TURNS // 8:
        return 0.0, 0.0, 0.0
    step = float(np.median(strongest(np.abs(inner_band - outer_band))[near_visible]))
    difference = float(np.median(strongest(np.abs(inner - outer))[far_visible]))
    spread = float((inner[far_visible].std(axis=0) + outer[far_visible].std(axis=0)).max() / 2)
    a, b = (detail(side)[near_visible].ravel() for side in (inner_band, outer_band))
    norm = float(np.sqrt((a @ a + 1.0) * (b @ b + 1.0)))
    return step, float(np.log((difference + MIN_STEP) / (spread + MIN_STEP))), float(a @ b) / norm


def _sides(
    polar: NDArray[np.float32],
    inside: NDArray[np.bool_],
    inner: tuple[float, float],
    outer: tuple[float, float],
) -> tuple[list[NDArray[np.float32]], NDArray[np.bool_]]:
    """Return means (turns, channels) of an inner and an outer band, and their visibility."""
    bands = [between(*inner), between(*outer)]
    is_visible = np.asarray(inside[:, bands[0]].all(axis=1) & inside[:, bands[1]].all(axis=1))
    return [polar[:, band].mean(axis=1) for band in bands], is_visible


def detail(side: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the variation within 30 deg along the ring, (turns, channels)."""
    width = TURNS // 12
    padded = np.concatenate([side[-width:], side, side[:width]])
    sums = np.cumsum(padded, axis=0)
    smooth = (sums[width:] - sums[:-width])[width // 2 : width // 2 + TURNS] / width
    detail: NDArray[np.float32] = side - smooth
    return detail


# -- Statistics of bands around a ring -------------------------------------------------------------
#
# A mirror compresses its surroundings towards its rim, a frame has a uniform colour, and the
# background shows neither effect.

Image = NDArray[np.float32]

BANDS = (
    (0.1, 0.3), (0.3, 0.6), (0.6, 0.8), (0.8, 0.9), (0.9, 0.95), (0.945, 0.985),
    (1.02, 1.055), (1.05, 1.1), (1.1, 1.2), (1.2, 1.4),
)  # fmt: skip
"""Fractions of the radius."""
CAMERA, MIDDLE, WITHIN_RIM, INNER, OUTER, OUTSIDE_RIM, SURROUNDINGS = 0, 2, 3, 5, 6, 7, 8
CONTRASTS = (
    (INNER, OUTER),
    (MIDDLE, INNER),
    (OUTER, SURROUNDINGS),
    (MIDDLE, SURROUNDINGS),
    (CAMERA, 1),
    (4, OUTSIDE_RIM),
)
CALMS = BANDS[2:9]  # bands for which the fraction of calm parts is computed
RINGS = (
    (0.55, 0.8), (0.8, 0.92), (0.92, 0.965), (0.965, 0.99), (1.01, 1.035), (1.035, 1.08), (1.08, 1.2), (1.2, 1.4),
)  # fmt: skip
"""Fractions of the radius between which another ring is searched."""
SIDES = ((0.94, 0.97), (0.965, 0.985), (0.86, 0.89), (1.03, 1.06), (1.015, 1.035), (1.1, 1.13))
CORRELATED_SIDES = (
    (0, 3),
    (1, 4),
    (0, 2),
    (3, 5),
)  # pairs of sides: across at two distances, inside, outside
CALM_BAND_TEXTURE, FAINT_BAND_TEXTURE, FAINT_LEVELS = 0.03, 0.004, 2.0
MIN_TURNS = 5  # minimum number of samples around the ring for a mean


def surrounding_statistics(working: WorkingImage, ellipse: Ellipse) -> Array:
    """Return statistics (67,) around an ellipse; NaN outside the image.

    For each band: logarithms of the changes along the ring, of the ratio of changes across and
    along it, relative to a typical edge, and of the spread of colours in levels. Further: the
    clearest ring at each distance and this ring; differences in colour between bands, and their
    brightness; correlations across the ring; fractions of calm parts of bands.
    """
    polar, inside = unrolled(working, ellipse)
    half, is_visible = polar[::2], inside[::2]
    min_step = max(MIN_STEP / 2, 2.5 * working.noise)
    along, across = (_significance(steps, min_step) for steps in _steps(polar, ellipse.radius))
    count = is_visible.sum(axis=0)
    turning, crossing = (
        _mean(along[..., None], is_visible, count)[:, 0],
        _mean(across[..., None], is_visible, count)[:, 0],
    )
    level = _mean(half, is_visible, count)
    spread = np.sqrt(np.maximum(_mean(half * half, is_visible, count) - level**2, 0.0)).max(axis=1)
    turn, cross, spreads, colours = (_banded(x) for x in (turning, crossing, spread, level))
    texture = np.log(turn + FAINT_BAND_TEXTURE)
    ring_clarity = [_peak_above_median(crossing[between(*ring)]) for ring in RINGS]
    differences = [
        float(np.log(np.abs(colours[a] - colours[b]).max() + FAINT_LEVELS)) for a, b in CONTRASTS
    ]
    grey = colours.mean(axis=1)
    return np.concatenate(
        [
            texture,
            np.log(cross + FAINT_BAND_TEXTURE) - texture,
            np.log(spreads + FAINT_LEVELS),
            ring_clarity,
            [_maximum(crossing[between(1 - RADIUS_FRACTION_STEP, 1 + 1.5 * RADIUS_FRACTION_STEP)])],
            differences,
            [(grey[INNER] - grey[OUTER]) / 64, (grey[WITHIN_RIM] - grey[SURROUNDINGS]) / 64],
            grey[[INNER, OUTER, SURROUNDINGS, CAMERA]] / 128,
            np.array(_edge_statistics(polar, inside)),
            np.array(_calm_fractions(along, is_visible)),
        ]
    )


def _steps(polar: Image, radius: float) -> tuple[Image, Image]:
    """Return changes along and across the ring in levels per px, for the steepest channel.

    Only every other sample along the ring is used.
    """
    length = RADIUS_FRACTIONS.astype(np.float32) * np.float32(radius * (2 * np.pi / TURNS) * 2)
    along = (
        strongest(np.abs(np.roll(polar, -1, axis=0)[::2] - np.roll(polar, 1, axis=0)[::2])) / length
    )
    half = polar[::2]
    across = np.zeros_like(along)
    across[:, 1:-1] = strongest(np.abs(half[:, 2:] - half[:, :-2])) / np.float32(
        radius * 2 * RADIUS_FRACTION_STEP
    )
    return along, across


def _significance(steps: Image, min_step: float) -> Image:
    significance: Image = np.clip(
        (steps - np.float32(min_step)) / np.float32(max(FULL_WEIGHT_STEP - min_step, min_step)),
        0,
        1,
    )
    return significance


def _mean(values: Image, is_visible: Mask, count: NDArray[np.int_]) -> Array:
    """Return means (shares, channels) along the ring, over its visible part."""
    sums = np.einsum("tsc,ts->sc", values, is_visible.astype(np.float32))
    return np.where((count >= MIN_TURNS)[:, None], sums / np.maximum(count, 1)[:, None], np.nan)


def _banded(values: Array) -> Array:
    """Return means over bands, ignoring unknown values."""
    means = np.full((len(BANDS), *values.shape[1:]), np.nan)
    for k, band in enumerate(BANDS):
        part = values[between(*band)]
        finite = part[np.isfinite(part.reshape(len(part), -1)).all(axis=1)]
        if len(finite):
            means[k] = finite.mean(axis=0)
    return means


def _peak_above_median(values: Array) -> float:
    """Return the difference of maximum and median."""
    finite = values[np.isfinite(values)]
    return float(finite.max() - np.median(finite)) if len(finite) else np.nan


def _maximum(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else np.nan


def _edge_statistics(polar: Image, inside: Mask) -> list[float]:
    """Return statistics across the ring (9,).

    They are correlations of both sides along the ring, in detail and as a whole, the consistency of
    the sign of the brightness step, and logarithms of the median and a low percentile of the step.
    """
    is_visible = inside[:, between(0.95, 1.05)].all(axis=1)
    if is_visible.sum() < TURNS // 10:
        return [np.nan] * 9
    sides = [polar[:, between(*side)].mean(axis=1) for side in SIDES]
    details = [detail(side)[is_visible] for side in sides]
    correlations = [_correlation(details[a], details[b]) for a, b in CORRELATED_SIDES]
    centred_sides = [side[is_visible] - side[is_visible].mean(axis=0) for side in sides]
    correlations += [
        _correlation(centred_sides[a], centred_sides[b]) for a, b in CORRELATED_SIDES[:2]
    ]
    step = (sides[1] - sides[4])[is_visible]
    sizes = strongest(np.abs(step))
    steps = [float(np.log(np.percentile(sizes, share) + 1)) for share in (50, 20)]
    return [*correlations, abs(float(np.sign(step.mean(axis=1)).mean())), *steps]


def _correlation(one: Image, other: Image) -> float:
    a, b = one.ravel(), other.ravel()
    return float(a @ b) / float(np.sqrt((a @ a + 1.0) * (b @ b + 1.0)))


def _calm_fractions(along: Image, is_visible: Mask) -> list[float]:
    """Return for each band the fraction of the visible ring with almost no change."""
    fractions = []
    for band in CALMS:
        cells = between(*band)
        cell_visible = is_visible[:, cells].reshape(PARTS, -1)
        sums = (along[:, cells].reshape(PARTS, -1) * cell_visible).sum(axis=1)
        count = cell_visible.sum(axis=1)
        fractions.append(
            float(np.mean(sums[count > 0] < CALM_BAND_TEXTURE * count[count > 0]))
            if count.any()
            else np.nan
        )
    return fractions


# -- Features relative to concentric rings ---------------------------------------------------------

MAX_STRETCH = 0.04  # maximum difference of the shapes of rings in a family
NEIGHBOUR_INTERVALS = (
    (0.2, 0.5),
    (0.5, 0.8),
    (0.8, 0.93),
    (0.93, 0.988),
    (1.012, 1.06),
    (1.06, 1.2),
    (1.2, 1.6),
)
"""Fractions of the ring's radius between which the clearest other ring is searched."""
INNER_NEIGHBOURS, OUTER_NEIGHBOURS = (
    (0.6, 0.988),
    (1.012, 1.5),
)  # fractions of the radius for the next ring
MIN_CLEARNESS, CLEAR, NEXT = 0.4, 0.7, 0.55  # fraction of the circumference with a close edge


def relations(rings: Sequence[Ring], chosen: Sequence[int]) -> Array:
    """Return features (len(chosen), 23) of the chosen rings relative to their concentric rings."""
    centres = np.array([ring.ellipse.centre for ring in rings])
    radii = np.array([ring.ellipse.radius for ring in rings])
    shapes = np.array([ring.ellipse.stretch for ring in rings])
    close = np.array([ring.close for ring in rings])
    visible_support = np.array([ring.support * ring.visible for ring in rings])
    rows = []
    for i in chosen:
        family = (np.hypot(*(centres - centres[i]).T) < FAMILY_OFFSET * radii[i]) & (
            np.hypot(*(shapes - shapes[i]).T) < MAX_STRETCH
        )
        radius_ratios = np.where(family, radii / radii[i], np.nan)
        clearest = [
            max(
                0.0,
                float(close[_between_ratios(radius_ratios, part)].max(initial=0.0)) - MIN_CLEARNESS,
            )
            for part in NEIGHBOUR_INTERVALS
        ]
        clear = close > CLEAR
        outside, inside = np.log1p(
            [
                (clear & (radius_ratios > OUTER_NEIGHBOURS[0])).sum(),
                (clear & (radius_ratios < INNER_NEIGHBOURS[1])).sum(),
            ]
        )
        rank = [
            close[i] - close.max(),
            visible_support[i] - visible_support.max(),
            close[i] - close[family].max(),
            np.log1p((close > close[i]).sum()),
        ]
        neighbours = [
            _next_ring_features(rings, i, radius_ratios, close, part)
            for part in (INNER_NEIGHBOURS, OUTER_NEIGHBOURS)
        ]
        rows.append([*clearest, outside, inside, *rank, *neighbours[0], *neighbours[1]])
    return np.array(rows)


def _between_ratios(radius_ratios: Array, part: tuple[float, float]) -> NDArray[np.bool_]:
    return (radius_ratios > part[0]) & (radius_ratios < part[1])


def _next_ring_features(
    rings: Sequence[Ring], i: int, radius_ratios: Array, close: Array, part: tuple[float, float]
) -> list[float]:
    """Return features of the next clear ring on one side.

    They are its clarity, distance, band texture, calmness and relative clarity.
    """
    others = np.nonzero(_between_ratios(radius_ratios, part) & (close > NEXT))[0]
    if not len(others):
        return [0.0, 0.0, 0.0, np.nan, 0.0]
    j = int(others[np.argmin(np.abs(np.log(radius_ratios[others])))])
    inner, outer = sorted((rings[i], rings[j]), key=lambda ring: ring.ellipse.radius)
    ratio = outer.ellipse.radius / inner.ellipse.radius
    gap = min(0.02, (ratio - 1) / 3)
    texture = inner.band(1 + gap, ratio - gap)
    return [
        close[j],
        float(np.log(np.log(ratio))),
        inner.calm(1 + gap, ratio - gap),
        float(np.log(FAINT_BAND_TEXTURE + np.nan_to_num(texture))),
        close[j] - close[i],
    ]
