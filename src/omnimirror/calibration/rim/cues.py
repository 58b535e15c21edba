"""Features of a ring that indicate a mirror's rim: complete edges, and texture that ends at it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from .edges import LEAST_STEP, USUAL_STEP, EdgePoints, Working, strongest, turns
from .ellipses import NORMAL_SLACK, Ellipse

SECTORS = 72
CLOSE_PX, NEAR_PX = 0.7, 1.6  # maximum distance from the ring for its own edges
TURNS, PARTS = 216, 36  # samples around the ring, and parts for the count of texture
STEP_SHARE = 0.0125
SHARES = np.round(np.arange(0.05, 1.44, STEP_SHARE), 4)  # sampled fractions of the radius
LEAST_SUPPORT = 0.35
SAME_RING = 0.012  # relative; closer rings are merged
FAMILY_OFFSET, FAMILY_STRETCH = 0.06, 0.03  # maximum differences of centre and shape in a frame
SHARES32 = SHARES.astype(np.float32)
CALM = 0.03  # maximum texture of a calm part
FAINT = 0.004  # negligible texture


@dataclass(frozen=True)
class Cues:
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
    seen: float
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
    seen: float
    step: float
    differs: float
    texture: Array
    """Texture (PARTS, len(SHARES)); NaN outside the image."""
    continues: float

    def band(self, low: float, high: float) -> float:
        """Return the mean texture between two fractions of the radius; NaN outside the image."""
        values = self.texture[:, between(low, high)]
        known = values[np.isfinite(values)]
        return float(known.mean()) if known.size >= 0.15 * values.size else np.nan

    def calm(self, low: float, high: float) -> float:
        """Return the fraction of the visible circumference with almost no texture in a band."""
        values = self.texture[:, between(low, high)]
        known = np.isfinite(values)
        seen = known.any(axis=1)
        if not seen.any():
            return 0.0
        sums = np.where(known, values, 0.0).sum(axis=1)[seen] / known.sum(axis=1)[seen]
        return float(np.mean(sums < CALM))


@dataclass(frozen=True)
class Finer:
    """Edges of a finer image, which resolves neighbouring rings."""

    edges: EdgePoints
    size: tuple[int, int]
    scale: float
    """Number of its pixels per pixel at working size."""


def ring_of(
    working: Working, edges: EdgePoints, ellipse: Ellipse, least_close: float = -1.0, finer: Finer | None = None
) -> Ring | None:
    """Return the statistics on and around an ellipse; None for too few edges.

    Edges of a ring that is not resolved at working size are taken from the finer image.
    """
    support, close, chance, seen = _support(edges, working.size, ellipse)
    if support < LEAST_SUPPORT and finer is not None:
        support, close, chance, seen = _support(finer.edges, finer.size, ellipse.scaled(finer.scale))
    if support < LEAST_SUPPORT or close <= least_close:
        return None
    polar, inside = unrolled(working, ellipse)
    texture = _texture(polar, inside, ellipse, working.noise)
    step, differs, continues = _across(polar, inside)
    return Ring(ellipse, support, close, chance, seen, step, differs, texture, continues)


def cues_of(rings: list[Ring], short_side: float) -> list[Cues]:
    """Return the features of the rings of an image."""
    return [_cues(ring, among, short_side) for ring, among in zip(rings, _frames(rings), strict=True)]


def _cues(ring: Ring, among: Array, short_side: float) -> Cues:
    framed, within, frames, about = (float(number) for number in among)
    inner, near = ring.band(0.6, 0.97), ring.band(0.9, 0.97)
    outer, beyond = ring.band(1.03, 1.4), ring.band(1.03, 1.1)
    return Cues(
        support=ring.support, close=ring.close, chance=ring.chance, step=float(np.log(ring.step / USUAL_STEP + 0.1)),
        differs=ring.differs, continues=ring.continues, seen=ring.seen,
        radius=float(np.log(ring.ellipse.radius / short_side)), texture=_log(inner),
        ends=_log(inner) - _log(outer), ends_near=_log(near) - _log(beyond),
        calm_inside=ring.calm(0.8, 0.97), calm_outside=ring.calm(1.03, 1.2), framed=framed, frames=frames,
        within=within, about=about,
    )  # fmt: skip


def _log(texture: float) -> float:
    return float(np.log(FAINT + (0.0 if np.isnan(texture) else texture)))


def between(low: float, high: float) -> slice:
    """Return the range of a band, at least one sample."""
    first, last = np.searchsorted(SHARES, [low, high])
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
    share = radius[:, None] / radius  # of the radius of the first to that of the second
    offset = np.hypot(*(centre[:, None] - centre).transpose(2, 0, 1)) / radius[:, None]
    bent = np.hypot(*(shape[:, None] - shape).transpose(2, 0, 1))
    clear = np.minimum(close[:, None], close)
    pairs = (share > 0.5) & (share < 1 - SAME_RING) & (offset <= FAMILY_OFFSET) & (bent <= FAMILY_STRETCH)
    found = np.zeros((len(rings), 4))
    for i, j in zip(*np.nonzero(pairs & (clear > 0.5)), strict=True):
        grown = 1 / float(share[i, j])
        gap = min(0.02, (grown - 1) / 3)
        framed = (clear[i, j] - 0.5) / 0.5 * rings[i].calm(1 + gap, grown - gap) ** 2
        seen = max(0.0, (clear[i, j] - 0.7) / 0.3)
        found[j, :2] = np.maximum(found[j, :2], [framed, seen])
        found[i, 2:] = np.maximum(found[i, 2:], [framed, seen])
    return found


def _support(edges: EdgePoints, size: tuple[int, int], ellipse: Ellipse) -> tuple[float, float, float, float]:
    """Return fractions of the circumference with edges, and its visible fraction.

    Edges are counted on, close to, and next to the ring.
    """
    turn = turns(SECTORS) + np.pi / SECTORS
    points = ellipse.points(turn)
    seen = ((points >= 3) & (points <= np.subtract(size, 4))).all(axis=1)
    if not seen.any():
        return 0.0, 0.0, 0.0, 0.0
    near = ellipse.near(edges.points, 12 * NEAR_PX)
    circle, normals, weights = ellipse.on_circle(edges.points[near]), edges.normals[near], edges.weights[near]
    away = (np.hypot(circle[:, 0], circle[:, 1]) - 1) * ellipse.radius
    angle = np.arctan2(circle[:, 1], circle[:, 0])
    aligned = np.abs(np.einsum("ij,ij->i", ellipse.outward(angle), normals)) > np.cos(NORMAL_SLACK)
    sector = np.minimum((angle % (2 * np.pi)) * (SECTORS / (2 * np.pi)), SECTORS - 1).astype(int)

    def share(chosen: NDArray[np.bool_]) -> float:
        best = np.zeros(SECTORS)
        np.maximum.at(best, sector[chosen], np.minimum(1.0, 2 * weights[chosen]))
        return float(best[seen].mean())

    beside = [share(aligned & (np.abs(away - k * NEAR_PX) < NEAR_PX)) for k in (-9, -6, 6, 9)]
    return (
        share(aligned & (np.abs(away) < NEAR_PX)), share(aligned & (np.abs(away) < CLOSE_PX)),
        float(np.mean(beside)), float(seen.mean()),
    )  # fmt: skip


def unrolled(working: Working, ellipse: Ellipse) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the image (turns, shares, channels) around an ellipse, and its visibility."""
    import cv2

    away = (ellipse.points(turns(TURNS)) - np.asarray(ellipse.centre)).astype(np.float32)
    u = away[:, :1] * SHARES32 + np.float32(ellipse.centre[0])
    v = away[:, 1:] * SHARES32 + np.float32(ellipse.centre[1])
    width, height = working.size
    inside = (u >= 0) & (u <= width - 1) & (v >= 0) & (v <= height - 1)
    polar: Any = cv2.remap(working.picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return polar.reshape(*u.shape, -1), inside


def _texture(polar: NDArray[np.float32], inside: NDArray[np.bool_], ellipse: Ellipse, noise: float) -> Array:
    """Return the texture around a ring for each part and fraction of the radius."""
    apart = SHARES32 * np.float32(ellipse.radius * (2 * np.pi / TURNS) * 2)  # px, previous to next sample
    steps = strongest(np.abs(np.roll(polar, -1, axis=0) - np.roll(polar, 1, axis=0))) / apart
    least = max(LEAST_STEP / 2, 2.5 * noise)
    counted = np.clip((steps - least) / max(USUAL_STEP - least, least), 0, 1) * inside
    known = inside.reshape(PARTS, -1, len(SHARES)).sum(axis=1)
    with np.errstate(invalid="ignore"):
        texture: Array = np.where(known > 0, counted.reshape(PARTS, -1, len(SHARES)).sum(axis=1) / known, np.nan)
    return texture


def _across(polar: NDArray[np.float32], inside: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return the median step across the ring, and the difference and correlation of its sides."""
    (within, beyond), near = _sides(polar, inside, (0.945, 0.975), (1.025, 1.055))
    (inner, outer), wide = _sides(polar, inside, (0.86, 0.93), (1.08, 1.15))
    if min(near.sum(), wide.sum()) < TURNS // 8:
        return 0.0, 0.0, 0.0
    step = float(np.median(strongest(np.abs(within - beyond))[near]))
    apart = float(np.median(strongest(np.abs(inner - outer))[wide]))
    spread = float((inner[wide].std(axis=0) + outer[wide].std(axis=0)).max() / 2)
    a, b = (detail(side)[near].ravel() for side in (within, beyond))
    norm = float(np.sqrt((a @ a + 1.0) * (b @ b + 1.0)))
    return step, float(np.log((apart + LEAST_STEP) / (spread + LEAST_STEP))), float(a @ b) / norm


def _sides(
    polar: NDArray[np.float32], inside: NDArray[np.bool_], within: tuple[float, float], beyond: tuple[float, float]
) -> tuple[list[NDArray[np.float32]], NDArray[np.bool_]]:
    """Return means (turns, channels) of an inner and an outer band, and their visibility."""
    bands = [between(*within), between(*beyond)]
    known = np.asarray(inside[:, bands[0]].all(axis=1) & inside[:, bands[1]].all(axis=1))
    return [polar[:, band].mean(axis=1) for band in bands], known


def detail(side: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the variation within 30 deg along the ring, (turns, channels)."""
    width = TURNS // 12
    padded = np.concatenate([side[-width:], side, side[:width]])
    sums = np.cumsum(padded, axis=0)
    smooth = (sums[width:] - sums[:-width])[width // 2 : width // 2 + TURNS] / width
    detail: NDArray[np.float32] = side - smooth
    return detail
