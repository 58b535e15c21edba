"""Ellipses that are nearly circles, and how one is laid through edges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .edges import EdgePoints, turns

Array = NDArray[np.float64]

FLATTEST = 0.16  # of the two numbers that stretch a circle; axes of .73
USUAL_STRETCH = 0.03  # as far as a mirror is mostly tilted; a prior, which decides where little of a rim is seen
NORMAL_SLACK = 0.26  # radians by which an edge may lean from the ellipse's own direction
PARAMETERS = 5
SECTORS = 72
CUT = 2.0  # reaches beyond which an edge does not count
TURNED = 0.3  # radians by which an ellipse may turn against its edges while it is laid through them
SHIFT_COST = 0.02  # share of the way round that a working pixel of shift must gain


@dataclass(frozen=True)
class Ellipse:
    """A circle of radius ``radius``, stretched by ``exp(p)`` along one direction and by ``exp(-p)`` across it.

    ``stretch`` holds p cos 2a and p sin 2a of the direction a: smooth numbers where the circle is none.
    """

    centre: tuple[float, float]
    radius: float
    stretch: tuple[float, float] = (0.0, 0.0)

    @property
    def semi_axes(self) -> tuple[float, float]:
        """The longer and the shorter one."""
        p = float(np.hypot(*self.stretch))
        return self.radius * float(np.exp(p)), self.radius * float(np.exp(-p))

    @property
    def angle_deg(self) -> float:
        """Direction of the longer axis, from image right towards image bottom, 0 to 180."""
        return float(np.degrees(np.arctan2(self.stretch[1], self.stretch[0])) / 2 % 180)

    def scaled(self, scale: float) -> Ellipse:
        """The same in a picture of which each pixel is ``scale`` of the present ones; pixel centres are integers."""
        u, v = ((c + 0.5) * scale - 0.5 for c in self.centre)
        return Ellipse((u, v), self.radius * scale, self.stretch)

    def grown(self, share: float) -> Ellipse:
        """The same enlarged about its centre."""
        return Ellipse(self.centre, self.radius * share, self.stretch)

    def points(self, turn: Array, share: Array | float = 1.0) -> Array:
        """Points (n, 2) on it, or on it enlarged, for the angles (n,) of the circle that it was."""
        unit = _stretched(np.stack([np.cos(turn), np.sin(turn)], axis=-1), self.stretch)
        points: Array = unit * (self.radius * np.asarray(share)[..., None]) + np.asarray(self.centre)
        return points

    def on_circle(self, points: Array) -> Array:
        """Points (n, 2) as they lay when it was a unit circle about the origin."""
        return _stretched(points - np.asarray(self.centre), (-self.stretch[0], -self.stretch[1])) / self.radius

    def away(self, points: Array) -> Array:
        """How far (n,) points (n, 2) lie outside of it, about."""
        circle = _stretched(points - np.asarray(self.centre), (-self.stretch[0], -self.stretch[1]))
        distance: Array = np.hypot(circle[:, 0], circle[:, 1]) - self.radius
        return distance

    def near(self, points: Array, reach: float) -> NDArray[np.intp]:
        """Which of points (n, 2) may lie within so many px of it: of all that do, and of few others."""
        away = points - np.asarray(self.centre)
        square = np.einsum("ij,ij->i", away, away)
        longer, shorter = self.semi_axes
        return np.nonzero((square < (longer + reach) ** 2) & (square > max(0.0, shorter - reach) ** 2))[0]

    def outward(self, turn: Array) -> Array:
        """Unit normals (n, 2) at the angles (n,) of the circle that it was."""
        normals = _stretched(np.stack([np.cos(turn), np.sin(turn)], axis=-1), (-self.stretch[0], -self.stretch[1]))
        return normals / np.hypot(normals[..., 0], normals[..., 1])[..., None]

    def offset_share(self, other: Ellipse) -> float:
        """How far the centres lie apart, in radii."""
        return float(np.hypot(*np.subtract(self.centre, other.centre))) / self.radius

    def is_near(self, other: Ellipse, share: float) -> bool:
        """Whether radius and centre are the same but for a share of the radius."""
        return abs(other.radius / self.radius - 1) < share and self.offset_share(other) < share


@dataclass(frozen=True)
class Shift:
    """How far and how finely an ellipse is moved, grown and stretched, working pixels; how many parts of its way round
    count."""

    reach_px: float
    step_px: float
    turns: int
    stretch_px: float = 0.0
    """Of its semi-axes, at most."""

    @property
    def cell_px(self) -> float:
        """Width of the cells in which edges are counted."""
        return self.step_px / 2

    @property
    def half(self) -> int:
        """Cells that may be reached to each side of the ring."""
        return int(np.ceil((3 * self.reach_px + 2 * self.stretch_px) / self.cell_px))


def shifted(edges: EdgePoints, ring: Ellipse, shift: Shift, scale: float = 1.0) -> Ellipse:
    """The ring moved, grown and stretched by a little to where most of the way round has an edge: what is beside it
    pulls nothing.

    Parameters
    ----------
    edges
        Of the ring's own direction.
    ring
    shift
    scale
        Working pixel in the pixels of edges and ring.

    Returns
    -------
    Ellipse
    """
    circle = ring.on_circle(edges.points)
    away = (np.linalg.norm(circle, axis=1) - 1) * ring.radius / scale
    turn = np.arctan2(circle[:, 1], circle[:, 0]) % (2 * np.pi)
    there = np.zeros((shift.turns, 2 * shift.half + 1))
    at = np.clip(np.round(away / shift.cell_px).astype(int) + shift.half, 0, 2 * shift.half)
    sector = (turn * (shift.turns / (2 * np.pi))).astype(int) % shift.turns
    np.maximum.at(there, (sector, at), edges.weights)
    there = np.maximum(there, 0.6 * np.maximum(np.roll(there, 1, axis=1), np.roll(there, -1, axis=1)))
    known = max(int(np.count_nonzero(there.any(axis=1))), 1)
    moves, cost, wanted = _moves(shift, ring.stretch)
    share = there.astype(np.float32).ravel()[wanted].sum(axis=0) / known
    u, v, r, p, q = (float(move) * scale for move in moves[int(np.argmax(share - cost))])
    stretch = ring.stretch[0] + p / ring.radius, ring.stretch[1] + q / ring.radius
    return Ellipse((ring.centre[0] + u, ring.centre[1] + v), ring.radius + r, stretch)


@lru_cache(maxsize=4)
def _moves(shift: Shift, stretch: tuple[float, float]) -> tuple[Array, Array, NDArray[np.int32]]:
    """Of every move of a ring of some shape: how far (n, 5) to the right, down, outwards and in both stretches, working
    pixels; what each costs (n,); and the cell (turns, n) of each part of the way round that is then on the ring."""
    steps = np.arange(-shift.reach_px, shift.reach_px + 0.01, shift.step_px)
    bends = np.arange(-shift.stretch_px, shift.stretch_px + 0.01, shift.step_px)
    moves = np.stack([a.ravel() for a in np.meshgrid(steps, steps, steps, bends, bends, indexing="ij")], axis=1)
    turn = turns(shift.turns) + np.pi / shift.turns
    out = Ellipse((0.0, 0.0), 1.0, stretch).outward(turn)
    outwards = np.stack([out[:, 0], out[:, 1], np.ones_like(turn), np.cos(2 * turn), np.sin(2 * turn)])
    cells = np.round(outwards.T @ moves.T / shift.cell_px).astype(np.int32) + shift.half
    cells += np.arange(shift.turns, dtype=np.int32)[:, None] * (2 * shift.half + 1)
    return moves, SHIFT_COST * np.linalg.norm(moves, axis=1), cells


def _stretched(points: Array, stretch: tuple[float, float]) -> Array:
    """Points (n, 2) times exp of the matrix ((p, q), (q, -p))."""
    p, q = stretch
    size = math.hypot(p, q)
    slope = math.sinh(size) / size if size > 0 else 1.0
    middle = math.cosh(size)
    matrix = np.array([[middle + slope * p, slope * q], [slope * q, middle - slope * p]])
    turned: Array = points @ matrix
    return turned


def laid_through(edges: EdgePoints, first: Ellipse, reaches: tuple[float, ...]) -> Ellipse:
    """The ellipse through the edges near a first one: Gauss-Newton, the farther an edge the less it counts.

    Parameters
    ----------
    edges
    first
    reaches : px
        How far edges may lie, step by step, the first and the last twice; each is the Cauchy weight's width as well.

    Returns
    -------
    Ellipse
        The first one where too few edges are near.
    """
    ellipse = first
    near = edges.among(_along(edges, first, CUT * reaches[0] + 3))
    circle = first.on_circle(near.points)
    sector = ((np.arctan2(circle[:, 1], circle[:, 0]) / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    for reach in (reaches[0], *reaches, reaches[-1]):
        step = _step(near, sector, ellipse, reach)
        if step is None:
            return ellipse
        u, v = ellipse.centre
        p, q = (min(max(s + float(d), -FLATTEST), FLATTEST) for s, d in zip(ellipse.stretch, step[3:], strict=True))
        radius = ellipse.radius * math.exp(min(max(float(step[2]), -0.1), 0.1))
        ellipse = Ellipse((u + float(step[0]), v + float(step[1])), radius, (p, q))
    return ellipse


def _along(edges: EdgePoints, ellipse: Ellipse, reach: float) -> NDArray[np.intp]:
    """Which edges lie near an ellipse and may become its own while it moves and stretches."""
    near = ellipse.near(edges.points, reach)
    out = _stretched(ellipse.on_circle(edges.points[near]), (-ellipse.stretch[0], -ellipse.stretch[1]))
    normals = edges.normals[near]
    across = np.abs(out[:, 0] * normals[:, 0] + out[:, 1] * normals[:, 1])
    chosen: NDArray[np.intp] = near[across > np.cos(NORMAL_SLACK + TURNED) * np.hypot(out[:, 0], out[:, 1])]
    return chosen


def _step(edges: EdgePoints, sector: NDArray[np.intp], ellipse: Ellipse, reach: float) -> Array | None:
    """A Gauss-Newton step (5,) of centre, log radius and stretch; None where there are too few edges."""
    circle = ellipse.on_circle(edges.points)
    length = np.hypot(circle[:, 0], circle[:, 1])
    residual, r = (length - 1) * ellipse.radius, ellipse.radius
    out = _stretched(circle, (-ellipse.stretch[0], -ellipse.stretch[1]))
    out /= np.hypot(out[:, 0], out[:, 1])[:, None]
    across = np.abs(out[:, 0] * edges.normals[:, 0] + out[:, 1] * edges.normals[:, 1])
    used = (np.abs(residual) < CUT * reach) & (across > np.cos(NORMAL_SLACK))
    if used.sum() < 2 * PARAMETERS:
        return None
    weight = used * edges.weights / (1 + (residual / reach) ** 2)
    total = np.bincount(sector, weight, SECTORS)  # each direction counts the same, however crowded
    weight = weight / np.maximum(total, 0.5)[sector]
    c, s = circle[:, 0] / length, circle[:, 1] / length
    columns = np.stack([out[:, 0], out[:, 1], np.full(len(c), r), r * (c * c - s * s), r * (2 * c * s)], 1)
    normal = (columns * weight[:, None]).T @ columns
    right = (columns * weight[:, None]).T @ residual
    pull = (reach / USUAL_STRETCH) ** 2 * 0.5
    normal[3, 3] += pull
    normal[4, 4] += pull
    right[3:] -= pull * np.asarray(ellipse.stretch)
    normal[np.diag_indices(PARAMETERS)] += 1e-9 * np.trace(normal)
    step: Array = np.linalg.solve(normal, right)
    return step
