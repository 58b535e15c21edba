"""Subpixel refinement of a ring in the full-size image, from edges of profiles across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .edges import LEAST_STEP, USUAL_STEP, EdgePoints, turns
from .ellipses import Ellipse, Shift, laid_through, shifted

PROFILES = 720
REACH_PX = 5.0  # working pixels to both sides
EDGE_PX = 1.5  # working pixels; minimum distance of profiles from the image boundary
SAMPLES = 4  # maximum number per working pixel
SHIFT = Shift(reach_px=1.5, step_px=0.3, turns=180)  # search range for a rim next to another edge
REACHES_PX = (0.8, 0.4)
CLEAR = 0.5  # fraction of the circumference above which no search is needed
CLOSE_PX, BESIDE_PX = 0.4, 1.5
STRETCH_COST = 8.0  # fraction of the circumference that a stretch must gain: most rims are round
LEAN = 0.08  # slope of an edge relative to the ring, caused by noise


def placed(levels: NDArray[np.number], ring: Ellipse, scale: float) -> tuple[Ellipse, float]:
    """Return the refined ellipse, and the fraction of the circumference with a close edge.

    Parameters
    ----------
    levels : (rows, columns, channels)
        Image, 0 to 255.
    ring
        Initial ellipse in pixels of the image, accurate to about one working pixel.
    scale
        Size of a working pixel in pixels.

    Returns
    -------
    tuple
        Ellipse and fraction.
    """
    edges = _edges_across(levels, ring, scale)
    shapes = {ring.stretch, (ring.stretch[0] / 2, ring.stretch[1] / 2), (0.0, 0.0)}
    reaches = tuple(reach * scale for reach in REACHES_PX)
    best = laid_through(edges, ring, reaches)
    share = _close(edges, best, CLOSE_PX * scale)
    if share > CLEAR:
        return best, share
    most = -np.inf
    for shape in sorted(shapes):
        start = shifted(edges, Ellipse(ring.centre, ring.radius, shape), SHIFT, scale)
        ellipse = laid_through(edges, start, reaches)
        close = _close(edges, ellipse, CLOSE_PX * scale)
        score = clearness(ellipse, close)
        if score > most:
            best, share, most = ellipse, close, score
    return best, share


def clearness(ellipse: Ellipse, share: float) -> float:
    """Return the clarity of an ellipse: fraction of close edges minus a stretch penalty."""
    return share - STRETCH_COST * float(np.hypot(*ellipse.stretch))


def _edges_across(levels: NDArray[np.number], ring: Ellipse, scale: float) -> EdgePoints:
    """Return the edges of profiles across the ring; a profile may have several."""
    import cv2

    step = max(0.5, scale / SAMPLES)
    reach = REACH_PX * scale
    away = np.arange(-reach, reach + step / 2, step)
    turn = turns(PROFILES)
    on, out = ring.points(turn), ring.outward(turn)
    points = (on[:, None, :] + away[None, :, None] * out[:, None, :]).astype(np.float32)
    height, width = levels.shape[:2]
    margin = EDGE_PX * scale
    inside = np.asarray(((on > margin) & (on < np.array([width - 1, height - 1]) - margin)).all(axis=1))
    top, left = (max(0, int(np.floor(points[..., k].min()))) for k in (1, 0))
    crop = np.ascontiguousarray(levels[top : int(points[..., 1].max()) + 2, left : int(points[..., 0].max()) + 2])
    if not inside.any() or not crop.size:
        return EdgePoints(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0))
    seen = cv2.remap(
        crop, points[..., 0] - left, points[..., 1] - top, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    seen = seen.reshape(PROFILES, len(away), -1).astype(np.float32)
    smooth = cv2.GaussianBlur(
        seen.reshape(PROFILES, -1, seen.shape[2]), (0, 0), sigmaX=0.8 * scale / step if scale > 1 else 1.6, sigmaY=0.8
    )
    smooth = smooth.reshape(seen.shape)
    across = np.gradient(smooth, step / scale, axis=1)
    which = np.abs(across).argmax(axis=2)[..., None]
    across = np.take_along_axis(across, which, axis=2)[..., 0]
    along = (np.roll(smooth, -1, axis=0) - np.roll(smooth, 1, axis=0)) / (4 * np.pi * ring.radius / PROFILES / scale)
    lean = np.take_along_axis(along, which, axis=2)[..., 0] / (np.abs(across) + 1e-6)
    slope = np.abs(across)
    here, before, after = slope[:, 1:-1], slope[:, :-2], slope[:, 2:]
    found = (here >= after) & (here > before) & (here > LEAST_STEP) & inside[:, None]
    which, place = np.nonzero(found)
    a, b, c = before[found], here[found], after[found]
    offset = np.clip((c - a) / np.maximum(2 * (2 * b - a - c), 1e-9), -0.5, 0.5)
    at = away[place + 1] + offset * step
    edge = on[which] + at[:, None] * out[which]
    clear = b * np.exp(-((at / (BESIDE_PX * scale)) ** 2) / 2)  # an outer frame may be stronger
    most = np.zeros(PROFILES)
    np.maximum.at(most, which, clear)
    weights = (clear / most[which]) ** 2 * np.minimum(b / USUAL_STEP, 1.0) / (1 + (lean[:, 1:-1][found] / LEAN) ** 2)
    return EdgePoints(edge, out[which], b.astype(float), weights)


def _close(edges: EdgePoints, ellipse: Ellipse, close: float) -> float:
    """Return the fraction of the profiles with an edge close to the ellipse."""
    circle = ellipse.on_circle(edges.points)
    away = np.abs(np.linalg.norm(circle, axis=1) - 1) * ellipse.radius
    sector = ((np.arctan2(circle[:, 1], circle[:, 0]) / (2 * np.pi) + 0.5) * PROFILES).astype(int) % PROFILES
    there, near = np.zeros((2, PROFILES))
    np.maximum.at(there, sector, edges.weights)
    np.maximum.at(near, sector, edges.weights * np.exp(-((away / close) ** 2) / 2))
    known = max(int(np.count_nonzero(there)), 1)
    return float(near.sum() / known)
