"""Residuals of a bundle adjustment and their derivatives with respect to camera, poses and board
shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.typing import Array, Mask
from ...cameras.models.camera_model import CameraModel
from .observations import Observation, RigidTransform, Stack, stacked

# -- Board shape -----------------------------------------------------------------------------------
#
# A printed board is stretched slightly and bends and twists by 1 to 2 mm. With corners accurate to
# 0.1 px, this limits the calibration rather than the camera. Five parameters describe the shape.
# All are even under rotation by 180 deg, and therefore independent of the end at which a detector
# starts numbering. They are regularised: without evidence in the images, the board is flat.

STRETCH_SIGMA = 0.003  # typical relative stretch and shear of a print
BEND_SIGMA = 0.01  # typical deviation of corners from the plane, relative to 0.5 times the diagonal
SHAPE_NAMES = ("board_aspect", "board_shear", "board_bend_xx", "board_twist_xy", "board_bend_yy")
SHAPE_UNITS = ("1", "1", "mm", "mm", "mm")


@dataclass(frozen=True)
class BoardShape:
    """Deviation of a board from a flat one with square fields.

    Parameters
    ----------
    centre_mm : (2,)
        Centre of its corners.
    half_diagonal_mm
        Distance from the centre to the farthest corner.
    values : (5,)
        Aspect (relative excess of width over height), shear (radians), and deviations from the
        plane in mm at a distance of 0.5 times the diagonal from the centre: terms in x^2, x y
        (twist) and y^2.

    Examples
    --------
    >>> corners = np.array([[x, y, 0.0] for x in (-40.0, 40.0) for y in (-30.0, 30.0)])
    >>> shape = BoardShape.flat(corners).with_values([0.0, 0.0, 0.0, 2.0, 0.0])
    >>> shape.deformed(corners)[:, 2].round(2)  # twisted: two corners before the plane, two behind it
    array([ 1.92, -1.92, -1.92,  1.92])
    """

    centre_mm: tuple[float, float]
    half_diagonal_mm: float
    values: tuple[float, ...] = (0.0,) * 5

    @classmethod
    def flat(cls, points_mm: ArrayLike) -> BoardShape:
        """Return the nominal shape of a board with corners (n, 3)."""
        points = np.asarray(points_mm, dtype=float)[:, :2]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (low + high) / 2
        return cls((float(x), float(y)), float(np.hypot(*(high - low)) / 2))

    def with_values(self, values: ArrayLike) -> BoardShape:
        """Return the same board with other shape values (5,)."""
        return BoardShape(
            self.centre_mm, self.half_diagonal_mm, tuple(float(v) for v in np.asarray(values))
        )

    def is_flat_within(self, sigmas: Array) -> bool:
        """Return whether all values are zero within three standard deviations (5,)."""
        return bool(np.all(np.abs(self.values) <= 3 * sigmas))

    @property
    def sigmas(self) -> Array:
        """Typical sizes of the values (5,): standard deviations of their prior."""
        bend = BEND_SIGMA * self.half_diagonal_mm
        return np.array([STRETCH_SIGMA, STRETCH_SIGMA, bend, bend, bend])

    def derivatives(self, points_mm: Array) -> Array:
        """Return derivatives (n, 3, 5) of board points (n, 3) with respect to the values."""
        x, y = (points_mm[:, :2] - self.centre_mm).T
        u, v = x / self.half_diagonal_mm, y / self.half_diagonal_mm
        change = np.zeros((len(points_mm), 3, 5))
        change[:, 0, 0], change[:, 1, 0] = x / 2, -y / 2
        change[:, 0, 1], change[:, 1, 1] = y / 2, x / 2
        change[:, 2, 2], change[:, 2, 3], change[:, 2, 4] = u * u, 2 * u * v, v * v
        return change

    def deformed(self, points_mm: Array) -> Array:
        """Return the deformed positions of points (n, 3) of the flat board."""
        points: Array = points_mm + self.derivatives(points_mm) @ np.array(self.values)
        return points


# -- Residuals and derivatives ---------------------------------------------------------------------

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
    poses: tuple[RigidTransform, ...]
    shape: BoardShape | None
    line_positions_mm: Array
    """Positions (n,) of points along their lines, mm."""
    marks: Array
    """Offsets (2k,) of marks from the points of their planes along two axes, mm."""


class Linearised(NamedTuple):
    """Residuals of an estimate and their derivatives."""

    residuals: Array
    """Residuals (n, 2) px, image minus pixel; 0 for invisible points."""
    visible: Mask
    """Visibility (n,)."""
    d_shared: Array
    """Derivatives (n, 2, g) with respect to the parameters of model, board and marks, in order."""
    d_pose: Array
    """Derivatives (n, 2, 6) with respect to a rotation in radians and a translation in mm."""
    d_line_position: Array | None
    """Derivatives (n, 2) with respect to positions along lines."""


def linearise(estimate: Estimate, stack: Stack) -> Linearised:
    """Compute residuals and derivatives of an estimate."""
    rotations = np.array([m.rotation for m in estimate.poses])[stack.owner]
    shifts = np.array([m.translation_mm for m in estimate.poses])[stack.owner]
    rotated = np.einsum("nij,nj->ni", rotations, targets(estimate, stack))
    points = rotated + np.where(stack.distant[:, None], 0.0, shifts)
    pixels, visible, d_points, d_parameters = _images(estimate.model, points, stack.distant)
    residuals = pixels - stack.pixels
    d_shared = d_parameters
    if estimate.shape is not None:
        changes = estimate.shape.derivatives(stack.points)
        changes[~stack.shaped] = 0.0
        d_shared = np.concatenate([d_shared, (d_points @ rotations) @ changes], axis=2)
    if stack.marks is not None:
        d_shared = np.concatenate(
            [d_shared, (d_points @ rotations) @ stack.marks.derivatives()], axis=2
        )
    d_pose = np.empty((len(points), 2, 6))
    # d(turn x X) = -[X]x turn: a row g of d_points becomes X x g
    (x, y, z), (gx, gy, gz) = rotated.T[..., None], np.moveaxis(d_points, 2, 0)
    d_pose[..., 0], d_pose[..., 1], d_pose[..., 2] = (
        y * gz - z * gy,
        z * gx - x * gz,
        x * gy - y * gx,
    )
    d_pose[..., 3:] = np.where(stack.distant[:, None, None], 0.0, d_points)
    d_line_position = None
    if stack.along is not None:
        d_line_position = np.einsum("nki,nij,nj->nk", d_points, rotations, stack.along)
    residuals[~visible] = 0.0
    return Linearised(residuals, visible, d_shared, d_pose, d_line_position)


def residuals_at_poses(model: CameraModel, observations: Sequence[Observation]) -> Linearised:
    """Compute residuals of points and directions at their current poses, without a board shape."""
    stack = stacked(observations)
    poses = tuple(s.pose or RigidTransform.identity() for s in observations)
    return linearise(Estimate(model, poses, None, np.zeros(len(stack.pixels)), np.zeros(0)), stack)


def targets(estimate: Estimate, stack: Stack) -> Array:
    """Return points (n, 3) in target frames, with board shape, lines and planes applied."""
    points = stack.points
    if estimate.shape is not None:
        points = np.where(stack.shaped[:, None], estimate.shape.deformed(points), points)
    if stack.along is not None:
        points = points + estimate.line_positions_mm[:, None] * stack.along
    if stack.marks is not None:
        points = points + stack.marks.derivatives() @ estimate.marks
    return points


def eliminate_line_positions(linearised: Linearised) -> Linearised:
    """Project out positions along lines: residuals remain perpendicular to the image of the line."""
    if linearised.d_line_position is None:
        return linearised
    length = np.sum(linearised.d_line_position**2, axis=1)
    along = linearised.d_line_position / np.sqrt(np.where(length > 0, length, 1.0))[:, None]
    across = np.eye(2) - along[:, :, None] * along[:, None, :]
    return linearised._replace(
        residuals=np.einsum("nij,nj->ni", across, linearised.residuals),
        d_shared=across @ linearised.d_shared,
        d_pose=across @ linearised.d_pose,
    )


def slide_steps(linearised: Linearised, stack: Stack, shared: Array, poses: Array) -> Array:
    """Return steps (n,) along lines for steps of the shared parameters (g,) and poses (m, 6)."""
    assert linearised.d_line_position is not None
    e = (
        linearised.residuals
        + linearised.d_shared @ shared
        + np.einsum("nki,ni->nk", linearised.d_pose, poses[stack.owner])
    )
    length = np.sum(linearised.d_line_position**2, axis=1)
    return np.asarray(
        -np.sum(linearised.d_line_position * e, axis=1) / np.where(length > 0, length, np.inf)
    )


def _images(model: CameraModel, points: Array, distant: Mask) -> tuple[Array, Mask, Array, Array]:
    """Return pixels, validity and derivatives of near and distant points; 0 where invalid."""
    if distant.all() or not distant.any():
        image = model.image_clamped(points, distant=bool(distant.any()))
        visible = image.valid
        if visible.all():
            return image.pixels, visible, image.d_points, image.d_parameters
        d_points, d_parameters = (
            np.where(visible[:, None, None], part, 0.0)
            for part in (image.d_points, image.d_parameters)
        )
        return np.where(visible[:, None], image.pixels, 0.0), visible, d_points, d_parameters
    masks: Sequence[Mask] = (~distant, distant)
    near, far = (_images(model, points[part], distant[part]) for part in masks)
    joined = []
    for a, b in zip(near, far, strict=True):
        combined = np.empty((len(points), *a.shape[1:]), dtype=a.dtype)
        combined[masks[0]], combined[masks[1]] = a, b
        joined.append(combined)
    return joined[0], joined[1], joined[2], joined[3]
