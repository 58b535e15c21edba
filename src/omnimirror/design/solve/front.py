"""What merits cost each other: designs of one space of free forms of which none is better than another by all."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked, file_name, instance
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.files import check_file, parse_json, replacing
from ...optics.lenses import BlurMode
from ...optics.sensor import Sensor
from ..criteria.merits import merit_named
from ..criteria.requirement_file import requirements_of
from ..criteria.requirements import UNNAMED, Requirements
from ..optimise.evolution import Contest, Generation, evolved, first_generation
from ..optimise.optimiser import described, problem_from
from .designer import Design, design_of
from .freeform import FreeFormSpace, free_form_notes, problem_of
from .verdict import judge

Array = NDArray[np.float64]

EPOCH = 20  # generations between two files
FORMAT = 3
LARGEST_FRONT = 256 << 20  # bytes
MOST_FRONT_VALUES = 20_000_000  # a short file may declare more than the memory holds


@dataclass(frozen=True)
class Front:
    """Designs of which none is better than another by every merit; :func:`omnimirror.pareto` finds them.

    Attributes
    ----------
    space
        The mirrors of free form that the requirements leave.
    merits
        Names of the merits, the columns of ``values``.
    y : (n, dim)
        The designs as points of ``space.designs``, each at its own best focus, sorted by the first merit.
    values : (n, merits)
        Their merits.
    is_complete
        False where the evolution was stopped before its last generation.

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

    space: FreeFormSpace
    merits: tuple[str, ...]
    y: Array
    values: Array
    is_complete: bool = True

    def __len__(self) -> int:
        return len(self.y)

    @property
    def requirements(self) -> Requirements:
        """What is asked of all designs."""
        return self.space.requirements

    @property
    def focus_mm(self) -> Array:
        """Where each design is focused (n,)."""
        return self.space.designs.focus_mm(self.y)

    def sensor(self, i: int) -> Sensor:
        """Design i as an ordinary sensor, at its best focus.

        Parameters
        ----------
        i
            Number of the design, from 0.

        Returns
        -------
        Sensor
            The sensor, in focus, named after the merits where the requirements give no name.

        Raises
        ------
        InvalidParameter
            There is no such design.
        """
        if not -len(self) <= i < len(self):
            raise InvalidParameter(f"the front has no design {i}; it has {len(self)}, from 0")
        merits = "-".join(m.replace("_", "-") for m in self.merits)
        name = f"front-{merits}-{i % len(self)}" if self.requirements.name == UNNAMED else self.requirements.name
        return self.space.designs.sensor(self.y[i], name)

    def design(self, i: int) -> Design:
        """Design i, judged: the same as :func:`omnimirror.design_sensor` answers.

        Parameters
        ----------
        i
            Number of the design, from 0.

        Returns
        -------
        Design
            The sensor, and a row for each requirement.

        Raises
        ------
        InvalidParameter
            There is no such design.
        """
        sensor = self.sensor(i)
        return design_of(judge(self.requirements, sensor), free_form_notes(self.space.problem, sensor))


@checked
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
    """The front of two or more merits.

    Parameters
    ----------
    requirements
        Those of an optimised mirror; ``merits`` stand in the place of the one that they name.
    merits
        Names of two or more merits, :data:`omnimirror.design.criteria.merits.DESIGN_MERITS`.
    population, generations
        Designs that live together, and how often they have offspring.
    seed
        Of everything drawn at random.
    resume
        A Parquet file that holds the generation and what it was made for; an interrupted run goes on from it, and
        :func:`load_front` reads it.
    on_progress
        Called with generations done and generations in all.
    mode, image_radius_px
        As :func:`omnimirror.evaluate` takes them: merits, and limits of blur while they are kept, are computed so.

    Returns
    -------
    Front
        Designs of which none is better by all merits.

    Raises
    ------
    InvalidParameter
        The mirror is not one to optimise; fewer than two merits, an unknown or repeated one; a population or number
        of generations below 1.
    OmnimirrorError
        pymoo or pyarrow is not installed, or the file belongs to another search.
    KeyboardInterrupt
        Stopped (Ctrl-C) before the first generation lived; later, the front of the last one kept is returned.

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
            "a front is one of optimised mirrors; give mirror.optimise, and neither mapping nor family"
        )
    if requirements.lens.focus_mm is not None:
        raise InvalidParameter("the designs of a front are compared each at its own best focus; leave out focus_mm")
    if len(set(merits)) < max(len(merits), 2):
        raise InvalidParameter(f"a front needs two different merits or more; given were {', '.join(merits) or 'none'}")
    for name, value in (("population", population), ("generations", generations)):
        if value < 1:
            raise InvalidParameter(f"{name} = {value} is not valid; it must be above 0")
    _needs("pymoo")
    space = FreeFormSpace(requirements, problem_of(requirements, mode, image_radius_px))
    contest = Contest(space.designs, [merit_named(m) for m in merits])
    search = {
        "format": FORMAT, "problem": described(space.problem), "merits": list(merits), "population": population,
        "seed": seed,
    }  # fmt: skip
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


def _front(space: FreeFormSpace, contest: Contest, alive: Generation, *, is_complete: bool = True) -> Front:
    """The best of a generation."""
    y, values = contest.best_of(alive.y)
    return Front(space, tuple(m.name for m in contest.merits), y, values, is_complete)


# -- files -----------------------------------------------------------------------------------------


@checked
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
    space = FreeFormSpace(requirements_of(tables), problem_from(search["problem"]))
    return _front(space, Contest(space.designs, [merit_named(m) for m in search["merits"]]), alive)


def _write(path: Path, search: dict[str, Any], space: FreeFormSpace, contest: Contest, alive: Generation) -> None:
    """One row per design: its merits, focus and coordinates; what it was made for as metadata."""
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
    with replacing(path) as temporary:
        pq.write_table(table, temporary)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any], Generation]:
    """What the search was for, the tables of its requirements, and the designs that live."""
    _needs("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        check_file(path, LARGEST_FRONT)
        metadata = pq.read_metadata(path)
        if metadata.num_rows * metadata.num_columns > MOST_FRONT_VALUES:
            raise ValueError
        table = pq.read_table(path)
        about = parse_json(table.schema.metadata[b"omnimirror"])
        tables = about.pop("requirements")
        y = np.column_stack([table[n].to_numpy() for n in table.column_names if n.startswith("y")])
        alive = Generation(about.pop("generation"), y, np.array(about.pop("box")))
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        raise OmnimirrorError(f"{path} is not a front that omnimirror wrote") from None
    return about, tables, alive


def _resumed(path: str | Path | None, search: dict[str, Any]) -> Generation | None:
    if path is None or not Path(path).exists():
        return None
    about, _, alive = _read(file_name("path", path))
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
