"""Feasible ranges of sliders with respect to the requirements."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from .....base.errors import OmnimirrorError
from ..messages import Slide, SlidesAsk, SlidesOf
from .judging import requirements_for, rows_of
from .sensors import in_place, sensor_on_bench

ANGLES = 61
"""Field angles at which limits are evaluated; slider tracks are only a few hundred pixels long."""


def slid(asked: SlidesAsk) -> SlidesOf:
    """Return the relative violation of each requirement for every value of each number, one number
    at a time.

    Raises
    ------
    OmnimirrorError
        Invalid requirements.
    """
    requirements_for(asked.requirements, in_place(sensor_on_bench(asked.tables, asked.follows)))
    return SlidesOf(
        missed=tuple(tuple(_missed(asked, slide, value) for value in slide.values) for slide in asked.slides)
    )


def _missed(asked: SlidesAsk, slide: Slide, value: float) -> tuple[float, ...] | None:
    is_distance = slide.path == ("mount", "mirror_distance_mm")
    try:
        sensor = in_place(sensor_on_bench(_with(asked.tables, slide.path, value), asked.follows and not is_distance))
        rows = rows_of(asked.requirements, requirements_for(asked.requirements, sensor), sensor, ANGLES)
    except OmnimirrorError:
        return None
    return tuple(min(row.shortfall, 0.0) if row.is_met else row.shortfall for row in rows)


def _with(tables: dict[str, Any], path: tuple[str, ...], value: float) -> dict[str, Any]:
    """Return the tables with one number replaced.

    >>> _with({"mirror": {"coefficients": [1.0, 2.0]}}, ("mirror", "coefficients", "1"), 3.0)
    {'mirror': {'coefficients': [1.0, 3.0]}}
    """
    changed = deepcopy(tables)
    place: Any = changed
    *way, last = path
    for step in way:
        place = place.setdefault(step, {})
    if isinstance(place, list):
        place[int(last)] = value
    else:
        place[last] = value
    return changed
