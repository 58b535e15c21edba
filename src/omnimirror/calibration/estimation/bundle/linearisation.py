"""Residuals of an estimate and their derivatives: what a bundle adjustment is told of camera, motions and shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....cameras.models.base import CameraModel
from .board_shape import BoardShape
from .observations import Motion, Sighting, Stack, stacked

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNSEEN_PX = 1e3
"""Residual of a point that the model does not see at all."""


@dataclass(frozen=True)
class Loss:
    """How residuals count: as their squares, or less where they are far above the noise.

    Parameters
    ----------
    kind
        ``"squares"``, ``"huber"`` or ``"cauchy"``.
    scale_px
        Where residuals begin to count less.
    """

    kind: str = "squares"
    scale_px: float = 1.0

    def weights(self, residuals: Array) -> Array:
        """Of residuals (n, 2): (n,), by which their squares count in reweighted least squares."""
        r = np.hypot(*residuals.T) / self.scale_px
        if self.kind == "cauchy":
            return np.asarray(1 / (1 + r * r))
        if self.kind == "huber":
            return np.asarray(1 / np.maximum(1.0, r))
        return np.ones(len(residuals))

    def sum(self, residuals: Array) -> float:
        """What an adjustment makes least; with squares it is the sum of squares, px^2."""
        s = self.scale_px**2
        q = np.sum(residuals * residuals, axis=1) / s
        if self.kind == "cauchy":
            q = np.log1p(q)
        elif self.kind == "huber":
            q = np.where(q > 1, 2 * np.sqrt(q) - 1, q)
        return float(s * q.sum())


class Estimate(NamedTuple):
    """What is estimated."""

    model: CameraModel
    motions: tuple[Motion, ...]
    shape: BoardShape | None
    slides: Array
    """(n,) mm; how far along its line each point lies"""
    marks: Array
    """(2k,) mm; how far each mark lies from the point of its plane, along two axes"""


class Linearised(NamedTuple):
    """Residuals of an estimate and their derivatives."""

    residuals: Array
    """(n, 2) px, image minus pixel; 0 where the model sees nothing"""
    seen: Mask
    """(n,)"""
    d_shared: Array
    """(n, 2, g), the model's parameters, then the board's, then the marks'"""
    d_motion: Array
    """(n, 2, 6), a turn in radians and a shift in mm"""
    d_slide: Array | None
    """(n, 2)"""


def linearised(estimate: Estimate, stack: Stack) -> Linearised:
    """Residuals and derivatives of an estimate."""
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
    # d(turn x X) = -[X]x turn, so that a row g of d_points becomes X x g
    (x, y, z), (gx, gy, gz) = turned.T[..., None], np.moveaxis(d_points, 2, 0)
    d_motion[..., 0], d_motion[..., 1], d_motion[..., 2] = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    d_motion[..., 3:] = np.where(stack.distant[:, None, None], 0.0, d_points)
    d_slide = None
    if stack.along is not None:
        d_slide = np.einsum("nki,nij,nj->nk", d_points, rotations, stack.along)
    residuals[~seen] = 0.0
    return Linearised(residuals, seen, d_shared, d_motion, d_slide)


def as_placed(model: CameraModel, sightings: Sequence[Sighting]) -> Linearised:
    """Residuals of points and directions, without any board's shape, where sightings have their targets."""
    stack = stacked(sightings)
    motions = tuple(s.motion or Motion.none() for s in sightings)
    return linearised(Estimate(model, motions, None, np.zeros(len(stack.pixels)), np.zeros(0)), stack)


def targets(estimate: Estimate, stack: Stack) -> Array:
    """Points (n, 3) in the frames of their targets, with the board's shape, and where they lie on lines and planes."""
    points = stack.points
    if estimate.shape is not None:
        points = np.where(stack.shaped[:, None], estimate.shape.applied(points), points)
    if stack.along is not None:
        points = points + estimate.slides[:, None] * stack.along
    if stack.marks is not None:
        points = points + stack.marks.changes() @ estimate.marks
    return points


def without_slides(found: Linearised) -> Linearised:
    """What is left when every point of a line may slide along it: residuals across the image of the line alone."""
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
    """Steps (n,) along lines that go with steps of the shared parameters (g,) and the motions (m, 6)."""
    assert found.d_slide is not None
    e = found.residuals + found.d_shared @ shared + np.einsum("nki,ni->nk", found.d_motion, motions[stack.owner])
    length = np.sum(found.d_slide**2, axis=1)
    return np.asarray(-np.sum(found.d_slide * e, axis=1) / np.where(length > 0, length, np.inf))


def _images(model: CameraModel, points: Array, distant: Mask) -> tuple[Array, Mask, Array, Array]:
    """Pixels, where they are valid and their derivatives, 0 where they are not, of points near and far."""
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
