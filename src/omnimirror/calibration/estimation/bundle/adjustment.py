"""Bundle adjustment of a camera model, target poses and board shape to all observations.

Levenberg-Marquardt steps on normal equations with eliminated poses. Gross errors are downweighted
by iterative reweighting with Cauchy weights at the scale of the noise (Hartley and Zisserman,
"Multiple view geometry", A6).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ....base.arguments import checked, choice
from ....base.errors import InvalidParameter
from ....base.typing import Array, Mask
from ....cameras.models.base import CameraModel
from .board_shape import NAMES, UNITS, BoardShape
from .edges import StraightEdges
from .linearisation import UNSEEN_PX, Estimate, Linearised, Loss, linearised, targets
from .observations import Sighting, Stack, rms_px, stacked
from .steps import LEAST_NOISE_PX, SETTLED, Question, least

MOST_STEPS = 80
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
class Adjustment:
    """Result of a bundle adjustment.

    Parameters
    ----------
    model
        Estimated camera model.
    sightings
        Observations with estimated poses.
    shape
        Estimated shape of the board; None if assumed flat.
    linearised
        Residuals and derivatives of all points of all sightings, in order.
    question
        Problem that was solved.
    estimate
        Solution in numerical form.
    fixed, priors, edges
        Constraints of the adjustment.
    """

    model: CameraModel
    sightings: tuple[Sighting, ...]
    shape: BoardShape | None
    linearised: Linearised
    question: Question
    estimate: Estimate
    fixed: tuple[str, ...] = ()
    priors: tuple[Prior, ...] = ()
    edges: StraightEdges | None = None

    def again(self, sightings: Sequence[Sighting], **options: Any) -> Adjustment:
        """Adjust again from this solution with other sightings; options as of :func:`adjust`."""
        given = {"shape": self.shape, "fixed": self.fixed, "priors": self.priors, "edges": self.edges} | options
        return adjust(self.model, sightings, **given)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all shared parameters, free or fixed."""
        return (*shared_names(self.model, self.shape), *_mark_names(self.question.stack))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all shared parameters."""
        marks = ("mm",) * len(_mark_names(self.question.stack))
        return (*(p.unit for p in self.model.parameters), *(UNITS if self.shape else ()), *marks)

    @property
    def residuals(self) -> Array:
        """Reprojection errors (n, 2), image minus pixel, px; 0 for invisible points."""
        return self.linearised.residuals

    @property
    def seen(self) -> Mask:
        """Visibility of the points in the model (n,)."""
        return self.linearised.seen

    @property
    def rms_px(self) -> float:
        """RMS reprojection error ``sqrt(mean |e|^2)``; invisible points count as gross errors."""
        return rms_px(np.where(self.seen[:, None], self.residuals, UNSEEN_PX))

    @property
    def noise_px(self) -> float:
        """Noise of a coordinate, estimated from residuals and degrees of freedom."""
        count = 2 * int(self.seen.sum()) - self.unknowns
        if self.question.stack.along is not None:
            count -= int(np.any(self.question.stack.along != 0, axis=1).sum())
        total = float(np.sum(self.residuals[self.seen] ** 2))
        return max(float(np.sqrt(total / max(count, 1))), LEAST_NOISE_PX)

    @property
    def unknowns(self) -> int:
        """Number of unknowns: shared parameters and target poses."""
        moving = (s for s, m in zip(self.sightings, self.question.moving, strict=True) if m)
        return int(self.question.free.sum()) + sum(3 if s.distant.all() else 6 for s in moving)

    def residuals_of(self, number: int) -> Array:
        """Return the residuals (n, 2) of a sighting."""
        return self.residuals[self.question.stack.slices[number]]


def shared_names(model: CameraModel, shape: BoardShape | None) -> tuple[str, ...]:
    """Return the names of the parameters of the model and of the board."""
    return (*(p.name for p in model.parameters), *(NAMES if shape else ()))


def _mark_names(stack: Stack) -> tuple[str, ...]:
    """Return the names of the coordinates of marks on their planes."""
    return () if stack.marks is None else tuple(f"mark {i} {axis}" for i in stack.marks.ids for axis in "xy")


@checked
def adjust(
    model: CameraModel,
    sightings: Sequence[Sighting],
    *,
    shape: BoardShape | None = None,
    fixed: Iterable[str] = (),
    priors: Iterable[Prior] = (),
    loss: str = "squares",
    noise_px: float | None = None,
    most_steps: int = MOST_STEPS,
    settled: float = SETTLED,
    on_step: Callable[[float], None] | None = None,
    edges: StraightEdges | None = None,
) -> Adjustment:
    """Adjust a camera model, target poses and the board shape to observations.

    Parameters
    ----------
    model
        Initial value of the camera model.
    sightings
        Observations of points, directions, lines or marks on planes in any combination, each with a
        known pose or an initial pose.
    shape
        Initial shape of the board in all near sightings except surveyed ones; None: nominal points.
    fixed
        Names of parameters held at their initial values.
    priors
        Prior knowledge of parameters.
    loss
        ``"squares"``, or the robust ``"cauchy"`` or ``"huber"`` for observations with outliers.
    noise_px
        Noise of a coordinate, which weights priors and scales robust losses; by default estimated
        from the residuals.
    most_steps
        Maximum number of steps.
    settled
        Relative decrease of the sum that ends the iteration.
    on_step
        Callback with the minimised sum after every successful step.
    edges
        Straight edges, as additional observations.

    Returns
    -------
    Adjustment
        Solution.

    Raises
    ------
    InvalidParameter
        If a name is unknown, a sighting has no pose, or there are no observations.

    Examples
    --------
    Camera from surveyed points of a room:

    >>> import omnimirror as om
    >>> from omnimirror.cameras.models import Unified
    >>> from omnimirror.calibration.estimation import Motion
    >>> truth = Unified(0.9, (150.0, 150.0), (322.0, 241.0), (640, 480))
    >>> points = np.random.default_rng(0).normal(0, 2000, (60, 3)) * [1, 1, 0.2]
    >>> room = om.Sighting("room", truth.image(points).pixels, points, Motion.none(), is_known=True)
    >>> start = Unified(1.0, (160.0, 160.0), (319.5, 239.5), (640, 480))
    >>> found = om.adjust(start, [room], fixed=("k1", "k2", "k3", "p1", "p2", "skew"))
    >>> round(found.model.xi, 4), round(found.rms_px, 6)
    (0.9, 0.0)
    """
    choice("loss", loss, ("squares", "cauchy", "huber"))
    fixed, priors = tuple(fixed), tuple(priors)
    question = _question(model, sightings, shape, fixed, priors)
    estimate = _start(model, sightings, shape, priors, question.stack)
    for _ in range(1 if edges is None else EDGES_FORMED):
        known = None if edges is None else edges.known(estimate.model)
        before = estimate.model
        estimate, question = _settled(
            estimate, replace(question, edges=known), loss, noise_px, most_steps, settled, on_step
        )  # fmt: skip
        if _furthest(before, estimate.model) < EDGES_SETTLED:
            break
    found = _told(estimate, sightings, question, fixed, priors)
    return replace(found, edges=edges)


def _settled(
    estimate: Estimate, question: Question, loss: str, noise_px: float | None, most_steps: int, settled: float,
    on_step: Callable[[float], None] | None,
) -> tuple[Estimate, Question]:  # fmt: skip
    """Return the minimum for the given noise, or for noise estimated from the residuals."""
    if noise_px is not None:
        question = replace(question, noise_px=noise_px, loss=Loss(loss, CAUCHY * noise_px))
        return least(estimate, question, most_steps, settled, on_step), question
    for _ in range(1 if loss == "squares" and not question.has_priors else SCALES_ADJUSTED):
        noise = _noise(estimate, question, robust=loss != "squares")
        question = replace(question, noise_px=noise, loss=Loss(loss, CAUCHY * noise))
        estimate = least(estimate, question, most_steps, settled, on_step)
        now = _noise(estimate, question, robust=loss != "squares")
        if abs(now - noise) < 0.02 * noise:
            break
    return estimate, replace(question, noise_px=_noise(estimate, question, robust=loss != "squares"))


def _furthest(before: CameraModel, after: CameraModel) -> float:
    """Return the largest parameter change, in units that move the image by about 1 px."""
    pairs = zip(before.parameters, after.parameters, strict=True)
    return max((abs(b.value - a.value) / a.scale for a, b in pairs), default=0.0)


def _told(
    estimate: Estimate,
    sightings: Sequence[Sighting],
    question: Question,
    fixed: tuple[str, ...],
    priors: tuple[Prior, ...],
) -> Adjustment:
    found = linearised(estimate, question.stack)
    moved = tuple(s.moved(m) for s, m in zip(sightings, estimate.motions, strict=True))
    if question.stack.marks is not None:  # sightings hold the positions of the marks
        at = targets(estimate._replace(shape=None, slides=np.zeros_like(estimate.slides)), question.stack)
        moved = tuple(replace(s, points=at[where]) for s, where in zip(moved, question.stack.slices, strict=True))
    return Adjustment(estimate.model, moved, estimate.shape, found, question, estimate, fixed, priors)


def _question(
    model: CameraModel,
    sightings: Sequence[Sighting],
    shape: BoardShape | None,
    fixed: tuple[str, ...],
    priors: tuple[Prior, ...],
) -> Question:
    stack = stacked(sightings)
    of_board = slice(len(model.parameters), len(shared_names(model, shape)))
    names = (*shared_names(model, shape), *_mark_names(stack))
    for name in (*fixed, *(p.name for p in priors)):
        if name not in names:
            raise InvalidParameter(f"there is no parameter {name!r} to fix; {', '.join(names)} are")
    missing = [s.name for s in sightings if s.motion is None]
    if missing:
        raise InvalidParameter(f"it is not said where the target stands in {', '.join(missing)}")
    free = np.array([n not in fixed for n in names], dtype=bool)
    information, expected = np.zeros(len(names)), np.zeros(len(names))
    if shape is not None:
        information[of_board] = 1 / shape.sigmas**2
    for prior in priors:
        at = names.index(prior.name)
        expected[at] = prior.value
        if prior.sigma > 0:
            information[at] = 1 / prior.sigma**2
        else:
            free[at] = False
    moving = np.array([not s.is_known for s in sightings])
    return Question(stack, moving, free, information, expected, Loss(), 1.0)


def _start(
    model: CameraModel, sightings: Sequence[Sighting], shape: BoardShape | None, priors: tuple[Prior, ...], stack: Stack
) -> Estimate:
    values = np.array([p.value for p in model.parameters])
    names = [p.name for p in model.parameters]
    for prior in priors:
        if prior.sigma == 0 and prior.name in names:
            values[names.index(prior.name)] = prior.value
    motions = tuple(s.motion for s in sightings if s.motion is not None)
    return Estimate(
        model.with_parameters(values), motions, shape, np.zeros(len(stack.pixels)), np.zeros(len(_mark_names(stack)))
    )


def _noise(estimate: Estimate, question: Question, *, robust: bool) -> float:
    """Return the noise of a coordinate, px."""
    found = linearised(estimate, question.stack)
    lengths = np.hypot(*found.residuals[found.seen].T)
    if not len(lengths):
        return 1.0
    noise = np.median(lengths) / MEDIAN_OF_NOISE if robust else np.sqrt(np.mean(lengths**2) / 2)
    return max(float(noise), LEAST_NOISE_PX)
