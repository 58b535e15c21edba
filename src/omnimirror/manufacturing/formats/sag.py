"""Sag of a mirror as a CSV table and as an OpticStudio Grid Sag surface.

The CSV file has a header of TOML lines. The first line of a grid sag file is
``nx ny delx dely unitflag xdec ydec``; each following line contains height, both slopes, mixed
second derivative and 0 (valid point), row by row from the corner at -x, +y.
"""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ... import __version__
from ...base.errors import InvalidParameter
from ...base.escaping import csv_comment, toml_string
from ...base.typing import Array
from ...optics.mirrors import Mirror
from ...optics.mirrors.mirror import sagittal_radius, tangential_radius
from ...optics.sensor import Sensor
from ..body import mirror_of, omega_of
from ..surface_approximation import best_fit_sphere, conic_parameters, deviation_um

COLUMNS = (
    "x_mm",
    "sag_mm",
    "omega_deg",
    "slope",
    "beta_deg",
    "curvature_per_mm",
    "radius_t_mm",
    "radius_s_mm",
    "departure_um",
)
"""Columns of the table; :meth:`SampledProfile.from_csv` reads the first two."""
MAX_ROWS = 1_000_000
CLOSE = 1e-9
"""Minimum distance of table rows as a fraction of the rim radius."""


def table_points(
    sensor: Sensor,
    step_mm: float | None = None,
    step_deg: float | None = None,
    secondary: bool = False,
) -> Array:
    """Return radii (n,) in mm at steps of ``step_mm``, or at steps of ``step_deg`` in field angle.

    Axis and rim are always included. The default is 100 equal steps along x. The radii refer to the
    primary mirror or to the ``secondary``.

    Raises
    ------
    InvalidParameter
        If both steps are given, or a step is not positive or results in more than a million rows.

    Examples
    --------
    >>> import omnimirror as om
    >>> table_points(om.load_sensor("paper-spherical"), step_deg=45).round(3)
    array([ 0.   , 16.969, 32.27 , 43.904, 43.905])
    """
    rim, (low, high) = mirror_of(sensor, secondary).rim_radius_mm, sensor.field_deg
    if step_mm is not None and step_deg is not None:
        raise InvalidParameter("step_mm and step_deg must not be given together")
    if step_deg is not None:
        omega = np.append(_steps("step_deg", step_deg, low, high), high)
        rays = sensor.meridian.trace(
            sensor.meridian.x_from_omega(np.radians(np.minimum(omega, high)))
        )
        x = rays.first.x if secondary else rays.x
        x = np.concatenate([[0.0], x[x > CLOSE * rim], [rim]])
    else:
        x = np.append(_steps("step_mm", rim / 100 if step_mm is None else step_mm, 0.0, rim), rim)
    # the last step may differ from the rim only by rounding
    points: Array = x[np.append(np.diff(x) > CLOSE * rim, True)]
    return points


def _steps(name: str, step: float, low: float, high: float) -> Array:
    if not (step > 0 and np.isfinite(step)):
        raise InvalidParameter(f"{name} must be positive; got {step:g}")
    if (high - low) / step > MAX_ROWS:
        raise InvalidParameter(
            f"{name} must result in at most {MAX_ROWS} rows; got {step:g}; use a larger value"
        )
    return low + step * np.arange(int((high - low) / step) + 1, dtype=float)


def sag_table(sensor: Sensor, x_mm: ArrayLike, secondary: bool = False) -> dict[str, Array]:
    """Compute the columns (n,) of the table; see :data:`COLUMNS`.

    ``departure_um`` refers to the least-squares sphere and is positive if material has to be removed
    from a spherical blank. ``omega_deg`` is the field angle of the reflected ray, NaN without one.
    """
    mirror, x = mirror_of(sensor, secondary), np.asarray(x_mm, dtype=float)
    z, slope, curvature = mirror.profile(x)
    values = (
        x,
        z,
        np.degrees(omega_of(sensor, x, secondary)),
        slope,
        np.degrees(np.arctan(slope)),
        curvature,
        tangential_radius(slope, curvature),
        sagittal_radius(x, slope, curvature),
        best_fit_sphere(mirror).departure_um(mirror, x),
    )
    return dict(zip(COLUMNS, values, strict=True))


def format_table(sensor: Sensor, x_mm: ArrayLike, digits: int = 6, secondary: bool = False) -> str:
    """Format the sag table as CSV with a header of TOML comments.

    Parameters
    ----------
    digits
        Decimals of lengths in mm and of angles; slopes and curvatures have three more, micrometres
        three fewer.
    secondary
        Tabulate the secondary mirror.

    Raises
    ------
    InvalidParameter
        If digits is not between 0 and 15.

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
        raise InvalidParameter(f"digits must be an integer between 0 and 15; got {digits}")
    columns = sag_table(sensor, x_mm, secondary)
    decimals = [_decimals(name, int(digits)) for name in COLUMNS]
    rows = zip(*(columns[name] for name in COLUMNS), strict=True)
    lines = [f"# {line}" for line in _head(sensor, len(columns["x_mm"]), secondary)]
    lines.append(",".join(COLUMNS))
    lines += [
        ",".join(f"{round(v, d) + 0.0:.{d}f}" for v, d in zip(row, decimals, strict=True))
        for row in rows
    ]
    return "\n".join(lines) + "\n"


def _decimals(name: str, digits: int) -> int:
    if name in ("slope", "curvature_per_mm"):
        return digits + 3
    return max(digits - 3, 0) if name.endswith("_um") else digits


def _head(sensor: Sensor, points: int, secondary: bool) -> list[str]:
    """Return the TOML lines of the header."""
    mirror = mirror_of(sensor, secondary)
    sphere = best_fit_sphere(mirror)
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
        f"best_fit_sphere_radius_mm = {sphere.radius_mm:.9g}",
        f"best_fit_sphere_centre_z_mm = {sphere.centre_z_mm:.9g}",
        f"departure_peak_to_valley_um = {sphere.peak_to_valley_um:.6g}",
        f"departure_rms_um = {sphere.rms_um:.6g}",
    ]


def _place_lines(sensor: Sensor, secondary: bool) -> list[str]:
    """Return the role of the mirror in a folded sensor."""
    if sensor.secondary is None:
        return []
    role = "secondary" if secondary else "primary"
    return [
        f'role = "{role}"',
        f"secondary_distance_mm = {sensor.secondary.distance_mm!r}  # between the vertices",
    ]


def _vertex_lines(mirror: Mirror) -> list[str]:
    """Return vertex radius and conic constant if the mirror has them."""
    conic = conic_parameters(mirror)
    if mirror.is_pointed:
        return ["pointed = true"]
    k = conic[1] if conic else getattr(mirror, "conic", None)
    lines = [f"vertex_radius_mm = {float(mirror.radius_t(0.0)):.12g}"]
    return [*lines, f"conic_constant = {float(k):.12g}"] if k is not None else lines


MARGIN = 2
"""Grid cells beyond the rim, so that the cells intersected by the rim are complete."""


def grid_axis(mirror: Mirror, points: int) -> Array:
    """Return the coordinates (points,) in mm along each side of the grid, symmetric about the axis.

    Raises
    ------
    InvalidParameter
        If the number of points is even or not between 9 and 2049; one point must be on the axis.
    """
    if not (points == int(points) and points % 2 and 9 <= points <= 2049):
        raise InvalidParameter(
            f"grid_points must be an odd number between 9 and 2049; got {points}"
        )
    half = points // 2
    return mirror.rim_radius_mm / (half - MARGIN) * np.arange(-half, half + 1, dtype=float)


def grid_sag(mirror: Mirror, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Compute height (mm), slopes along x and y, and mixed derivative (1/mm) at points (x, y) in mm.

    Beyond the rim, the mirror is extrapolated by a third-order Taylor series, which programs need to
    interpolate up to the rim. The slopes at a pointed apex are 0.

    >>> from omnimirror.optics.mirrors import Paraboloid
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
    """Format the grid sag file.

    >>> from omnimirror.optics.mirrors import Sphere
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
    """Compute the maximum distance of the bicubic surface from the mirror, um, at 25 points per cell.

    The bicubic Hermite patch of a cell is the product of two cubic interpolations. By symmetry, a
    quarter of the grid is sufficient.
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
    """Interpolate between adjacent grid lines by cubic Hermite polynomials at a fraction t."""
    here, there = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
    if along:
        here, there = here[::-1], there[::-1]
    value = (1 + 2 * t) * (1 - t) ** 2 * f[here] + t * t * (3 - 2 * t) * f[there]
    bent: Array = value + h * t * (1 - t) * ((1 - t) * rate[here] - t * rate[there])
    return bent


def _third_derivative(mirror: Mirror) -> float:
    """Estimate d3z/dx3 (1/mm^2) at the rim by a one-sided difference of the curvature."""
    step = 1e-3 * mirror.rim_radius_mm
    c = mirror.curvature(mirror.rim_radius_mm - step * np.arange(3.0))
    return float((3 * c[0] - 4 * c[1] + c[2]) / (2 * step))


def write_grid_sag(path: Path, mirror: Mirror, points: int) -> float:
    """Write the grid sag file and return the deviation of its bicubic surface from the mirror, um."""
    path.write_text(format_grid_sag(mirror, points), encoding="ascii", newline="")
    return grid_deviation_um(mirror, points)
