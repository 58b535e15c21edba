"""Results reported by designs, and the corresponding evaluations."""

from __future__ import annotations

import numpy as np

import omnimirror as om
from omnimirror.design import Design, RequirementCheck, Requirements, Verdict
from omnimirror.design._parameter_search import RangeSearch


def row(design: Design | Verdict, name: str) -> RequirementCheck:
    """Return a row of a design table by name."""
    return next(r for r in design.rows if r.name == name)


def evaluated_merits(sensor: om.Sensor, angles: int = 4001, **options) -> dict[str, float]:
    """Return the merits of a sensor by om.evaluate at equidistant field angles, other than those of
    the optimiser."""
    r = om.evaluate(sensor, np.linspace(*sensor.field_deg, angles), **options)
    sine = np.sin(np.radians(r.omega_deg))

    def mean(values: np.ndarray) -> float:
        return np.trapezoid(values, r.omega_deg)

    return {
        "worst_floored_area_deg2": r.floored_area_deg2.max(),
        "mean_floored_area_deg2": mean(r.floored_area_deg2 * sine) / mean(sine),
        "worst_blur_deg": max(np.abs(r.blur_t_deg).max(), np.abs(r.blur_s_deg).max()),
        "worst_blur_rss_deg": np.hypot(r.blur_t_deg, r.blur_s_deg).max(),
        "worst_blur_t_deg": np.abs(r.blur_t_deg).max(),
        "worst_blur_s_deg": np.abs(r.blur_s_deg).max(),
        "inverse_area_ratio": r.area_px2.max() / r.area_px2.min(),
        "worst_aspect": np.exp(np.abs(np.log(r.aspect)).max()),
        "viewpoint_spread_mm": np.ptp(r.viewpoint_z_mm),
        "total_track_mm": sensor.lens.image_distance
        + sensor.mirror_distance_mm
        + float(sensor.mirror.sag(43.9)),
    }


def best(requirements: Requirements) -> Verdict:
    """Return the verdict of the best sensor with a mapping or family mirror, without relaxations."""
    return RangeSearch(requirements).best().verdict
