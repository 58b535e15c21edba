"""Mirrors of free form that are best by one merit: several starts, each followed to its optimum.

The starts are mirrors that do the job already: the sphere, the exact equidistant mirror, then the sphere
with seeded waves. Each is pressed down by :mod:`.minimax` on a coarse set of field angles, the best one
once more on a fine set. Derivatives are complex steps through closed forms, exact to rounding.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter, OmnimirrorError
from ..files import write_text
from ..mirrors import Equidistant, Mirror, Sphere
from ..sensor import Sensor
from .batch import evaluate_designs
from .merits import merit_named
from .minimax import Minimum, least_mean, least_worst
from .objective import Objective, check_limits
from .problem import DesignProblem, DesignSpace, ends

Array = NDArray[np.float64]

COARSE, FINE = 241, 1201  # field angles of the search and of the last polish
POLISH_TRUST = 1e-3
CLOSE, CLOSER = 1e-6, 1e-7  # relative gains that end the search, and the polish
WAVES, HEIGHT = 4, 0.05  # of the starts that are not known mirrors: how many, and their relative height
KEPT = 1e-6  # largest violation of a constraint that counts as kept


@dataclass(frozen=True)
class Run:
    """One start followed to its end.

    Attributes
    ----------
    start
        Which mirror it started from.
    y
        Where it ended in the design space.
    value
        The merit there, over the coarse field angles.
    kept
        Whether all constraints are.
    history
        The merit after each step.
    """

    start: str
    y: tuple[float, ...]
    value: float
    kept: bool
    history: tuple[float, ...]


@dataclass(frozen=True)
class Progress:
    """Told after each step: which start out of how many, and how good it is by now."""

    run: int
    runs: int
    value: float


@dataclass(frozen=True)
class Optimum:
    """The best design found, and how it was found.

    Attributes
    ----------
    sensor
        An ordinary sensor, focused where the merit is least.
    value
        The merit over 1201 field angles, in its unit.
    runs
        Every start, the first being the sphere.
    """

    problem: DesignProblem
    merit: str
    sensor: Sensor
    value: float
    y: Array
    runs: tuple[Run, ...]


def optimise(
    problem: DesignProblem,
    merit: str = "blur_area",
    *,
    limits: Mapping[str, float] | None = None,
    starts: int = 4,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Optimum:
    """The mirror, distance, focus and F-number with the least merit.

    Parameters
    ----------
    merit
        One of :data:`omnimirror.design.merits.MERITS`.
    limits
        Other merits, and the numbers that they may not exceed.
    starts, seed
        From how many mirrors to start; the third and later ones are drawn with the seed.
    checkpoint
        A file that keeps finished starts; a search that was stopped goes on where it was.

    Raises
    ------
    InvalidParameter
        An unknown merit, a limit that is none, no start; or no design found that keeps all constraints.

    Examples
    --------
    >>> best = optimise(DesignProblem(family="even-polynomial", terms=3), "blur", starts=1)
    >>> best.sensor.mirror.KIND, round(best.value, 3)
    ('even-polynomial', 0.635)
    """
    limits = dict(limits or {})
    check_limits(limits)
    if starts < 1:
        raise InvalidParameter(f"starts = {starts} is not valid; at least one is needed")
    space = DesignSpace(problem)
    coarse = Objective(space, merit_named(merit), np.linspace(0.0, 1.0, max(COARSE, 12 * problem.terms + 1)), limits)
    header = _header(problem, merit, limits, seed)
    runs = _finished(checkpoint, header)[:starts]
    for i in range(len(runs), starts):
        name, y = start(space, i, seed)
        said = (lambda v, i=i: on_progress(Progress(i, starts, coarse.shown(v)))) if on_progress else None
        found = _follow(coarse, y, tolerance=CLOSE, on_step=said)
        runs.append(_run(name, found, coarse))
        if checkpoint is not None:
            write_text(checkpoint, json.dumps({**header, "runs": [asdict(r) for r in runs]}, indent=1) + "\n")
    return _best(space, merit, limits, runs)


def _best(space: DesignSpace, merit: str, limits: Mapping[str, float], runs: list[Run]) -> Optimum:
    """The best run, polished over the fine field angles."""
    kept = [r for r in runs if r.kept]
    if not kept:
        raise InvalidParameter(
            f"no mirror found with {space.problem.terms} terms of {space.problem.family} that keeps all limits; "
            "allow more terms, more starts, or looser limits"
        )
    best = min(kept, key=lambda r: r.value)
    fine = Objective(space, merit_named(merit), np.linspace(0.0, 1.0, FINE), limits)
    found = _follow(fine, np.array(best.y), tolerance=CLOSER, first_trust=POLISH_TRUST)
    y, value = found.y, fine.shown(found.value)
    if not fine.is_about_sharpness:
        y = _focused(space, y)
    sensor = space.sensor(y, f"optimised-{merit.replace('_', '-')}", _notes(space.problem, merit, limits, value))
    return Optimum(space.problem, merit, sensor, value, y, tuple(runs))


def _follow(objective: Objective, y: Array, **options: Any) -> Minimum:
    bounds = objective.space.bounds
    if not objective.is_about_sharpness:  # any focus would do: keep the start's, and find the best one in the end
        i = objective.space.names.index("focus")
        low, high = (np.concatenate([b[:i], y[i : i + 1], b[i + 1 :]]) for b in bounds)
        bounds = low, high
    if objective.merit.is_mean:
        options.pop("first_trust", None)
        return least_mean(objective.values, objective.rows, y, bounds, **options)
    return least_worst(objective.values, objective.rows, y, bounds, objective.merit.is_spread, **options)


def _focused(space: DesignSpace, y: Array) -> Array:
    """The same mirror at its own best focus."""
    design = space.designs(y)
    focus = float(evaluate_designs(design, FINE).focus_mm[0])
    return space.with_focus(y, focus)


def _run(name: str, found: Minimum, objective: Objective) -> Run:
    history = tuple(objective.shown(v) for v in found.history)
    return Run(name, tuple(found.y.tolist()), objective.shown(found.value), found.violation < KEPT, history)


# -- starts ----------------------------------------------------------------------------------------


def start(space: DesignSpace, index: int, seed: int) -> tuple[str, Array]:
    """The start of that number, its name and its point (dim,), at its own best focus."""
    p = space.problem
    theta, F = (float(np.sqrt(np.prod(ends(r)))) for r in (p.theta_max_deg, p.f_number))
    beta = np.radians(p.omega_max_deg - theta) / 2
    sphere = Sphere(p.rim_radius_mm / float(np.sin(beta)), p.rim_radius_mm)
    if index == 0:
        return "sphere", _point(space, sphere, theta, F)
    if index == 1:
        return "equidistant", _point(space, Equidistant(p.omega_max_deg, theta, p.rim_radius_mm), theta, F)
    rng = np.random.default_rng([seed, index])
    y = _point(space, sphere, theta, F)
    u = space.family.slope_places()[:-1]
    waves = np.cos(np.pi * np.outer(u, np.arange(WAVES))) @ rng.standard_normal(WAVES)
    y[: u.size] *= 1 + HEIGHT * waves * (1 - u**2)
    return f"sphere with waves {index - 1}", y


def _point(space: DesignSpace, mirror: Mirror, theta_max_deg: float, f_number: float) -> Array:
    """The point (dim,) whose slopes are those of a mirror."""
    M = space.problem.rim_radius_mm
    coordinates = {
        "curvature": M * float(mirror.curvature(0.0)),
        "conic": 0.0,
        "focus": 1.0,
        "theta_max_deg": np.log(theta_max_deg),
        "f_number": np.log(f_number),
    }
    slopes = mirror.slope(space.family.slope_places()[:-1] * M)
    y = np.concatenate([slopes, [coordinates[name] for name in space.names[slopes.size :]]])
    return _focused(space, y)


# -- checkpoints -----------------------------------------------------------------------------------


def _header(problem: DesignProblem, merit: str, limits: Mapping[str, float], seed: int) -> dict[str, Any]:
    described = json.loads(json.dumps(asdict(problem)).replace("Infinity", '"inf"'))
    return {"problem": described, "merit": merit, "limits": dict(limits), "seed": seed}


def _finished(checkpoint: str | Path | None, header: dict[str, Any]) -> list[Run]:
    """The runs of a checkpoint of the same search; none where there is no file yet."""
    if checkpoint is None or not Path(checkpoint).exists():
        return []
    try:
        data = json.loads(Path(checkpoint).read_text(encoding="utf-8"))
        runs = [Run(r["start"], tuple(r["y"]), r["value"], r["kept"], tuple(r["history"])) for r in data.pop("runs")]
    except (OSError, ValueError, KeyError, TypeError):
        raise OmnimirrorError(f"{checkpoint} is not a checkpoint of a search; name another file") from None
    if data != header:
        changed = ", ".join(k for k in header if data.get(k) != header[k])
        raise OmnimirrorError(f"{checkpoint} belongs to another search ({changed} differ); name another file")
    return runs


def _notes(problem: DesignProblem, merit: str, limits: Mapping[str, float], value: float) -> str:
    m = merit_named(merit)
    kept = "".join(f", {k} at most {v:g} {merit_named(k).unit}".rstrip() for k, v in limits.items())
    found = f"Optimised: {m.meaning}, {value:.5g} {m.unit}".rstrip()
    shape = f"{problem.family} of {problem.terms} terms, object at {problem.object_distance_mm:g} mm"
    return f"{found}{kept}; {shape}, blur by the {problem.mode} form."
