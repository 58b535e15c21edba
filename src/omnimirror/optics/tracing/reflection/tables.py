"""Lookup tables for the search for reflection points: meridian and initial values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....base.typing import Array
from ...mirrors import Mirror
from ..meridian import trace_chief_rays
from .surface import continued_profile

CELLS = 1024  # from vertex to rim: cubic pieces of sag and slope are accurate to 1e-9 mm and 1e-9
BEYOND = 256  # cells of the same width beyond the rim, for iterates outside the mirror
TIP = 1e-3  # of the rim radius: initial points keep this distance from an apex


@dataclass(frozen=True)
class MirrorTables:
    """Tables of a mirror, in cubic pieces of four coefficients for each function.

    Parameters
    ----------
    meridian : (n, 8)
        Sag and slope as functions of the distance from the axis, ``cell_mm`` per piece.
    by_omega : (m, 4)
        Distance from the axis as a function of the field angle about ``middle_mm``, between
        ``omegas``.
    depth : (k, 4) or None
        Depth from the lens as a function of the ray's tangent, up to ``most_tangent``; None if
        telecentric.
    rim_mm, least_mm
        Radius of the rim, and of the excluded zone about the apex of a pointed mirror.
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
        """Create tables for a pupil at a distance (mm) from the vertex, infinite if telecentric."""
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

    def surface(self, pupil: tuple[float, ...], telecentric: bool) -> tuple[Any, ...]:
        """Return kernel arguments of the surface, including the lens position."""
        return (self.meridian, self.cell_mm, self.rim_mm, self.least_mm, *pupil, telecentric)


def radii(mirror: Mirror, cells: int = CELLS) -> Array:
    """Return the nodes (n,), mm, of the tables, one of them at the rim."""
    beyond = cells * BEYOND // CELLS
    return np.linspace(0.0, (cells + beyond) / cells * mirror.rim_radius_mm, cells + beyond + 1)


def meridian_table(mirror: Mirror, cells: int = CELLS) -> Array:
    """Return cubic pieces (n, 8) of sag and slope, four coefficients each, between the nodes.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> table = meridian_table(Sphere(50.0, 40.0))
    >>> table.shape, table[768, [0, 4]]  # at 30 mm: sag 10 mm, slope .75
    ((1280, 8), array([10.  ,  0.75]))
    """
    sag, slope, curvature = continued_profile(mirror, radii(mirror, cells))
    step = mirror.rim_radius_mm / cells
    return np.concatenate([cubic_pieces(sag, slope * step), cubic_pieces(slope, curvature * step)], axis=1)


def cubic_pieces(values: Array, rates: Array) -> Array:
    """Return the coefficients (n, 4) of cubic Hermite pieces between n + 1 nodes.

    >>> cubic_pieces(np.array([0.0, 1.0, 8.0]), np.array([0.0, 3.0, 12.0]))[1]  # t^3 about 1
    array([1., 3., 3., 1.])
    """
    rise = np.diff(values)
    low, high = rates[:-1], rates[1:]
    return np.stack([values[:-1], low, 3 * rise - 2 * low - high, low + high - 2 * rise], axis=1)


def _depths(mirror: Mirror, distance: float, tangents: np.ndarray, x: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return pieces (n, 4) of the mirror's depth from the lens, by tangents."""
    r = np.interp(tangents, x / w, x)
    for _ in range(4):
        sag, slope, _ = mirror.profile(r)
        r = np.clip(r - (r - (distance + sag) * tangents) / (1 - slope * tangents), 0.0, mirror.rim_radius_mm)
    sag, slope, _ = mirror.profile(r)
    growth = slope * (distance + sag) / (1 - slope * tangents)
    return cubic_pieces(distance + sag, growth * (tangents[1] - tangents[0]))
