"""The tolerance file: errors, what they cost, how they hang together, and what a good sensor stays within."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ...arguments import check_fields, checked, choice, file_name
from ...design.criteria.limits import LIMITABLE
from ...design.criteria.requirement_file import LimitTable, limit_of
from ...errors import SpecError
from ...escaping import line_comment
from ...files import parse_json, parse_toml, read_text
from ...mirrors.form import LARGEST_ORDER, MirrorForm
from ...sensor import Sensor
from ...specs import Places, Table, check_entries, validated
from ..metrology.readers import Unit
from .compensation import Calibration, merit_names
from .evaluator import Judge
from .mirror_form import LOWEST_ORDER, RandomFigure, figure_of, measured_form
from .monte_carlo import check_limits
from .perturbation import GRADES, MEASURED, check_name, errors_of, measured
from .requirement_merits import MeritName, names_of
from .tolerances import Distribution, ErrorBound, Tolerances
from .trial_images import REFOCUS, Refocus

FORMAT = 1


class ErrorTable(Table):
    """An error and its tolerance."""

    name: str
    tolerance: Annotated[float, Field(ge=0, description="plus or minus, in the unit that the name ends with")]
    distribution: Distribution = "uniform"
    price: Annotated[float, Field(gt=0, description="of this tolerance; half of it costs twice as much")] = 1.0
    widest: Annotated[float, Field(gt=0, description="to which --yield may widen it")] | None = None


class FigureTable(Table):
    """A random figure of a power spectrum."""

    exponent: Annotated[float, Field(ge=0, le=10, description="by which the spectral density falls")] = 2.5
    orders: Annotated[list[int], Field(min_length=2, max_length=2, description="[FIRST, LAST]")] | None = None
    rms_um: Annotated[float, Field(gt=0)] | None = None
    peak_to_valley_um: Annotated[float, Field(gt=0)] | None = None
    slope_mrad: Annotated[float, Field(gt=0)] | None = None
    price: Annotated[float, Field(gt=0)] = 1.0


class MeasuredTable(Table):
    """A form that was measured on a mirror of this making."""

    name: str
    file: str
    unit: Unit = "mm"
    tolerance: Annotated[float, Field(ge=0, description="how many times the form")] = 1.0
    distribution: Distribution = "always"
    price: Annotated[float, Field(gt=0)] = 1.0


class CorrelationTable(Table):
    """Two errors that come together."""

    between: Annotated[list[str], Field(min_length=2, max_length=2, description="two names")]
    value: Annotated[float, Field(ge=-1, le=1)]


class BoundTable(LimitTable):
    """What a good sensor stays within, as requirements have it; or what is left of a motion after a calibration."""

    after: Calibration = "none"


class JudgedTable(Table):
    """What is looked at."""

    field_deg: Annotated[list[float], Field(min_length=2, max_length=2, description="[FROM, TO]")] | None = None
    angles: Annotated[int, Field(ge=1, le=200)] = 8
    azimuths: Annotated[int, Field(ge=3, le=720)] = 12
    object_distance_mm: Annotated[float, Field(gt=0)] | None = None
    refocus: Refocus = "none"


@dataclass(frozen=True)
class TolerancePlan:
    """What a tolerance file says.

    Attributes
    ----------
    tolerances
        Of the errors.
    limits
        Largest values by names of merits.
    prices
        Of tolerances, by the names of errors.
    refocus
        Whether each sensor is focused.
    judged
        Field and number of objects, as :func:`omnimirror.manufacturing.tolerancing.object_field.field_of` takes them.
    widest
        How wide tolerances may become where a yield is wanted, by the names of errors; as a coarse shop holds them by
        default.

    Examples
    --------
    >>> import omnimirror as om
    >>> errors = {"lens.k1": om.ErrorBound(0.01)}
    >>> plan = TolerancePlan(om.Tolerances(om.load_sensor("paper-spherical"), errors), {"motion_px": 1.0})
    >>> plan.limits
    {'motion_px': 1.0}
    """

    tolerances: Tolerances
    limits: Mapping[str, float] = field(default_factory=dict)
    prices: Mapping[str, float] = field(default_factory=dict)
    refocus: Refocus = "none"
    judged: Mapping[str, Any] = field(default_factory=dict)
    widest: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        choice("refocus", self.refocus, REFOCUS)
        check_limits(self.limits)


@checked
def load_tolerances(path: str | Path, sensor: Sensor) -> TolerancePlan:
    """Read the tolerances of a sensor.

    Parameters
    ----------
    path
        Of a TOML file; ``omnimirror tolerance init`` writes one.
    sensor
        Whose they are.

    Returns
    -------
    TolerancePlan
        What it says.

    Raises
    ------
    SpecError
        No such file; not TOML; an unknown, missing or wrong entry, with file and line and what would be valid.

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
    text = read_text(path, "tolerance file", SpecError, f"there is no tolerance file {str(path)!r}")
    return parse_tolerances(text, sensor, str(path), path.parent)


@checked
def allocated_tolerances(path: str | Path, sensor: Sensor) -> dict[str, float]:
    """Tolerances by the names of their errors, for a drawing.

    Parameters
    ----------
    path
        A tolerance file; or the JSON that ``omnimirror tolerance --json`` writes, whose allocated tolerances are taken
        if a yield was asked for, and those that were tried otherwise.
    sensor
        Whose they are.

    Returns
    -------
    dict
        Plus and minus, in the units that the names end with.

    Raises
    ------
    SpecError
        A file that is neither, or names an error that the sensor cannot have.

    Examples
    --------
    >>> import pathlib, tempfile, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "tolerances.toml")
    ...     _ = path.write_text(tolerance_template(sensor))
    ...     allocated_tolerances(path, sensor)["mirror.tilt_x_deg"]
    0.1
    """
    path = file_name("path", path)
    if path.suffix.lower() != ".json":
        plan = load_tolerances(path, sensor)
        return {name: bound.value for name, bound in plan.tolerances.errors.items()}
    text = read_text(path, "tolerance file", SpecError, f"there is no tolerance file {str(path)!r}")
    try:
        data = parse_json(text)
        found = data["allocation"]["tolerances"] if data["allocation"] else {
            row["name"]: row["tolerance"] for row in data["sensitivities"]
        }  # fmt: skip
        tolerances = {str(name): float(value) for name, value in found.items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise SpecError(f"{path} is not what omnimirror tolerance --json writes") from None
    for name in tolerances:
        if not name.startswith(f"{MEASURED.name}["):
            check_name(name, errors_of(sensor))
    return tolerances


def parse_tolerances(
    text: str, sensor: Sensor, source: str = "tolerances", folder: Path | None = None
) -> TolerancePlan:
    """Tolerances from the text of a file; ``folder`` is where those that it names are, without one it may name none.

    >>> import omnimirror as om
    >>> text = '[[error]]\\nname = "mirror.tilt_x_deg"\\ntolerance = 0.1'
    >>> parse_tolerances(text, om.load_sensor("paper-spherical")).tolerances.names
    ('mirror.tilt_x_deg',)
    """
    text = text.removeprefix("\ufeff")
    where = Places(text, source)
    data = parse_toml(text, source)
    known: dict[str, type] = {"format": int, "judged": dict, "error": list, "correlation": list, "limit": list}
    known |= {"figure": list, "measured": list}
    check_entries(data, known, FORMAT, where)
    errors, prices, widest = _errors(data.get("error", []), sensor, where)
    _add_figures(data.get("figure", []), sensor, where, errors, prices)
    forms = _add_measured(data.get("measured", []), sensor, where, folder, errors, prices)
    pairs = [
        validated(CorrelationTable, f"correlation.{i}", table, where)
        for i, table in enumerate(data.get("correlation", []))
    ]
    correlations = {(pair.between[0], pair.between[1]): pair.value for pair in pairs}
    judged = validated(JudgedTable, "judged", data.get("judged", {}), where).model_dump()
    refocus = judged.pop("refocus")
    judged["object_distance_mm"] = judged["object_distance_mm"] or np.inf
    tolerances = where.wrap((), lambda: Tolerances(sensor, errors, correlations, forms))
    return TolerancePlan(tolerances, _limits(data.get("limit", []), sensor, where), prices, refocus, judged, widest)


def _errors(
    tables: list[dict[str, Any]], sensor: Sensor, where: Places
) -> tuple[dict[str, ErrorBound], dict[str, float], dict[str, float]]:
    """Tolerances, prices and how wide they may become, by the names of errors."""
    known, errors, prices, widest = errors_of(sensor), dict[str, ErrorBound](), dict[str, float](), dict[str, float]()

    def is_new(name: str) -> None:
        check_name(name, known)
        if name in errors:
            raise SpecError(f"{name} has a tolerance already; leave one out")

    for i, table in enumerate(tables):
        entry = validated(ErrorTable, f"error.{i}", table, where)
        where.wrap((f"error.{i}", "name"), partial(is_new, entry.name))
        errors[entry.name] = where.wrap(
            (f"error.{i}", "tolerance"), partial(ErrorBound, entry.tolerance, entry.distribution)
        )
        prices[entry.name] = entry.price
        if entry.widest is not None:
            if entry.widest < entry.tolerance:
                raise where.error(
                    (f"error.{i}", "widest"),
                    f"widest = {entry.widest:g} is below the tolerance {entry.tolerance:g}, which it is valid from",
                )
            widest[entry.name] = entry.widest
    return errors, prices, widest


def _add_figures(
    tables: list[dict[str, Any]], sensor: Sensor, where: Places, errors: dict[str, ErrorBound], prices: dict[str, float]
) -> None:
    """The Zernike terms of random figures, beside other errors."""
    for i, table in enumerate(tables):
        entry = validated(FigureTable, f"figure.{i}", table, where).model_dump()
        price, orders = entry.pop("price"), tuple(entry.pop("orders") or (LOWEST_ORDER, LARGEST_ORDER))
        figure = where.wrap((f"figure.{i}",), partial(RandomFigure, orders=orders, **entry))
        for name, bound in figure_of(sensor.mirror, figure).items():
            if name in errors:
                raise where.error((f"figure.{i}",), f"{name} has a tolerance already; leave it out, or its order")
            where.wrap((f"figure.{i}",), partial(check_name, name, errors_of(sensor)))
            errors[name] = where.wrap((f"figure.{i}",), partial(ErrorBound, bound, "normal"))
            prices[name] = price


def _add_measured(
    tables: list[dict[str, Any]],
    sensor: Sensor,
    where: Places,
    folder: Path | None,
    errors: dict[str, ErrorBound],
    prices: dict[str, float],
) -> dict[str, MirrorForm]:
    """Forms that were measured, by their names; their errors beside others."""
    forms: dict[str, MirrorForm] = {}
    for i, table in enumerate(tables):
        entry = validated(MeasuredTable, f"measured.{i}", table, where)
        if folder is None:
            raise where.error((f"measured.{i}", "file"), "file names another file, and text from here may name none")
        if sensor.secondary is not None:
            raise where.error((f"measured.{i}",), "measured forms are errors of sensors of one mirror")
        if entry.name in forms:
            raise where.error(
                (f"measured.{i}", "name"), f"there is a form {entry.name!r} already; give it another name"
            )
        read = partial(measured_form, sensor.mirror, folder / entry.file, entry.unit)
        forms[entry.name] = where.wrap((f"measured.{i}", "file"), read)
        name = measured(entry.name)
        bound = partial(ErrorBound, entry.tolerance, entry.distribution)
        errors[name], prices[name] = where.wrap((f"measured.{i}", "tolerance"), bound), entry.price
    return forms


def _limits(tables: list[dict[str, Any]], sensor: Sensor, where: Places) -> dict[str, float]:
    """Largest values by the names of merits, and least ones."""
    limits: dict[str, float] = {}
    for i, table in enumerate(tables):
        section = f"limit.{i}"
        bound = validated(BoundTable, section, table, where)
        if bound.quantity in LIMITABLE and bound.after == "none":
            asked = {name: value for name, value in table.items() if name != "after"}
            found = names_of(limit_of(i, asked, sensor.mount, where))
        else:
            found = _limit_of_trials(bound, section, where)
        where.wrap((section, "quantity"), partial(check_limits, found))
        limits |= found
    return limits


def _limit_of_trials(bound: BoundTable, section: str, where: Places) -> dict[str, float]:
    """A limit of what sensors without errors have none of."""
    for name in ("omega_deg", "elevation_deg", "cycles_per_px"):
        if getattr(bound, name) is not None:
            raise where.error(
                (section, name), f"{name} does not apply to {bound.quantity}, which is of the whole picture"
            )
    sides = {True: bound.at_least, False: bound.at_most}
    found = {MeritName(bound.quantity, least, after=bound.after).text: v for least, v in sides.items() if v is not None}
    if not found:
        raise where.error((section,), f"limit of {bound.quantity} says neither at_most nor at_least")
    return found


@checked
def tolerance_template(sensor: Sensor, grade: str = "medium") -> str:
    """A commented tolerance file to start from.

    Parameters
    ----------
    sensor
        Whose it is.
    grade
        Of the shop: one of :data:`~omnimirror.manufacturing.tolerancing.perturbation.GRADES`.

    Returns
    -------
    str
        TOML.

    Raises
    ------
    InvalidParameter
        A word that is no grade.

    Examples
    --------
    >>> import omnimirror as om
    >>> print(tolerance_template(om.load_sensor("paper-spherical"), "fine").splitlines()[0])
    # Tolerances of paper-spherical, as a shop of the grade fine holds them. Values are plus or minus.
    """
    choice("grade", grade, GRADES)
    blur = float(
        Judge.of(sensor).judged({next(iter(errors_of(sensor))): np.zeros(1)})[0, merit_names().index("blur_px")]
    )
    lines = [HEAD.format(name=line_comment(sensor.name), grade=grade, blur=blur, most_blur=MORE_BLUR * blur)]
    for kind in errors_of(sensor).values():
        if kind.name.startswith("mirror.zernike") and int(kind.name.split("_")[1]) > LAST_ZERNIKE:
            continue
        usual = ", ".join(f"{g} {kind.usual[g]:.3g}" for g in GRADES)
        unit = f" {kind.unit}" if kind.unit else ""
        lines.append(
            f'\n[[error]]  # {kind.meaning}; shops hold{unit}: {usual}\nname = "{kind.name}"\n'
            f"tolerance = {float(f'{kind.usual[grade]:.3g}')!r}\n"
        )
    return "".join(lines)


LAST_ZERNIKE = 11
MORE_BLUR = 1.2  # times that of a sensor without errors, as a start
HEAD = """\
# Tolerances of {name}, as a shop of the grade {grade} holds them. Values are plus or minus.
#   omnimirror tolerance SENSOR tolerances.toml
format = 1

[judged]
# field_deg = [0, 120]     # from its smallest to .97 of its largest field angle by default
angles = 8                 # circles of objects over the field
azimuths = 12              # objects on each
# object_distance_mm = 2000
refocus = "none"           # or "rms", "worst": each sensor is focused anew

# A good sensor stays within all of these. The picture moves against that of a sensor without errors:
[[limit]]
quantity = "motion_px"     # or motion_rms_px, direction_error_deg, direction_error_rms_deg
after = "pose"             # what a calibration leaves of it: none, principal-point, affine, pose, radial
at_most = 0.5

[[limit]]
quantity = "blur_px"       # without errors {blur:.3g}
at_most = {most_blur:.3g}

# And of anything that requirements limit, in their words, over the whole picture; or of what is built alone:
#   [[limit]]
#   quantity = "resolution_px_per_deg"   # total_blur_px, aspect, viewpoint_spread_mm, mtf, ..
#   at_least = 4.0
#   omega_deg = [20, 100]
#   [[limit]]
#   quantity = "straightness_deg"        # or field_to_deg (at_least), rim_reach_px, viewpoint_shift_mm
#   after = "affine"
#   at_most = 0.1

# Form errors of a power spectrum, and one that was measured on a mirror of this making (x, y, z by the line, in mm):
#   [[figure]]
#   rms_um = 0.3              # or peak_to_valley_um, or slope_mrad; of Zernike terms of these orders
#   orders = [5, 12]
#   exponent = 2.5
#   [[measured]]
#   name = "lathe"
#   file = "cmm.csv"          # distribution = "always" by default: every sensor has it, tolerance = 1.0 times

# Errors: distribution = "uniform" (default), "normal" (the tolerance is two sigma), "truncated", "end-heavy", "always";
# price = 1.0 of a tolerance as it stands, for --yield; widest = how wide it may become then, as a coarse shop holds it
# by default. Those that come together:
#   [[correlation]]
#   between = ["mirror.tilt_x_deg", "mirror.decentre_y_mm"]
#   value = 0.7
"""
