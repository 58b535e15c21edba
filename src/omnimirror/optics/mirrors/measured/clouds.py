"""Meridian of a mirror from measured point clouds and grids.

The axes of the measuring machine differ from those of the mirror: centre and tilt are fitted
together with the meridian by robust least squares. (The axis of a sphere is undetermined; the
machine's is kept.) Rings of equally many points are averaged to one profile point each, to equalise
the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ....base.arguments import float_of, shown
from ....base.errors import OmnimirrorError
from ....base.files import read_text
from ....base.typing import Array
from .point_rows import parsed_points
from .smoothing import NORMAL, _least_squares, extended

Columns = tuple[tuple[float, ...], tuple[float, ...]]

FEWEST = 200  # points
FARTHEST_MM = 1e7  # largest coordinate: 10 km from the machine origin, a double resolves 2 nm
NARROWEST_MM = 1e-3  # minimum width of a cloud across its longest direction, projected along z
NARROWEST = 1e-6  # the same, relative to its length
MOST_FOR_AXIS = 1500  # points used to fit the axis
IN_A_RING = 8
MOST_RINGS = 500
PIECES = (4, 48)  # spline pieces of the meridian, during the axis fit and finally
TIP = 0.7  # ratio of residual squares, pointed to smooth, below which the apex is pointed
UNITS_MM = (1.0, 10.0, 25.4, 1000.0)  # OpticStudio's unit flags: mm, cm, in, m


def read_cloud(path: Path, noun: str = "cloud", names: str = "x, y, z in mm") -> Columns:
    """Return the profile of a CSV file of points x, y, z in mm; header and comments are skipped."""
    return profile_of(cloud_points(path, noun, names), str(path))


def cloud_points(path: Path, noun: str = "points", names: str = "x, y, z in mm") -> Array:
    """Return the points (n, 3) of a text file, one per line; see :func:`.point_rows.parsed_points`.

    Raises
    ------
    OmnimirrorError
        If the file cannot be read, or contains the two columns of a profile.
    """
    points = parsed_points(read_text(path, noun), path)
    if points.shape[1] != 3:
        raise OmnimirrorError(f"{path} holds two columns of numbers; {noun} need {names}")
    return points


def read_grid(path: Path, noun: str = "grid", names: str = "z and further columns") -> Columns:
    """Return the profile of an OpticStudio grid sag file (.DAT)."""
    return profile_of(grid_points(path, noun, names), str(path))


def grid_points(path: Path, noun: str = "grid", names: str = "z and further columns") -> Array:
    """Return the points (n, 3), mm, of an OpticStudio grid sag file (.DAT).

    The first line is ``nx ny dx dy unit xdec ydec``. Points follow row by row, one per line,
    starting at the corner -x, +y; a non-zero fifth number marks missing data.
    """
    text = read_text(path, noun)
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("!", "#"))]
    try:
        head = [float_of(word) for word in lines[0].split()]
        nx, ny, (dx, dy), unit = int(head[0]), int(head[1]), head[2:4], UNITS_MM[int(head[4])]
        offset = [*head[5:7], 0.0, 0.0][:2]
        if nx < 2 or ny < 2 or nx * ny != len(lines) - 1 or not (dx > 0 and dy > 0):
            raise ValueError
    except (ValueError, IndexError):
        raise OmnimirrorError(
            f"{path} is no grid of heights: its first line must be 'nx ny dx dy unit xdec ydec', and nx * ny lines "
            "must follow"
        ) from None
    rows = _rows(path, "\n".join(lines[1:]), names)
    j, i = np.divmod(np.arange(nx * ny), nx)
    x, y = (i - (nx - 1) / 2) * dx + offset[0], ((ny - 1) / 2 - j) * dy + offset[1]
    points = np.stack([x, y, rows[:, 0]], axis=-1) * unit
    valid = np.hypot(x, y) <= min((nx - 1) * dx, (ny - 1) * dy) / 2 * (1 + 1e-9)
    if rows.shape[1] >= 5:
        valid &= rows[:, 4] == 0
    return np.asarray(points[valid])


def _rows(path: Path, text: str, names: str) -> Array:
    """Return the numbers (n, columns) of a grid's text, separated by commas or blanks."""
    found: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            numbers = [float_of(word) for word in line.replace(",", " ").replace(";", " ").split()]
            if not numbers or not np.isfinite(numbers).all() or len(numbers) < len(found[0] if found else []):
                raise ValueError
        except ValueError:
            raise OmnimirrorError(f"{path} line {number}: {shown(line)} is not {names}") from None
        found.append(numbers[: len(found[0])] if found else numbers)
    return np.array(found).reshape(-1, len(found[0]) if found else 1)


def profile_of(points: Array, source: str = "the cloud") -> Columns:
    """Return distances from the axis and heights, away from the lens, of points (n, 3), mm.

    Raises
    ------
    OmnimirrorError
        If there are too few points, or they do not surround an axis.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-10, 10, 41), np.linspace(-10, 10, 41))
    >>> r, z = profile_of(np.stack([x + 3, y - 2, 50 - (x**2 + y**2) / 100], axis=-1).reshape(-1, 3))
    >>> bool(np.abs(np.array(z) - np.square(r) / 100).max() < 1e-9)
    True
    """
    check_spread(points, source)
    points = points - points.mean(axis=0)
    a = np.column_stack([np.ones(len(points)), points[:, :2], (points[:, :2] ** 2).sum(axis=1)])
    bowl = np.linalg.lstsq(a, points[:, 2], rcond=None)[0]
    if bowl[3] < 0:  # measured from above: rotate about x
        points, bowl = points * [1.0, -1.0, -1.0], bowl * [-1.0, -1.0, 1.0, -1.0]
    if not bowl[3] > 0:
        raise OmnimirrorError(f"{source} is flat; a mirror bends away from the lens")
    r, z = _about_axis(points, -bowl[1:3] / (2 * bowl[3]), source)
    order = np.argsort(r, kind="stable")
    r, z = r[order], z[order]
    pieces = min(PIECES[1], len(r) // (2 * IN_A_RING))
    smooth, pointed = (_least_squares(r, z, apex, np.ones(len(r), dtype=bool), pieces) for apex in (True, False))
    curve = pointed if pointed.left < TIP * smooth.left else smooth
    rings = np.array_split(np.arange(len(r)), min(MOST_RINGS, len(r) // IN_A_RING))
    x = np.array([r[ring].mean() for ring in rings])
    heights = curve.spline(x) + np.array([curve.residuals[ring].mean() for ring in rings])
    growing = np.concatenate([[True], np.diff(x) > 1e-9 * r[-1]]) & (x > 1e-6 * r[-1])
    x, heights = x[growing], heights[growing]
    rim = [r[-1]] if r[-1] > x[-1] * (1 + 1e-9) else []
    ends = extended(x, heights, curve is smooth, np.array([0.0, *rim]))
    x, heights = np.concatenate([[0.0], x, rim]), np.concatenate([ends[:1], heights, ends[1:]]) - ends[0]
    return tuple(map(float, x)), tuple(map(float, heights))


def check_distance(points: Array, source: str) -> None:
    """Check that no point (n, 3), mm, is farther than 10 km from the origin."""
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest > FARTHEST_MM:
        raise OmnimirrorError(
            f"{source} must lie within {FARTHEST_MM:g} mm of the machine's origin; got {farthest:.4g} mm; check the "
            "unit and remove wrong points"
        )


def check_spread(points: Array, source: str) -> None:
    """Check that points (n, 3) mm can determine a surface.

    Raises
    ------
    OmnimirrorError
        If there are fewer than 200, one is farther than 10 km from the origin, or all are on a line
        projected along z.
    """
    if len(points) < FEWEST:
        raise OmnimirrorError(f"{source} has {len(points)} points; at least {FEWEST} are valid")
    check_distance(points, source)
    length, width = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False) / np.sqrt(len(points))
    if width < max(NARROWEST_MM, NARROWEST * length):
        raise OmnimirrorError(
            f"{source} must not lie on one line; got points {width:.2g} mm about a line (rms, along z); measure points "
            "all over the mirror"
        )


def _about_axis(points: Array, start: Array, source: str) -> tuple[Array, Array]:
    """Return distances (n,) from the best-fit axis and heights (n,) of points (n, 3)."""
    from scipy.optimize import least_squares

    size = float(np.ptp(points[:, :2])) / 2
    some = points[:: max(len(points) // MOST_FOR_AXIS, 1)]
    place = _placed(some, size)

    def misses(pose: Array) -> Array:
        r, z = place(pose)
        order = np.argsort(r)
        curve = _least_squares(r[order], z[order], False, np.ones(len(r), dtype=bool), PIECES[0])
        missed = np.empty_like(r)
        missed[order] = curve.residuals / scale
        return missed

    scale, pose = 1.0, np.array([*(start / size), 0.0, 0.0])
    scale = max(NORMAL * float(np.median(np.abs(misses(pose)))), 1e-12 * size)
    for _ in range(2):
        pose = least_squares(misses, pose, loss="soft_l1", x_scale=1e-2, xtol=1e-12, ftol=1e-12, max_nfev=25).x
        scale = max(scale * NORMAL * float(np.median(np.abs(misses(pose)))), 1e-12 * size)
    r, z = _placed(points, size)(pose)
    turned = points[:, :2] - pose[:2] * size
    if len({(bool(x > 0), bool(y > 0)) for x, y in turned}) < 4:
        raise OmnimirrorError(f"{source} does not lie all about its axis; points on all sides of it are needed")
    return r, z


def _placed(points: Array, size: float) -> Callable[[Array], tuple[Array, Array]]:
    """Return a function from centre and tilts to distances and heights of points."""

    def at(pose: Array) -> tuple[Array, Array]:
        cx, cy, a, b = pose
        axis = np.array([np.sin(a), np.sin(b), np.sqrt(max(1 - np.sin(a) ** 2 - np.sin(b) ** 2, 0.0))])
        p = points - [cx * size, cy * size, 0.0]
        z = p @ axis
        return np.sqrt(np.maximum((p**2).sum(axis=1) - z**2, 0.0)), z

    return at
