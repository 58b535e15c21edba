"""What a search for reflection points looks up: a mirror's meridian, and where to begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mirrors import Mirror
from ..tracing.meridian import trace_chief_rays
from .library import Tensor
from .pieces import CELLS, cubic_pieces, meridian_table

Array = NDArray[np.float64]

TIP = 1e-3  # of the rim radius: nearer to the tip of a pointed mirror nothing is looked for first


@dataclass(frozen=True)
class MirrorTables:
    """A mirror's tables, in cubic pieces of four coefficients for each function.

    Parameters
    ----------
    meridian : (n, 8)
        Sag and slope by the distance from the axis, ``cell_mm`` a piece.
    by_omega : (m, 4)
        Distance from the axis by the field angle about ``middle_mm``, between ``omegas``.
    depth : (k, 4) or None
        Depth before the lens by the tangent of a ray, up to ``most_tangent``; None if the lens is telecentric.
    rim_mm, least_mm
        Radius of the rim, and of what is too near to the tip of a pointed mirror.
    """

    meridian: Array
    by_omega: Array
    depth: Array | None
    cell_mm: float
    omegas: tuple[float, float]
    middle_mm: float
    most_tangent: float
    rim_mm: float
    least_mm: float

    @classmethod
    def of(cls, mirror: Mirror, pupil_distance: float) -> MirrorTables:
        """A mirror as a lens sees it whose entrance pupil is so far (mm) from its vertex, infinitely if telecentric."""
        rim = mirror.rim_radius_mm
        x = np.linspace(0.0, rim, 4 * CELLS + 1)
        rays = trace_chief_rays(mirror, pupil_distance, x)
        omegas = float(rays.omega[0]), float(rays.omega[-1])
        even = np.interp(np.linspace(*omegas, CELLS + 1), rays.omega, x)
        depth, most = None, 0.0
        if np.isfinite(pupil_distance):
            most = float(x[-1] / rays.w[-1])
            depth = _depths(mirror, pupil_distance, np.linspace(0.0, most, CELLS + 1), x, rays.w)
        return cls(
            meridian_table(mirror),
            cubic_pieces(even, np.gradient(even)),
            depth,
            rim / CELLS,
            omegas,
            float(rays.z[2 * CELLS] + rays.viewpoint_offset()[2 * CELLS]),
            most,
            rim,
            TIP * rim if mirror.is_pointed else 0.0,
        )

    def surface(self, pupil: tuple[Tensor, ...], telecentric: bool) -> tuple[Any, ...]:
        """As kernels take it, with where the lens is."""
        return (self.meridian, self.cell_mm, self.rim_mm, self.least_mm, *map(_number, pupil), telecentric)


def _number(part: Tensor) -> float:
    return float(part.detach() if hasattr(part, "detach") else part)


def _depths(mirror: Mirror, distance: float, tangents: np.ndarray, x: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Pieces (n, 4) of how far before the lens the mirror lies under tangents, found from pairs x and depth w."""
    r = np.interp(tangents, x / w, x)
    for _ in range(4):
        sag, slope, _ = mirror.profile(r)
        r = np.clip(r - (r - (distance + sag) * tangents) / (1 - slope * tangents), 0.0, mirror.rim_radius_mm)
    sag, slope, _ = mirror.profile(r)
    growth = slope * (distance + sag) / (1 - slope * tangents)
    return cubic_pieces(distance + sag, growth * (tangents[1] - tangents[0]))
