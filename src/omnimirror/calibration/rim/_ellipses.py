"""Nearly circular ellipses, their fit to edges, and subpixel refinement in the full-size image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from ..edge_detection import FULL_WEIGHT_STEP, MIN_STEP, EdgePoints, revolution_angles

# -- Ellipses and their fit to edges ---------------------------------------------------------------

MAX_STRETCH = 0.16  # limit of the stretch parameters; ratio of axes 0.73
USUAL_STRETCH = 0.03  # typical stretch by tilt; prior for partially visible rims
NORMAL_SLACK = 0.26  # radians; maximum angle between an edge and the ellipse
PARAMETERS = 5
SECTORS = 72
CUT = 2.0  # multiple of the reach beyond which edges are ignored
TURNED = 0.3  # radians; maximum rotation of the ellipse against its edges during the fit
SHIFT_COST = 0.02  # fraction of the circumference that a shift of one working pixel must gain


@dataclass(frozen=True)
class Ellipse:
    """Circle stretched by ``exp(p)`` along one direction and ``exp(-p)`` across it.

    ``stretch`` contains p cos 2a and p sin 2a for the direction a, which are smooth for a circle.
    """

    centre: tuple[float, float]
    radius: float
    stretch: tuple[float, float] = (0.0, 0.0)

    @property
    def semi_axes(self) -> tuple[float, float]:
        """Major and minor semi-axis."""
        p = float(np.hypot(*self.stretch))
        return self.radius * float(np.exp(p)), self.radius * float(np.exp(-p))

    @property
    def angle_deg(self) -> float:
        """Direction of the major axis, from image right towards image bottom, 0 to 180 deg."""
        return float(np.degrees(np.arctan2(self.stretch[1], self.stretch[0])) / 2 % 180)

    def scaled(self, scale: float) -> Ellipse:
        """Return the ellipse in an image scaled by ``scale``; pixel centres are integers."""
        u, v = ((c + 0.5) * scale - 0.5 for c in self.centre)
        return Ellipse((u, v), self.radius * scale, self.stretch)

    def grown(self, scale: float) -> Ellipse:
        """Return the ellipse enlarged about its centre."""
        return Ellipse(self.centre, self.radius * scale, self.stretch)

    def points(self, azimuth: Array, scale: Array | float = 1.0) -> Array:
        """Return points (n, 2) on the (enlarged) ellipse for angles (n,) on the original circle."""
        unit = _stretched(np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1), self.stretch)
        points: Array = unit * (self.radius * np.asarray(scale)[..., None]) + np.asarray(
            self.centre
        )
        return points

    def on_circle(self, points: Array) -> Array:
        """Return points (n, 2) mapped to the original unit circle about the origin."""
        return (
            _stretched(points - np.asarray(self.centre), (-self.stretch[0], -self.stretch[1]))
            / self.radius
        )

    def away(self, points: Array) -> Array:
        """Return approximate distances (n,) of points (n, 2) outside the ellipse."""
        circle = _stretched(points - np.asarray(self.centre), (-self.stretch[0], -self.stretch[1]))
        distance: Array = np.hypot(circle[:, 0], circle[:, 1]) - self.radius
        return distance

    def near(self, points: Array, reach: float) -> NDArray[np.intp]:
        """Return the indices of points (n, 2) that may be within a distance in px of the ellipse.

        The result contains all such points and few others.
        """
        offsets = points - np.asarray(self.centre)
        square = np.einsum("ij,ij->i", offsets, offsets)
        longer, shorter = self.semi_axes
        return np.nonzero(
            (square < (longer + reach) ** 2) & (square > max(0.0, shorter - reach) ** 2)
        )[0]

    def outward(self, azimuth: Array) -> Array:
        """Return unit normals (n, 2) for angles (n,) on the original circle."""
        normals = _stretched(
            np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1),
            (-self.stretch[0], -self.stretch[1]),
        )
        return normals / np.hypot(normals[..., 0], normals[..., 1])[..., None]

    def offset_share(self, other: Ellipse) -> float:
        """Return the distance of the centres in radii."""
        return float(np.hypot(*np.subtract(self.centre, other.centre))) / self.radius

    def is_near(self, other: Ellipse, tolerance: float) -> bool:
        """Return whether radius and centre agree within a fraction of the radius."""
        return (
            abs(other.radius / self.radius - 1) < tolerance and self.offset_share(other) < tolerance
        )


@dataclass(frozen=True)
class Shift:
    """Search range and step of ellipse shifts in working pixels.

    ``turns`` is the number of parts of the circumference.
    """

    reach_px: float
    step_px: float
    turns: int
    stretch_px: float = 0.0
    """Maximum change of the semi-axes."""

    @property
    def cell_px(self) -> float:
        """Width of the cells in which edges are counted."""
        return self.step_px / 2

    @property
    def half(self) -> int:
        """Number of cells to each side of the ring."""
        return int(np.ceil((3 * self.reach_px + 2 * self.stretch_px) / self.cell_px))


def shifted(edges: EdgePoints, ring: Ellipse, shift: Shift, scale: float = 1.0) -> Ellipse:
    """Return the shifted and stretched ring for which most of the circumference has an edge.

    Unlike a least-squares fit, the result is not biased by edges next to the ring.

    Parameters
    ----------
    edges
        Edges with the direction of the ring.
    ring
        Initial ellipse.
    shift
        Search range.
    scale
        Size of a working pixel in pixels of edges and ring.

    Returns
    -------
    Ellipse
        Best ellipse.
    """
    circle = ring.on_circle(edges.points)
    distances = (np.linalg.norm(circle, axis=1) - 1) * ring.radius / scale
    azimuth = np.arctan2(circle[:, 1], circle[:, 0]) % (2 * np.pi)
    edge_weights = np.zeros((shift.turns, 2 * shift.half + 1))
    cells = np.clip(np.round(distances / shift.cell_px).astype(int) + shift.half, 0, 2 * shift.half)
    sector = (azimuth * (shift.turns / (2 * np.pi))).astype(int) % shift.turns
    np.maximum.at(edge_weights, (sector, cells), edges.weights)
    edge_weights = np.maximum(
        edge_weights,
        0.6 * np.maximum(np.roll(edge_weights, 1, axis=1), np.roll(edge_weights, -1, axis=1)),
    )
    sector_count = max(int(np.count_nonzero(edge_weights.any(axis=1))), 1)
    moves, cost, cell_indices = _moves(shift, ring.stretch)
    fractions = edge_weights.astype(np.float32).ravel()[cell_indices].sum(axis=0) / sector_count
    u, v, r, p, q = (float(move) * scale for move in moves[int(np.argmax(fractions - cost))])
    stretch = ring.stretch[0] + p / ring.radius, ring.stretch[1] + q / ring.radius
    return Ellipse((ring.centre[0] + u, ring.centre[1] + v), ring.radius + r, stretch)


@lru_cache(maxsize=4)
def _moves(shift: Shift, stretch: tuple[float, float]) -> tuple[Array, Array, NDArray[np.int32]]:
    """Return the search grid of ellipse shifts for a ring shape.

    The result contains shifts (n, 5) to the right, downwards, outwards and in both stretches in
    working pixels, their costs (n,), and the cell (turns, n) on the shifted ring for each part of
    the circumference.
    """
    steps = np.arange(-shift.reach_px, shift.reach_px + 0.01, shift.step_px)
    bends = np.arange(-shift.stretch_px, shift.stretch_px + 0.01, shift.step_px)
    moves = np.stack(
        [a.ravel() for a in np.meshgrid(steps, steps, steps, bends, bends, indexing="ij")], axis=1
    )
    azimuth = revolution_angles(shift.turns) + np.pi / shift.turns
    normals = Ellipse((0.0, 0.0), 1.0, stretch).outward(azimuth)
    outwards = np.stack(
        [
            normals[:, 0],
            normals[:, 1],
            np.ones_like(azimuth),
            np.cos(2 * azimuth),
            np.sin(2 * azimuth),
        ]
    )
    cells = np.round(outwards.T @ moves.T / shift.cell_px).astype(np.int32) + shift.half
    cells += np.arange(shift.turns, dtype=np.int32)[:, None] * (2 * shift.half + 1)
    return moves, SHIFT_COST * np.linalg.norm(moves, axis=1), cells


def _stretched(points: Array, stretch: tuple[float, float]) -> Array:
    """Return points (n, 2) times the matrix exponential of ((p, q), (q, -p))."""
    p, q = stretch
    size = math.hypot(p, q)
    slope = math.sinh(size) / size if size > 0 else 1.0
    middle = math.cosh(size)
    matrix = np.array([[middle + slope * p, slope * q], [slope * q, middle - slope * p]])
    transformed: Array = points @ matrix
    return transformed


def fit_ellipse(edges: EdgePoints, first: Ellipse, reaches: tuple[float, ...]) -> Ellipse:
    """Fit an ellipse to edges near an initial one by Gauss-Newton steps with robust weights.

    Parameters
    ----------
    edges
        Edges of the image.
    first
        Initial ellipse.
    reaches : px
        Maximum distance of edges in each step, with the first and the last repeated; also the width
        of the Cauchy weights.

    Returns
    -------
    Ellipse
        Fitted ellipse; the initial one if there are too few edges.
    """
    ellipse = first
    near = edges.subset(_along(edges, first, CUT * reaches[0] + 3))
    circle = first.on_circle(near.points)
    sector = ((np.arctan2(circle[:, 1], circle[:, 0]) / (2 * np.pi) + 0.5) * SECTORS).astype(
        int
    ) % SECTORS
    for reach in (reaches[0], *reaches, reaches[-1]):
        step = _step(near, sector, ellipse, reach)
        if step is None:
            return ellipse
        u, v = ellipse.centre
        p, q = (
            min(max(s + float(d), -MAX_STRETCH), MAX_STRETCH)
            for s, d in zip(ellipse.stretch, step[3:], strict=True)
        )
        radius = ellipse.radius * math.exp(min(max(float(step[2]), -0.1), 0.1))
        ellipse = Ellipse((u + float(step[0]), v + float(step[1])), radius, (p, q))
    return ellipse


def _along(edges: EdgePoints, ellipse: Ellipse, reach: float) -> NDArray[np.intp]:
    """Return the indices of edges near an ellipse that may belong to it during the fit."""
    candidates = ellipse.near(edges.points, reach)
    outward = _stretched(
        ellipse.on_circle(edges.points[candidates]), (-ellipse.stretch[0], -ellipse.stretch[1])
    )
    normals = edges.normals[candidates]
    alignment = np.abs(outward[:, 0] * normals[:, 0] + outward[:, 1] * normals[:, 1])
    selected: NDArray[np.intp] = candidates[
        alignment > np.cos(NORMAL_SLACK + TURNED) * np.hypot(outward[:, 0], outward[:, 1])
    ]
    return selected


def _step(
    edges: EdgePoints, sector: NDArray[np.intp], ellipse: Ellipse, reach: float
) -> Array | None:
    """Return a Gauss-Newton step (5,) of centre, log radius and stretch; None for too few edges."""
    circle = ellipse.on_circle(edges.points)
    length = np.hypot(circle[:, 0], circle[:, 1])
    residual, r = (length - 1) * ellipse.radius, ellipse.radius
    outward = _stretched(circle, (-ellipse.stretch[0], -ellipse.stretch[1]))
    outward /= np.hypot(outward[:, 0], outward[:, 1])[:, None]
    alignment = np.abs(outward[:, 0] * edges.normals[:, 0] + outward[:, 1] * edges.normals[:, 1])
    is_used = (np.abs(residual) < CUT * reach) & (alignment > np.cos(NORMAL_SLACK))
    if is_used.sum() < 2 * PARAMETERS:
        return None
    weight = is_used * edges.weights / (1 + (residual / reach) ** 2)
    total = np.bincount(sector, weight, SECTORS)  # equal weight of all directions
    weight = weight / np.maximum(total, 0.5)[sector]
    c, s = circle[:, 0] / length, circle[:, 1] / length
    columns = np.stack(
        [outward[:, 0], outward[:, 1], np.full(len(c), r), r * (c * c - s * s), r * (2 * c * s)], 1
    )
    normal = (columns * weight[:, None]).T @ columns
    right = (columns * weight[:, None]).T @ residual
    prior_weight = (reach / USUAL_STRETCH) ** 2 * 0.5
    normal[3, 3] += prior_weight
    normal[4, 4] += prior_weight
    right[3:] -= prior_weight * np.asarray(ellipse.stretch)
    normal[np.diag_indices(PARAMETERS)] += 1e-9 * np.trace(normal)
    step: Array = np.linalg.solve(normal, right)
    return step


# -- Subpixel refinement ---------------------------------------------------------------------------

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


def refine_ring(levels: NDArray[np.number], ring: Ellipse, scale: float) -> tuple[Ellipse, float]:
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
    best = fit_ellipse(edges, ring, reaches)
    fraction = _close(edges, best, CLOSE_PX * scale)
    if fraction > CLEAR:
        return best, fraction
    best_score = -np.inf
    for shape in sorted(shapes):
        start = shifted(edges, Ellipse(ring.centre, ring.radius, shape), SHIFT, scale)
        ellipse = fit_ellipse(edges, start, reaches)
        close = _close(edges, ellipse, CLOSE_PX * scale)
        score = clearness(ellipse, close)
        if score > best_score:
            best, fraction, best_score = ellipse, close, score
    return best, fraction


def clearness(ellipse: Ellipse, fraction: float) -> float:
    """Return the clarity of an ellipse: fraction of close edges minus a stretch penalty."""
    return fraction - STRETCH_COST * float(np.hypot(*ellipse.stretch))


def _smoothed_profiles(
    levels: NDArray[np.number], points: NDArray[np.float32], step: float, scale: float
) -> NDArray[np.float32]:
    """Return smoothed image levels (profiles, samples, channels) at points (profiles, samples, 2)."""
    import cv2

    top, left = (max(0, int(np.floor(points[..., k].min()))) for k in (1, 0))
    crop = np.ascontiguousarray(
        levels[top : int(points[..., 1].max()) + 2, left : int(points[..., 0].max()) + 2]
    )
    if not crop.size:
        return np.empty((*points.shape[:2], 0), np.float32)
    samples = cv2.remap(
        crop,
        points[..., 0] - left,
        points[..., 1] - top,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    samples = samples.reshape(*points.shape[:2], -1).astype(np.float32)
    smooth = cv2.GaussianBlur(
        samples.reshape(len(points), -1, samples.shape[2]),
        (0, 0),
        sigmaX=0.8 * scale / step if scale > 1 else 1.6,
        sigmaY=0.8,
    )
    profiles: NDArray[np.float32] = smooth.reshape(samples.shape)  # type: ignore[assignment]  # stub of cv2
    return profiles


def _edges_across(levels: NDArray[np.number], ring: Ellipse, scale: float) -> EdgePoints:
    """Return the edges of profiles across the ring; a profile may have several."""
    step = max(0.5, scale / SAMPLES)
    reach = REACH_PX * scale
    distances = np.arange(-reach, reach + step / 2, step)
    azimuth = revolution_angles(PROFILES)
    ring_points, normals = ring.points(azimuth), ring.outward(azimuth)
    points = (ring_points[:, None, :] + distances[None, :, None] * normals[:, None, :]).astype(
        np.float32
    )
    height, width = levels.shape[:2]
    margin = EDGE_PX * scale
    inside = np.asarray(
        ((ring_points > margin) & (ring_points < np.array([width - 1, height - 1]) - margin)).all(
            axis=1
        )
    )
    no_edges = EdgePoints(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0))
    if not inside.any():
        return no_edges
    smooth = _smoothed_profiles(levels, points, step, scale)
    if not smooth.size:
        return no_edges
    gradients = np.gradient(smooth, step / scale, axis=1)
    channel = np.abs(gradients).argmax(axis=2)[..., None]
    gradients = np.take_along_axis(gradients, channel, axis=2)[..., 0]
    tangential_gradients = (np.roll(smooth, -1, axis=0) - np.roll(smooth, 1, axis=0)) / (
        4 * np.pi * ring.radius / PROFILES / scale
    )
    obliquity = np.take_along_axis(tangential_gradients, channel, axis=2)[..., 0] / (
        np.abs(gradients) + 1e-6
    )
    slope = np.abs(gradients)
    here, before, after = slope[:, 1:-1], slope[:, :-2], slope[:, 2:]
    is_edge = (here >= after) & (here > before) & (here > MIN_STEP) & inside[:, None]
    channel, sample_index = np.nonzero(is_edge)
    a, b, c = before[is_edge], here[is_edge], after[is_edge]
    offset = np.clip((c - a) / np.maximum(2 * (2 * b - a - c), 1e-9), -0.5, 0.5)
    edge_distance = distances[sample_index + 1] + offset * step
    edge = ring_points[channel] + edge_distance[:, None] * normals[channel]
    proximity_weight = b * np.exp(
        -((edge_distance / (BESIDE_PX * scale)) ** 2) / 2
    )  # an outer frame may be stronger
    max_weight = np.zeros(PROFILES)
    np.maximum.at(max_weight, channel, proximity_weight)
    weights = (
        (proximity_weight / max_weight[channel]) ** 2
        * np.minimum(b / FULL_WEIGHT_STEP, 1.0)
        / (1 + (obliquity[:, 1:-1][is_edge] / LEAN) ** 2)
    )
    return EdgePoints(edge, normals[channel], b.astype(float), weights)


def _close(edges: EdgePoints, ellipse: Ellipse, close: float) -> float:
    """Return the fraction of the profiles with an edge close to the ellipse."""
    circle = ellipse.on_circle(edges.points)
    distances = np.abs(np.linalg.norm(circle, axis=1) - 1) * ellipse.radius
    sector = ((np.arctan2(circle[:, 1], circle[:, 0]) / (2 * np.pi) + 0.5) * PROFILES).astype(
        int
    ) % PROFILES
    edge_weights, close_weights = np.zeros((2, PROFILES))
    np.maximum.at(edge_weights, sector, edges.weights)
    np.maximum.at(close_weights, sector, edges.weights * np.exp(-((distances / close) ** 2) / 2))
    sector_count = max(int(np.count_nonzero(edge_weights)), 1)
    return float(close_weights.sum() / sector_count)
