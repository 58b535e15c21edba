"""The sag table: a CSV file that a workshop's programs read, with what it is in its head."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import __version__
from ...errors import InvalidParameter
from ...escaping import csv_comment, toml_string
from ...mirrors import Mirror
from ...mirrors.base import sagittal_radius, tangential_radius
from ...sensor import Sensor
from ..body import mirror_of, omega_of
from ..surface_approximation import best_sphere, conic_of, deviation_um

Array = NDArray[np.float64]

COLUMNS = (
    "x_mm", "sag_mm", "omega_deg", "slope", "beta_deg", "curvature_per_mm", "radius_t_mm", "radius_s_mm",
    "departure_um",
)  # fmt: skip
"""The columns of the table; the first two are what :meth:`SampledProfile.from_csv` reads."""
MOST_ROWS = 1_000_000
CLOSE = 1e-9
"""Points no farther apart than this share of the rim radius are one."""


def table_points(
    sensor: Sensor, step_mm: float | None = None, step_deg: float | None = None, secondary: bool = False
) -> Array:
    """Distances from the axis (n,) mm: every ``step_mm``, or where the field angle grows by ``step_deg``.

    The axis and the rim always belong to them; without a step there are a hundred equal ones along x. They are
    those of the first mirror, or of the ``secondary``.

    Raises
    ------
    InvalidParameter
        Both steps are given, or one that is not above 0 or makes more than a million rows.

    Examples
    --------
    >>> import omnimirror as om
    >>> table_points(om.load_sensor("paper-spherical"), step_deg=45).round(3)
    array([ 0.   , 16.969, 32.27 , 43.904, 43.905])
    """
    rim, (low, high) = mirror_of(sensor, secondary).rim_radius_mm, sensor.field_deg
    if step_mm is not None and step_deg is not None:
        raise InvalidParameter("the table has one step; give step_mm or step_deg, not both")
    if step_deg is not None:
        omega = np.append(_steps("step_deg", step_deg, low, high), high)
        rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(np.minimum(omega, high))))
        x = rays.first.x if secondary else rays.x
        x = np.concatenate([[0.0], x[x > CLOSE * rim], [rim]])
    else:
        x = np.append(_steps("step_mm", rim / 100 if step_mm is None else step_mm, 0.0, rim), rim)
    # the last step may meet the rim but for rounding
    points: Array = x[np.append(np.diff(x) > CLOSE * rim, True)]
    return points


def _steps(name: str, step: float, low: float, high: float) -> Array:
    if not (step > 0 and np.isfinite(step)):
        raise InvalidParameter(f"{name} = {step:g} is no step; it is valid above 0")
    if (high - low) / step > MOST_ROWS:
        raise InvalidParameter(f"{name} = {step:g} makes more than {MOST_ROWS} rows; choose a larger one")
    return low + step * np.arange(int((high - low) / step) + 1, dtype=float)


def sag_table(sensor: Sensor, x_mm: ArrayLike, secondary: bool = False) -> dict[str, Array]:
    """Columns of the table, each (n,): see :data:`COLUMNS`.

    ``departure_um`` is from the least-squares sphere, positive where a spherical blank has material to
    be removed. ``omega_deg`` is what is seen by way of a point, NaN where that is nothing.
    """
    mirror, x = mirror_of(sensor, secondary), np.asarray(x_mm, dtype=float)
    z, slope, curvature = mirror.profile(x)
    values = (
        x, z, np.degrees(omega_of(sensor, x, secondary)), slope, np.degrees(np.arctan(slope)), curvature,
        tangential_radius(slope, curvature), sagittal_radius(x, slope, curvature),
        best_sphere(mirror).departure_um(mirror, x),
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def format_table(sensor: Sensor, x_mm: ArrayLike, digits: int = 6, secondary: bool = False) -> str:
    """The CSV file: a head of TOML behind ``#``, the names of the columns, and a row per point.

    Parameters
    ----------
    digits
        Decimals of lengths in mm and of angles; slopes and curvatures get three more, micrometres three fewer.
    secondary
        Whether it is the table of the second mirror.

    Raises
    ------
    InvalidParameter
        Digits outside 0 to 15.

    Examples
    --------
    >>> import omnimirror as om, tomllib
    >>> text = format_table(om.load_sensor("paper-spherical"), [0.0, 10.0, 20.0], digits=3)
    >>> head = tomllib.loads("".join(line[2:] + "\\n" for line in text.splitlines() if line.startswith("#")))
    >>> head["mirror"], head["vertex_radius_mm"], head["points"]
    ('sphere', 49.9582, 3)
    >>> print(text.splitlines()[-1][:19])
    20.000,4.178,53.381
    """
    if not (digits == int(digits) and 0 <= digits <= 15):
        raise InvalidParameter(f"digits = {digits} is not valid; give a whole number from 0 to 15")
    columns = sag_table(sensor, x_mm, secondary)
    decimals = [_decimals(name, int(digits)) for name in COLUMNS]
    rows = zip(*(columns[name] for name in COLUMNS), strict=True)
    lines = [f"# {line}" for line in _head(sensor, len(columns["x_mm"]), secondary)]
    lines.append(",".join(COLUMNS))
    lines += [",".join(f"{round(v, d) + 0.0:.{d}f}" for v, d in zip(row, decimals, strict=True)) for row in rows]
    return "\n".join(lines) + "\n"


def _decimals(name: str, digits: int) -> int:
    if name in ("slope", "curvature_per_mm"):
        return digits + 3
    return max(digits - 3, 0) if name.endswith("_um") else digits


def _head(sensor: Sensor, points: int, secondary: bool) -> list[str]:
    """What the file is, line by line of TOML."""
    mirror = mirror_of(sensor, secondary)
    sphere = best_sphere(mirror)
    z_axis = "along the axis from the lens towards the mirror, 0 at the vertex"
    return [
        'format = "omnimirror sag table 1"',
        f'omnimirror = "{__version__}"',
        f"sensor = {csv_comment(toml_string(sensor.name))}",
        f"mirror = {toml_string(mirror.KIND)}",
        f"rim_radius_mm = {mirror.rim_radius_mm!r}",
        *_vertex_lines(mirror),
        f"mirror_distance_mm = {float(sensor.meridian.m)!r}  # from the lens to the vertex",
        *_place_lines(sensor, secondary),
        f"points = {points}",
        f'sag = "{z_axis}"',
        f"best_sphere_radius_mm = {sphere.radius_mm:.9g}",
        f"best_sphere_centre_z_mm = {sphere.centre_z_mm:.9g}",
        f"departure_peak_to_valley_um = {sphere.peak_to_valley_um:.6g}",
        f"departure_rms_um = {sphere.rms_um:.6g}",
    ]


def _place_lines(sensor: Sensor, secondary: bool) -> list[str]:
    """Which of two mirrors it is."""
    if sensor.secondary is None:
        return []
    role = "secondary" if secondary else "primary"
    return [f'role = "{role}"', f"secondary_distance_mm = {sensor.secondary.distance_mm!r}  # between the vertices"]


def _vertex_lines(mirror: Mirror) -> list[str]:
    """Vertex radius and conic constant, where the mirror has them."""
    conic = conic_of(mirror)
    if mirror.is_pointed:
        return ["pointed = true"]
    k = conic[1] if conic else getattr(mirror, "conic", None)
    lines = [f"vertex_radius_mm = {float(mirror.radius_t(0.0)):.12g}"]
    return [*lines, f"conic_constant = {float(k):.12g}"] if k is not None else lines


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
