"""What the scatter of a measured profile does to the evaluation: the standard deviation of every column."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..mirrors import SampledProfile
from ..sensor import Sensor

if TYPE_CHECKING:
    from .evaluation import Evaluation

Array = NDArray[np.float64]

SHARE = 1e-4  # of a standard deviation, by which the profile is moved


def standard_deviations(result: Evaluation, columns: tuple[str, ...]) -> dict[str, Array]:
    """Standard deviations (n,) of columns at their field angles; none for a mirror that is not measured.

    The smooth curve is linear in the heights, so each of its independent deviations is tried alone and what it
    changes in the columns is added in quadrature.
    """
    mirror = result.sensor.mirror
    if not (isinstance(mirror, SampledProfile) and len(mirror.fit.deviations)):
        return {}
    sensors = [replace(result.sensor, mirror=m) for m in mirror.deviated(SHARE)]
    nominal, *moved = (_columns(result, sensor, columns) for sensor in sensors)
    return {name: np.sqrt(sum((m[name] - nominal[name]) ** 2 for m in moved)) / SHARE for name in columns}


def _columns(result: Evaluation, sensor: Sensor, columns: tuple[str, ...]) -> dict[str, Array]:
    """Columns of another sensor at the field angles of an evaluation; NaN where it does not see one."""
    from .evaluation import evaluate

    seen = sensor.meridian.sees(np.radians(result.omega_deg))
    p, radius = np.asarray(result.object_distance_mm), result.image_radius_px
    there = evaluate(
        sensor,
        result.omega_deg[seen],
        object_distance_mm=p[seen] if p.size > 1 else p,
        mode=result.mode,
        wavelength_nm=result.wavelength_nm,
        image_radius_px=None if radius is None else radius * sensor.rim_radius_px / result.sensor.rim_radius_px,
    )
    found = {}
    for name in columns:
        found[name] = np.full(len(result), np.nan)
        found[name][seen] = getattr(there, name)
    return found
