"""Grid sag: heights and slopes of the mirror on a square grid, as OpticStudio's Grid Sag surface reads them.

The first line is ``nx ny delx dely unitflag xdec ydec``; then one line per point with the height, both
slopes, the mixed second derivative and a zero (the point is valid), row by row from the corner at -x, +y.
"""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from ...mirrors import Mirror
from ..forms import deviation_um

Array = NDArray[np.float64]

MARGIN = 2
"""Cells past the rim, so that those which hold it have all their corners."""


def grid_axis(mirror: Mirror, points: int) -> Array:
    """Coordinates (points,) mm of the grid along each side, symmetric about the axis.

    Raises
    ------
    InvalidParameter
        Fewer than 9 or more than 2049 points, or an even number: one must lie on the axis.
    """
    if not (points == int(points) and points % 2 and 9 <= points <= 2049):
        raise InvalidParameter(f"grid_points = {points} is not valid; give an odd number from 9 to 2049")
    half = points // 2
    return mirror.rim_radius_mm / (half - MARGIN) * np.arange(-half, half + 1, dtype=float)


def grid_sag(mirror: Mirror, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Height (mm), slopes along x and y, and mixed derivative (1/mm) of the mirror at points (x, y) in mm.

    Past the rim the mirror is continued by the first four terms of its Taylor series there; no light goes
    there, but a program interpolates up to the rim with it. At a pointed apex the slopes are 0.

    >>> from omnimirror.mirrors import Paraboloid
    >>> [float(v) for v in grid_sag(Paraboloid(50.0, 20.0), np.array(3.0), np.array(4.0))]
    [0.25, 0.06, 0.08, 0.0]
    """
    rim, r = mirror.rim_radius_mm, np.hypot(x, y)
    inside = np.minimum(r, rim)
    z, slope, curvature = mirror.profile(inside)
    past, third = r - inside, _third_derivative(mirror)
    z = z + past * (slope + past * (curvature / 2 + past * third / 6))
    slope, curvature = slope + past * (curvature + past * third / 2), curvature + past * third
    safe = np.where(r > 0, r, 1.0)
    rate = np.where(r > 0, slope / safe, 0.0)
    mixed = np.where(r > 0, x * y / safe**2 * (curvature - rate), 0.0)
    return z, x * rate, y * rate, mixed


def format_grid_sag(mirror: Mirror, points: int = 257) -> str:
    """The text of the .DAT file.

    >>> from omnimirror.mirrors import Sphere
    >>> lines = format_grid_sag(Sphere(50.0, 40.0), 9).splitlines()
    >>> lines[0], len(lines)
    ('9 9 20 20 0 0 0', 82)
    """
    axis = grid_axis(mirror, points)
    x, y = np.meshgrid(axis, axis[::-1])
    step = f"{axis[-1] - axis[-2]:.17g}"
    table = np.stack([v.ravel() for v in grid_sag(mirror, x, y)], axis=-1)
    text = StringIO()
    text.write(f"{points} {points} {step} {step} 0 0 0\n")
    np.savetxt(text, table, fmt="%.15e", delimiter=" ", newline=" 0\n")
    return text.getvalue()


def grid_deviation_um(mirror: Mirror, points: int) -> float:
    """Largest distance of the bicubic surface through the grid from the mirror, um, by 25 points of each cell.

    A cell's bicubic Hermite patch is the product of two cubic ones. By symmetry a quarter of the grid is enough.
    """
    axis = grid_axis(mirror, points)[points // 2 :]
    h = float(axis[1] - axis[0])
    z, zx, zy, zxy = grid_sag(mirror, *np.meshgrid(axis, axis, indexing="ij"))
    worst = 0.0
    for u in np.linspace(0, 1, 5):
        for v in np.linspace(0, 1, 5):
            height = _between(_between(z, zx, u, h, 0), _between(zy, zxy, u, h, 0), v, h, 1)
            r = np.hypot(*np.meshgrid(axis[:-1] + u * h, axis[:-1] + v * h, indexing="ij"))
            inside = r <= mirror.rim_radius_mm
            worst = max(worst, float(np.abs(deviation_um(mirror, r[inside], height[inside])).max()))
    return worst


def _between(f: Array, rate: Array, t: float, h: float, along: int) -> Array:
    """Cubic Hermite interpolation a share t of the way from each line of points to the next."""
    here, there = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
    if along:
        here, there = here[::-1], there[::-1]
    value = (1 + 2 * t) * (1 - t) ** 2 * f[here] + t * t * (3 - 2 * t) * f[there]
    bent: Array = value + h * t * (1 - t) * ((1 - t) * rate[here] - t * rate[there])
    return bent


def _third_derivative(mirror: Mirror) -> float:
    """d3z/dx3 (1/mm^2) at the rim, by a one-sided difference of the curvature."""
    step = 1e-3 * mirror.rim_radius_mm
    c = mirror.curvature(mirror.rim_radius_mm - step * np.arange(3.0))
    return float((3 * c[0] - 4 * c[1] + c[2]) / (2 * step))


def write_grid_sag(path: Path, mirror: Mirror, points: int) -> float:
    """Write the .DAT file; how far the bicubic surface through it lies from the mirror, um."""
    path.write_text(format_grid_sag(mirror, points), encoding="ascii", newline="")
    return grid_deviation_um(mirror, points)
