"""Plumb-line fit: refinement of a camera model for which images of straight edges are straight.

Each edge is in a plane through the viewpoint with unit normal n; the direction d of each of its
pixels satisfies ``n . d = 0``. The residual is the distance of the pixel from the image of that
plane in pixels, to first order ``n . d / |(dd/du)^T n|``. Angular residuals would be minimal for
a model that compresses the whole scene into one direction. Normals are fitted for each trial and
eliminated, which leaves only the parameters of the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...base.typing import Array, Mask
from ...cameras.frames import turned
from ...cameras.models.base import CameraModel

NORMAL_STEPS = 3
MOST_STEPS = 40
SETTLED = 1e-7
SCALE_PX = 0.5  # residual above which an edge is downweighted
LEAST_POINTS = 6  # minimum visible points of an edge, or all of an edge with fewer
UNSEEN_PX = 10.0


class Knobs(NamedTuple):
    """Free parameters of a model, some of them coupled."""

    names: tuple[tuple[str, ...], ...]
    """Names of parameters; coupled ones form a group."""
    turn: Array
    """Change (p, q) of each model parameter by each free parameter."""
    prior: Array
    """Expected values (q,)."""
    information: Array
    """Information (q,), 1 / sigma^2, of the expected values."""
    scales: Array
    """Typical changes (q,)."""


class Edges(NamedTuple):
    """Concatenated chains of all images."""

    pixels: Array
    """Pixels (n, 2)."""
    slices: tuple[slice, ...]


@dataclass(frozen=True)
class LinesFit:
    """Fit of a model to its edges."""

    model: CameraModel
    normals: Array
    """Plane normals (chains, 3) in the camera frame."""
    residuals: Array
    """Residuals (n,) px; NaN for pixels outside the model's field."""
    rates: Array
    """Derivatives (n, q) of the residuals with respect to the free parameters, normals eliminated.
    """
    cost: float
    weights: Array
    """Weights (chains,) from 0 to 1."""

    def rms_of(self, edges: Edges) -> Array:
        """Return the RMS residual (chains,) px; infinite for invisible chains."""
        return np.array([_rms(self.residuals[part]) for part in edges.slices])


def edges_of(chains: Sequence[Array]) -> Edges:
    """Return concatenated chains (n, 2)."""
    ends = np.cumsum([len(chain) for chain in chains])
    parts = tuple(slice(int(e) - len(c), int(e)) for e, c in zip(ends, chains, strict=True))
    return Edges(np.concatenate(chains), parts)


def fitted_lines(
    model: CameraModel, edges: Edges, knobs: Knobs, *, distance_mm: float = np.inf, most_steps: int = MOST_STEPS
) -> LinesFit:
    """Return the model with the straightest edges, starting from an initial model."""
    start = np.array([p.value for p in model.parameters])
    values = np.zeros(len(knobs.names))
    fit, damping = _compared(model, edges, knobs, values, distance_mm), 1e-3
    for _ in range(most_steps):
        matrix, gradient = normal_equations(fit, edges, knobs, values)
        before = fit.cost
        while damping < 1e8:
            size = np.sqrt(np.diag(matrix))
            size = np.where(size > 0, size, 1.0)
            scaled = matrix / np.outer(size, size) + damping * np.eye(len(size))
            step = -np.linalg.solve(scaled, gradient / size) / size
            try:
                other = model.with_parameters(start + knobs.turn @ (values + step))
                trial = _compared(other, edges, knobs, values + step, distance_mm)
            except OmnimirrorError:
                damping *= 10
                continue
            if trial.cost <= fit.cost:
                fit, values, damping = trial, values + step, max(damping / 5, 1e-9)
                break
            damping *= 10
        else:
            break
        if before - fit.cost <= SETTLED * before:
            break
    return fit


def normal_equations(fit: LinesFit, edges: Edges, knobs: Knobs, values: Array) -> tuple[Array, Array]:
    """Return matrix (q, q) and gradient (q,) of the weighted squares, including priors."""
    matrix = np.diag(knobs.information).astype(float)
    gradient = knobs.information * (values - knobs.prior)
    for part, weight in zip(edges.slices, fit.weights, strict=True):
        r, a = fit.residuals[part], fit.rates[part]
        seen = np.isfinite(r)
        matrix += weight * a[seen].T @ a[seen]
        gradient += weight * a[seen].T @ r[seen]
    return matrix, gradient


def gradients_left_out(fit: LinesFit, edges: Edges, matrix: Array) -> Array:
    """Return the gradients (chains, q) of each chain at the model fitted without it."""
    scale = np.sqrt(np.diag(matrix))
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale), hermitian=True)
    found = []
    for part, weight in zip(edges.slices, fit.weights, strict=True):
        rates = np.nan_to_num(fit.rates[part]) / scale
        own = weight * rates.T @ rates @ inverse
        gradient = weight * rates.T @ np.nan_to_num(fit.residuals[part])
        found.append(np.linalg.lstsq(np.eye(len(own)) - own, gradient, rcond=None)[0] * scale)
    return np.array(found)


def _compared(model: CameraModel, edges: Edges, knobs: Knobs, values: Array, distance_mm: float) -> LinesFit:
    """Evaluate all chains at once, with sums over each chain by reduction."""
    at = np.concatenate([np.arange(part.start, part.stop) for part in edges.slices])
    sizes = np.array([part.stop - part.start for part in edges.slices])
    owner, starts = np.repeat(np.arange(len(sizes)), sizes), np.concatenate([[0], np.cumsum(sizes)[:-1]])
    towards, to_angles, moved, seen = _seen(model, edges.pixels[at], distance_mm)
    enough = np.add.reduceat(seen.astype(int), starts) >= np.minimum(LEAST_POINTS, sizes)
    seen &= enough[owner]
    count = np.maximum(np.add.reduceat(seen.astype(int), starts), 1)
    e, j, change = (np.where(seen[(...,) + (None,) * (a.ndim - 1)], a, 0.0) for a in (towards, to_angles, moved))
    normal, slant = _planes(e, j, seen, owner, starts)
    r = np.einsum("ni,ni->n", e, normal[owner]) / slant
    by_normal = np.einsum("ni,nik->nk", e, _across(normal)[owner]) / slant[:, None]  # by turns of n
    by_knobs = np.einsum("nip,ni->np", change, normal[owner]) @ knobs.turn / slant[:, None]
    inner = np.add.reduceat(by_normal[:, :, None] * by_normal[:, None, :], starts) + 1e-30 * np.eye(2)
    outer = np.add.reduceat(by_normal[:, :, None] * by_knobs[:, None, :], starts)
    by_knobs = by_knobs - np.einsum("nk,nkq->nq", by_normal, (np.linalg.pinv(inner, hermitian=True) @ outer)[owner])
    square = np.add.reduceat(r**2, starts) / count
    cost = float((sizes * np.where(enough, _loss(square), _loss(UNSEEN_PX**2))).sum())
    cost += float((knobs.information * (values - knobs.prior) ** 2).sum())
    residuals, rates = np.full(len(edges.pixels), np.nan), np.zeros((len(edges.pixels), len(knobs.names)))
    residuals[at], rates[at] = np.where(seen, r, np.nan), by_knobs
    normal[~enough] = np.nan
    return LinesFit(model, normal, residuals, rates, cost, np.where(enough, 1 / (1 + square / SCALE_PX**2), 0.0))


def _loss(square: Any) -> Any:
    """Return the robust loss of a chain's mean square, which saturates for curved chains."""
    return SCALE_PX**2 * np.log1p(square / SCALE_PX**2)


def _planes(e: Array, j: Array, seen: Mask, owner: NDArray[np.int64], starts: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return normals (chains, 3) of planes fitted to directions (n, 3) in pixels, and |J^T n| (n,).

    The unit of |J^T n| is radians per pixel.
    """
    weight = seen.astype(float)
    for _ in range(NORMAL_STEPS):
        moments = np.add.reduceat(weight[:, None, None] * e[:, :, None] * e[:, None, :], starts)
        normal = np.linalg.eigh(moments)[1][:, :, 0]
        slant = np.maximum(np.linalg.norm(np.einsum("nik,ni->nk", j, normal[owner]), axis=1), 1e-12)
        weight = seen / slant**2
    return normal, np.where(seen, slant, 1.0)


def _seen(model: CameraModel, pixels: Array, distance_mm: float) -> tuple[Array, Array, Array, Mask]:
    """Return directions (n, 3) of pixels in the camera frame and their derivatives.

    Derivatives are with respect to pixels (n, 3, 2) and parameters (n, 3, p). For a camera with
    several viewpoints, directions are those from the point nearest to all rays to points on the
    rays at the given distance.
    """
    rays = model.backproject(pixels)
    world = model.mount.rotation()
    directions, origins = turned(rays.directions, world), turned(rays.origins, world)
    towards, length = directions, np.ones(len(pixels))
    if np.isfinite(distance_mm):
        points = origins + distance_mm * directions
        towards = points - _crossing(origins[rays.valid], directions[rays.valid])
        length = np.linalg.norm(towards, axis=1)
        towards = towards / length[:, None]
        image = model.image(np.nan_to_num(points), distant=False)
    else:
        image = model.image(np.nan_to_num(directions, nan=1.0), distant=True)
    across = _across(towards)
    by_angle = image.d_points @ across * length[:, None, None]
    seen = rays.valid & image.valid & np.isfinite(image.d_parameters).all(axis=(1, 2))
    seen[seen] = np.abs(np.linalg.det(by_angle[seen])) > 0
    to_angles = np.full((len(pixels), 3, 2), np.nan)
    to_angles[seen] = across[seen] @ np.linalg.inv(by_angle[seen])
    return towards, to_angles, -to_angles @ image.d_parameters, seen


def _crossing(origins: Array, directions: Array) -> Array:
    """Return the point (3,) nearest to rays with origins (n, 3) and directions (n, 3)."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    point: Array = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, origins), rcond=None)[0]
    return point


def _across(directions: Array) -> Array:
    """Return two unit vectors (n, 3, 2) perpendicular to unit vectors (n, 3)."""
    helper = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=2)


def _rms(residuals: Array) -> float:
    kept = residuals[np.isfinite(residuals)]
    return float(np.sqrt((kept**2).mean())) if len(kept) >= min(LEAST_POINTS, len(residuals)) else np.inf
