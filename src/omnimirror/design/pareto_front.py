"""Pareto fronts of merits: non-dominated designs of one space of freeform mirrors.

An evolutionary search starts from known mirrors and from mirrors optimised for each merit.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arguments import file_name, instance, validate_arguments
from ..base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from ..base.files import atomic_output, check_file, parse_json
from ..base.results import Columns, Result
from ..base.typing import Array
from ..optics.batch.closed_forms import DEGREE
from ..optics.lenses import BlurMode
from ..optics.sensor import Sensor
from ._design_problem import DesignSpace
from .designer import Design, design_of
from .freeform import FreeformDesignSpace, freeform_notes, problem_of
from .merits import Merit, merit_named
from .optimiser import described, optimise, problem_from, start, violation_rows
from .requirement_check import check_requirements
from .requirement_files import requirements_of
from .requirements import UNNAMED, Requirements

# -- Evolutionary multi-objective optimisation, starting from known mirrors ------------------------

ANGLES = 161  # field angles of every evaluation
MARGIN = 0.1  # extension of the search box beyond the first designs, in every coordinate
REFUSED = 1e6  # merit of an invalid design


@dataclass(frozen=True)
class Contest:
    """Comparison of designs by several merits."""

    space: DesignSpace
    merits: list[Merit]

    def compare(self, y: Array) -> tuple[Array, Array, Array]:
        """Return designs (n, dim) at best focus, merits (n, merits) and violations (n,)."""
        y = self.space.at_best_focus(y, ANGLES)
        result = self.space.evaluate(y, ANGLES)
        field, omega = self.space.field(y, result), result.omega_deg * DEGREE
        hidden = self.space.hidden(field, omega)
        counting = partial(self.space.counting, omega, hidden)
        counted = field.at(counting())
        values = np.stack([m.value(counted) for m in self.merits], axis=1)
        broken = np.where(result.valid, 0.0, 1.0)
        image = self.space.image(self.space.given(y))
        for _, rows in violation_rows(self.space, field, counting, omega, hidden, image):
            broken = np.maximum(broken, rows.max(axis=1))
        usable = result.valid & np.isfinite(values).all(axis=1) & np.isfinite(broken)
        return y, np.where(usable[:, None], values, REFUSED), np.where(usable, broken, 1.0)

    def best_of(self, y: Array) -> tuple[Array, Array]:
        """Return the non-dominated designs (n, dim), sorted by the first merit, and merits."""
        y, values, broken = self.compare(y)
        better: Any = (values[:, None] <= values).all(axis=2) & (values[:, None] < values).any(
            axis=2
        )
        keep = np.flatnonzero((broken <= 0) & ~better[broken <= 0].any(axis=0))
        _, first = np.unique(
            values[keep], axis=0, return_index=True
        )  # sorted by the first merit, without duplicates
        keep = keep[first]
        if not keep.size:
            raise OmnimirrorError(
                "no design meets all limits; use more generations or looser limits, or "
                "optimise a single merit, which reports the conflicts"
            )
        return y[keep], values[keep]


@dataclass(frozen=True)
class Generation:
    """Generation of designs (n, dim) with its search box (2, dim)."""

    number: int
    y: Array
    box: Array


def first_generation(contest: Contest, population: int, seed: int) -> Generation:
    """Return the first generation: known mirrors, single optima, and convex combinations."""
    space = contest.space
    starts = [start(space, i, seed)[1] for i in range(2)]
    for merit in contest.merits:
        with suppress(OmnimirrorError):  # limits that a single start does not meet
            starts.append(optimise(space.problem, merit.name, starts=1, seed=seed).y)
    corners = np.array(starts)
    rng = np.random.default_rng(seed)
    blends = rng.dirichlet(np.full(len(corners), 0.5), max(population - len(corners), 0)) @ corners
    blends *= 1 + 0.003 * rng.standard_normal(blends.shape)
    low, high = space.bounds
    box = np.clip([corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN], low, high)
    return Generation(0, np.clip(np.concatenate([corners, blends])[:population], *box), box)


def evolved(contest: Contest, alive: Generation, generations: int, seed: int) -> Generation:
    """Return the generation after some steps of NSGA-II, or NSGA-III for three or more merits."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.algorithms.moo.nsga3 import NSGA3
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize
    from pymoo.util.ref_dirs import get_reference_directions

    class Comparison(Problem):  # type: ignore[misc]  # base class of a package without types
        def __init__(self) -> None:
            count = len(contest.merits)
            super().__init__(
                n_var=contest.space.dim,
                n_obj=count,
                n_ieq_constr=1,
                xl=alive.box[0],
                xu=alive.box[1],
            )

        def _evaluate(self, y: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
            values, broken = contest.compare(y)[1:]
            out["F"], out["G"] = values, broken[:, None]

    size, count = len(alive.y), len(contest.merits)
    if count == 2:
        algorithm = NSGA2(pop_size=size, sampling=alive.y)
    else:
        steps = next(
            n for n in range(size, 0, -1) if comb(n + count - 1, count - 1) <= size or n == 1
        )
        directions = get_reference_directions("das-dennis", count, n_partitions=steps)
        algorithm = NSGA3(
            ref_dirs=directions, pop_size=max(size, len(directions)), sampling=alive.y
        )
    seed_here = int(np.random.SeedSequence([seed, alive.number]).generate_state(1)[0] >> 1)
    with np.errstate(all="ignore"):
        result = minimize(
            Comparison(), algorithm, ("n_gen", generations + 1), seed=seed_here, verbose=False
        )
    return Generation(alive.number + generations, result.pop.get("X"), alive.box)


# -- Pareto fronts of merits: non-dominated designs of one space of freeform mirrors ---------------

EPOCH = 20  # generations between two saved states
FORMAT = 3
LARGEST_FRONT = 256 << 20  # bytes
MAX_FRONT_VALUES = 20_000_000  # a small file may declare more values than fit into memory


@dataclass(frozen=True)
class Front(Result):
    """Non-dominated designs for several merits, computed by :func:`omnimirror.pareto`.

    Attributes
    ----------
    space
        Design space of freeform mirrors for the requirements.
    merits
        Names of the merits, the columns of ``values``.
    y : (n, dim)
        Designs as points of ``space.designs``, each at its best focus, sorted by the first merit.
    values : (n, merits)
        Merits of the designs.
    is_complete
        False if the evolution was stopped before its last generation.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(optimise="worst_blur_deg", shape="spline:3", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12),
    ... )
    >>> front = om.pareto(requirements, ["worst_blur_deg", "inverse_area_ratio"], population=8, generations=2)
    >>> front.values.shape == (len(front), 2)
    True
    """

    space: FreeformDesignSpace
    merits: tuple[str, ...]
    y: Array
    values: Array
    is_complete: bool = True

    def _table(self) -> Columns:
        columns = {name: self.values[:, i] for i, name in enumerate(self.merits)}
        coordinates = {
            f"y{i} {name}": self.y[:, i] for i, name in enumerate(self.space.designs.names)
        }
        return {**columns, "focus_mm": self.focus_mm, **coordinates}

    def __len__(self) -> int:
        return len(self.y)

    @property
    def requirements(self) -> Requirements:
        """Requirements common to all designs."""
        return self.space.requirements

    @property
    def focus_mm(self) -> Array:
        """Focus distances of the designs (n,)."""
        return self.space.designs.focus_mm(self.y)

    def sensor(self, i: int) -> Sensor:
        """Return design i as a sensor at its best focus.

        Parameters
        ----------
        i
            Index of the design, from 0.

        Returns
        -------
        Sensor
            Focused sensor, named after the merits unless the requirements contain a name.

        Raises
        ------
        InvalidParameter
            If the index is out of range.
        """
        if not -len(self) <= i < len(self):
            raise InvalidParameter(f"the index must be from 0 to {len(self) - 1}; got {i}")
        merits = "-".join(m.replace("_", "-") for m in self.merits)
        name = (
            f"front-{merits}-{i % len(self)}"
            if self.requirements.name == UNNAMED
            else self.requirements.name
        )
        return self.space.designs.sensor(self.y[i], name)

    def design(self, i: int) -> Design:
        """Return design i with its requirement check, as :func:`omnimirror.design_sensor` does.

        Parameters
        ----------
        i
            Index of the design, from 0.

        Returns
        -------
        Design
            Sensor, and one row for each requirement.

        Raises
        ------
        InvalidParameter
            If the index is out of range.
        """
        sensor = self.sensor(i)
        return design_of(
            check_requirements(self.requirements, sensor),
            freeform_notes(self.space.problem, sensor),
        )


@validate_arguments
def pareto(
    requirements: Requirements,
    merits: Sequence[str] = ("worst_floored_area_deg2", "inverse_area_ratio"),
    *,
    population: int = 120,
    generations: int = 200,
    seed: int = 0,
    resume: str | Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    mode: BlurMode = "exact",
    image_radius_px: float | None = None,
) -> Front:
    """Compute the Pareto front of two or more merits.

    Parameters
    ----------
    requirements
        Requirements of an optimised mirror; ``merits`` replace the merit given there.
    merits
        Names of two or more merits, :data:`omnimirror.design.merits.DESIGN_MERITS`.
    population, generations
        Population size and number of generations.
    seed
        Random seed.
    resume
        Parquet file with the generation and the search settings; an interrupted run is resumed from
        it, and :func:`load_front` reads it.
    on_progress
        Callback with the finished and the total number of generations.
    mode, image_radius_px
        As in :func:`omnimirror.evaluate`, for merits and for limits of blur as constraints.

    Returns
    -------
    Front
        Non-dominated designs.

    Raises
    ------
    InvalidParameter
        If the requirements have no optimised mirror, there are fewer than two merits, a merit is
        unknown or repeated, or the population or number of generations is below 1.
    OmnimirrorError
        If pymoo or pyarrow is missing, or the file belongs to another search.
    KeyboardInterrupt
        If interrupted (Ctrl-C) before the first generation is complete; later, the front of the
        last saved generation is returned.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(optimise="worst_blur_deg", shape="polynomial:3", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12),
    ... )
    >>> front = om.pareto(requirements, ["worst_blur_deg", "inverse_area_ratio"], population=10, generations=2)
    >>> bool((np.diff(front.values[:, 0]) > 0).all() and (np.diff(front.values[:, 1]) < 0).all())
    True
    """
    instance("requirements", requirements, Requirements, "requirements")
    if requirements.mirror.optimise is None:
        raise InvalidParameter(
            "a Pareto front requires mirror.optimise, without mapping and family"
        )
    if requirements.lens.focus_mm is not None:
        raise InvalidParameter(
            "focus_mm must be omitted for a Pareto front; each design is evaluated at its best focus"
        )
    if len(set(merits)) < max(len(merits), 2):
        raise InvalidParameter(
            f"merits must be at least two different names; got {', '.join(merits) or 'none'}"
        )
    for name, value in (("population", population), ("generations", generations)):
        if value < 1:
            raise InvalidParameter(f"{name} must be greater than 0; got {value}")
    _needs("pymoo")
    space = FreeformDesignSpace(requirements, problem_of(requirements, mode, image_radius_px))
    contest = Contest(space.designs, [merit_named(m) for m in merits])
    search = {
        "format": FORMAT,
        "problem": described(space.problem),
        "merits": list(merits),
        "population": population,
        "seed": seed,
    }
    alive = _resumed(resume, search) or first_generation(contest, population, seed)
    while alive.number < generations:
        try:
            alive = evolved(contest, alive, min(EPOCH, generations - alive.number), seed)
        except KeyboardInterrupt:
            return _front(space, contest, alive, is_complete=False)
        if resume is not None:
            _write(Path(resume), search, space, contest, alive)
        if on_progress:
            on_progress(alive.number, generations)
    return _front(space, contest, alive)


def _front(
    space: FreeformDesignSpace, contest: Contest, alive: Generation, *, is_complete: bool = True
) -> Front:
    """Return the front of a generation."""
    y, values = contest.best_of(alive.y)
    return Front(space, tuple(m.name for m in contest.merits), y, values, is_complete)


# -- files -----------------------------------------------------------------------------------------


@validate_arguments
def load_front(path: str | Path) -> Front:
    """Read a front from a file written by :func:`pareto`.

    Parameters
    ----------
    path
        File name.

    Returns
    -------
    Front
        Saved front.

    Raises
    ------
    OmnimirrorError
        If pyarrow is missing, or the file is invalid.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(optimise="worst_blur_deg", shape="spline:3", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12),
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     front = om.pareto(requirements, population=8, generations=1, resume=f"{folder}/front.parquet")
    ...     len(om.load_front(f"{folder}/front.parquet")) == len(front)
    True
    """
    search, tables, alive = _read(file_name("path", path))
    space = FreeformDesignSpace(requirements_of(tables), problem_from(search["problem"]))
    return _front(space, Contest(space.designs, [merit_named(m) for m in search["merits"]]), alive)


def _write(
    path: Path,
    search: dict[str, Any],
    space: FreeformDesignSpace,
    contest: Contest,
    alive: Generation,
) -> None:
    """Write one row per design: merits, focus and coordinates; search settings as metadata."""
    _needs("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    focused, values, broken = contest.compare(alive.y)
    columns: dict[str, Any] = {m.name: values[:, i] for i, m in enumerate(contest.merits)}
    columns |= {"limits_kept": broken <= 0, "focus_mm": contest.space.focus_mm(focused)}
    columns |= {f"y{i} {name}": alive.y[:, i] for i, name in enumerate(contest.space.names)}
    about = {**search, "generation": alive.number, "box": alive.box.tolist()}
    about["requirements"] = space.requirements.tables()
    table = pa.table(columns).replace_schema_metadata({"omnimirror": json.dumps(about)})
    with atomic_output(path) as temporary:
        pq.write_table(table, temporary)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any], Generation]:
    """Read the search settings, the requirement tables and the generation."""
    _needs("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        check_file(path, LARGEST_FRONT)
        metadata = pq.read_metadata(path)
        if metadata.num_rows * metadata.num_columns > MAX_FRONT_VALUES:
            raise ValueError
        table = pq.read_table(path)
        about = parse_json(table.schema.metadata[b"omnimirror"])
        tables = about.pop("requirements")
        y = np.column_stack([table[n].to_numpy() for n in table.column_names if n.startswith("y")])
        alive = Generation(about.pop("generation"), y, np.array(about.pop("box")))
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        raise OmnimirrorError(f"{path} must be a Pareto front written by omnimirror") from None
    return about, tables, alive


def _resumed(path: str | Path | None, search: dict[str, Any]) -> Generation | None:
    if path is None or not Path(path).exists():
        return None
    about, _, alive = _read(file_name("path", path))
    if about != json.loads(json.dumps(search)):
        changed = ", ".join(k for k in search if about.get(k) != json.loads(json.dumps(search[k])))
        raise OmnimirrorError(
            f"{path} must be the state of the same search; {changed} differ; specify another file"
        )
    return alive


def _needs(package: str) -> None:
    try:
        import_module(package)
    except ImportError:
        raise OmnimirrorError(
            f"Pareto fronts require {package}: {extra_remedy('design')}"
        ) from None
