"""Levenberg and Marquardt's steps to the least sum of a bundle adjustment, bent along curved valleys.

Focal length, distortion and the like lie in a valley that is long, narrow and bent. A straight step leaves it at once;
with the second derivative along the step taken into account, one follows it (Transtrum and Sethna, "Geodesic
acceleration", 2012): the same equations are solved once more, for how the residuals bend.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.errors import OmnimirrorError
from .edges import Knowledge
from .linearisation import UNSEEN_PX, Estimate, Linearised, Loss, linearised, slid, without_slides
from .normal_equations import Blocks, assembled, solved, with_priors
from .observations import Stack, moved

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED = 1e-7  # relative; a step that gains less is the last
MOST_DAMPING, LEAST_DAMPING = 1e12, 1e-10
STIFFNESS = 1e-6  # what nothing determines moves less than its scale in a step, and what anything does freely
LEAST_NOISE_PX = 1e-6
PROBE = 0.1  # of a step, over which the bend of residuals is measured
STRAIGHT_STEPS = 4  # before bends are measured
MOST_BEND = 0.75  # of a step
STOPPED = 1e12  # times the diagonal is added for a parameter that is to stay


@dataclass(frozen=True)
class Question:
    """What an adjustment is asked; names are those of the model's parameters, and of the board's shape."""

    stack: Stack
    moving: Mask
    free: Mask
    """(g,) of the shared parameters"""
    information: Array
    """(g,) of their priors, 1 / sigma^2"""
    expected: Array
    """(g,) of their priors"""
    loss: Loss
    noise_px: float
    """of a coordinate; what priors are weighed with"""
    edges: Knowledge | None = None
    """what straight edges say of the model's parameters"""

    @property
    def has_priors(self) -> bool:
        """Whether anything is known of the shared parameters beforehand, or by edges."""
        return self.edges is not None or bool(self.information.any())

    def prior(self, values: Array) -> Foreknowledge:
        """What is known of the free ones among shared parameters (g,), where they are now."""
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
    """What is known of f free shared parameters besides what was seen."""

    information: Array
    """(f, f)"""
    pull: Array
    """(f,) the information times how far they are off"""
    cost: float
    """squares of how far they are off, in standard deviations"""


class Step(NamedTuple):
    """A change of everything."""

    shared: Array
    """(g,), 0 where fixed"""
    motions: Array
    """(m, 6)"""

    def times(self, factor: float) -> Step:
        """A part of it."""
        return Step(factor * self.shared, factor * self.motions)


def shared_values(estimate: Estimate) -> Array:
    """The model's parameters, the board's shape and where marks lie (g,)."""
    values = [p.value for p in estimate.model.parameters]
    return np.array([*values, *(estimate.shape.values if estimate.shape else ()), *estimate.marks])


def least(
    estimate: Estimate,
    question: Question,
    most_steps: int,
    settled: float = SETTLED,
    on_step: Callable[[float], None] | None = None,
) -> Estimate:
    """The estimate with the least sum, from another one."""
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
    unseen = UNSEEN_PX**2 * int((~found.seen).sum())  # whatever the loss: it was seen, so a camera has to see it
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
    """The estimate a step farther; None where the equations or the model do not allow it."""
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
    """How the step bends; None where that is too much to be trusted."""
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
    """Length of a step, each part against what moves the residuals."""
    shared = step.shared[question.free] ** 2 @ np.diag(blocks.shared)
    return float(np.sqrt(shared + np.sum(step.motions**2 * np.einsum("mii->mi", blocks.motions))))


def _stopped(estimate: Estimate, step: Step) -> Mask:
    """Parameters (g,) of the model that cannot go on alone, since they are at the end of their range."""
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
    """The step; parameters that are stopped stay where they are."""
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
    """The estimate after a step; None where the numbers describe no camera."""
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
