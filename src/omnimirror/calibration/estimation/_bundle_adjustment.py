"""Bundle adjustment: normal equations in sparse block form and Levenberg-Marquardt iteration."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import choice, validate_arguments
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.logs import OnProgress
from ...base.numerics import levenberg_marquardt
from ...base.results import Columns, Result, table_of
from ...base.typing import Array, Mask
from ...cameras.models.camera_model import CameraModel
from ..straight_edges import EdgeInformation, StraightEdges
from .observations import (
    SHAPE_NAMES,
    SHAPE_UNITS,
    UNSEEN_PX,
    BoardShape,
    Estimate,
    Linearised,
    Loss,
    Observation,
    Stack,
    eliminate_line_positions,
    linearise,
    moved,
    rms_px,
    slide_steps,
    stacked,
    targets,
)

LOGGER = logging.getLogger(__name__)

# -- Normal equations ------------------------------------------------------------------------------
#
# Shared parameters form one small dense block, and the six parameters of each pose a block of their
# own. Poses are eliminated image by image with the Schur complement, at a cost linear in the number
# of images (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6).

MAX_PRODUCTS = 1 << 16  # multiplications per product; OpenBLAS starts threads above
MIN_ROWS = 32  # minimum rows per product; for wide matrices threads pay off


class NormalEquations(NamedTuple):
    """Normal equations ``H d = -g`` with g shared parameters and m poses."""

    shared: Array
    """Shared block (g, g)."""
    cross: Array
    """Coupling blocks (m, g, 6)."""
    poses: Array
    """Pose blocks (m, 6, 6)."""
    shared_gradient: Array
    """Gradient of the shared parameters (g,)."""
    pose_gradients: Array
    """Gradients of the poses (m, 6)."""


def assembled(
    stack: Stack,
    residuals: Array,
    d_shared: Array,
    d_pose: Array,
    weights: Array,
    is_free_pose: NDArray[np.bool_],
) -> NormalEquations:
    """Assemble the normal equations.

    Inputs are residuals (n, 2), derivatives (n, 2, g) and (n, 2, 6), weights (n,), and a mask
    ``is_free_pose`` (m,) of free poses.
    """
    rows = np.concatenate([d_shared, d_pose, residuals[..., None]], axis=2)
    weighted = (rows * weights[:, None, None]).reshape(2 * len(weights), -1)
    rows = rows.reshape(weighted.shape)
    count, g = len(stack.slices), d_shared.shape[2]
    cross, blocks, gradients = (
        np.zeros((count, g, 6)),
        np.zeros((count, 6, 6)),
        np.zeros((count, 6)),
    )
    square, gradient = np.zeros((g, g)), np.zeros(g)
    for i, part in enumerate(stack.slices):
        part_rows = slice(2 * part.start, 2 * part.stop)
        product = _product(rows[part_rows], weighted[part_rows])
        square += product[:g, :g]
        gradient += product[:g, -1]
        if is_free_pose[i]:
            cross[i], blocks[i], gradients[i] = (
                product[:g, g:-1],
                product[g:-1, g:-1],
                product[g:-1, -1],
            )
        else:
            blocks[i] = np.eye(6)
    return NormalEquations(square, cross, blocks, gradient, gradients)


def _product(one: Array, other: Array) -> Array:
    """Return ``one.T @ other`` of rows (n, k), computed in chunks.

    BLAS starts threads even for small products, and they spin for longer than the product takes.
    For a matrix times itself the limit is lower still, so the weights are applied to one factor.
    """
    chunk = max(MAX_PRODUCTS // one.shape[1] ** 2, MIN_ROWS)
    total = np.zeros((one.shape[1], one.shape[1]))
    for first in range(0, len(one), chunk):
        total += one[first : first + chunk].T @ other[first : first + chunk]
    return total


def with_priors(blocks: NormalEquations, information: Array, pull: Array) -> NormalEquations:
    """Add priors on shared parameters: information (g, g), and information times deviations (g,)."""
    return blocks._replace(
        shared=blocks.shared + information, shared_gradient=blocks.shared_gradient + pull
    )


def solved(blocks: NormalEquations, damping: float, floor: Array) -> tuple[Array, Array]:
    """Solve for Marquardt's step: shared (g,) and poses (m, 6).

    ``floor`` (g,) is added to the diagonal independently of the damping.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations are singular.
    """
    poses = _damped(blocks.poses, damping)
    inverse_cross, inverse_gradient = _eliminate_poses(poses, blocks)
    # Schur complement: (A - B C^-1 B^T) d_s = -(g - B C^-1 h), then
    # d_p = -C^-1 h - C^-1 B^T d_s for each pose
    enlarged = blocks.shared + np.diag(damping * np.diag(blocks.shared) + floor)
    reduced = enlarged - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    right = blocks.shared_gradient - np.einsum("mgk,mk->g", blocks.cross, inverse_gradient)
    shared = -solved_scaled(reduced, right)
    return shared, -inverse_gradient - np.einsum("mkg,g->mk", inverse_cross, shared)


def reduced_system(blocks: NormalEquations) -> tuple[Array, Array]:
    """Return the reduced system for free poses: Schur complement (g, g) and gradient (g,)."""
    inverse_cross, inverse_gradient = _eliminate_poses(_damped(blocks.poses, 1e-12), blocks)
    reduced: Array = blocks.shared - np.einsum("mgk,mkh->gh", blocks.cross, inverse_cross)
    gradient: Array = blocks.shared_gradient - np.einsum(
        "mgk,mk->g", blocks.cross, inverse_gradient
    )
    return (reduced + reduced.T) / 2, gradient


def solved_scaled(matrix: Array, right: Array) -> Array:
    """Solve symmetric positive definite equations with diagonal scaling of the unknowns."""
    if not len(right):
        return np.zeros(0)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    lower = np.linalg.cholesky(matrix * scale[:, None] * scale)
    half = np.linalg.solve(lower, right * scale)
    return np.asarray(np.linalg.solve(lower.T, half) * scale)


def _damped(matrices: Array, damping: float) -> Array:
    """Return matrices (..., k, k) with enlarged diagonals; undetermined poses remain unchanged."""
    diagonal = np.einsum("...ii->...i", matrices)
    minimum = np.maximum(diagonal.max(axis=-1, initial=0.0, keepdims=True) * 1e-14, 1e-30)
    damped = matrices.copy()
    np.einsum("...ii->...i", damped)[...] += damping * diagonal + np.where(
        diagonal <= minimum, minimum, 0.0
    )
    return damped


def _eliminate_poses(poses: Array, blocks: NormalEquations) -> tuple[Array, Array]:
    """Return ``C^-1 B^T`` (m, 6, g) and ``C^-1 h`` (m, 6), with rows scaled for radians and mm."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("mii->mi", poses), 1e-300))
    scaled = poses * scale[:, :, None] * scale[:, None, :]
    right = np.concatenate(
        [blocks.cross.transpose(0, 2, 1), blocks.pose_gradients[..., None]], axis=2
    )
    solution = np.linalg.solve(scaled, right * scale[..., None]) * scale[..., None]
    return solution[..., :-1], solution[..., -1]


# -- Levenberg-Marquardt steps with geodesic acceleration ------------------------------------------
#
# Focal length and distortion are correlated: the sum of squares has a long, narrow and curved
# valley, which straight steps leave. Geodesic acceleration (Transtrum and Sethna, "Geodesic
# acceleration", 2012) follows it with the second derivative of the residuals along the step, at
# the cost of one more solution of the same equations.

RELATIVE_TOLERANCE = 1e-7  # relative decrease that ends the iteration
STIFFNESS = 1e-6  # undetermined parameters move by less than their scale in a step
MIN_NOISE_PX = 1e-6
PROBE = 0.1  # fraction of the step used to measure the second derivative
STRAIGHT_STEPS = 4  # number of steps before acceleration
MAX_ACCELERATION = 0.75  # maximum acceleration relative to the step
HELD_DAMPING = 1e12  # multiple of the diagonal that is added for held parameters


@dataclass(frozen=True)
class AdjustmentProblem:
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
    edges: EdgeInformation | None = None
    """Information from straight edges on the model parameters."""

    @property
    def has_priors(self) -> bool:
        """True if there are priors on shared parameters, or edges."""
        return self.edges is not None or bool(self.information.any())

    def prior(self, values: Array) -> PriorInformation:
        """Return the prior information on free shared parameters at values (g,)."""
        information, deviation = (
            np.diag(self.information * self.free),
            (values - self.expected) * self.free,
        )
        pull = information @ deviation
        cost = float(deviation @ pull)
        if self.edges is not None:
            count = len(self.edges.expected)
            edge_deviation = values[:count] - self.edges.expected
            information[:count, :count] += self.edges.information
            pull[:count] += self.edges.information @ edge_deviation
            cost += float(edge_deviation @ self.edges.information @ edge_deviation)
        return PriorInformation(information[np.ix_(self.free, self.free)], pull[self.free], cost)


class PriorInformation(NamedTuple):
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
    poses: Array
    """Poses (m, 6)."""

    def times(self, factor: float) -> Step:
        """Return the step multiplied by a factor."""
        return Step(factor * self.shared, factor * self.poses)


def shared_values(estimate: Estimate) -> Array:
    """Return the shared parameters (g,): model, board shape and mark positions."""
    values = [p.value for p in estimate.model.parameters]
    return np.array([*values, *(estimate.shape.values if estimate.shape else ()), *estimate.marks])


def minimise(
    estimate: Estimate,
    problem: AdjustmentProblem,
    max_steps: int,
    relative_tolerance: float = RELATIVE_TOLERANCE,
    on_step: Callable[[float], None] | None = None,
) -> Estimate:
    """Minimise the sum, starting from an estimate."""
    linearised = linearise(estimate, problem.stack)

    def steps_from(state: _AdjustmentState) -> Callable[[float], _AdjustmentState | None]:
        estimate, linearised, _, number = state
        blocks = _blocks(estimate, eliminate_line_positions(linearised), problem)

        def after_step(damping: float) -> _AdjustmentState | None:
            trial = _trial_step(
                estimate, linearised, blocks, problem, damping, number >= STRAIGHT_STEPS
            )
            if trial is None:
                return None
            residuals = linearise(trial, problem.stack)
            return _AdjustmentState(trial, residuals, _cost(trial, residuals, problem), number + 1)

        return after_step

    return levenberg_marquardt(
        _AdjustmentState(estimate, linearised, _cost(estimate, linearised, problem), 0),
        steps_from,
        max_steps,
        relative_tolerance,
        MIN_NOISE_PX**2 * len(linearised.visible),
        on_step,
    ).estimate


class _AdjustmentState(NamedTuple):
    """Estimate with its residuals, the minimised sum and the number of steps before it."""

    estimate: Estimate
    linearised: Linearised
    cost: float
    number: int


def _cost(estimate: Estimate, linearised: Linearised, problem: AdjustmentProblem) -> float:
    penalty = UNSEEN_PX**2 * int(
        (~linearised.visible).sum()
    )  # full penalty: points must be visible
    prior_cost = problem.noise_px**2 * problem.prior(shared_values(estimate)).cost
    total = problem.loss.sum(linearised.residuals) + penalty + prior_cost
    return total if np.isfinite(total) else np.inf


def _blocks(
    estimate: Estimate, linearised: Linearised, problem: AdjustmentProblem
) -> NormalEquations:
    weights = problem.loss.weights(linearised.residuals) * linearised.visible
    blocks = assembled(
        problem.stack,
        linearised.residuals,
        linearised.d_shared[:, :, problem.free],
        linearised.d_pose,
        weights,
        problem.moving,
    )
    prior, scale = problem.prior(shared_values(estimate)), problem.noise_px**2
    return with_priors(blocks, scale * prior.information, scale * prior.pull)


def _trial_step(
    estimate: Estimate,
    linearised: Linearised,
    blocks: NormalEquations,
    problem: AdjustmentProblem,
    damping: float,
    with_acceleration: bool,
) -> Estimate | None:
    """Return the estimate after a step; None if the equations or the model do not permit it."""
    step = _marquardt_step(estimate, blocks, problem, damping)
    if step is None:
        return None
    stepped = _after_step(estimate, linearised, problem, step)
    if stepped is None:
        at_boundary = _parameters_at_boundary(estimate, step)
        step = (
            _marquardt_step(estimate, blocks, problem, damping, at_boundary)
            if at_boundary.any()
            else None
        )
        return None if step is None else _after_step(estimate, linearised, problem, step)
    acceleration = (
        _acceleration(estimate, linearised, blocks, problem, damping, step)
        if with_acceleration and linearised.d_line_position is None
        else None
    )
    if acceleration is None:
        return stepped
    return _after_step(
        estimate,
        linearised,
        problem,
        Step(step.shared + acceleration.shared / 2, step.poses + acceleration.poses / 2),
    )


def _acceleration(
    estimate: Estimate,
    linearised: Linearised,
    blocks: NormalEquations,
    problem: AdjustmentProblem,
    damping: float,
    step: Step,
) -> Step | None:
    """Return the geodesic acceleration of a step; None if it is too large."""
    probe = _after_step(estimate, linearised, problem, step.times(PROBE))
    if probe is None:
        return None
    probe_residuals = linearise(probe, problem.stack)
    along = linearised.d_shared @ step.shared + np.einsum(
        "nki,ni->nk", linearised.d_pose, step.poses[problem.stack.owner]
    )
    # second directional derivative: r'' = 2 / h ((r(x + h v) - r(x)) / h - J v)
    # (Transtrum and Sethna 2012)
    second = 2 / PROBE * ((probe_residuals.residuals - linearised.residuals) / PROBE - along)
    is_visible = probe_residuals.visible & linearised.visible
    weights = problem.loss.weights(linearised.residuals) * is_visible
    equations = assembled(
        problem.stack,
        second,
        linearised.d_shared[:, :, problem.free],
        linearised.d_pose,
        weights,
        problem.moving,
    )
    right = blocks._replace(
        shared_gradient=equations.shared_gradient, pose_gradients=equations.pose_gradients
    )
    acceleration = _marquardt_step(estimate, right, problem, damping)
    if acceleration is None or _step_length(
        acceleration, blocks, problem
    ) > MAX_ACCELERATION * _step_length(step, blocks, problem):
        return None
    return acceleration


def _step_length(step: Step, blocks: NormalEquations, problem: AdjustmentProblem) -> float:
    """Return the length of a step, weighted by its effect on the residuals."""
    shared = step.shared[problem.free] ** 2 @ np.diag(blocks.shared)
    return float(np.sqrt(shared + np.sum(step.poses**2 * np.einsum("mii->mi", blocks.poses))))


def _parameters_at_boundary(estimate: Estimate, step: Step) -> Mask:
    """Return the mask (g,) of model parameters at the boundary of their range."""
    values = np.array([p.value for p in estimate.model.parameters])
    at_boundary = np.zeros(len(step.shared), dtype=bool)
    for i in np.flatnonzero(step.shared[: len(values)]):
        trial = values.copy()
        trial[i] += step.shared[i]
        try:
            estimate.model.with_parameters(trial)
        except OmnimirrorError:
            at_boundary[i] = True
    return at_boundary


def _marquardt_step(
    estimate: Estimate,
    blocks: NormalEquations,
    problem: AdjustmentProblem,
    damping: float,
    at_boundary: Mask | None = None,
) -> Step | None:
    """Return the step; stopped parameters are held."""
    scales = [
        *(p.scale for p in estimate.model.parameters),
        *(estimate.shape.sigmas if estimate.shape else ()),
    ]
    scales += [1.0] * len(estimate.marks)
    floor = (STIFFNESS * problem.noise_px / np.array(scales)[problem.free]) ** 2
    if at_boundary is not None:
        floor = np.where(
            at_boundary[problem.free], HELD_DAMPING * np.diag(blocks.shared) + floor, floor
        )
    try:
        free, poses = solved(blocks, damping, floor)
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(free).all() and np.isfinite(poses).all()):
        return None
    shared = np.zeros(len(problem.free))
    shared[problem.free] = free
    return Step(shared, poses)


def _after_step(
    estimate: Estimate, linearised: Linearised, problem: AdjustmentProblem, step: Step
) -> Estimate | None:
    """Return the estimate after a step; None if the values do not describe a camera."""
    values = shared_values(estimate) + step.shared
    count, last = len(estimate.model.parameters), len(values) - len(estimate.marks)
    try:
        model = estimate.model.with_parameters(values[:count])
    except OmnimirrorError:
        return None
    poses = moved(estimate.poses, np.where(problem.moving[:, None], step.poses, 0.0))
    shape = estimate.shape and estimate.shape.with_values(values[count:last])
    line_positions_mm = estimate.line_positions_mm
    if linearised.d_line_position is not None:
        line_positions_mm = line_positions_mm + slide_steps(
            linearised, problem.stack, step.shared, step.poses
        )
    return Estimate(model, poses, shape, line_positions_mm, values[last:])


# -- Bundle adjustment -----------------------------------------------------------------------------
#
# Levenberg-Marquardt steps on normal equations with eliminated poses. Gross errors are downweighted
# by iterative reweighting with Cauchy weights at the scale of the noise (Hartley and Zisserman,
# "Multiple view geometry", A6).

MAX_STEPS = 80
SCALES_ADJUSTED = 4  # re-estimations of the scale of robust weights
CAUCHY = 2.385  # scale over noise at which Cauchy weights have 95 % efficiency for normal noise
EDGES_FORMED, EDGES_SETTLED = 6, 0.01
"""Maximum relinearisations of the edges, and the parameter change (about pixels) that ends them."""
MEDIAN_OF_NOISE = 1.1774  # median length of two-dimensional noise of 1 px per coordinate


class Prior(NamedTuple):
    """Prior knowledge of a parameter, from a drawing or another measurement.

    Examples
    --------
    >>> Prior("xi", 0.97, 0.02)
    Prior(name='xi', value=0.97, sigma=0.02)
    """

    name: str
    """Name of the model parameter."""
    value: float
    """Expected value in the unit of the parameter."""
    sigma: float
    """Standard deviation; 0 fixes the parameter to the value."""


@dataclass(frozen=True)
class BundleAdjustment(Result):
    """Result of a bundle adjustment.

    Parameters
    ----------
    model
        Estimated camera model.
    observations
        Observations with estimated poses.
    shape
        Estimated shape of the board; None if assumed flat.
    linearised
        Residuals and derivatives of all points of all observations, in order.
    problem
        Problem that was solved.
    estimate
        Solution in numerical form.
    fixed, priors, edges
        Constraints of the adjustment.
    """

    model: CameraModel
    observations: tuple[Observation, ...]
    shape: BoardShape | None
    linearised: Linearised
    problem: AdjustmentProblem
    estimate: Estimate
    fixed: tuple[str, ...] = ()
    priors: tuple[Prior, ...] = ()
    edges: StraightEdges | None = None

    def _table(self) -> Columns:
        parameters = self.model.parameters
        return table_of({"name": p.name, "value": p.value, "unit": p.unit} for p in parameters)

    def refit(self, observations: Sequence[Observation], **options: Any) -> BundleAdjustment:
        """Adjust again from this solution with other observations; options as of :func:`bundle_adjust`."""
        arguments = {
            "shape": self.shape,
            "fixed": self.fixed,
            "priors": self.priors,
            "edges": self.edges,
        } | options
        return bundle_adjust(self.model, observations, **arguments)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all shared parameters, free or fixed."""
        return (*shared_names(self.model, self.shape), *_mark_names(self.problem.stack))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all shared parameters."""
        marks = ("mm",) * len(_mark_names(self.problem.stack))
        return (
            *(p.unit for p in self.model.parameters),
            *(SHAPE_UNITS if self.shape else ()),
            *marks,
        )

    @property
    def residuals(self) -> Array:
        """Reprojection errors (n, 2), image minus pixel, px; 0 for invisible points."""
        return self.linearised.residuals

    @property
    def visible(self) -> Mask:
        """Visibility of the points in the model (n,)."""
        return self.linearised.visible

    @property
    def rms_px(self) -> float:
        """RMS reprojection error ``sqrt(mean |e|^2)``; invisible points count as gross errors."""
        return rms_px(np.where(self.visible[:, None], self.residuals, UNSEEN_PX))

    @property
    def noise_px(self) -> float:
        """Noise of a coordinate, estimated from residuals and degrees of freedom."""
        count = 2 * int(self.visible.sum()) - self.unknowns
        if self.problem.stack.along is not None:
            count -= int(np.any(self.problem.stack.along != 0, axis=1).sum())
        total = float(np.sum(self.residuals[self.visible] ** 2))
        return max(float(np.sqrt(total / max(count, 1))), MIN_NOISE_PX)

    @property
    def unknowns(self) -> int:
        """Number of unknowns: shared parameters and target poses."""
        moving = (s for s, m in zip(self.observations, self.problem.moving, strict=True) if m)
        return int(self.problem.free.sum()) + sum(3 if s.distant.all() else 6 for s in moving)

    def residuals_of(self, number: int) -> Array:
        """Return the residuals (n, 2) of an observation."""
        return self.residuals[self.problem.stack.slices[number]]


def shared_names(model: CameraModel, shape: BoardShape | None) -> tuple[str, ...]:
    """Return the names of the parameters of the model and of the board."""
    return (*(p.name for p in model.parameters), *(SHAPE_NAMES if shape else ()))


def _mark_names(stack: Stack) -> tuple[str, ...]:
    """Return the names of the coordinates of marks on their planes."""
    return (
        ()
        if stack.marks is None
        else tuple(f"mark {i} {axis}" for i in stack.marks.ids for axis in "xy")
    )


@validate_arguments
def bundle_adjust(
    model: CameraModel,
    observations: Sequence[Observation],
    *,
    shape: BoardShape | None = None,
    fixed: Iterable[str] = (),
    priors: Iterable[Prior] = (),
    loss: str = "squares",
    noise_px: float | None = None,
    max_steps: int = MAX_STEPS,
    relative_tolerance: float = RELATIVE_TOLERANCE,
    on_progress: OnProgress | None = None,
    edges: StraightEdges | None = None,
) -> BundleAdjustment:
    """Adjust a camera model, target poses and the board shape to observations.

    Parameters
    ----------
    model
        Initial value of the camera model.
    observations
        Observations of points, directions, lines or marks on planes in any combination, each with a
        known pose or an initial pose.
    shape
        Initial shape of the board in all near observations except surveyed ones; None: nominal points.
    fixed
        Names of parameters held at their initial values.
    priors
        Prior knowledge of parameters.
    loss
        ``"squares"``, or the robust ``"cauchy"`` or ``"huber"`` for observations with outliers.
    noise_px
        Noise of a coordinate, which weights priors and scales robust losses; by default estimated
        from the residuals.
    max_steps
        Maximum number of steps.
    relative_tolerance
        Relative decrease of the sum that ends the iteration.
    on_progress
        Callback of the number of successful steps, and None. The logger
        ``omnimirror.calibration`` reports the minimised sum.
    edges
        Straight edges, as additional observations.

    Returns
    -------
    BundleAdjustment
        Solution.

    Raises
    ------
    InvalidParameter
        If a name is unknown, an observation has no pose, or there are no observations.

    Examples
    --------
    Camera from surveyed points of a room:

    >>> import omnimirror as om
    >>> from omnimirror.cameras.models import Unified
    >>> from omnimirror.calibration.estimation import RigidTransform
    >>> truth = Unified(
    ...     xi=0.9, focal_px=(150.0, 150.0), centre_px=(322.0, 241.0), image_size=(640, 480)
    ... )
    >>> points = np.random.default_rng(0).normal(0, 2000, (60, 3)) * [1, 1, 0.2]
    >>> room = om.Observation("room", truth.image(points).pixels, points, RigidTransform.identity(), is_known=True)
    >>> start = Unified(
    ...     xi=1.0, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> found = om.bundle_adjust(start, [room], fixed=("k1", "k2", "k3", "p1", "p2", "skew"))
    >>> round(found.model.xi, 4), round(found.rms_px, 6)
    (0.9, 0.0)
    """
    choice("loss", loss, ("squares", "cauchy", "huber"))
    fixed, priors = tuple(fixed), tuple(priors)
    problem = _problem(model, observations, shape, fixed, priors)
    estimate = _start(model, observations, shape, priors, problem.stack)
    steps = count(1)

    def on_step(cost: float) -> None:
        step = next(steps)
        LOGGER.info("step %d, sum of squares %.6g", step, cost)
        if on_progress is not None:
            on_progress(step, None)

    for _ in range(1 if edges is None else EDGES_FORMED):
        edge_information = None if edges is None else edges.information(estimate.model)
        before = estimate.model
        estimate, problem = _minimise_with_noise(
            estimate,
            replace(problem, edges=edge_information),
            loss,
            noise_px,
            max_steps,
            relative_tolerance,
            on_step,
        )
        if _max_change(before, estimate.model) < EDGES_SETTLED:
            break
    adjustment = _result(estimate, observations, problem, fixed, priors)
    return replace(adjustment, edges=edges)


def _minimise_with_noise(
    estimate: Estimate,
    problem: AdjustmentProblem,
    loss: str,
    noise_px: float | None,
    max_steps: int,
    relative_tolerance: float,
    on_step: Callable[[float], None],
) -> tuple[Estimate, AdjustmentProblem]:
    """Return the minimum for the given noise, or for noise estimated from the residuals."""
    if noise_px is not None:
        problem = replace(problem, noise_px=noise_px, loss=Loss(loss, CAUCHY * noise_px))
        return minimise(estimate, problem, max_steps, relative_tolerance, on_step), problem
    for _ in range(1 if loss == "squares" and not problem.has_priors else SCALES_ADJUSTED):
        noise = _noise(estimate, problem, robust=loss != "squares")
        problem = replace(problem, noise_px=noise, loss=Loss(loss, CAUCHY * noise))
        estimate = minimise(estimate, problem, max_steps, relative_tolerance, on_step)
        updated_noise = _noise(estimate, problem, robust=loss != "squares")
        if abs(updated_noise - noise) < 0.02 * noise:
            break
    return estimate, replace(problem, noise_px=_noise(estimate, problem, robust=loss != "squares"))


def _max_change(before: CameraModel, after: CameraModel) -> float:
    """Return the largest parameter change, in units that move the image by about 1 px."""
    pairs = zip(before.parameters, after.parameters, strict=True)
    return max((abs(b.value - a.value) / a.scale for a, b in pairs), default=0.0)


def _result(
    estimate: Estimate,
    observations: Sequence[Observation],
    problem: AdjustmentProblem,
    fixed: tuple[str, ...],
    priors: tuple[Prior, ...],
) -> BundleAdjustment:
    linearised = linearise(estimate, problem.stack)
    posed = tuple(s.with_pose(m) for s, m in zip(observations, estimate.poses, strict=True))
    if problem.stack.marks is not None:  # observations hold the positions of the marks
        points = targets(
            estimate._replace(
                shape=None, line_positions_mm=np.zeros_like(estimate.line_positions_mm)
            ),
            problem.stack,
        )
        posed = tuple(
            replace(s, points=points[part])
            for s, part in zip(posed, problem.stack.slices, strict=True)
        )
    return BundleAdjustment(
        estimate.model, posed, estimate.shape, linearised, problem, estimate, fixed, priors
    )


def _problem(
    model: CameraModel,
    observations: Sequence[Observation],
    shape: BoardShape | None,
    fixed: tuple[str, ...],
    priors: tuple[Prior, ...],
) -> AdjustmentProblem:
    stack = stacked(observations)
    board_slice = slice(len(model.parameters), len(shared_names(model, shape)))
    names = (*shared_names(model, shape), *_mark_names(stack))
    for name in (*fixed, *(p.name for p in priors)):
        if name not in names:
            raise InvalidParameter(
                f"fixed and priors must name parameters of the model ({', '.join(names)}); got {name!r}"
            )
    missing = [s.name for s in observations if s.pose is None]
    if missing:
        raise InvalidParameter(
            f"observations must have an initial pose; missing for {', '.join(missing)}"
        )
    free = np.array([n not in fixed for n in names], dtype=bool)
    information, expected = np.zeros(len(names)), np.zeros(len(names))
    if shape is not None:
        information[board_slice] = 1 / shape.sigmas**2
    for prior in priors:
        index = names.index(prior.name)
        expected[index] = prior.value
        if prior.sigma > 0:
            information[index] = 1 / prior.sigma**2
        else:
            free[index] = False
    moving = np.array([not s.is_known for s in observations])
    return AdjustmentProblem(stack, moving, free, information, expected, Loss(), 1.0)


def _start(
    model: CameraModel,
    observations: Sequence[Observation],
    shape: BoardShape | None,
    priors: tuple[Prior, ...],
    stack: Stack,
) -> Estimate:
    values = np.array([p.value for p in model.parameters])
    names = [p.name for p in model.parameters]
    for prior in priors:
        if prior.sigma == 0 and prior.name in names:
            values[names.index(prior.name)] = prior.value
    poses = tuple(s.pose for s in observations if s.pose is not None)
    return Estimate(
        model.with_parameters(values),
        poses,
        shape,
        np.zeros(len(stack.pixels)),
        np.zeros(len(_mark_names(stack))),
    )


def _noise(estimate: Estimate, problem: AdjustmentProblem, *, robust: bool) -> float:
    """Return the noise of a coordinate, px."""
    linearised = linearise(estimate, problem.stack)
    lengths = np.hypot(*linearised.residuals[linearised.visible].T)
    if not len(lengths):
        return 1.0
    noise = np.median(lengths) / MEDIAN_OF_NOISE if robust else np.sqrt(np.mean(lengths**2) / 2)
    return max(float(noise), MIN_NOISE_PX)
