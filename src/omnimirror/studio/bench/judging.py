"""Requirements against a sensor that was not made from them: any on the bench."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...design.criteria.like import lens_like
from ...design.criteria.requirement_file import requirements_of
from ...design.criteria.requirements import Requirements
from ...design.solve.verdict import Judgement, judge
from ...errors import OmnimirrorError
from ...sensor import Sensor
from ...specs import tables_of
from .messages import JudgementOf

DIGITS = 6
ANGLES = 181  # at which limits are looked at while a slider moves
OWN = ("rim_radius_mm", "focal_length_mm", "theta_max_deg", "f_number")
"""Entries that are judged only where the requirements themselves have them."""


def requirements_for(tables: dict[str, Any], sensor: Sensor) -> Requirements:
    """Requirements from their tables; what they leave out (mirror, lens, imager) is the sensor's.

    Raises
    ------
    SpecError
        They are wrong; the message says where and what would be valid.
    """
    data = dict(tables)
    data.setdefault("mirror", {"family": "sphere", "rim_radius_mm": sensor.mirror.rim_radius_mm})
    data.setdefault("lens", lens_table(sensor))
    data.setdefault("imager", tables_of(sensor)["imager"])
    return requirements_of(data)


def lens_table(sensor: Sensor) -> dict[str, Any]:
    """The lens of a sensor as a requirement file states it, in numbers that people read."""
    return {name: round(v, DIGITS) if isinstance(v, float) else v for name, v in lens_like(sensor).items()}


def verdict_rows(tables: dict[str, Any], sensor: Sensor) -> tuple[tuple[JudgementOf, ...], str | None]:
    """Every requirement with what the sensor reaches, and why they cannot be judged, if they cannot."""
    try:
        requirements = requirements_for(tables, sensor)
        rows = judge(requirements, sensor, angles=ANGLES).rows
    except OmnimirrorError as e:
        return (), str(e)
    asked = {*tables.get("mirror", {}), *tables.get("lens", {})}
    shown = [row for row in rows if row.name not in OWN or row.name in asked]
    first = len(shown) - len(requirements.limits)
    return tuple(_told(row, i - first) for i, row in enumerate(shown)), None


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
