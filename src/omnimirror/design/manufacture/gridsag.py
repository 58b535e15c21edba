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
from .forms import deviation_um

Array = NDArray[np.float64]

MARGIN = 2
"""Cells past the rim, so that those which hold it have all their corners."""


def grid_axis(mirror: Mirror, points: int) -> Array:
    """Coordinates (points,) mm of the grid along each side, symmetric about the axis.

    Raises
    ------
    InvalidParameter
        Fewer than 9 or more than 4097 points, or an even number: one must lie on the axis.
    """
    if not (points == int(points) and points % 2 and 9 <= points <= 4097):
        raise InvalidParameter(f"grid_points = {points} is not valid; give an odd number from 9 to 4097")
    half = points // 2
    return mirror.rim_radius_mm / (half - MARGIN) * np.arange(-half, half + 1, dtype=float)


def grid_sag(mirror: Mirror, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Height (mm), slopes along x and y, and mixed derivative (1/mm) of the mirror at points (x, y) in mm.

    Past the rim the mirror is continued with the slope and curvature that it has there; no light goes there,
    but a program interpolates up to the rim with it. At a pointed apex the slopes are 0.

    >>> from omnimirror.mirrors import Paraboloid
    >>> [float(v) for v in grid_sag(Paraboloid(50.0, 20.0), np.array(3.0), np.array(4.0))]
    [0.25, 0.06, 0.08, 0.0]
    """
    rim, r = mirror.rim_radius_mm, np.hypot(x, y)
    inside = np.minimum(r, rim)
    z, slope, curvature = mirror.profile(inside)
    past = r - inside
    z, slope = z + past * (slope + past * curvature / 2), slope + past * curvature
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
    """Largest distance of the bicubic surface through the grid from the mirror, um: at the middles of its cells.

    Of a cell with corners f and derivatives the bicubic Hermite patch has, in the middle, the mean of the
    corners plus (f_x left - f_x right) h/8 and so on; by symmetry an eighth of the grid is enough.
    """
    axis = grid_axis(mirror, points)
    axis = axis[points // 2 :]
    h = axis[1] - axis[0]
    z, zx, zy, zxy = grid_sag(mirror, *np.meshgrid(axis, axis, indexing="ij"))

    def corners(a: Array, sign_x: int, sign_y: int) -> Array:
        total: Array = a[:-1, :-1] + sign_x * a[1:, :-1] + sign_y * a[:-1, 1:] + sign_x * sign_y * a[1:, 1:]
        return total

    middle = (
        corners(z, 1, 1) + h / 4 * (corners(zx, -1, 1) + corners(zy, 1, -1)) + h * h / 16 * corners(zxy, -1, -1)
    ) / 4
    centres = (axis[1:] + axis[:-1]) / 2
    r = np.hypot(*np.meshgrid(centres, centres, indexing="ij"))
    inside = r <= mirror.rim_radius_mm
    return float(np.abs(deviation_um(mirror, r[inside], middle[inside])).max())


def write_grid_sag(path: Path, mirror: Mirror, points: int) -> float:
    """Write the .DAT file; how far the bicubic surface through it lies from the mirror, um."""
    path.write_text(format_grid_sag(mirror, points), encoding="ascii", newline="")
    return grid_deviation_um(mirror, points)
