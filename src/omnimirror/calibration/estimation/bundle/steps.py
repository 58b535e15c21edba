"""Levenberg-Marquardt steps with geodesic acceleration.

Focal length and distortion are correlated: the sum of squares has a long, narrow and curved
valley, which straight steps leave. Geodesic acceleration (Transtrum and Sethna, "Geodesic
acceleration", 2012) follows it with the second derivative of the residuals along the step, at
the cost of one more solution of the same equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....base.errors import OmnimirrorError
from ....base.typing import Array, Mask
from .edges import Knowledge
from .linearisation import UNSEEN_PX, Estimate, Linearised, Loss, linearised, slid, without_slides
from .normal_equations import Blocks, assembled, solved, with_priors
from .observations import Stack, moved

SETTLED = 1e-7  # relative decrease that ends the iteration
MOST_DAMPING, LEAST_DAMPING = 1e12, 1e-10
STIFFNESS = 1e-6  # undetermined parameters move by less than their scale in a step
LEAST_NOISE_PX = 1e-6
PROBE = 0.1  # fraction of the step used to measure the second derivative
STRAIGHT_STEPS = 4  # number of steps before acceleration
MOST_BEND = 0.75  # maximum acceleration relative to the step
STOPPED = 1e12  # multiple of the diagonal that is added for held parameters


@dataclass(frozen=True)
class Question:
    """Definition of an adjustment problem.

    Names are those of the parameters of the model and of the board shape.
    """

    stack: Stack
    moving: Mask
    free: Mask
    """Mask (g,) of free shared parameters."""
    information: Array
    """Information (g,) of their priors, 1 / sigma^2."""
    expected: Array
    """Expected values (g,) of their priors."""
    loss: Loss
    noise_px: float
    """Noise of a coordinate, which weights the priors."""
    edges: Knowledge | None = None
    """Information from straight edges on the model parameters."""

    @property
    def has_priors(self) -> bool:
        """True if there are priors on shared parameters, or edges."""
        return self.edges is not None or bool(self.information.any())

    def prior(self, values: Array) -> Foreknowledge:
        """Return the prior information on free shared parameters at values (g,)."""
        information, off = np.diag(self.information * self.free), (values - self.expected) * self.free
        pull = information @ off
        cost = float(off @ pull)
        if self.edges is not None:
            count = len(self.edges.expected)
            of_edges = values[:count] - self.edges.expected
            information[:count, :count] += self.edges.information
            pull[:count] += self.edges.information @ of_edges
            cost += float(of_edges @ self.edges.information @ of_edges)
        return Foreknowledge(information[np.ix_(self.free, self.free)], pull[self.free], cost)


class Foreknowledge(NamedTuple):
    """Prior information on the f free shared parameters."""

    information: Array
    """Information matrix (f, f)."""
    pull: Array
    """Information times deviation (f,)."""
    cost: float
    """Squared deviation in standard deviations."""


class Step(NamedTuple):
    """Change of all unknowns."""

    shared: Array
    """Shared parameters (g,), 0 if fixed."""
    motions: Array
    """Poses (m, 6)."""

    def times(self, factor: float) -> Step:
        """Return the step multiplied by a factor."""
        return Step(factor * self.shared, factor * self.motions)


def shared_values(estimate: Estimate) -> Array:
    """Return the shared parameters (g,): model, board shape and mark positions."""
    values = [p.value for p in estimate.model.parameters]
    return np.array([*values, *(estimate.shape.values if estimate.shape else ()), *estimate.marks])


def least(
    estimate: Estimate,
    question: Question,
    most_steps: int,
    settled: float = SETTLED,
    on_step: Callable[[float], None] | None = None,
) -> Estimate:
    """Minimise the sum, starting from an estimate."""
    raw = linearised(estimate, question.stack)
    cost, damping = _cost(estimate, raw, question), 1e-3
    for number in range(most_steps):
        blocks = _blocks(estimate, without_slides(raw), question)
        before, growth = cost, 2.0
        while damping < MOST_DAMPING:
            trial = _tried(estimate, raw, blocks, question, damping, number >= STRAIGHT_STEPS)
            if trial is not None:
                found = linearised(trial, question.stack)
                trial_cost = _cost(trial, found, question)
                if trial_cost <= cost:
                    estimate, raw, cost, damping = trial, found, trial_cost, max(damping / 5, LEAST_DAMPING)
                    break
            damping, growth = damping * growth, growth * 2
        else:
            return estimate
        if on_step is not None:
            on_step(cost)
        if before - cost <= settled * before or cost < LEAST_NOISE_PX**2 * len(raw.seen):
            return estimate
    return estimate


def _cost(estimate: Estimate, found: Linearised, question: Question) -> float:
    unseen = UNSEEN_PX**2 * int((~found.seen).sum())  # full penalty: points must be visible
    known = question.noise_px**2 * question.prior(shared_values(estimate)).cost
    total = question.loss.sum(found.residuals) + unseen + known
    return total if np.isfinite(total) else np.inf


def _blocks(estimate: Estimate, found: Linearised, question: Question) -> Blocks:
    weights = question.loss.weights(found.residuals) * found.seen
    blocks = assembled(
        question.stack, found.residuals, found.d_shared[:, :, question.free], found.d_motion, weights, question.moving
    )
    prior, scale = question.prior(shared_values(estimate)), question.noise_px**2
    return with_priors(blocks, scale * prior.information, scale * prior.pull)


def _tried(
    estimate: Estimate, raw: Linearised, blocks: Blocks, question: Question, damping: float, is_bent: bool
) -> Estimate | None:
    """Return the estimate after a step; None if the equations or the model do not permit it."""
    step = _solved(estimate, blocks, question, damping)
    if step is None:
        return None
    straight = _moved(estimate, raw, question, step)
    if straight is None:
        stopped = _stopped(estimate, step)
        step = _solved(estimate, blocks, question, damping, stopped) if stopped.any() else None
        return None if step is None else _moved(estimate, raw, question, step)
    bend = _bend(estimate, raw, blocks, question, damping, step) if is_bent and raw.d_slide is None else None
    if bend is None:
        return straight
    return _moved(estimate, raw, question, Step(step.shared + bend.shared / 2, step.motions + bend.motions / 2))


def _bend(
    estimate: Estimate, raw: Linearised, blocks: Blocks, question: Question, damping: float, step: Step
) -> Step | None:
    """Return the geodesic acceleration of a step; None if it is too large."""
    probe = _moved(estimate, raw, question, step.times(PROBE))
    if probe is None:
        return None
    found = linearised(probe, question.stack)
    along = raw.d_shared @ step.shared + np.einsum("nki,ni->nk", raw.d_motion, step.motions[question.stack.owner])
    second = 2 / PROBE * ((found.residuals - raw.residuals) / PROBE - along)
    both = found.seen & raw.seen
    weights = question.loss.weights(raw.residuals) * both
    bent = assembled(question.stack, second, raw.d_shared[:, :, question.free], raw.d_motion, weights, question.moving)
    right = blocks._replace(shared_gradient=bent.shared_gradient, motion_gradients=bent.motion_gradients)
    bend = _solved(estimate, right, question, damping)
    if bend is None or _length(bend, blocks, question) > MOST_BEND * _length(step, blocks, question):
        return None
    return bend


def _length(step: Step, blocks: Blocks, question: Question) -> float:
    """Return the length of a step, weighted by its effect on the residuals."""
    shared = step.shared[question.free] ** 2 @ np.diag(blocks.shared)
    return float(np.sqrt(shared + np.sum(step.motions**2 * np.einsum("mii->mi", blocks.motions))))


def _stopped(estimate: Estimate, step: Step) -> Mask:
    """Return the mask (g,) of model parameters at the boundary of their range."""
    values = np.array([p.value for p in estimate.model.parameters])
    stopped = np.zeros(len(step.shared), dtype=bool)
    for i in np.flatnonzero(step.shared[: len(values)]):
        trial = values.copy()
        trial[i] += step.shared[i]
        try:
            estimate.model.with_parameters(trial)
        except OmnimirrorError:
            stopped[i] = True
    return stopped


def _solved(
    estimate: Estimate, blocks: Blocks, question: Question, damping: float, stopped: Mask | None = None
) -> Step | None:
    """Return the step; stopped parameters are held."""
    scales = [*(p.scale for p in estimate.model.parameters), *(estimate.shape.sigmas if estimate.shape else ())]
    scales += [1.0] * len(estimate.marks)
    floor = (STIFFNESS * question.noise_px / np.array(scales)[question.free]) ** 2
    if stopped is not None:
        floor = np.where(stopped[question.free], STOPPED * np.diag(blocks.shared) + floor, floor)
    try:
        free, motions = solved(blocks, damping, floor)
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(free).all() and np.isfinite(motions).all()):
        return None
    shared = np.zeros(len(question.free))
    shared[question.free] = free
    return Step(shared, motions)


def _moved(estimate: Estimate, raw: Linearised, question: Question, step: Step) -> Estimate | None:
    """Return the estimate after a step; None if the values do not describe a camera."""
    values = shared_values(estimate) + step.shared
    count, last = len(estimate.model.parameters), len(values) - len(estimate.marks)
    try:
        model = estimate.model.with_parameters(values[:count])
    except OmnimirrorError:
        return None
    motions = moved(estimate.motions, np.where(question.moving[:, None], step.motions, 0.0))
    shape = estimate.shape and estimate.shape.with_values(values[count:last])
    slides = estimate.slides
    if raw.d_slide is not None:
        slides = slides + slid(raw, question.stack, step.shared, step.motions)
    return Estimate(model, motions, shape, slides, values[last:])
