"""The quantities of an evaluation that a requirement can set a limit to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..analysis import Evaluation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Quantity:
    """A quantity by its name, with its unit and how it is had.

    ``column`` gives one number per field angle of an evaluation (n,); a limit is judged by the largest or
    the smallest. ``spread`` instead gives one number for the whole part of the field.
    """

    unit: str
    meaning: str
    column: Callable[[Evaluation], Array] | None = None
    spread: Callable[[Evaluation], float] | None = None

    def extreme(self, result: Evaluation, largest: bool) -> tuple[float, float | None]:
        """The largest or smallest value, and the field angle (deg) where it is."""
        if self.column is None:
            assert self.spread is not None
            return self.spread(result), None
        values = self.column(result)
        i = int(np.nanargmax(values) if largest else np.nanargmin(values))
        return float(values[i]), float(result.omega_deg[i])


def _largest(*names: str) -> Callable[[Evaluation], Array]:
    """The largest magnitude of the named columns."""
    return lambda e: np.max([np.abs(getattr(e, name)) for name in names], axis=0)


def _smallest(*names: str) -> Callable[[Evaluation], Array]:
    return lambda e: np.min([getattr(e, name) for name in names], axis=0)


def length_mm(result: Evaluation) -> float:
    """From the lens's principal point (telecentric: from the vertex) to the highest point of the mirror, mm."""
    (_, _), (_, top) = result.sensor.mirror.bounds
    m = result.sensor.mirror_distance_mm
    return top + (m if np.isfinite(m) else 0.0)


QUANTITIES: dict[str, Quantity] = {
    "blur_px": Quantity("px", "larger of tangential and sagittal blur", _largest("blur_t_px", "blur_s_px")),
    "blur_t_px": Quantity("px", "tangential blur", _largest("blur_t_px")),
    "blur_s_px": Quantity("px", "sagittal blur", _largest("blur_s_px")),
    "blur_deg": Quantity("deg", "larger of both blurs, in angle", _largest("blur_t_deg", "blur_s_deg")),
    "blur_t_deg": Quantity("deg", "tangential blur in angle", _largest("blur_t_deg")),
    "blur_s_deg": Quantity("deg", "sagittal blur in angle", _largest("blur_s_deg")),
    "floored_area_deg2": Quantity("deg²", "blur area with a pixel and the Airy disk", _largest("floored_area_deg2")),
    "resolution_px_per_deg": Quantity(
        "px/deg", "smaller of radial and tangential resolution", _smallest("dh_domega_px_per_deg", "width_px_per_deg")
    ),
    "resolution_t_px_per_deg": Quantity("px/deg", "radial resolution Dh", _smallest("dh_domega_px_per_deg")),
    "resolution_s_px_per_deg": Quantity("px/deg", "resolution around the circle Dw", _smallest("width_px_per_deg")),
    "aspect": Quantity("", "width to height of a small square", _smallest("aspect")),
    "viewpoint_spread_mm": Quantity(
        "mm", "highest less lowest viewpoint", spread=lambda e: float(np.ptp(e.viewpoint_z_mm))
    ),
    "area_ratio": Quantity(
        "",
        "smallest to largest image of a square degree",
        spread=lambda e: float(np.min(e.area_px2) / np.max(e.area_px2)),
    ),
    "length_mm": Quantity("mm", "from the lens to the farther of rim and vertex", spread=length_mm),
}
"""What a ``[[limit]]`` can be set to, by its name."""
