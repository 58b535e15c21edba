"""Requirement checks of arbitrary sensors in the Design tab, and feasible ranges of sliders."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...analysis.evaluation import Evaluation
from ...base.errors import InvalidParameter, OmnimirrorError
from ...design.merits import values_of_evaluation
from ...design.mirror_construction import FAMILIES
from ...design.optimiser import IMAGE
from ...design.relaxation import Conflict, Relaxation, relaxed
from ...design.requirement_check import RequirementCheck, check_requirements, evaluations
from ...design.requirement_files import lens_like, requirements_of
from ...design.requirements import Requirements
from ...optics.image_sensor import Imager
from ...optics.mirrors import Ellipsoid, EvenPolynomial
from ...optics.mirrors.mappings import MAPPINGS
from ...optics.sensor import Sensor
from ...optics.sensor_files import tables_of
from ._design_sensors import aligned_sensor, sensor_from_tables
from .design_messages import (
    BlockValues,
    RelaxationOption,
    RelaxedValue,
    RequirementResult,
    SliderRequest,
    SliderValues,
    SliderViolations,
    columns_of,
)

# -- Requirement checks ----------------------------------------------------------------------------

DIGITS = 6
CHECK_ANGLES = 181  # field angles at which limits are evaluated while a slider moves
OF_MAPPINGS = ("plane_distance_mm", "cylinder_radius_mm", "omega_deg", "height")
"""Entries of mappings in addition to field and rim."""
OWN = ("rim_radius_mm", "focal_length_mm", "theta_max_deg", "f_number")
"""Entries that are checked only if the requirements contain them explicitly."""


def requirements_for(tables: dict[str, Any], sensor: Sensor) -> Requirements:
    """Build requirements from tables; a missing lens or imager is that of the sensor, and a missing
    mirror any mirror of its rim radius, for checks only.

    Raises
    ------
    SpecError
        If the tables are invalid; the message contains the position and the valid values.
    """
    data = dict(tables)
    data.setdefault("mirror", {"family": "sphere", "rim_radius_mm": sensor.mirror.rim_radius_mm})
    data.setdefault("lens", lens_table(sensor))
    data.setdefault("imager", tables_of(sensor)["imager"])
    return requirements_of(data)


def mirror_table(sensor: Sensor) -> dict[str, Any]:
    """Return the family or mapping of a mirror as a table of a requirement file.

    Raises
    ------
    InvalidParameter
        If the mirror has neither.

    Examples
    --------
    >>> import omnimirror as om
    >>> mirror_table(om.load_sensor("exact-equidistant"))
    {'mapping': 'equidistant', 'rim_radius_mm': 43.9}
    """
    mirror = sensor.mirror
    kind, own = mirror.KIND, {"rim_radius_mm": mirror.rim_radius_mm}
    if kind == Ellipsoid.KIND:
        return {"family": kind, "conic": round(mirror.conic, DIGITS), **own}  # type: ignore[attr-defined]  # an ellipsoid
    if kind in FAMILIES:
        return {"family": kind, **own}
    if isinstance(mirror, EvenPolynomial):
        return {"family": f"polynomial:{len(mirror.coefficients)}", **own}
    if kind in MAPPINGS:
        entries = {name: getattr(mirror, name) for name in OF_MAPPINGS if hasattr(mirror, name)}
        return {"mapping": kind, **entries, **own}
    raise InvalidParameter(
        f"a requirement file requires a family or a mapping; got a {kind} mirror; choose another "
        "type of mirror or open a requirement file with [mirror]"
    )


def lens_table(sensor: Sensor) -> dict[str, Any]:
    """Return the lens of a sensor as a table of a requirement file, with rounded numbers."""
    return {
        name: round(v, DIGITS) if isinstance(v, float) else v
        for name, v in lens_like(sensor).items()
    }


@dataclass(frozen=True)
class CheckResult:
    """Result of a requirement check: achieved values or an error message, and the limited
    quantities."""

    rows: tuple[RequirementResult, ...] = ()
    error: str | None = None
    curves: tuple[BlockValues, ...] = ()
    """One block, "limits": limited quantities over the field, named after their rows."""


UNCHECKED = CheckResult()


def check_evaluation(tables: dict[str, Any], curve: Evaluation) -> CheckResult:
    """Check an evaluated sensor against requirements from tables, with limits at the same field
    angles."""
    sensor = curve.sensor
    try:
        requirements = requirements_for(tables, sensor)
        rows = rows_of(tables, requirements, sensor, CHECK_ANGLES)
        curves = limit_curves(requirements, curve)
    except OmnimirrorError as e:
        return CheckResult(error=str(e))
    first = len(rows) - len(requirements.limits)
    return CheckResult(
        tuple(_result_row(row, i - first) for i, row in enumerate(rows)), None, (curves,)
    )


def rows_of(
    tables: dict[str, Any], requirements: Requirements, sensor: Sensor, angles: int
) -> list[RequirementCheck]:
    """Return the checked requirements of the tables; limits last, in their order."""
    requested = {*tables.get("mirror", {}), *tables.get("lens", {})}
    rows = check_requirements(requirements, sensor, angles=angles).rows
    return [row for row in rows if row.name not in OWN or row.name in requested]


def limit_curves(requirements: Requirements, curve: Evaluation) -> BlockValues:
    """Return the limits over the field, the stricter of near and far objects."""
    omega = curve.omega_deg
    fields = [
        values_of_evaluation(result) for result in evaluations(requirements, curve.sensor, omega)
    ]
    columns = {"omega_deg": omega}
    for limit in requirements.limits:
        values = np.stack([limit.of.values(field) for field in fields])
        if values.shape[1:] == omega.shape:
            columns[limit.name] = (np.max if limit.of.takes == "largest" else np.min)(
                values, axis=0
            )
    return columns_of("limits", tuple(columns), np.stack(list(columns.values())))


def _result_row(row: RequirementCheck, limit: int) -> RequirementResult:
    value = float(row.reached) if np.isfinite(row.reached) else None
    return RequirementResult(
        name=row.name,
        unit=row.unit,
        at_least=row.at_least,
        at_most=row.at_most,
        value=value,
        margin=None if value is None else float(row.margin),
        is_met=bool(row.is_met) and value is not None,
        omega_deg=row.omega_deg,
        part_deg=row.part_deg,
        limit=limit if limit >= 0 else None,
    )


# -- Relaxations of infeasible requirements --------------------------------------------------------


def relaxation_options(
    tables: dict[str, Any], requirements: Requirements, conflict: Conflict | None
) -> tuple[RelaxationOption, ...]:
    """Return the individual relaxations, smallest first, and the joint one, with the tables of the
    relaxed requirements.

    Parameters
    ----------
    tables, requirements
        Requested requirements.
    conflict
        Result of the search for relaxations; None if all requirements are met.
    """
    if conflict is None:
        return ()
    groups: list[tuple[Relaxation, ...]] = [(relaxation,) for relaxation in conflict.alone]
    if len(conflict.joint) > 1:
        groups.append(conflict.joint)
    return tuple(
        RelaxationOption(
            values=tuple(
                RelaxedValue(
                    name=r.name,
                    unit=r.unit,
                    requested=r.requested,
                    needed=r.requested if r.needed is None else r.needed,
                )
                for r in group
            ),
            requirements=relaxed_tables(tables, requirements, group),
        )
        for group in groups
        if all(r.is_changed for r in group)
    )


def relaxed_tables(
    tables: dict[str, Any], requirements: Requirements, relaxations: Sequence[Relaxation]
) -> dict[str, Any]:
    """Return the tables with some requirements relaxed."""
    result = deepcopy(tables)
    changed = relaxed(requirements, relaxations)
    for r in relaxations:
        if r.limit is not None:
            limit = changed.limits[r.limit]
            for side in ("at_least", "at_most"):
                if (bound := getattr(limit, side)) is not None:
                    result["limit"][r.limit][side] = bound
        elif r.name == IMAGE:
            result["imager"] = tables_of_imager(changed.imager)
        else:
            section = next(
                name
                for name in ("field", "mirror", "lens")
                if hasattr(getattr(requirements, name), r.name)
            )
            result.setdefault(section, {})[r.name] = r.needed
    return result


def tables_of_imager(imager: Imager) -> dict[str, Any]:
    """Return an imager as a table of a requirement file."""
    return {name: value for name, value in asdict(imager).items() if value is not None}


# -- Feasible ranges of sliders --------------------------------------------------------------------

SLIDER_ANGLES = 61
"""Field angles at which limits are evaluated; slider tracks are only a few hundred pixels long."""


def slider_violations(requested: SliderRequest) -> SliderViolations:
    """Return the relative violation of each requirement for every value of each number, one number
    at a time.

    Raises
    ------
    OmnimirrorError
        If the requirements are invalid.
    """
    requirements_for(
        requested.requirements,
        aligned_sensor(sensor_from_tables(requested.tables, requested.follows_mapping)),
    )
    return SliderViolations(
        violations=tuple(
            tuple(_missed(requested, slide, value) for value in slide.values)
            for slide in requested.sliders
        )
    )


def _missed(
    requested: SliderRequest, slide: SliderValues, value: float
) -> tuple[float, ...] | None:
    is_distance = slide.path == ("mount", "mirror_distance_mm")
    try:
        sensor = aligned_sensor(
            sensor_from_tables(
                _with(requested.tables, slide.path, value),
                requested.follows_mapping and not is_distance,
            )
        )
        rows = rows_of(
            requested.requirements,
            requirements_for(requested.requirements, sensor),
            sensor,
            SLIDER_ANGLES,
        )
    except OmnimirrorError:
        return None
    return tuple(min(row.shortfall, 0.0) if row.is_met else row.shortfall for row in rows)


def _with(tables: dict[str, Any], path: tuple[str, ...], value: float) -> dict[str, Any]:
    """Return the tables with one number replaced.

    >>> _with({"mirror": {"coefficients": [1.0, 2.0]}}, ("mirror", "coefficients", "1"), 3.0)
    {'mirror': {'coefficients': [1.0, 3.0]}}
    """
    changed = deepcopy(tables)
    table: Any = changed
    *way, last = path
    for step in way:
        table = table.setdefault(step, {})
    if isinstance(table, list):
        table[int(last)] = value
    else:
        table[last] = value
    return changed
