"""Candidate rings of an image: Hough transform for circles, fitted ellipses, concentric rings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..edge_detection import (
    FINER_PX,
    EdgePoints,
    WorkingImage,
    at_working_size,
    edges_of,
    revolution_angles,
)
from ._ellipses import MAX_STRETCH, NORMAL_SLACK, Ellipse, Shift, fit_ellipse, shifted
from ._features import FAMILY_OFFSET, SAME_RING, SECTORS, Finer, Ring, ring_of

# -- Hough transform for circles -------------------------------------------------------------------

MIN_RADIUS, LARGEST_RADIUS = 0.18, 0.75  # relative to the short image side
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
    circles = hough_circles_between(edges, size, (MIN_RADIUS * short, largest), RADIUS_STEP)
    return list(islice(circles, PEAKS))


def hough_circles_between(
    edges: EdgePoints, size: tuple[int, int], radii: tuple[float, float], step: float
) -> Iterator[Ellipse]:
    """Yield circles with radii in a geometric series, ordered by votes relative to their size."""
    peaks: list[tuple[float, float, float, float]] = []
    radius, largest = radii
    while radius < largest:
        peaks += _peaks(edges, size, radius)
        radius *= step
    distinct: list[Ellipse] = []
    for _, u, v, r in sorted(peaks, reverse=True):
        circle = Ellipse((u, v), r)
        if not any(circle.is_near(other, SAME_CIRCLE) for other in distinct):
            distinct.append(circle)
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
    visible = np.maximum(visible_fraction((columns, rows), radius / CELL_PX), MIN_VISIBLE_FRACTION)
    score = spread * (blur**2 / radius) / visible
    is_peak = (score >= cv2.dilate(score, np.ones((7, 7), np.uint8))) & (score > 0)
    v, u = np.nonzero(is_peak)
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
    azimuth = revolution_angles(48)
    u, v = columns[:, None] + radius * np.cos(azimuth), rows[:, None] + radius * np.sin(azimuth)
    in_u, in_v = (u >= 0) & (u <= size[0] - 1), (v >= 0) & (v <= size[1] - 1)
    coarse_fraction = in_v.astype(np.float32) @ in_u.astype(np.float32).T / np.float32(len(azimuth))
    at_u = np.linspace(0, len(columns) - 1, size[0], dtype=np.float32)
    at_v = np.linspace(0, len(rows) - 1, size[1], dtype=np.float32)
    fraction: NDArray[np.float32] = cv2.remap(
        coarse_fraction, *np.meshgrid(at_u, at_v), cv2.INTER_LINEAR
    )  # type: ignore[assignment]  # stub of cv2 returns any dtype
    return fraction


# -- Candidate rings -------------------------------------------------------------------------------

REACHES_PX = (6.0, 3.0, 1.5, 0.8)
AGAIN_PX, MOVED_PX, NARROW_PX = (1.0, 0.7), (2.0, 1.0, 0.7), (2.0, 1.5, 0.8)
SHIFT = Shift(6.0, 2.0, turns=72, stretch_px=4.0)  # for voted circles, displaced by other edges
FAMILIES, FINER_FAMILIES = 10, 3  # number of rings around which concentric rings are searched
PROFILE_PX = 0.5
SEARCH_RANGE, FINE_SEARCH_RANGE = (
    (0.5, 1.7),
    (0.8, 1.25),
)  # fractions of a ring's radius for that search
SAME_FINER, SAME_FIT = 0.003, 0.0005
SAME_FAMILY = 0.01  # fraction of the radius between centres of distinct families
SAME_START = 0.005  # fraction of the radius within which a search leads to a known ring
MIN_FINER_SCALE = 1.2  # minimum scale at which a finer image adds information
MIN_EDGE_FRACTION = 0.3  # minimum fraction of the circumference with edges for a concentric ring


def candidate_rings(image: NDArray[Any], working: WorkingImage, edges: EdgePoints) -> list[Ring]:
    """Return the rings of an image with known edges at working size."""
    rings = working_rings(working, edges)
    if working.scale > MIN_FINER_SCALE:
        fine = at_working_size(image, FINER_PX)
        add_finer(rings, (working, edges), (fine, edges_of(fine)))
    return rings


def working_rings(working: WorkingImage, edges: EdgePoints) -> list[Ring]:
    """Return the distinct rings of an image."""
    rings: list[Ring] = []
    for circle in hough_circles(edges, working.size):
        fitted = [fit_ellipse(edges, circle, REACHES_PX)]
        displaced = shifted(edges.subset(_along(edges, circle)), circle, SHIFT)
        fitted.append(fit_ellipse(edges, displaced, MOVED_PX))
        if not any(
            circle.is_near(other, SAME_RING) for other in fitted
        ):  # both displaced by other edges
            fitted.append(fit_ellipse(edges, circle, NARROW_PX))
        for other in fitted:
            _add(rings, working, edges, other)
    for ring in _clearest(rings, FAMILIES, SAME_FAMILY):
        for ellipse in concentric_rings(edges, ring.ellipse):
            if not _is_known(rings, ellipse):
                _add(rings, working, edges, fit_ellipse(edges, ellipse, AGAIN_PX))
    return rings


def add_finer(
    rings: list[Ring],
    coarse: tuple[WorkingImage, EdgePoints],
    fine: tuple[WorkingImage, EdgePoints],
) -> None:
    """Add rings around the clearest ones that only a finer image resolves."""
    working, edges = coarse
    scale = working.scale / fine[0].scale
    for ring in _clearest(rings, FINER_FAMILIES, FAMILY_OFFSET):
        for ellipse in concentric_rings(fine[1], ring.ellipse.scaled(scale), FINE_SEARCH_RANGE):
            refined = fit_ellipse(fine[1], ellipse, AGAIN_PX)
            _add(
                rings,
                working,
                edges,
                refined.scaled(1 / scale),
                SAME_FINER,
                Finer(fine[1], fine[0].size, scale),
            )


def _clearest(rings: list[Ring], count: int, min_offset: float) -> list[Ring]:
    """Return the most evident rings with distinct centres."""
    best: list[Ring] = []
    for ring in sorted(rings, key=lambda ring: (ring.chance - ring.close) * ring.visible):
        if all(other.ellipse.offset_share(ring.ellipse) > min_offset for other in best):
            best.append(ring)
        if len(best) == count:
            break
    return best


def _add(
    rings: list[Ring],
    working: WorkingImage,
    edges: EdgePoints,
    ellipse: Ellipse,
    tolerance: float = SAME_RING,
    finer: Finer | None = None,
) -> None:
    """Add a ring unless it is known with equal clarity, or implausible for a mirror."""
    short = min(working.size)
    u, v = ellipse.centre
    if (
        not (0 <= u < working.size[0] and 0 <= v < working.size[1])
        or ellipse.radius < 0.9 * MIN_RADIUS * short
    ):
        return
    if np.hypot(*ellipse.stretch) > MAX_STRETCH:
        return
    equal = _twins(rings, ellipse, tolerance)
    if len(_twins([rings[i] for i in equal], ellipse, SAME_FIT)):
        return
    ring = ring_of(
        working, edges, ellipse, max((rings[i].close for i in equal), default=-1.0), finer
    )
    if ring is None:
        return
    if len(equal):
        rings[equal[0]] = ring
    else:
        rings.append(ring)


def _along(edges: EdgePoints, circle: Ellipse) -> NDArray[np.bool_]:
    """Return the mask of edges near a circle with its direction."""
    offsets = edges.points - np.asarray(circle.centre)
    length = np.hypot(offsets[:, 0], offsets[:, 1])
    across = np.abs(np.einsum("ij,ij->i", offsets, edges.normals))
    is_near = np.abs(length - circle.radius) < 2.5 * SHIFT.reach_px
    return np.asarray(is_near & (across > np.cos(NORMAL_SLACK) * length))


def _is_known(rings: list[Ring], ellipse: Ellipse) -> bool:
    """Return whether a search from an ellipse would lead to a known ring."""
    return len(_twins(rings, ellipse, SAME_START)) > 0


def _twins(rings: list[Ring], ellipse: Ellipse, tolerance: float) -> NDArray[np.intp]:
    """Return the rings equal to an ellipse within a fraction of the radius and two pixels."""
    if not rings:
        return np.empty(0, np.intp)
    others = np.array(
        [(*ring.ellipse.centre, ring.ellipse.radius, *ring.ellipse.stretch) for ring in rings]
    )
    u, v, radius, p, q = others.T
    limits = np.minimum(tolerance, 2.0 / radius)
    offsets = np.hypot(u - ellipse.centre[0], v - ellipse.centre[1]) / ellipse.radius
    stretch = np.hypot(p - ellipse.stretch[0], q - ellipse.stretch[1])
    is_same = (
        (np.abs(radius / ellipse.radius - 1) < limits) & (offsets < limits) & (stretch < limits)
    )
    return np.nonzero(is_same)[0]


def concentric_rings(
    edges: EdgePoints, ellipse: Ellipse, within: tuple[float, float] = SEARCH_RANGE
) -> list[Ellipse]:
    """Return ellipses of the same shape and centre that edges with matching direction support."""
    low, high = within
    fractions = ellipse.away(edges.points) / ellipse.radius + 1
    is_near = (fractions > low) & (fractions < high)
    circle, ring_fractions = ellipse.on_circle(edges.points[is_near]), fractions[is_near]
    angle = np.arctan2(circle[:, 1], circle[:, 0])
    outward, normals = ellipse.outward(angle), edges.normals[is_near]
    aligned = np.abs(outward[:, 0] * normals[:, 0] + outward[:, 1] * normals[:, 1]) > np.cos(
        NORMAL_SLACK / 1.5
    )
    ring_fractions, angle = ring_fractions[aligned], angle[aligned]
    sector = np.minimum((angle % (2 * np.pi)) * (SECTORS / (2 * np.pi)), SECTORS - 1).astype(int)
    width = PROFILE_PX / ellipse.radius
    ring = ((ring_fractions - low) / width).astype(int)
    count = int((high - low) / width) + 3
    has_edge = np.zeros((count, SECTORS), dtype=bool)
    for shift in (0, 1, 2):  # moving sum over three narrow rings
        has_edge[np.minimum(ring + shift, count - 1), sector] = True
    profile = has_edge.mean(axis=1)
    peaks = [
        k
        for k in range(2, count - 2)
        if profile[k] >= MIN_EDGE_FRACTION
        and profile[k] == profile[k - 2 : k + 3].max()
        and profile[k] > profile[k - 1]
    ]
    return [ellipse.grown(low + (k - 0.5) * width) for k in peaks]
