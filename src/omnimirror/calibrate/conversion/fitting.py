"""A camera as another model says it: least squares over the field between the two pictures of the same points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera_models import CameraModel
from ...errors import OmnimirrorError
from .sampling import Sample

Array = NDArray[np.float64]

MOST_STEPS = 200
CLOSE = 1e-13  # of the sum of squares, by which a step that is worth another makes it smaller
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
        if gain <= CLOSE * square:
            break
    return step.at(x)


class _Problem:
    """The sum of squares of a fit, in steps of the parameters' typical changes."""

    def __init__(
        self, start: CameraModel, sample: Sample, free: NDArray[np.intp], distances: tuple[float, ...]
    ) -> None:
        self.start, self.sample, self.free = start, sample, free
        self.values = np.array([p.value for p in start.parameters])
        self.scale = np.array([p.scale for p in start.parameters])
        finite = [d for d in distances if np.isfinite(d)]
        self.distances = (np.inf,) if sample.is_central else distances
        self.moves = not sample.is_central and bool(finite)
        self.first = sample.origins.mean(axis=0) if self.moves else np.zeros(3)
        self.count = len(free) + 3 * self.moves

    def at(self, x: Array) -> Fitted:
        """The model of a step."""
        values = self.values.copy()
        values[self.free] += self.scale[self.free] * x[: len(self.free)]
        shift = x[len(self.free) :] if self.moves else np.zeros(3)
        return Fitted(self.start.with_parameters(values), self.first + shift)

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
            points = self.sample.points(distance)
            image = model.image(points if distant else points - viewpoint, distant=distant)
            if not image.valid.all():
                return bad
            residual = (image.pixels - self.sample.pixels).reshape(-1)
            slopes = np.zeros((len(residual), self.count))
            p = len(self.free)
            slopes[:, :p] = image.d_parameters[:, :, self.free].reshape(len(residual), p) * self.scale[self.free]
            if self.moves and not distant:
                slopes[:, p:] = -image.d_points.reshape(len(residual), 3)
            total += float(residual @ residual)
            gradient += slopes.T @ residual
            hessian += slopes.T @ slopes
        return total, gradient, hessian


def cost(found: Fitted, sample: Sample, distance_mm: float) -> Cost:
    """How far a model's picture of points at a distance lies from the sample's pixels; infinite where it has none."""
    distant = bool(np.isinf(distance_mm))
    points = sample.points(distance_mm)
    image = found.model.image(points if distant else points - found.viewpoint_mm, distant=distant)
    error = np.where(image.valid, np.hypot(*(image.pixels - sample.pixels).T), np.inf)
    worst = int(np.argmax(error))
    u, v = sample.pixels[worst]
    return Cost(
        distance_mm, float(np.sqrt(np.mean(error**2))), float(error[worst]), (float(u), float(v)),
        float(np.degrees(sample.omega[worst])),
    )  # fmt: skip
