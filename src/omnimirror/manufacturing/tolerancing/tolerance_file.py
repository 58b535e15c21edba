"""Tolerance files: errors with costs and correlations, and limits of a good sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ...base.arguments import check_fields, choice, file_name, validate_arguments
from ...base.errors import SpecError
from ...base.escaping import line_comment
from ...base.files import parse_json, parse_toml, read_text
from ...base.project import schema_directive
from ...base.table_models import Table, validated
from ...base.toml_validation import SourceLocator, check_entries, merge_tables
from ...design.limits import LIMITABLE
from ...design.requirement_files import LimitTable, limit_of
from ...optics.mirrors.mirror import MAX_ORDER, MirrorForm
from ...optics.sensor import Sensor
from ..metrology.readers import Unit
from .compensation import Calibration, merit_names
from .evaluator import MeritName, TrialEvaluator, merit_limits
from .mirror_form import LOWEST_ORDER, RandomFigure, figure_tolerances, load_measured_form
from .monte_carlo import check_limits
from .tolerances import (
    GRADES,
    MEASURED,
    Distribution,
    Tolerance,
    Tolerances,
    check_name,
    error_sources,
    measured,
)
from .trial_images import REFOCUS, Refocus

FORMAT = 1
TOLERANCE_ENTRIES: dict[str, type] = {
    "format": int,
    "objects": dict,
    "error": list,
    "correlation": list,
    "limit": list,
    "figure": list,
    "measured": list,
}
"""Entries and tables of a tolerance file with their types."""


class ErrorTable(Table):
    """Error and its tolerance."""

    name: str
    tolerance: Annotated[
        float, Field(ge=0, description="half-width, in the unit at the end of the name")
    ]
    distribution: Distribution = "uniform"
    cost: Annotated[
        float,
        Field(gt=0, description="cost of this tolerance; half the tolerance has twice the cost"),
    ] = 1.0
    max_tolerance: Annotated[float, Field(gt=0, description="upper bound for --yield")] | None = (
        None
    )


class FigureTable(Table):
    """Random form error with a power spectrum."""

    exponent: Annotated[
        float,
        Field(
            ge=0,
            le=10,
            description="exponent of the decrease of the spectral density with frequency",
        ),
    ] = 2.5
    orders: (
        Annotated[list[int], Field(min_length=2, max_length=2, description="[FIRST, LAST]")] | None
    ) = None
    rms_um: Annotated[float, Field(gt=0)] | None = None
    peak_to_valley_um: Annotated[float, Field(gt=0)] | None = None
    slope_mrad: Annotated[float, Field(gt=0)] | None = None
    cost: Annotated[float, Field(gt=0)] = 1.0


class MeasuredTable(Table):
    """Form error measured on a mirror of the same process."""

    name: str
    file: str
    unit: Unit = "mm"
    tolerance: Annotated[
        float, Field(ge=0, description="tolerance as a multiple of the measured form")
    ] = 1.0
    distribution: Distribution = "constant"
    cost: Annotated[float, Field(gt=0)] = 1.0


class CorrelationTable(Table):
    """Correlation of two errors."""

    between: Annotated[list[str], Field(min_length=2, max_length=2, description="two names")]
    value: Annotated[float, Field(ge=-1, le=1)]


class BoundTable(LimitTable):
    """Limit as in requirement files, or limit of a motion after a calibration."""

    after: Calibration = "none"


class ObjectsTable(Table):
    """Objects at which trials are evaluated, and refocusing."""

    field_deg: (
        Annotated[list[float], Field(min_length=2, max_length=2, description="[FROM, TO]")] | None
    ) = None
    angles: Annotated[int, Field(ge=1, le=200)] = 8
    azimuths: Annotated[int, Field(ge=3, le=720)] = 12
    object_distance_mm: Annotated[float, Field(gt=0)] | None = None
    refocus: Refocus = "none"


@dataclass(frozen=True)
class TolerancePlan:
    """Content of a tolerance file.

    Attributes
    ----------
    tolerances
        Tolerances of the errors.
    limits
        Limits by merit name.
    costs
        Costs of tolerances by error source.
    refocus
        Refocusing mode.
    objects
        Field range and number of objects, arguments of
        :func:`omnimirror.manufacturing.tolerancing.trial_images.field_of`.
    max_tolerances
        Maximum tolerances for allocation by error source; those of the coarse grade by default.

    Examples
    --------
    >>> import omnimirror as om
    >>> errors = {"lens.k1": om.Tolerance(0.01)}
    >>> plan = TolerancePlan(om.Tolerances(om.load_sensor("paper-spherical"), errors), {"motion_px": 1.0})
    >>> plan.limits
    {'motion_px': 1.0}
    """

    tolerances: Tolerances
    limits: Mapping[str, float] = field(default_factory=dict)
    costs: Mapping[str, float] = field(default_factory=dict)
    refocus: Refocus = "none"
    objects: Mapping[str, Any] = field(default_factory=dict)
    max_tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        choice("refocus", self.refocus, REFOCUS)
        check_limits(self.limits)


@validate_arguments
def load_tolerances(
    path: str | Path, sensor: Sensor, changes: dict[str, Any] | None = None
) -> TolerancePlan:
    """Read a tolerance file.

    Parameters
    ----------
    path
        TOML file; ``omnimirror tolerance init`` writes a template.
    sensor
        Sensor of the tolerances.
    changes
        Replacements for entries of the file, as for :func:`omnimirror.load_sensor`.

    Returns
    -------
    TolerancePlan
        Content of the file.

    Raises
    ------
    SpecError
        If the file is missing, is not TOML, or has an invalid entry; with file, line and valid values.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/tolerances.toml"
    ...     with open(path, "w") as file:
    ...         _ = file.write(tolerance_template(sensor))
    ...     plan = load_tolerances(path, sensor)
    >>> plan.limits
    {'motion_px after pose': 0.5, 'blur_px': 9.59}
    """
    path = file_name("path", path)
    text = read_text(
        path,
        "tolerance file",
        SpecError,
        f"cannot read the tolerance file {path}: the file does not exist",
    )
    return parse_tolerances(text, sensor, str(path), path.parent, changes)


@validate_arguments
def load_allocated_tolerances(path: str | Path, sensor: Sensor) -> dict[str, float]:
    """Read tolerances by error source for a drawing.

    Parameters
    ----------
    path
        Tolerance file, or the JSON file of ``omnimirror tolerance --json``, from which the allocated
        tolerances are taken, or the initial ones without an allocation.
    sensor
        Sensor of the tolerances.

    Returns
    -------
    dict
        Tolerances by error source.

    Raises
    ------
    SpecError
        If the file is invalid.

    Examples
    --------
    >>> import pathlib, tempfile, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "tolerances.toml")
    ...     _ = path.write_text(tolerance_template(sensor))
    ...     load_allocated_tolerances(path, sensor)["mirror.tilt_x_deg"]
    0.1
    """
    path = file_name("path", path)
    if path.suffix.lower() != ".json":
        plan = load_tolerances(path, sensor)
        return {name: bound.value for name, bound in plan.tolerances.errors.items()}
    text = read_text(
        path,
        "tolerance file",
        SpecError,
        f"cannot read the tolerance file {path}: the file does not exist",
    )
    try:
        data = parse_json(text)
        result = (
            data["allocation"]["tolerances"]
            if data["allocation"]
            else {row["name"]: row["tolerance"] for row in data["sensitivities"]}
        )
        tolerances = {str(name): float(value) for name, value in result.items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise SpecError(f"{path} is not a file of omnimirror tolerance --json") from None
    for name in tolerances:
        if not name.startswith(f"{MEASURED.name}["):
            check_name(name, error_sources(sensor))
    return tolerances


def parse_tolerances(
    text: str,
    sensor: Sensor,
    source: str = "tolerances",
    folder: Path | None = None,
    changes: Mapping[str, Any] | None = None,
) -> TolerancePlan:
    """Parse the text of a tolerance file, with changed entries.

    Referenced files are relative to ``folder`` and require it.

    >>> import omnimirror as om
    >>> text = '[[error]]\\nname = "mirror.tilt_x_deg"\\ntolerance = 0.1'
    >>> parse_tolerances(text, om.load_sensor("paper-spherical")).tolerances.names
    ('mirror.tilt_x_deg',)
    """
    text = text.removeprefix("\ufeff")
    where = SourceLocator(text, source)
    data = merge_tables(parse_toml(text, source), changes or {})
    check_entries(data, TOLERANCE_ENTRIES, FORMAT, where)
    errors, costs, max_tolerances = _errors(data.get("error", []), sensor, where)
    _add_figures(data.get("figure", []), sensor, where, errors, costs)
    forms = _add_measured(data.get("measured", []), sensor, where, folder, errors, costs)
    pairs = [
        validated(CorrelationTable, f"correlation.{i}", table, where)
        for i, table in enumerate(data.get("correlation", []))
    ]
    correlations = {(pair.between[0], pair.between[1]): pair.value for pair in pairs}
    objects = validated(ObjectsTable, "objects", data.get("objects", {}), where).model_dump()
    refocus = objects.pop("refocus")
    if objects["object_distance_mm"] is None:
        del objects["object_distance_mm"]
    tolerances = where.wrap((), lambda: Tolerances(sensor, errors, correlations, forms))
    return TolerancePlan(
        tolerances,
        _limits(data.get("limit", []), sensor, where),
        costs,
        refocus,
        objects,
        max_tolerances,
    )


def _errors(
    tables: list[dict[str, Any]], sensor: Sensor, where: SourceLocator
) -> tuple[dict[str, Tolerance], dict[str, float], dict[str, float]]:
    """Return tolerances, costs and maximum tolerances by error source."""
    sources, errors, costs, max_tolerances = (
        error_sources(sensor),
        dict[str, Tolerance](),
        dict[str, float](),
        dict[str, float](),
    )

    def is_new(name: str) -> None:
        check_name(name, sources)
        if name in errors:
            raise SpecError(f"{name} has two tolerances; remove one")

    for i, table in enumerate(tables):
        entry = validated(ErrorTable, f"error.{i}", table, where)
        where.wrap((f"error.{i}", "name"), partial(is_new, entry.name))
        errors[entry.name] = where.wrap(
            (f"error.{i}", "tolerance"), partial(Tolerance, entry.tolerance, entry.distribution)
        )
        costs[entry.name] = entry.cost
        if entry.max_tolerance is not None:
            if entry.max_tolerance < entry.tolerance:
                raise where.error(
                    (f"error.{i}", "max_tolerance"),
                    f"max_tolerance must be at least the tolerance {entry.tolerance:g}; got {entry.max_tolerance:g}",
                )
            max_tolerances[entry.name] = entry.max_tolerance
    return errors, costs, max_tolerances


def _add_figures(
    tables: list[dict[str, Any]],
    sensor: Sensor,
    where: SourceLocator,
    errors: dict[str, Tolerance],
    costs: dict[str, float],
) -> None:
    """Add the Zernike terms of random figures to the errors."""
    for i, table in enumerate(tables):
        entry = validated(FigureTable, f"figure.{i}", table, where).model_dump()
        cost, orders = entry.pop("cost"), tuple(entry.pop("orders") or (LOWEST_ORDER, MAX_ORDER))
        figure = where.wrap((f"figure.{i}",), partial(RandomFigure, orders=orders, **entry))
        for name, bound in figure_tolerances(sensor.mirror, figure).items():
            if name in errors:
                raise where.error(
                    (f"figure.{i}",), f"{name} has two tolerances; remove it or exclude its order"
                )
            where.wrap((f"figure.{i}",), partial(check_name, name, error_sources(sensor)))
            errors[name] = where.wrap((f"figure.{i}",), partial(Tolerance, bound, "normal"))
            costs[name] = cost


def _add_measured(
    tables: list[dict[str, Any]],
    sensor: Sensor,
    where: SourceLocator,
    folder: Path | None,
    errors: dict[str, Tolerance],
    costs: dict[str, float],
) -> dict[str, MirrorForm]:
    """Add the errors of measured forms and return the forms by name."""
    forms: dict[str, MirrorForm] = {}
    for i, table in enumerate(tables):
        entry = validated(MeasuredTable, f"measured.{i}", table, where)
        if folder is None:
            raise where.error(
                (f"measured.{i}", "file"), "file is not supported in text without a folder"
            )
        if sensor.secondary is not None:
            raise where.error(
                (f"measured.{i}",), "measured forms are supported only for sensors with one mirror"
            )
        if entry.name in forms:
            raise where.error(
                (f"measured.{i}", "name"),
                f"names of measured forms must be unique; got {entry.name!r} twice",
            )
        read = partial(load_measured_form, sensor.mirror, folder / entry.file, entry.unit)
        forms[entry.name] = where.wrap((f"measured.{i}", "file"), read)
        name = measured(entry.name)
        bound = partial(Tolerance, entry.tolerance, entry.distribution)
        errors[name], costs[name] = where.wrap((f"measured.{i}", "tolerance"), bound), entry.cost
    return forms


def _limits(tables: list[dict[str, Any]], sensor: Sensor, where: SourceLocator) -> dict[str, float]:
    """Return limits by merit name."""
    limits: dict[str, float] = {}
    for i, table in enumerate(tables):
        section = f"limit.{i}"
        bound = validated(BoundTable, section, table, where)
        if bound.quantity in LIMITABLE and bound.after == "none":
            requested = {name: value for name, value in table.items() if name != "after"}
            result = merit_limits(limit_of(i, requested, sensor.mount, where))
        else:
            result = _limit_of_trials(bound, section, where)
        where.wrap((section, "quantity"), partial(check_limits, result))
        limits |= result
    return limits


def _limit_of_trials(bound: BoundTable, section: str, where: SourceLocator) -> dict[str, float]:
    """Return the limit of a quantity of as-built sensors."""
    for name in ("omega_deg", "elevation_deg", "cycles_per_px"):
        if getattr(bound, name) is not None:
            raise where.error(
                (section, name),
                f"{name} does not apply to {bound.quantity}, a quantity of the whole image",
            )
    sides = {True: bound.at_least, False: bound.at_most}
    result = {
        MeritName(bound.quantity, is_lower, after=bound.after).text: v
        for is_lower, v in sides.items()
        if v is not None
    }
    if not result:
        raise where.error((section,), f"limit of {bound.quantity} requires at_most or at_least")
    return result


@validate_arguments
def tolerance_template(sensor: Sensor, grade: str = "medium") -> str:
    """Create a commented tolerance file.

    Parameters
    ----------
    sensor
        Sensor of the tolerances.
    grade
        Manufacturing grade, one of
        :data:`~omnimirror.manufacturing.tolerancing.tolerances.GRADES`.

    Returns
    -------
    str
        TOML text.

    Raises
    ------
    InvalidParameter
        If the grade is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> print(tolerance_template(om.load_sensor("paper-spherical"), "fine").splitlines()[1])
    # Tolerances of paper-spherical, grade fine. All values are symmetric (plus or minus).
    """
    choice("grade", grade, GRADES)
    blur = float(
        TrialEvaluator.of(sensor).evaluate({next(iter(error_sources(sensor))): np.zeros(1)})[
            0, merit_names().index("blur_px")
        ]
    )
    head = HEAD.format(
        name=line_comment(sensor.name), grade=grade, blur=blur, max_blur=MORE_BLUR * blur
    )
    lines = [schema_directive("tolerances") + head]
    for kind in error_sources(sensor).values():
        if kind.name.startswith("mirror.zernike") and int(kind.name.split("_")[1]) > LAST_ZERNIKE:
            continue
        typical_tolerances = ", ".join(f"{g} {kind.typical_tolerances[g]:.3g}" for g in GRADES)
        unit = f" {kind.unit}" if kind.unit else ""
        lines.append(
            f'\n[[error]]  # {kind.meaning}; typical{unit}: {typical_tolerances}\nname = "{kind.name}"\n'
            f"tolerance = {float(f'{kind.typical_tolerances[grade]:.3g}')!r}\n"
        )
    return "".join(lines)


LAST_ZERNIKE = 11
MORE_BLUR = 1.2  # default limit relative to the nominal blur
HEAD = """\
# Tolerances of {name}, grade {grade}. All values are symmetric (plus or minus).
#   omnimirror tolerance SENSOR tolerances.toml
format = 1

[objects]
# field_deg = [0, 120]     # default: minimum to 0.97 of the maximum field angle
angles = 8                 # circles of objects over the field
azimuths = 12              # objects per circle
# object_distance_mm = 2000  # default: infinity
refocus = "none"           # "rms" or "worst": refocus each sensor

# Limits of a good sensor. Image motion relative to the nominal sensor:
[[limit]]
quantity = "motion_px"     # or motion_rms_px, direction_error_deg, direction_error_rms_deg
after = "pose"             # residual after calibration: none, principal-point, affine, pose, radial
at_most = 0.5

[[limit]]
quantity = "blur_px"       # nominal: {blur:.3g}
at_most = {max_blur:.3g}

# Limits of all quantities of requirement files, and of quantities of as-built sensors:
#   [[limit]]
#   quantity = "resolution_px_per_deg"   # total_blur_px, aspect, viewpoint_spread_mm, mtf, ...
#   at_least = 4.0
#   omega_deg = [20, 100]
#   [[limit]]
#   quantity = "straightness_deg"        # or field_to_deg (at_least), rim_reach_px, viewpoint_shift_mm
#   after = "affine"
#   at_most = 0.1

# Random form errors with a power spectrum, and a measured form (list of x, y, z in mm):
#   [[figure]]
#   rms_um = 0.3              # or peak_to_valley_um, or slope_mrad
#   orders = [5, 12]          # Zernike orders
#   exponent = 2.5
#   [[measured]]
#   name = "lathe"
#   file = "cmm.csv"          # distribution = "constant" by default: all sensors, tolerance = 1.0 times

# Errors: distribution = "uniform" (default), "normal" (tolerance = 2 sigma), "truncated-normal",
# "arcsine", "constant"; cost = 1.0, of the given tolerance, for --yield; max_tolerance, upper bound for
# --yield (default: grade coarse). Correlated errors:
#   [[correlation]]
#   between = ["mirror.tilt_x_deg", "mirror.decentre_y_mm"]
#   value = 0.7
"""
