"""Least-squares fit of another camera model to the projection of a camera over its field."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...base.typing import Array
from ...cameras.models import CameraModel, Image, OCam
from .sampling import Sample

MOST_STEPS = 80
CLOSE = 1e-10  # relative decrease of the sum of squares that ends the iteration
EXACT_PX = 1e-6  # rms error that ends the iteration
GIVE_UP = 1e12  # maximum damping


class Cost(NamedTuple):
    """Reprojection error of a fitted model for points at one distance."""

    distance_mm: float
    """Distance from the camera's origin; infinite for distant points."""
    rms_px: float
    largest_px: float
    at_px: tuple[float, float]
    """Pixel of the maximum error."""
    at_deg: float
    """Field angle there, deg from the axis."""


@dataclass(frozen=True)
class Fitted:
    """Fitted model, with its viewpoint in the camera frame of the original camera, mm."""

    model: CameraModel
    viewpoint_mm: Array


def fit(start: CameraModel, sample: Sample, free: list[bool], distances_mm: tuple[float, ...]) -> Fitted:
    """Fit a model's parameters to the pixels of a sample for points at several distances.

    Levenberg-Marquardt iteration with the analytic derivatives of the model. For a camera without a
    single viewpoint, the viewpoint of the model is also estimated.

    Parameters
    ----------
    start
        Initial value.
    sample
        Pixels and rays of the camera.
    free
        Mask of free parameters of ``start``.
    distances_mm
        Distances with equal weights; irrelevant for a central camera.
    """
    step = _Problem(start, sample, np.flatnonzero(free), distances_mm)
    x = np.zeros(step.count)
    square, gradient, hessian = step.evaluate(x)
    damping = 1e-3
    for _ in range(MOST_STEPS):
        scale = np.maximum(np.diag(hessian), 1e-12 * np.diag(hessian).max())
        while damping < GIVE_UP:
            move = np.linalg.lstsq(hessian + damping * np.diag(scale), -gradient, rcond=None)[0]
            tried = step.evaluate(x + move)
            if tried[0] <= square:
                break
            damping *= 5
        else:
            break
        gain = square - tried[0]
        x, (square, gradient, hessian), damping = x + move, tried, max(damping / 10, 1e-15)
        if gain <= CLOSE * square or square <= EXACT_PX**2 * len(sample.pixels):
            break
    return step.at(x)


class _Problem:
    """Sum of squares of a fit, in units of typical parameter changes.

    The free parameters are followed by the viewpoint for a non-central camera, and by a rotation
    about the axis for models without such a parameter (OCamCalib's e, which calibration assigns to
    the camera pose). Formats without the affine matrix have no rotation.
    """

    def __init__(self, start: CameraModel, sample: Sample, free: NDArray[np.intp], far: tuple[float, ...]) -> None:
        self.start, self.sample, self.free = start, sample, free
        self.values = np.array([p.value for p in start.parameters])
        self.scale = np.array([p.scale for p in start.parameters])
        self.distances = (np.inf,) if sample.is_central else far
        self.moves = not sample.is_central and bool(np.isfinite(far).any())
        self.turns = isinstance(start, OCam) and "d" in {start.parameters[i].name for i in free}
        self.first = sample.origins.mean(axis=0) if self.moves else np.zeros(3)
        self.count = len(free) + 3 * self.moves + self.turns

    def at(self, x: Array) -> Fitted:
        """Return the model after a step."""
        p = len(self.free)
        values = self.values.copy()
        values[self.free] += self.scale[self.free] * x[:p]
        model = self.start.with_parameters(values)
        if self.turns:
            assert isinstance(model, OCam)
            model = replace(model, affine=_turned(model.affine, float(x[-1])))
        return Fitted(model, self.first + (x[p : p + 3] if self.moves else 0.0))

    def evaluate(self, x: Array) -> tuple[float, Array, Array]:
        """Return sum of squares, gradient and Hessian; an infinite sum for invalid cameras."""
        bad = np.inf, np.zeros(self.count), np.eye(self.count)
        try:
            model, viewpoint = (found := self.at(x)).model, found.viewpoint_mm
        except OmnimirrorError:
            return bad
        total, gradient, hessian = 0.0, np.zeros(self.count), np.zeros((self.count, self.count))
        for distance in self.distances:
            distant = bool(np.isinf(distance))
            points = self.sample.points(distance) - (0.0 if distant else viewpoint)
            image = model.image(points, distant=distant)
            if not image.valid.all():
                return bad
            residual = (image.pixels - self.sample.pixels).reshape(-1)
            slopes = self._slopes(image, points, distant)
            total += float(residual @ residual)
            gradient += slopes.T @ residual
            hessian += slopes.T @ slopes
        return total, gradient, hessian

    def _slopes(self, image: Image, points: Array, distant: bool) -> Array:
        """Return the derivatives (2 n, count) of the pixels."""
        n, p = len(points), len(self.free)
        slopes = np.zeros((n, 2, self.count))
        slopes[:, :, :p] = image.d_parameters[:, :, self.free] * self.scale[self.free]
        if self.moves and not distant:
            slopes[:, :, p : p + 3] = -image.d_points
        if self.turns:
            signs = self.sample.signs
            x, y, _ = (points * signs).T
            slopes[:, :, -1] = image.d_points[:, :, 0] * (-y * signs[0])[:, None] + image.d_points[:, :, 1] * x[:, None]
        return slopes.reshape(2 * n, self.count)


def _turned(affine: tuple[float, float, float], angle: float) -> tuple[float, float, float]:
    """Return OCamCalib's c, d, e after a prior image rotation (radians), up to scale."""
    c, d, e = affine
    cos, sin = np.cos(angle), np.sin(angle)
    (a, upper), (lower, last) = np.array([[1.0, e], [d, c]]) @ [[cos, -sin], [sin, cos]]
    return float(last / a), float(lower / a), float(upper / a)


def cost(found: Fitted, sample: Sample, distance_mm: float) -> Cost:
    """Return the reprojection error of a model at a distance; infinite for invisible points."""
    distant = bool(np.isinf(distance_mm))
    points = sample.points(distance_mm)
    image = found.model.image(points if distant else points - found.viewpoint_mm, distant=distant)
    error = np.where(image.valid, np.hypot(*(image.pixels - sample.pixels).T), np.inf)
    return _cost_of(error, sample, distance_mm)


def nearest_point(origins: Array, directions: Array) -> Array:
    """Return the point (3,) with the minimum sum of squared distances from rays (n, 3).

    It is the viewpoint of a panorama.

    >>> nearest_point(np.array([[1.0, 0, 0], [0, 2.0, 0]]), np.array([[1.0, 0, 0], [0, 1.0, 0]])).round(12)
    array([0., 0., 0.])
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, origins))


def parallax(sample: Sample, viewpoint_mm: Array, distance_mm: float, pixels_per_degree: float) -> Cost:
    """Return the parallax error of near points in a panorama with the directions of distant points."""
    towards = sample.points(distance_mm) - (0.0 if np.isinf(distance_mm) else viewpoint_mm)
    across = np.linalg.norm(np.cross(towards, sample.directions), axis=1)
    angle = np.arctan2(across, np.sum(towards * sample.directions, axis=1))
    error = np.degrees(angle) * pixels_per_degree
    return _cost_of(error, sample, distance_mm)


def _cost_of(error: Array, sample: Sample, distance_mm: float) -> Cost:
    """Return the summary of errors (n,) px."""
    worst = int(np.argmax(error))
    u, v = sample.pixels[worst]
    return Cost(
        distance_mm, float(np.sqrt(np.mean(error**2))), float(error[worst]), (float(u), float(v)),
        float(np.degrees(sample.omega[worst])),
    )  # fmt: skip
