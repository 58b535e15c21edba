"""Residuals of an estimate and their derivatives with respect to camera, poses and shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....base.typing import Array, Mask
from ....cameras.models.base import CameraModel
from .board_shape import BoardShape
from .observations import Motion, Sighting, Stack, stacked

UNSEEN_PX = 1e3
"""Residual of a point outside the model's field."""


@dataclass(frozen=True)
class Loss:
    """Loss function: squares, or a robust loss that downweights residuals far above the noise.

    Parameters
    ----------
    kind
        ``"squares"``, ``"huber"`` or ``"cauchy"``.
    scale_px
        Residual above which the weight decreases.
    """

    kind: str = "squares"
    scale_px: float = 1.0

    def weights(self, residuals: Array) -> Array:
        """Return the weights (n,) of squared residuals (n, 2) in reweighted least squares."""
        r = np.hypot(*residuals.T) / self.scale_px
        if self.kind == "cauchy":
            return np.asarray(1 / (1 + r * r))
        if self.kind == "huber":
            return np.asarray(1 / np.maximum(1.0, r))
        return np.ones(len(residuals))

    def sum(self, residuals: Array) -> float:
        """Return the loss that an adjustment minimises; for squares, the sum in px^2."""
        s = self.scale_px**2
        q = np.sum(residuals * residuals, axis=1) / s
        if self.kind == "cauchy":
            q = np.log1p(q)
        elif self.kind == "huber":
            q = np.where(q > 1, 2 * np.sqrt(q) - 1, q)
        return float(s * q.sum())


class Estimate(NamedTuple):
    """Estimated quantities."""

    model: CameraModel
    motions: tuple[Motion, ...]
    shape: BoardShape | None
    slides: Array
    """Positions (n,) of points along their lines, mm."""
    marks: Array
    """Offsets (2k,) of marks from the points of their planes along two axes, mm."""


class Linearised(NamedTuple):
    """Residuals of an estimate and their derivatives."""

    residuals: Array
    """Residuals (n, 2) px, image minus pixel; 0 for invisible points."""
    seen: Mask
    """Visibility (n,)."""
    d_shared: Array
    """Derivatives (n, 2, g) with respect to the parameters of model, board and marks, in order."""
    d_motion: Array
    """Derivatives (n, 2, 6) with respect to a rotation in radians and a translation in mm."""
    d_slide: Array | None
    """Derivatives (n, 2) with respect to positions along lines."""


def linearised(estimate: Estimate, stack: Stack) -> Linearised:
    """Compute residuals and derivatives of an estimate."""
    rotations = np.array([m.rotation for m in estimate.motions])[stack.owner]
    shifts = np.array([m.shift_mm for m in estimate.motions])[stack.owner]
    turned = np.einsum("nij,nj->ni", rotations, targets(estimate, stack))
    points = turned + np.where(stack.distant[:, None], 0.0, shifts)
    pixels, seen, d_points, d_parameters = _images(estimate.model, points, stack.distant)
    residuals = pixels - stack.pixels
    d_shared = d_parameters
    if estimate.shape is not None:
        changes = estimate.shape.changes(stack.points)
        changes[~stack.shaped] = 0.0
        d_shared = np.concatenate([d_shared, (d_points @ rotations) @ changes], axis=2)
    if stack.marks is not None:
        d_shared = np.concatenate([d_shared, (d_points @ rotations) @ stack.marks.changes()], axis=2)
    d_motion = np.empty((len(points), 2, 6))
    # d(turn x X) = -[X]x turn: a row g of d_points becomes X x g
    (x, y, z), (gx, gy, gz) = turned.T[..., None], np.moveaxis(d_points, 2, 0)
    d_motion[..., 0], d_motion[..., 1], d_motion[..., 2] = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    d_motion[..., 3:] = np.where(stack.distant[:, None, None], 0.0, d_points)
    d_slide = None
    if stack.along is not None:
        d_slide = np.einsum("nki,nij,nj->nk", d_points, rotations, stack.along)
    residuals[~seen] = 0.0
    return Linearised(residuals, seen, d_shared, d_motion, d_slide)


def as_placed(model: CameraModel, sightings: Sequence[Sighting]) -> Linearised:
    """Compute residuals of points and directions at their current poses, without a board shape."""
    stack = stacked(sightings)
    motions = tuple(s.motion or Motion.none() for s in sightings)
    return linearised(Estimate(model, motions, None, np.zeros(len(stack.pixels)), np.zeros(0)), stack)


def targets(estimate: Estimate, stack: Stack) -> Array:
    """Return points (n, 3) in target frames, with board shape, lines and planes applied."""
    points = stack.points
    if estimate.shape is not None:
        points = np.where(stack.shaped[:, None], estimate.shape.applied(points), points)
    if stack.along is not None:
        points = points + estimate.slides[:, None] * stack.along
    if stack.marks is not None:
        points = points + stack.marks.changes() @ estimate.marks
    return points


def without_slides(found: Linearised) -> Linearised:
    """Project out positions along lines: residuals remain perpendicular to the image of the line."""
    if found.d_slide is None:
        return found
    length = np.sum(found.d_slide**2, axis=1)
    along = found.d_slide / np.sqrt(np.where(length > 0, length, 1.0))[:, None]
    across = np.eye(2) - along[:, :, None] * along[:, None, :]
    return found._replace(
        residuals=np.einsum("nij,nj->ni", across, found.residuals),
        d_shared=across @ found.d_shared,
        d_motion=across @ found.d_motion,
    )


def slid(found: Linearised, stack: Stack, shared: Array, motions: Array) -> Array:
    """Return steps (n,) along lines for steps of the shared parameters (g,) and poses (m, 6)."""
    assert found.d_slide is not None
    e = found.residuals + found.d_shared @ shared + np.einsum("nki,ni->nk", found.d_motion, motions[stack.owner])
    length = np.sum(found.d_slide**2, axis=1)
    return np.asarray(-np.sum(found.d_slide * e, axis=1) / np.where(length > 0, length, np.inf))


def _images(model: CameraModel, points: Array, distant: Mask) -> tuple[Array, Mask, Array, Array]:
    """Return pixels, validity and derivatives of near and distant points; 0 where invalid."""
    if distant.all() or not distant.any():
        image = model.image_to_the_end(points, distant=bool(distant.any()))
        seen = image.valid
        if seen.all():
            return image.pixels, seen, image.d_points, image.d_parameters
        d_points, d_parameters = (
            np.where(seen[:, None, None], part, 0.0) for part in (image.d_points, image.d_parameters)
        )
        return np.where(seen[:, None], image.pixels, 0.0), seen, d_points, d_parameters
    both: Sequence[Mask] = (~distant, distant)
    near, far = (_images(model, points[part], distant[part]) for part in both)
    joined = []
    for a, b in zip(near, far, strict=True):
        whole = np.empty((len(points), *a.shape[1:]), dtype=a.dtype)
        whole[both[0]], whole[both[1]] = a, b
        joined.append(whole)
    return joined[0], joined[1], joined[2], joined[3]
