"""Hough transform for circles: each edge votes for centres on both sides, for each radius."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from .edges import EdgePoints, turns
from .ellipses import Ellipse

LEAST_RADIUS, LARGEST_RADIUS = 0.18, 0.75  # relative to the short image side
RADIUS_STEP = 1.016
CELL_PX = 2
BLUR_PX, BLUR_SHARE = 1.5, 0.016  # px, and error of the centre relative to the radius
PEAKS_A_RADIUS, PEAKS = 5, 50
SAME_CIRCLE = 0.035  # fraction of the radius; circles within it lead to the same ring
LEAST_SEEN = 0.35  # minimum visible fraction of the circumference
COARSE = 4


def circles(edges: EdgePoints, size: tuple[int, int]) -> list[Ellipse]:
    """Return the circles with the most votes relative to their size, best first."""
    short = min(size)
    largest = max(LARGEST_RADIUS * short, 0.52 * max(size))
    found = circles_between(edges, size, (LEAST_RADIUS * short, largest), RADIUS_STEP)
    return list(islice(found, PEAKS))


def circles_between(
    edges: EdgePoints, size: tuple[int, int], radii: tuple[float, float], step: float
) -> Iterator[Ellipse]:
    """Yield circles with radii in a geometric series, ordered by votes relative to their size."""
    found: list[tuple[float, float, float, float]] = []
    radius, largest = radii
    while radius < largest:
        found += _peaks(edges, size, radius)
        radius *= step
    kept: list[Ellipse] = []
    for _, u, v, r in sorted(found, reverse=True):
        circle = Ellipse((u, v), r)
        if not any(circle.is_near(other, SAME_CIRCLE) for other in kept):
            kept.append(circle)
            yield circle


def _peaks(edges: EdgePoints, size: tuple[int, int], radius: float) -> list[tuple[float, float, float, float]]:
    """Return votes, centre and radius of the best circles with one radius."""
    import cv2

    columns, rows = size[0] // CELL_PX + 1, size[1] // CELL_PX + 1
    votes = np.zeros(rows * columns)
    for side in (radius, -radius):
        u = ((edges.points[:, 0] + side * edges.normals[:, 0]) / CELL_PX + 0.5).astype(int)
        v = ((edges.points[:, 1] + side * edges.normals[:, 1]) / CELL_PX + 0.5).astype(int)
        inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        votes += np.bincount((v * columns + u)[inside], edges.weights[inside], rows * columns)
    blur = (BLUR_PX + BLUR_SHARE * radius) / CELL_PX
    spread = cv2.GaussianBlur(
        votes.reshape(rows, columns).astype(np.float32), (0, 0), blur, borderType=cv2.BORDER_CONSTANT
    )
    seen = np.maximum(seen_share((columns, rows), radius / CELL_PX), LEAST_SEEN)
    score = spread * (blur**2 / radius) / seen
    top = (score >= cv2.dilate(score, np.ones((7, 7), np.uint8))) & (score > 0)
    v, u = np.nonzero(top)
    best = np.argsort(score[v, u])[::-1][:PEAKS_A_RADIUS]
    return [(float(score[v[i], u[i]]), float(u[i]) * CELL_PX, float(v[i]) * CELL_PX, radius) for i in best]


def seen_share(size: tuple[int, int], radius: float) -> NDArray[np.float32]:
    """Return the visible fraction (rows, columns) of circles centred at each pixel.

    It is interpolated between every fourth pixel, since it varies slowly.
    """
    import cv2

    columns, rows = (np.linspace(0, side - 1, side // COARSE + 2) for side in size)
    turn = turns(48)
    u, v = columns[:, None] + radius * np.cos(turn), rows[:, None] + radius * np.sin(turn)
    in_u, in_v = (u >= 0) & (u <= size[0] - 1), (v >= 0) & (v <= size[1] - 1)
    share = in_v.astype(np.float32) @ in_u.astype(np.float32).T / np.float32(len(turn))
    at_u = np.linspace(0, len(columns) - 1, size[0], dtype=np.float32)
    at_v = np.linspace(0, len(rows) - 1, size[1], dtype=np.float32)
    seen: NDArray[np.float32] = cv2.remap(share, *np.meshgrid(at_u, at_v), cv2.INTER_LINEAR)  # type: ignore[assignment]
    return seen
