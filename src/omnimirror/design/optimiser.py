"""Optimisation of freeform mirrors for one merit: objective, constraints and starts."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.files import MAX_TEXT_BYTES, json_plain, parse_json, read_bytes, write_text
from ..base.optimisation import (
    LinearisedValues,
    MinimaxResult,
    ObjectiveValues,
    minimise_mean,
    solve_minimax,
)
from ..base.results import Columns, Result, record_of, table_of
from ..base.toml_validation import NullLocator
from ..base.typing import Array
from ..optics.batch.families import Basis
from ..optics.image_sensor import Imager
from ..optics.mirrors import Equidistant, Mirror, SlopeSpline, Sphere
from ..optics.sensor import Sensor
from ..optics.sensor_files import housing_of, housing_tables, lens_of, lens_table
from ._blur_bound import BlurBound, blur_bound
from ._design_problem import DesignProblem, DesignSpace, State
from .limits import Limit
from .merits import FieldValues, Merit, merit_named
from .requirements import ends

# -- Objectives and constraints of the optimiser, as rows with exact derivatives in a design space
#
# The objective is a merit, or the slack of requirements: relative violations of limits and relative
# changes of given numbers.

RealOrComplexArray = NDArray[Any]

IMAGINARY_STEP = 1e-30  # imaginary step; without cancellation it may be arbitrarily small
MIN_DOMEGA_DU = 0.05  # dOmega/du, radians; smaller values count as a folded mapping
MIN_COS_INCIDENCE = 0.01  # cosine of the angle of incidence; smaller values count as edge-on
TIGHT = 1e-4  # relative tightening at the nodes, which keeps limits met between them
IMAGE, CLEAR = "image_radius_px", "omega_min_deg"  # constraints other than limits
Key = int | str


@dataclass(frozen=True)
class Slack:
    """Requirements that may be relaxed (elastic constraints) by a minimal relative amount.

    Attributes
    ----------
    keys
        Limits by index, :data:`IMAGE`, :data:`CLEAR`. All others are constraints.
    numbers
        Free numbers with their requested values and the sign of the permitted change.
    margin
        Relative tightening of all other requirements, which keeps them met between the evaluated
        angles.
    """

    keys: tuple[Key, ...]
    numbers: tuple[tuple[str, float, int], ...] = ()
    margin: float = 0.0


@dataclass(frozen=True)
class Objective:
    """Merit, or slack of requirements, over fractions u of the rim radius, the last of them 1."""

    space: DesignSpace
    goal: Merit | Slack
    u: RealOrComplexArray

    def values(self, y: RealOrComplexArray) -> ObjectiveValues:
        """Return rows and constraints at a point (dim,)."""
        rows, constraints = self._parts(y[None], self.space.state(y[None], self.u, self._basis))
        return ObjectiveValues(rows[0], constraints[0])

    def rows(self, y: RealOrComplexArray) -> LinearisedValues:
        """Return rows and constraints at a point (dim,) with complex-step derivatives."""
        stepped = y + 1j * IMAGINARY_STEP * np.eye(self.space.dim)
        g, c = self._parts(stepped, self.space.state(stepped, self.u, self._basis))
        return LinearisedValues(
            g[0].real, c[0].real, g.imag.T / IMAGINARY_STEP, c.imag.T / IMAGINARY_STEP
        )

    def shown(self, value: float) -> float:
        """Return the merit in its unit, or the largest relative violation, from the largest row."""
        if isinstance(self.goal, Slack):
            return value
        return float(self.goal.shown(np.asarray(value * self._scale)))

    @property
    def is_spread(self) -> bool:
        return isinstance(self.goal, Merit) and self.goal.is_spread

    @property
    def is_mean(self) -> bool:
        return isinstance(self.goal, Merit) and self.goal.is_mean

    @property
    def depends_on_focus(self) -> bool:
        """True if the goal or a limit depends on the focus."""
        own = isinstance(self.goal, Merit) and self.goal.is_sharpness
        return own or any(limit.of.is_sharpness for limit in self.space.problem.limits)

    @property
    def requested(self) -> tuple[Key, ...]:
        """Keys of all limits, image size and view past the camera."""
        problem = self.space.problem
        keys: list[Key] = [*range(len(problem.limits))]
        keys += [IMAGE] if problem.has_image_to_fit else []
        keys += [CLEAR] if problem.has_view_to_clear else []
        return tuple(keys)

    def missed(self, y: RealOrComplexArray) -> dict[Key, float]:
        """Return relative violations at a point (dim,); negative if a requirement is met."""
        state = self.space.state(y[None], self.u, self._basis)
        return {key: float(rows.max()) for key, rows in self._requirements(state)}

    @cached_property
    def _basis(self) -> Basis:
        return self.space.basis(self.u)

    @cached_property
    def _scale(self) -> float:
        """Scale of the rows, the rim radius for lengths."""
        is_length = isinstance(self.goal, Merit) and self.goal.quantity.unit == "mm"
        return ends(self.space.problem.rim_radius_mm)[1] if is_length else 1.0

    def _parts(
        self, y: RealOrComplexArray, state: State
    ) -> tuple[RealOrComplexArray, RealOrComplexArray]:
        with np.errstate(all="ignore"):
            required = dict(self._requirements(state))
            constraints = [MIN_DOMEGA_DU - state.domega_du, MIN_COS_INCIDENCE - state.cos_incidence]
            specified, margin = tuple[Key, ...](), TIGHT
            if isinstance(self.goal, Slack):
                specified, margin = self.goal.keys, TIGHT + self.goal.margin
                rows = [required[key] for key in specified] + [
                    self._moved(y, *n) for n in self.goal.numbers
                ]
                objective = _beside(rows, len(y))
            else:
                objective = self._merit(self.goal, state)
            constraints += [margin + part for key, part in required.items() if key not in specified]
            return objective, _beside(constraints, len(y))

    def _moved(
        self, y: RealOrComplexArray, name: str, requested: float, sign: int
    ) -> RealOrComplexArray:
        """Return the relative change of a free number."""
        value = np.exp(y[:, self.space.names.index(name), None])
        moved: RealOrComplexArray = sign * (value / requested - 1)
        return moved

    def _merit(self, merit: Merit, state: State) -> RealOrComplexArray:
        field = state.field.at(self._counting(state)())
        if merit.is_mean:
            area, weights = np.exp(field.log_area), field.solid_angle
            mean: RealOrComplexArray = (area * weights).sum(axis=1, keepdims=True) / weights.sum(
                axis=1, keepdims=True
            )
            return mean
        return _beside([*merit.rows(field)], len(state.omega)) / self._scale

    def _requirements(self, state: State) -> Iterator[tuple[Key, RealOrComplexArray]]:
        return violation_rows(
            self.space, state.field, self._counting(state), state.omega, state.hidden, state.image
        )

    def _counting(self, state: State) -> Counting:
        """Return the counted columns of the first design, to which all derivatives refer."""
        return partial(self.space.counting, state.omega[:1].real, state.hidden[:1].real)


Counting = Callable[..., NDArray[np.intp]]
"""Function that returns the counted columns between two field angles in degrees."""


def violation_rows(
    space: DesignSpace,
    field: FieldValues,
    counting: Counting,
    omega: RealOrComplexArray,
    hidden: RealOrComplexArray,
    image: RealOrComplexArray,
) -> Iterator[tuple[Key, RealOrComplexArray]]:
    """Yield the relative violations of each requirement as rows (b, r)."""
    problem = space.problem
    if problem.has_image_to_fit:
        yield IMAGE, image - 1
    if problem.has_view_to_clear:
        yield CLEAR, space.hidden_from(omega, hidden)
    for i, limit in enumerate(problem.limits):
        yield (
            i,
            limit.excess(field.at(counting(*(limit.omega_deg or ()))), len(problem.distances_mm)),
        )


def _beside(rows: list[RealOrComplexArray], count: int) -> RealOrComplexArray:
    """Concatenate rows of shapes (count or 1, r)."""
    return np.concatenate([np.broadcast_to(r, (count, r.shape[1])) for r in rows], axis=1)


# -- Optimisation of freeform mirrors for one merit, from several starts ---------------------------
#
# The starts are known mirrors: the sphere, the exact equidistant mirror, then the sphere with random
# undulations. Each is optimised by :mod:`.minimax` on a coarse set of field angles, the best one
# again on a fine set. Derivatives are complex steps through closed forms, exact to rounding.

COARSE, FINE = 241, 1201  # field angles of the search and of the final refinement
POLISH_TRUST = 1e-3
CLOSE, CLOSER = 1e-6, 1e-7  # relative gains that end the search and the refinement
INITIAL_KNOTS, KNOT_STEP = 16, 12  # knots of a first spline, and increment of the number of knots
WAVES, HEIGHT = 4, 0.05  # undulations of the random starts: number and relative height
FEASIBILITY_TOLERANCE = 1e-6  # largest constraint violation of a feasible design
REFOCUSED = 3  # refocusing iterations for merits independent of sharpness


@dataclass(frozen=True)
class Run(Result):
    """Result of one start.

    Attributes
    ----------
    start
        Initial mirror.
    y
        Final point in the design space.
    value
        Final merit over the coarse field angles.
    kept
        True if all constraints are met.
    history
        Merit after each step.
    """

    start: str
    y: tuple[float, ...]
    value: float
    kept: bool
    history: tuple[float, ...]


@dataclass(frozen=True)
class Progress:
    """Progress after a step: index and number of starts, and current merit."""

    run: int
    runs: int
    value: float


@dataclass(frozen=True)
class Optimum(Result):
    """Best design, with the results of all starts.

    Attributes
    ----------
    problem
        Design problem with its free parameters.
    merit
        Name of the minimised merit.
    sensor
        Sensor at the focus of minimum merit.
    value
        Merit over 1201 field angles, in its unit.
    y : (k,)
        Design as a point of the :class:`~omnimirror.design._design_problem.DesignSpace` of the
        problem.
    runs
        Results of all starts; the first is the sphere.
    is_complete
        False if the search was stopped before its last start.

    Examples
    --------
    >>> found = optimise(DesignProblem(terms=3), starts=1)
    >>> found.merit, found.sensor.mirror.KIND
    ('worst_floored_area_deg2', 'slope-spline')
    """

    problem: DesignProblem
    merit: str
    sensor: Sensor
    value: float
    y: Array
    runs: tuple[Run, ...]
    is_complete: bool = True

    def _table(self) -> Columns:
        return table_of(record_of(run) for run in self.runs)

    @cached_property
    def bound(self) -> BlurBound:
        """Lower bound of the worst single blur for the same field, rim and lens, at the
        most demanding object distance.
        """
        problem = self.problem
        low = max(problem.omega_min_deg, self.sensor.clear_field_deg[0])
        bounds = (
            blur_bound(
                self.sensor,
                distance,
                omega_min_deg=low,
                mode=problem.mode,
                image_radius_px=problem.image_radius_px,
            )
            for distance in problem.distances_mm
        )
        return max(bounds, key=lambda b: b.blur_deg)


def optimise(
    problem: DesignProblem,
    merit: str = "worst_floored_area_deg2",
    *,
    starts: int = 4,
    seed: int = 0,
    resume: str | Path | None = None,
    on_iteration: Callable[[Progress], None] | None = None,
) -> Optimum:
    """Optimise mirror, focus and free parameters of a problem for a merit.

    Parameters
    ----------
    problem
        Design problem with its free parameters.
    merit
        Name of a merit in :data:`omnimirror.design.merits.DESIGN_MERITS`.
    starts, seed
        Number of initial mirrors; the seed determines the third and later ones.
    resume
        File of finished starts, from which an interrupted search is resumed.
    on_iteration
        Callback of start and merit, called after each step.

    Returns
    -------
    Optimum
        Best sensor, and the result of each start.

    Raises
    ------
    InvalidParameter
        If the merit is unknown, or there is no start.
    OmnimirrorError
        If there is no feasible design.
    KeyboardInterrupt
        If interrupted (Ctrl-C) before the first start is finished; later, the best finished result
        is returned.

    Examples
    --------
    >>> best = optimise(DesignProblem(family="even-polynomial", terms=3), "worst_blur_deg", starts=1)
    >>> best.sensor.mirror.KIND, round(best.value, 3)
    ('even-polynomial', 0.635)

    Design with a limit, for a telecentric lens, whose sphere is already equiareal:

    >>> import omnimirror as om
    >>> from omnimirror.design import Limit
    >>> even = Limit("area_ratio", at_least=0.9)
    >>> problem = DesignProblem(lens="orthographic", omega_max_deg=120, family="conic-asphere", terms=3, limits=(even,))
    >>> best = optimise(problem, "worst_floored_area_deg2", starts=1)
    >>> result = om.evaluate(best.sensor)
    >>> float(result.area_px2.min() / result.area_px2.max()) > 0.8999
    True
    """
    optimum = optimised(problem, merit, starts, seed, resume, on_iteration)
    if not isinstance(optimum, Optimum):
        raise OmnimirrorError(
            f"no mirror of {problem.terms} terms of {problem.family} meets all limits; use "
            "more terms, more starts, or looser limits"
        )
    return optimum


def optimised(
    problem: DesignProblem,
    merit: str,
    starts: int = 4,
    seed: int = 0,
    resume: str | Path | None = None,
    on_iteration: Callable[[Progress], None] | None = None,
) -> Optimum | list[Array]:
    """Optimise like :func:`optimise`, but return end points if no design is feasible."""
    if starts < 1:
        raise InvalidParameter(f"starts must be at least 1; got {starts}")
    space = DesignSpace(problem)
    coarse = Objective(space, merit_named(merit), coarse_nodes(problem))
    header = _header(problem, merit, seed)
    runs = _finished(resume, header)[:starts]
    try:
        for i in range(len(runs), starts):
            on_step = (
                (lambda v, i=i: on_iteration(Progress(i, starts, coarse.shown(v))))
                if on_iteration
                else None
            )
            name, y = _start_of_many(space, merit, i, seed, on_step)
            runs.append(_run(name, _kept_first(coarse, y, on_step), coarse))
            if resume is not None:
                write_text(
                    resume,
                    json.dumps({**header, "runs": [asdict(r) for r in runs]}, indent=1) + "\n",
                )
    except KeyboardInterrupt:
        if not runs:
            raise
    if not any(run.kept for run in runs):
        return [np.array(run.y) for run in runs]
    return replace(_polished(space, merit, runs), is_complete=len(runs) == starts)


def _start_of_many(
    space: DesignSpace, merit: str, index: int, seed: int, on_step: Callable[[float], None] | None
) -> tuple[str, Array]:
    """Return a start; for many knots the optimum with fewer, which avoids local minima."""
    problem = space.problem
    if problem.family != SlopeSpline.KIND or problem.terms <= INITIAL_KNOTS:
        return start(space, index, seed)
    fewer = DesignSpace(replace(problem, terms=max(INITIAL_KNOTS, problem.terms - KNOT_STEP)))
    objective = Objective(fewer, merit_named(merit), coarse_nodes(fewer.problem))
    name, y = _start_of_many(fewer, merit, index, seed, on_step)
    result = _kept_first(objective, y, on_step).y
    try:
        mirror = fewer.sensor(result).mirror
    except OmnimirrorError:  # no valid mirror: start with all knots
        return start(space, index, seed)
    rest = result[fewer.family.terms - 1 :]
    return name, _shaped(space, mirror, np.concatenate([np.zeros(space.dim - rest.size), rest]))


def _kept_first(
    objective: Objective, y: Array, on_step: Callable[[float], None] | None
) -> MinimaxResult:
    """Optimise one start; if infeasible, repeat from the point of minimum violation."""
    result = follow(objective, y, tolerance=CLOSE, on_step=on_step)
    if result.violation < FEASIBILITY_TOLERANCE:
        return result
    keys = objective.requested
    if not keys:
        return result
    minimum = follow(replace(objective, goal=Slack(keys)), result.y, tolerance=CLOSE)
    return (
        follow(objective, minimum.y, tolerance=CLOSE, on_step=on_step)
        if minimum.value < 0
        else result
    )


def _polished(space: DesignSpace, merit: str, runs: list[Run]) -> Optimum:
    """Return the best run, refined over the fine field angles."""
    best = min((r for r in runs if r.kept), key=lambda r: r.value)
    fine = Objective(space, merit_named(merit), np.linspace(0.0, 1.0, FINE))
    optimum = follow(fine, np.array(best.y), tolerance=CLOSER, initial_trust_radius=POLISH_TRUST)
    if not fine.depends_on_focus:
        for _ in range(REFOCUSED):
            optimum = follow(
                fine,
                _focused(space, optimum.y),
                tolerance=CLOSER,
                initial_trust_radius=POLISH_TRUST,
            )
    value = fine.shown(optimum.value)
    sensor = space.sensor(
        optimum.y, f"optimised-{merit.replace('_', '-')}", _notes(space.problem, merit, value)
    )
    return Optimum(space.problem, merit, sensor, value, optimum.y, tuple(runs))


def coarse_nodes(problem: DesignProblem) -> Array:
    """Return the fractions (k,) of the rim radius used in the search."""
    return np.linspace(0.0, 1.0, max(COARSE, 12 * problem.terms + 1))


def follow(objective: Objective, y: Array, **options: Any) -> MinimaxResult:
    """Return the local optimum of an objective near a point."""
    low, high = (np.array(b) for b in objective.space.bounds)
    if not objective.depends_on_focus:  # independent of focus and F-number: keep the initial values
        held = [i for i, name in enumerate(objective.space.names) if name in ("focus", "f_number")]
        low[held] = high[held] = y[held]
    bounds = low, high
    if objective.is_mean:
        options.pop("initial_trust_radius", None)
        return minimise_mean(objective.values, objective.rows, y, bounds, **options)
    return solve_minimax(
        objective.values, objective.rows, y, bounds, objective.is_spread, **options
    )


def _focused(space: DesignSpace, y: Array) -> Array:
    """Return the same mirror (dim,) at its best focus."""
    at_best: Array = space.at_best_focus(y[None], FINE)[0]
    return at_best


def _run(name: str, result: MinimaxResult, objective: Objective) -> Run:
    history = tuple(objective.shown(v) for v in result.history)
    return Run(
        name,
        tuple(result.y.tolist()),
        objective.shown(result.value),
        result.violation < FEASIBILITY_TOLERANCE,
        history,
    )


# -- starts ----------------------------------------------------------------------------------------


def start(space: DesignSpace, index: int, seed: int) -> tuple[str, Array]:
    """Return name and point (dim,) of a start by its number, at its best focus."""
    middle = {
        name: np.sqrt(np.prod(ends(getattr(space.problem, name)))) for name in space.problem.free
    }
    y = np.array([np.log(middle[n]) if n in middle else FIRST.get(n, 0.0) for n in space.names])
    specified = space.given(y[None])
    omega, theta, M = (float(v[0, 0]) for v in (specified.omega_max, specified.theta, specified.M))
    sphere = Sphere(M / float(np.sin((omega - theta) / 2)), M)
    if index == 1:
        mirror: Mirror = Equidistant(float(np.degrees(omega)), float(np.degrees(theta)), M)
        return "equidistant", _shaped(space, mirror, y)
    y = _shaped(space, sphere, y)
    if index == 0:
        return "sphere", y
    rng = np.random.default_rng([seed, index])
    u = space.family.slope_places()[:-1]
    waves = np.cos(np.pi * np.outer(u, np.arange(WAVES))) @ rng.standard_normal(WAVES)
    y[: u.size] *= 1 + HEIGHT * waves * (1 - u**2)
    return f"sphere with waves {index - 1}", y


FIRST = {"focus": 1.0}
"""Coordinates before the mirror is known."""


def _shaped(space: DesignSpace, mirror: Mirror, y: Array) -> Array:
    """Return a point (dim,) with the slopes of a mirror, at its best focus."""
    M, y = mirror.rim_radius_mm, np.array(y)
    u = space.family.slope_places()[:-1]
    y[: u.size] = mirror.slope(u * M)
    if "curvature" in space.names:
        y[space.names.index("curvature")] = M * float(mirror.curvature(0.0))
    return _focused(space, y)


# -- files -----------------------------------------------------------------------------------------


def _header(problem: DesignProblem, merit: str, seed: int) -> dict[str, Any]:
    return {"problem": json.loads(json.dumps(described(problem))), "merit": merit, "seed": seed}


def described(problem: DesignProblem) -> dict[str, Any]:
    """Convert a problem to data for JSON; :func:`problem_from` is the inverse."""
    optics = None if problem.optics is None else lens_table(problem.optics)
    parts = {"housing": housing_tables(problem.housing), "optics": optics}
    plain: dict[str, Any] = json_plain(asdict(replace(problem, optics=None)) | parts)
    return plain


def problem_from(data: dict[str, Any]) -> DesignProblem:
    """Return the problem of data from :func:`described`.

    >>> from omnimirror.optics.housing import CameraBody, Housing
    >>> limits, housing = (Limit("total_blur_px", 4.0),), Housing(CameraBody(30.0))
    >>> problem = DesignProblem(theta_max_deg=(10.0, 14.0), limits=limits, housing=housing)
    >>> problem_from(json.loads(json.dumps(described(problem)))) == problem
    True
    """
    values: dict[str, Any] = _read(data)
    parts = {
        "imager": Imager(**values["imager"]),
        "housing": housing_of(values["housing"], NullLocator()),
    }
    if data.get("optics"):
        parts["optics"] = lens_of(data["optics"], NullLocator(), None)
    return DesignProblem(
        **values | parts | {"limits": tuple(Limit(**limit) for limit in values["limits"])}
    )


def _read(value: Any) -> Any:
    """Convert data from :func:`~omnimirror.base.files.json_plain`, with lists as tuples."""
    if isinstance(value, dict):
        return {k: _read(v) for k, v in value.items()}
    if isinstance(value, list):
        return tuple(_read(v) for v in value)
    return np.inf if value == "inf" else value


def _finished(resume: str | Path | None, header: dict[str, Any]) -> list[Run]:
    """Return the runs of a saved search; empty without a file."""
    if resume is None or not Path(resume).exists():
        return []
    try:
        data = parse_json(read_bytes(resume, MAX_TEXT_BYTES))
        runs = [
            Run(r["start"], tuple(r["y"]), r["value"], r["kept"], tuple(r["history"]))
            for r in data.pop("runs")
        ]
    except (OSError, ValueError, KeyError, TypeError):
        raise OmnimirrorError(
            f"{resume} must be the state of a search, as saved by omnimirror; specify another file"
        ) from None
    if data != header:
        changed = ", ".join(k for k in header if data.get(k) != header[k])
        raise OmnimirrorError(
            f"{resume} must be the state of the same search; {changed} differ; specify another file"
        )
    return runs


def _notes(problem: DesignProblem, merit: str, value: float) -> str:
    q = merit_named(merit).quantity
    message = f"Optimised: {q.title}, {value:.5g} {q.unit}".rstrip()
    distances = " and ".join(f"{d:g}" for d in problem.distances_mm)
    shape = f"{problem.family} of {problem.terms} terms, object at {distances} mm"
    return f"{message}; {shape}, blur by the {problem.mode} form."
