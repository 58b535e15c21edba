"""Candidate rings of an image: Hough transform for circles, fitted ellipses, concentric rings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..edge_detection import FINER_PX, EdgePoints, WorkingImage, at_working_size, edges_of, turns
from ._ellipses import FLATTEST, NORMAL_SLACK, Ellipse, Shift, laid_through, shifted
from ._features import FAMILY_OFFSET, SAME_RING, SECTORS, Finer, Ring, ring_of

# -- Hough transform for circles -------------------------------------------------------------------

LEAST_RADIUS, LARGEST_RADIUS = 0.18, 0.75  # relative to the short image side
RADIUS_STEP = 1.016
CELL_PX = 2
BLUR_PX, BLUR_SHARE = 1.5, 0.016  # px, and error of the centre relative to the radius
PEAKS_A_RADIUS, PEAKS = 5, 50
SAME_CIRCLE = 0.035  # fraction of the radius; circles within it lead to the same ring
MIN_VISIBLE_FRACTION = 0.35  # minimum visible fraction of the circumference
COARSE = 4


def hough_circles(edges: EdgePoints, size: tuple[int, int]) -> list[Ellipse]:
    """Return the circles with the most votes relative to their size, best first."""
    short = min(size)
    largest = max(LARGEST_RADIUS * short, 0.52 * max(size))
    found = hough_circles_between(edges, size, (LEAST_RADIUS * short, largest), RADIUS_STEP)
    return list(islice(found, PEAKS))


def hough_circles_between(
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


def _peaks(
    edges: EdgePoints, size: tuple[int, int], radius: float
) -> list[tuple[float, float, float, float]]:
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
        votes.reshape(rows, columns).astype(np.float32),
        (0, 0),
        blur,
        borderType=cv2.BORDER_CONSTANT,
    )
    seen = np.maximum(visible_fraction((columns, rows), radius / CELL_PX), MIN_VISIBLE_FRACTION)
    score = spread * (blur**2 / radius) / seen
    top = (score >= cv2.dilate(score, np.ones((7, 7), np.uint8))) & (score > 0)
    v, u = np.nonzero(top)
    best = np.argsort(score[v, u])[::-1][:PEAKS_A_RADIUS]
    return [
        (float(score[v[i], u[i]]), float(u[i]) * CELL_PX, float(v[i]) * CELL_PX, radius)
        for i in best
    ]


def visible_fraction(size: tuple[int, int], radius: float) -> NDArray[np.float32]:
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


# -- Candidate rings -------------------------------------------------------------------------------

REACHES_PX = (6.0, 3.0, 1.5, 0.8)
AGAIN_PX, MOVED_PX, NARROW_PX = (1.0, 0.7), (2.0, 1.0, 0.7), (2.0, 1.5, 0.8)
SHIFT = Shift(6.0, 2.0, turns=72, stretch_px=4.0)  # for voted circles, displaced by other edges
FAMILIES, FINER_FAMILIES = 10, 3  # number of rings around which concentric rings are searched
PROFILE_PX = 0.5
BESIDE, FINER = (0.5, 1.7), (0.8, 1.25)  # fractions of a ring's radius for that search
SAME_FINER, SAME_FIT = 0.003, 0.0005
SAME_FAMILY = 0.01  # fraction of the radius between centres of distinct families
SAME_START = 0.005  # fraction of the radius within which a search leads to a known ring
MIN_FINER_SCALE = 1.2  # minimum scale at which a finer image adds information
MIN_EDGE_FRACTION = 0.3  # minimum fraction of the circumference with edges for a concentric ring


def candidate_rings(picture: NDArray[Any], working: WorkingImage, edges: EdgePoints) -> list[Ring]:
    """Return the rings of an image with known edges at working size."""
    found = working_rings(working, edges)
    if working.scale > MIN_FINER_SCALE:
        fine = at_working_size(picture, FINER_PX)
        add_finer(found, (working, edges), (fine, edges_of(fine)))
    return found


def working_rings(working: WorkingImage, edges: EdgePoints) -> list[Ring]:
    """Return the distinct rings of an image."""
    found: list[Ring] = []
    for circle in hough_circles(edges, working.size):
        laid = [laid_through(edges, circle, REACHES_PX)]
        moved = shifted(edges.among(_along(edges, circle)), circle, SHIFT)
        laid.append(laid_through(edges, moved, MOVED_PX))
        if not any(circle.is_near(one, SAME_RING) for one in laid):  # both displaced by other edges
            laid.append(laid_through(edges, circle, NARROW_PX))
        for one in laid:
            _add(found, working, edges, one)
    for ring in _clearest(found, FAMILIES, SAME_FAMILY):
        for ellipse in concentric_rings(edges, ring.ellipse):
            if not _is_known(found, ellipse):
                _add(found, working, edges, laid_through(edges, ellipse, AGAIN_PX))
    return found


def add_finer(
    found: list[Ring],
    coarse: tuple[WorkingImage, EdgePoints],
    fine: tuple[WorkingImage, EdgePoints],
) -> None:
    """Add rings around the clearest ones that only a finer image resolves."""
    working, edges = coarse
    scale = working.scale / fine[0].scale
    for ring in _clearest(found, FINER_FAMILIES, FAMILY_OFFSET):
        for ellipse in concentric_rings(fine[1], ring.ellipse.scaled(scale), FINER):
            placed = laid_through(fine[1], ellipse, AGAIN_PX)
            _add(
                found,
                working,
                edges,
                placed.scaled(1 / scale),
                SAME_FINER,
                Finer(fine[1], fine[0].size, scale),
            )


def _clearest(found: list[Ring], count: int, apart: float) -> list[Ring]:
    """Return the most evident rings with distinct centres."""
    best: list[Ring] = []
    for ring in sorted(found, key=lambda ring: (ring.chance - ring.close) * ring.seen):
        if all(other.ellipse.offset_share(ring.ellipse) > apart for other in best):
            best.append(ring)
        if len(best) == count:
            break
    return best


def _add(
    found: list[Ring],
    working: WorkingImage,
    edges: EdgePoints,
    ellipse: Ellipse,
    same: float = SAME_RING,
    finer: Finer | None = None,
) -> None:
    """Add a ring unless it is known with equal clarity, or implausible for a mirror."""
    short = min(working.size)
    u, v = ellipse.centre
    if (
        not (0 <= u < working.size[0] and 0 <= v < working.size[1])
        or ellipse.radius < 0.9 * LEAST_RADIUS * short
    ):
        return
    if np.hypot(*ellipse.stretch) > FLATTEST:
        return
    twins = _twins(found, ellipse, same)
    if len(_twins([found[i] for i in twins], ellipse, SAME_FIT)):
        return
    ring = ring_of(
        working, edges, ellipse, max((found[i].close for i in twins), default=-1.0), finer
    )
    if ring is None:
        return
    if len(twins):
        found[twins[0]] = ring
    else:
        found.append(ring)


def _along(edges: EdgePoints, circle: Ellipse) -> NDArray[np.bool_]:
    """Return the mask of edges near a circle with its direction."""
    away = edges.points - np.asarray(circle.centre)
    length = np.hypot(away[:, 0], away[:, 1])
    across = np.abs(np.einsum("ij,ij->i", away, edges.normals))
    near = np.abs(length - circle.radius) < 2.5 * SHIFT.reach_px
    return np.asarray(near & (across > np.cos(NORMAL_SLACK) * length))


def _is_known(found: list[Ring], ellipse: Ellipse) -> bool:
    """Return whether a search from an ellipse would lead to a known ring."""
    return len(_twins(found, ellipse, SAME_START)) > 0


def _twins(found: list[Ring], ellipse: Ellipse, same: float) -> NDArray[np.intp]:
    """Return the rings equal to an ellipse within a fraction of the radius and two pixels."""
    if not found:
        return np.empty(0, np.intp)
    others = np.array(
        [(*ring.ellipse.centre, ring.ellipse.radius, *ring.ellipse.stretch) for ring in found]
    )
    u, v, radius, p, q = others.T
    share = np.minimum(same, 2.0 / radius)
    away = np.hypot(u - ellipse.centre[0], v - ellipse.centre[1]) / ellipse.radius
    stretch = np.hypot(p - ellipse.stretch[0], q - ellipse.stretch[1])
    is_same = (np.abs(radius / ellipse.radius - 1) < share) & (away < share) & (stretch < share)
    return np.nonzero(is_same)[0]


def concentric_rings(
    edges: EdgePoints, ellipse: Ellipse, within: tuple[float, float] = BESIDE
) -> list[Ellipse]:
    """Return ellipses of the same shape and centre that edges with matching direction support."""
    low, high = within
    away = ellipse.away(edges.points) / ellipse.radius + 1
    near = (away > low) & (away < high)
    circle, share = ellipse.on_circle(edges.points[near]), away[near]
    angle = np.arctan2(circle[:, 1], circle[:, 0])
    out, normals = ellipse.outward(angle), edges.normals[near]
    aligned = np.abs(out[:, 0] * normals[:, 0] + out[:, 1] * normals[:, 1]) > np.cos(
        NORMAL_SLACK / 1.5
    )
    share, angle = share[aligned], angle[aligned]
    sector = np.minimum((angle % (2 * np.pi)) * (SECTORS / (2 * np.pi)), SECTORS - 1).astype(int)
    width = PROFILE_PX / ellipse.radius
    ring = ((share - low) / width).astype(int)
    count = int((high - low) / width) + 3
    there = np.zeros((count, SECTORS), dtype=bool)
    for shift in (0, 1, 2):  # moving sum over three narrow rings
        there[np.minimum(ring + shift, count - 1), sector] = True
    profile = there.mean(axis=1)
    peaks = [
        k
        for k in range(2, count - 2)
        if profile[k] >= MIN_EDGE_FRACTION
        and profile[k] == profile[k - 2 : k + 3].max()
        and profile[k] > profile[k - 1]
    ]
    return [ellipse.grown(low + (k - 0.5) * width) for k in peaks]
