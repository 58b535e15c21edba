"""Requirement checks of arbitrary sensors on the bench, independent of the requirements of their
design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .....analysis.evaluation import Evaluation
from .....base.errors import OmnimirrorError
from .....design.criteria.like import lens_like
from .....design.criteria.merits import values_of_evaluation
from .....design.criteria.requirement_file import requirements_of
from .....design.criteria.requirements import Requirements
from .....design.solve.verdict import Judgement, evaluations, judge
from .....optics.sensor import Sensor
from .....optics.sensor_files import tables_of
from ..messages import BlockValues, JudgementOf, columns_of

DIGITS = 6
ANGLES = 181  # field angles at which limits are evaluated while a slider moves
OWN = ("rim_radius_mm", "focal_length_mm", "theta_max_deg", "f_number")
"""Entries that are checked only if the requirements contain them explicitly."""


def requirements_for(tables: dict[str, Any], sensor: Sensor) -> Requirements:
    """Build requirements from tables; missing parts (mirror, lens, imager) are taken from the
    sensor.

    Raises
    ------
    SpecError
        Invalid tables; the message contains the position and the valid values.
    """
    data = dict(tables)
    data.setdefault("mirror", {"family": "sphere", "rim_radius_mm": sensor.mirror.rim_radius_mm})
    data.setdefault("lens", lens_table(sensor))
    data.setdefault("imager", tables_of(sensor)["imager"])
    return requirements_of(data)


def lens_table(sensor: Sensor) -> dict[str, Any]:
    """Return the lens of a sensor as a table of a requirement file, with rounded numbers."""
    return {name: round(v, DIGITS) if isinstance(v, float) else v for name, v in lens_like(sensor).items()}


@dataclass(frozen=True)
class Judged:
    """Result of a requirement check: achieved values or an error message, and the limited
    quantities."""

    rows: tuple[JudgementOf, ...] = ()
    trouble: str | None = None
    curves: tuple[BlockValues, ...] = ()
    """One block, "limits": limited quantities over the field, named after their rows."""


def judged_by(tables: dict[str, Any], curve: Evaluation) -> Judged:
    """Check an evaluated sensor against requirements from tables, with limits at the same field
    angles."""
    sensor = curve.sensor
    try:
        requirements = requirements_for(tables, sensor)
        rows = rows_of(tables, requirements, sensor, ANGLES)
        curves = limit_curves(requirements, curve)
    except OmnimirrorError as e:
        return Judged(trouble=str(e))
    first = len(rows) - len(requirements.limits)
    return Judged(tuple(_told(row, i - first) for i, row in enumerate(rows)), None, (curves,))


def rows_of(tables: dict[str, Any], requirements: Requirements, sensor: Sensor, angles: int) -> list[Judgement]:
    """Return the checked requirements of the tables; limits last, in their order."""
    asked = {*tables.get("mirror", {}), *tables.get("lens", {})}
    rows = judge(requirements, sensor, angles=angles).rows
    return [row for row in rows if row.name not in OWN or row.name in asked]


def limit_curves(requirements: Requirements, curve: Evaluation) -> BlockValues:
    """Return the limits over the field, the stricter of near and far objects."""
    omega = curve.omega_deg
    fields = [values_of_evaluation(result) for result in evaluations(requirements, curve.sensor, omega)]
    columns = {"omega_deg": omega}
    for limit in requirements.limits:
        values = np.stack([limit.of.values(field) for field in fields])
        if values.shape[1:] == omega.shape:
            columns[limit.name] = (np.max if limit.of.takes == "largest" else np.min)(values, axis=0)
    return columns_of("limits", tuple(columns), np.stack(list(columns.values())))


def _told(row: Judgement, limit: int) -> JudgementOf:
    reached = float(row.reached) if np.isfinite(row.reached) else None
    return JudgementOf(
        name=row.name,
        unit=row.unit,
        at_least=row.at_least,
        at_most=row.at_most,
        reached=reached,
        margin=None if reached is None else float(row.margin),
        is_met=bool(row.is_met) and reached is not None,
        omega_deg=row.omega_deg,
        part_deg=row.part_deg,
        limit=limit if limit >= 0 else None,
    )
