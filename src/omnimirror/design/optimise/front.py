"""Trade-offs: the designs of which none is better by every merit, found by an evolution on the batch evaluator.

The first generation holds known mirrors, the optima of each merit by itself, and blends of them; NSGA-II
(NSGA-III for three merits and more) spreads them along the front. It runs in epochs, each with its own
seed, and the generation after each is kept: a run that was stopped goes on as if it had not been.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...analysis import best_focus, evaluate
from ...arguments import file_name
from ...batch.optics import DEGREE
from ...errors import InvalidParameter, OmnimirrorError
from ...files import replacing
from ...numerics.lazy import cached_property
from ...sensor import Sensor
from ..criteria.merits import Merit, merit_named, values_of_evaluation
from .objective import requirements_of
from .optimiser import described, optimise, problem_from, start
from .problem import DesignProblem
from .variables import DesignSpace

Array = NDArray[np.float64]

ANGLES = 161  # of every evaluation
EPOCH = 20  # generations between two files
MARGIN = 0.1  # of the box of designs beyond the first ones, in every coordinate
REFUSED = 1e6  # merit of a design that cannot be used
FORMAT = 2


@dataclass(frozen=True)
class Front:
    """Designs of which none is better than another by every merit.

    Parameters
    ----------
    problem
        What is designed, and what is free.

    Attributes
    ----------
    merits
        Names of the merits, the columns of ``values``.
    y : (n, dim)
        The designs as points of the design space, each at its own best focus, sorted by the first merit.
    values : (n, merits)
        Their merits.
    is_complete
        False where the evolution was stopped before its last generation.

    Examples
    --------
    >>> import omnimirror as om
    >>> front = om.pareto(om.DesignProblem(terms=3), population=8, generations=2)
    >>> front.values.shape == (len(front), 2)
    True
    """

    problem: DesignProblem
    merits: tuple[str, ...]
    y: Array
    values: Array
    is_complete: bool = True

    def __len__(self) -> int:
        return len(self.y)

    @cached_property
    def _space(self) -> DesignSpace:
        return DesignSpace(self.problem)

    @property
    def focus_mm(self) -> Array:
        """Where each design is focused (n,)."""
        return self._space.focus_mm(self.y)

    def sensor(self, i: int) -> Sensor:
        """Design i as an ordinary sensor, at its best focus.

        Parameters
        ----------
        i
            Number of the design, from 0.

        Returns
        -------
        Sensor
            The sensor, in focus.

        Raises
        ------
        InvalidParameter
            There is no such design.
        """
        if not -len(self) <= i < len(self):
            raise InvalidParameter(f"the front has no design {i}; it has {len(self)}, from 0")
        name = "-".join(m.replace("_", "-") for m in self.merits)
        return self._space.sensor(self.y[i], f"front-{name}-{i % len(self)}")


def merit_values(
    sensor: Sensor, merits: Sequence[str], problem: DesignProblem, focus_by: str | None = "worst_floored_area_deg2"
) -> Array:
    """The merits (n,) of any sensor, computed as the problem says.

    ``focus_by`` is one of the merits that :func:`omnimirror.best_focus` knows, or None for the sensor's own focus.
    """
    sensor.check_one_mirror("comparing with a front")
    rim = sensor.mirror.rim_radius_mm
    least = float(sensor.meridian.x_from_omega(np.radians(max(problem.omega_min_deg, sensor.field_deg[0]))))
    common: dict[str, Any] = {
        "mode": problem.mode, "image_radius_px": problem.image_radius_px, "wavelength_nm": problem.wavelength_nm
    }  # fmt: skip
    x, distances = np.linspace(least, rim, 1001), np.array(problem.distances_mm)
    if focus_by is not None:
        omega = np.degrees(sensor.meridian.trace(x).omega)
        angles, far = np.tile(omega, distances.size), np.repeat(distances, omega.size)
        best = best_focus(sensor, focus_by, omega_deg=angles, object_distance_mm=far, **common)
        sensor = replace(sensor, lens=sensor.lens.focused_at(best.focus_mm))
    results = [evaluate(sensor, x_mm=x, object_distance_mm=d, **common) for d in distances]
    values = np.array([[merit_named(m).value(values_of_evaluation(r)) for m in merits] for r in results])
    means = np.array([merit_named(m).is_mean for m in merits])
    joined: Array = np.where(means, values.mean(axis=0), values.max(axis=0))
    return joined


def pareto(
    problem: DesignProblem,
    merits: Sequence[str] = ("worst_floored_area_deg2", "inverse_area_ratio"),
    *,
    population: int = 120,
    generations: int = 200,
    seed: int = 0,
    resume: str | Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Front:
    """The front of two or more merits.

    Parameters
    ----------
    problem
        What is designed, and what is free.
    merits
        Names of two or more merits.
    population, generations
        Designs that live together, and how often they have offspring.
    seed
        Of everything drawn at random.
    resume
        A Parquet file that holds the generation and what it was made for; an interrupted run goes on from it, and
        :func:`load_front` reads it.
    on_progress
        Called with generations done and generations in all.

    Returns
    -------
    Front
        Designs of which none is better by all merits.

    Raises
    ------
    InvalidParameter
        Fewer than two merits, an unknown or repeated one; a population or number of generations below 1.
    OmnimirrorError
        pymoo or pyarrow is not installed, or the file belongs to another search.
    KeyboardInterrupt
        Stopped (Ctrl-C) before the first generation lived; later, the front of the last one kept is returned.

    Examples
    --------
    >>> problem = DesignProblem(family="even-polynomial", terms=3)
    >>> front = pareto(problem, ("worst_floored_area_deg2", "inverse_area_ratio"), population=10, generations=2)
    >>> bool((np.diff(front.values[:, 0]) > 0).all() and (np.diff(front.values[:, 1]) < 0).all())
    True
    """
    if problem.focus_mm is not None:
        raise InvalidParameter("the designs of a front are compared each at its own best focus; leave out focus_mm")
    if len(set(merits)) < max(len(merits), 2):
        raise InvalidParameter(f"a front needs two different merits or more; given were {', '.join(merits) or 'none'}")
    for name, value in (("population", population), ("generations", generations)):
        if value < 1:
            raise InvalidParameter(f"{name} = {value} is not valid; it must be above 0")
    _needs("pymoo")
    contest = _Contest(DesignSpace(problem), [merit_named(m) for m in merits])
    search = {
        "format": FORMAT, "problem": described(problem), "merits": list(merits), "population": population,
        "seed": seed,
    }  # fmt: skip
    alive = _resumed(resume, search) or _first_generation(contest, population, seed)
    while alive.generation < generations:
        try:
            alive = _epoch(contest, alive, min(EPOCH, generations - alive.generation), seed)
        except KeyboardInterrupt:
            return replace(contest.front(alive.y), is_complete=False)
        if resume is not None:
            _write(Path(resume), search, contest, alive)
        if on_progress:
            on_progress(alive.generation, generations)
    return contest.front(alive.y)


@dataclass(frozen=True)
class _Contest:
    """What designs are compared by."""

    space: DesignSpace
    merits: list[Merit]

    def compare(self, y: Array) -> tuple[Array, Array, Array]:
        """Designs (n, dim) at their best focus, their merits (n, merits), and by what share they miss a limit (n,)."""
        y = self.space.at_best_focus(y, ANGLES)
        result = self.space.evaluate(y, ANGLES)
        field, omega = self.space.field(y, result), result.omega_deg * DEGREE
        hidden = self.space.hidden(field, omega)
        counting = partial(self.space.counting, omega, hidden)
        counted = field.at(counting())
        values = np.stack([m.value(counted) for m in self.merits], axis=1)
        broken = np.where(result.valid, 0.0, 1.0)
        image = self.space.image(self.space.given(y))
        for _, rows in requirements_of(self.space, field, counting, omega, hidden, image):
            broken = np.maximum(broken, rows.max(axis=1))
        usable = result.valid & np.isfinite(values).all(axis=1) & np.isfinite(broken)
        return y, np.where(usable[:, None], values, REFUSED), np.where(usable, broken, 1.0)

    def front(self, y: Array) -> Front:
        """Those designs (n, dim) of which none is better by every merit."""
        y, values, broken = self.compare(y)
        better: Any = (values[:, None] <= values).all(axis=2) & (values[:, None] < values).any(axis=2)
        keep = np.flatnonzero((broken <= 0) & ~better[broken <= 0].any(axis=0))
        _, first = np.unique(values[keep], axis=0, return_index=True)  # sorted by the first merit, each but once
        keep = keep[first]
        if not keep.size:
            raise InvalidParameter(
                "no design found that keeps all limits; allow more generations or looser limits, or optimise one merit "
                "alone, which says what conflicts"
            )
        return Front(self.space.problem, tuple(m.name for m in self.merits), y[keep], values[keep])


@dataclass(frozen=True)
class _Alive:
    """A generation (n, dim), and the box (2, dim) that it lives in."""

    generation: int
    y: Array
    box: Array


def _first_generation(contest: _Contest, population: int, seed: int) -> _Alive:
    """Known mirrors, the optimum of each merit, and blends of these."""
    space = contest.space
    known = [start(space, i, seed)[1] for i in range(2)]
    for merit in contest.merits:
        with suppress(InvalidParameter):  # limits that one start does not meet
            known.append(optimise(space.problem, merit.name, starts=1, seed=seed).y)
    corners = np.array(known)
    rng = np.random.default_rng(seed)
    blends = rng.dirichlet(np.full(len(corners), 0.5), max(population - len(corners), 0)) @ corners
    blends *= 1 + 0.003 * rng.standard_normal(blends.shape)
    low, high = space.bounds
    box = np.clip([corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN], low, high)
    return _Alive(0, np.clip(np.concatenate([corners, blends])[:population], *box), box)


def _epoch(contest: _Contest, alive: _Alive, generations: int, seed: int) -> _Alive:
    """Some generations later."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.algorithms.moo.nsga3 import NSGA3
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize
    from pymoo.util.ref_dirs import get_reference_directions

    class Comparison(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            count = len(contest.merits)
            super().__init__(n_var=contest.space.dim, n_obj=count, n_ieq_constr=1, xl=alive.box[0], xu=alive.box[1])

        def _evaluate(self, y: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
            values, broken = contest.compare(y)[1:]
            out["F"], out["G"] = values, broken[:, None]

    size, count = len(alive.y), len(contest.merits)
    if count == 2:
        algorithm = NSGA2(pop_size=size, sampling=alive.y)
    else:
        steps = next(n for n in range(size, 0, -1) if comb(n + count - 1, count - 1) <= size or n == 1)
        directions = get_reference_directions("das-dennis", count, n_partitions=steps)
        algorithm = NSGA3(ref_dirs=directions, pop_size=max(size, len(directions)), sampling=alive.y)
    seed_here = int(np.random.SeedSequence([seed, alive.generation]).generate_state(1)[0] >> 1)
    with np.errstate(all="ignore"):
        found = minimize(Comparison(), algorithm, ("n_gen", generations + 1), seed=seed_here, verbose=False)
    return _Alive(alive.generation + generations, found.pop.get("X"), alive.box)


# -- files -----------------------------------------------------------------------------------------


def load_front(path: str | Path) -> Front:
    """The front of a file that :func:`pareto` wrote.

    Parameters
    ----------
    path
        Name of the file.

    Returns
    -------
    Front
        The front as it was written.

    Raises
    ------
    OmnimirrorError
        pyarrow is not installed, or the file is no such file.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     front = om.pareto(om.DesignProblem(terms=3), population=8, generations=1, resume=f"{folder}/front.parquet")
    ...     len(om.load_front(f"{folder}/front.parquet")) == len(front)
    True
    """
    search, alive = _read(file_name("path", path))
    merits = [merit_named(m) for m in search["merits"]]
    return _Contest(DesignSpace(problem_from(search["problem"])), merits).front(alive.y)


def _write(path: Path, search: dict[str, Any], contest: _Contest, alive: _Alive) -> None:
    """One row per design: its merits, focus and coordinates; what it was made for as metadata."""
    _needs("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    focused, values, broken = contest.compare(alive.y)
    columns: dict[str, Any] = {m.name: values[:, i] for i, m in enumerate(contest.merits)}
    columns |= {"limits_kept": broken <= 0, "focus_mm": contest.space.focus_mm(focused)}
    columns |= {f"y{i} {name}": alive.y[:, i] for i, name in enumerate(contest.space.names)}
    about = {**search, "generation": alive.generation, "box": alive.box.tolist()}
    table = pa.table(columns).replace_schema_metadata({"omnimirror": json.dumps(about)})
    with replacing(path) as temporary:
        pq.write_table(table, temporary)


def _read(path: Path) -> tuple[dict[str, Any], _Alive]:
    _needs("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        about = json.loads(table.schema.metadata[b"omnimirror"])
        y = np.column_stack([table[n].to_numpy() for n in table.column_names if n.startswith("y")])
        alive = _Alive(about.pop("generation"), y, np.array(about.pop("box")))
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        raise OmnimirrorError(f"{path} is not a front that omnimirror wrote") from None
    return about, alive


def _resumed(path: str | Path | None, search: dict[str, Any]) -> _Alive | None:
    if path is None or not Path(path).exists():
        return None
    about, alive = _read(file_name("path", path))
    if about != json.loads(json.dumps(search)):
        changed = ", ".join(k for k in search if about.get(k) != json.loads(json.dumps(search[k])))
        raise OmnimirrorError(f"{path} belongs to another search ({changed} differ); name another file")
    return alive


def _needs(package: str) -> None:
    try:
        import_module(package)
    except ImportError:
        raise OmnimirrorError(
            f"fronts need {package}, which is not installed: pip install 'omnimirror[design]'"
        ) from None
