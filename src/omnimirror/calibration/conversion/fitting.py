"""A camera as another model says it: least squares over the field between the two pictures of the same points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import OmnimirrorError
from ...cameras.models import CameraModel, Image, OCam
from .sampling import Sample

Array = NDArray[np.float64]

MOST_STEPS = 80
CLOSE = 1e-10  # of the sum of squares, by which a step that is worth another makes it smaller
EXACT_PX = 1e-6  # off (rms), where nothing is left to be gained
GIVE_UP = 1e12  # damping at which no step helps any more


class Cost(NamedTuple):
    """How far the other model's picture of points at one distance lies from the camera's own."""

    distance_mm: float
    """From the camera's origin; infinite for distant things."""
    rms_px: float
    largest_px: float
    at_px: tuple[float, float]
    """The pixel where it is largest."""
    at_deg: float
    """The field angle there, deg from the axis."""


@dataclass(frozen=True)
class Fitted:
    """A model, and where its one viewpoint lies in the camera frame of the camera that it stands for, mm."""

    model: CameraModel
    viewpoint_mm: Array


def fit(start: CameraModel, sample: Sample, free: list[bool], distances_mm: tuple[float, ...]) -> Fitted:
    """Move a model's parameters until its pixels are those of the sample, for points at all of some distances.

    Levenberg and Marquardt with the model's own derivatives. Where the camera has no single viewpoint, the place of
    the model's is found too.

    Parameters
    ----------
    start
        Where to begin.
    sample
    free
        Which parameters of ``start`` may move.
    distances_mm
        Each counts as much as the others; of a central camera none matters.
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
    """The sum of squares of a fit, in steps of the parameters' typical changes.

    After the free parameters come the place of the viewpoint, where there is none in the camera, and a turn about the
    axis, where the model has no parameter for that: OCamCalib's e, which calibration leaves to the camera's pose. Of a
    file without its matrix nothing turns.
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
        """The model of a step."""
        p = len(self.free)
        values = self.values.copy()
        values[self.free] += self.scale[self.free] * x[:p]
        model = self.start.with_parameters(values)
        if self.turns:
            assert isinstance(model, OCam)
            model = replace(model, affine=_turned(model.affine, float(x[-1])))
        return Fitted(model, self.first + (x[p : p + 3] if self.moves else 0.0))

    def evaluate(self, x: Array) -> tuple[float, Array, Array]:
        """Sum of squares, its gradient and its approximate Hessian; an infinite sum where there is no such camera."""
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
        """Derivatives (2 n, count) of the pixels."""
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
    """OCamCalib's c, d and e of a picture turned by an angle (radians) before its matrix, but for a scale."""
    c, d, e = affine
    cos, sin = np.cos(angle), np.sin(angle)
    (a, upper), (lower, last) = np.array([[1.0, e], [d, c]]) @ [[cos, -sin], [sin, cos]]
    return float(last / a), float(lower / a), float(upper / a)


def cost(found: Fitted, sample: Sample, distance_mm: float) -> Cost:
    """How far a model's picture of points at a distance lies from the sample's pixels; infinite where it has none."""
    distant = bool(np.isinf(distance_mm))
    points = sample.points(distance_mm)
    image = found.model.image(points if distant else points - found.viewpoint_mm, distant=distant)
    error = np.where(image.valid, np.hypot(*(image.pixels - sample.pixels).T), np.inf)
    return _cost_of(error, sample, distance_mm)


def nearest_point(origins: Array, directions: Array) -> Array:
    """The place (3,) with the least sum of squared distances from rays (n, 3), which is where a panorama is from.

    >>> nearest_point(np.array([[1.0, 0, 0], [0, 2.0, 0]]), np.array([[1.0, 0, 0], [0, 1.0, 0]])).round(12)
    array([0., 0., 0.])
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, origins))


def parallax(sample: Sample, viewpoint_mm: Array, distance_mm: float, pixels_per_degree: float) -> Cost:
    """How far near points lie from where a panorama draws them, whose directions are those of distant ones."""
    towards = sample.points(distance_mm) - (0.0 if np.isinf(distance_mm) else viewpoint_mm)
    across = np.linalg.norm(np.cross(towards, sample.directions), axis=1)
    angle = np.arctan2(across, np.sum(towards * sample.directions, axis=1))
    error = np.degrees(angle) * pixels_per_degree
    return _cost_of(error, sample, distance_mm)


def _cost_of(error: Array, sample: Sample, distance_mm: float) -> Cost:
    """Errors (n,) px in a few numbers."""
    worst = int(np.argmax(error))
    u, v = sample.pixels[worst]
    return Cost(
        distance_mm, float(np.sqrt(np.mean(error**2))), float(error[worst]), (float(u), float(v)),
        float(np.degrees(sample.omega[worst])),
    )  # fmt: skip
