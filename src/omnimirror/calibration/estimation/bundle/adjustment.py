"""Bundle adjustment of a camera model, of where targets stand and of the board's shape, to everything that was seen.

Levenberg and Marquardt's steps on normal equations with the motions eliminated; gross errors are held down by
reweighting with Cauchy's weights at the scale of the noise (Hartley and Zisserman, "Multiple view geometry", A6).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import checked, choice
from ....base.errors import InvalidParameter
from ....cameras.models.base import CameraModel
from .board_shape import NAMES, UNITS, BoardShape
from .edges import StraightEdges
from .linearisation import UNSEEN_PX, Estimate, Linearised, Loss, linearised, targets
from .observations import Sighting, Stack, rms_px, stacked
from .steps import LEAST_NOISE_PX, SETTLED, Question, least

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_STEPS = 80
SCALES_ADJUSTED = 4  # times that the scale of robust weights is found anew
CAUCHY = 2.385  # scale over noise at which Cauchy's weights lose 5 % where there are no gross errors
EDGES_FORMED, EDGES_SETTLED = 6, 0.01
"""Times that what edges say is formed anew, and the change (about pixels) below which it is what it was."""
MEDIAN_OF_NOISE = 1.1774  # of the length of two-dimensional noise of 1 px a coordinate


class Prior(NamedTuple):
    """What is known of a parameter beforehand, from a drawing or another measurement.

    Examples
    --------
    >>> Prior("xi", 0.97, 0.02)
    Prior(name='xi', value=0.97, sigma=0.02)
    """

    name: str
    """Of the parameter, as the model has it."""
    value: float
    """In its unit."""
    sigma: float
    """Standard deviation; 0: it is fixed to the value."""


@dataclass(frozen=True)
class Adjustment:
    """What was found.

    Parameters
    ----------
    model
        The camera.
    sightings
        With the motions that were found.
    shape
        Of the board, None where it was taken as flat.
    linearised
        Residuals and derivatives of all points of all sightings, one after the other.
    question
        What was asked.
    estimate
        What was found, in the form of the arithmetic.
    fixed, priors, edges
        With which it was found.
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
        """The same from here on with other sightings; options as of :func:`adjust`."""
        given = {"shape": self.shape, "fixed": self.fixed, "priors": self.priors, "edges": self.edges} | options
        return adjust(self.model, sightings, **given)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all shared parameters, free or not."""
        return (*shared_names(self.model, self.shape), *_mark_names(self.question.stack))

    @property
    def units(self) -> tuple[str, ...]:
        """Of all shared parameters."""
        marks = ("mm",) * len(_mark_names(self.question.stack))
        return (*(p.unit for p in self.model.parameters), *(UNITS if self.shape else ()), *marks)

    @property
    def residuals(self) -> Array:
        """Image minus pixel, px (n, 2); 0 where the model sees nothing."""
        return self.linearised.residuals

    @property
    def seen(self) -> Mask:
        """Whether the model sees the points at all (n,)."""
        return self.linearised.seen

    @property
    def rms_px(self) -> float:
        """``sqrt(mean |e|^2)``; a point that the model does not see counts as far off."""
        return rms_px(np.where(self.seen[:, None], self.residuals, UNSEEN_PX))

    @property
    def noise_px(self) -> float:
        """Noise of a coordinate, from the residuals and what they leave free."""
        count = 2 * int(self.seen.sum()) - self.unknowns
        if self.question.stack.along is not None:
            count -= int(np.any(self.question.stack.along != 0, axis=1).sum())
        total = float(np.sum(self.residuals[self.seen] ** 2))
        return max(float(np.sqrt(total / max(count, 1))), LEAST_NOISE_PX)

    @property
    def unknowns(self) -> int:
        """How many numbers were estimated: those that are shared, and how targets stand."""
        moving = (s for s, m in zip(self.sightings, self.question.moving, strict=True) if m)
        return int(self.question.free.sum()) + sum(3 if s.distant.all() else 6 for s in moving)

    def residuals_of(self, number: int) -> Array:
        """Residuals (n, 2) of a sighting."""
        return self.residuals[self.question.stack.slices[number]]


def shared_names(model: CameraModel, shape: BoardShape | None) -> tuple[str, ...]:
    """Names of the model's parameters, and of the board's."""
    return (*(p.name for p in model.parameters), *(NAMES if shape else ()))


def _mark_names(stack: Stack) -> tuple[str, ...]:
    """Names of where marks lie on their planes."""
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
    """Adjust a camera model, the places of targets and the board's shape to what was seen.

    Parameters
    ----------
    model
        Where the search begins.
    sightings
        Each with a motion, known or to begin with; of points, directions, lines or marks on planes, mixed as they come.
    shape
        Of the board that all near sightings but surveyed ones show, to be estimated from here; None: they are as they
        say.
    fixed
        Names of parameters that stay.
    priors
        What is known of parameters beforehand.
    loss
        ``"squares"``, or ``"cauchy"`` or ``"huber"`` where some of what was seen is wrong.
    noise_px
        Of a coordinate, against which priors are weighed and from which robust losses take their scale; found from the
        residuals by default.
    most_steps
        After which it ends in any case.
    settled
        A step that makes the sum less by no more than this share of it is the last.
    on_step
        Called with the sum that is made least, after every step that makes it less.
    edges
        Straight edges that count beside what was seen.

    Returns
    -------
    Adjustment
        What was found.

    Raises
    ------
    InvalidParameter
        A name that is none, a sighting without a motion, nothing seen.

    Examples
    --------
    A camera from points of a room that was surveyed:

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
    """The least sum, at the noise that is said, or that is found from the residuals."""
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
    """The largest change of a parameter, in changes that move the picture by about a pixel."""
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
    if question.stack.marks is not None:  # the sightings tell where on their planes the marks are
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
    """Noise of a coordinate, px."""
    found = linearised(estimate, question.stack)
    lengths = np.hypot(*found.residuals[found.seen].T)
    if not len(lengths):
        return 1.0
    noise = np.median(lengths) / MEDIAN_OF_NOISE if robust else np.sqrt(np.mean(lengths**2) / 2)
    return max(float(noise), LEAST_NOISE_PX)
