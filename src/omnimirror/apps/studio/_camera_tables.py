"""Camera projection as lookup tables for the GPU, accurate to a few 0.001 px."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array, Mask
from ...cameras.camera import Mount, inside_image, rotate_vectors
from ...cameras.models import MirrorBall, OCam, ViewpointSpline
from ...dewarp._source_coordinates import tables_of
from ...dewarp.view_geometry import field_of
from ...optics.camera_files import AnyCamera
from ...optics.housing import Tube
from ...optics.sensor import Sensor
from ...optics.tracing.reflection import RayEndpoints
from .look_messages import CameraInfo, Kind, MountInfo, TableLayout

# -- Adaptive interpolation on a square lattice ----------------------------------------------------

Exact = Callable[[Array], Array]
"""Function that returns values (n, m) at points (n, 2); rows of NaN outside the domain."""
Index = NDArray[np.intp]
PartOf = Callable[[Array], Index]
"""Function that returns the part indices (...) of values (..., m)."""

LATTICE_STEP = 4  # spacing of the exact values, nodes
OFF_MIDDLE = (2, 1)  # test point of a cell, off centre, where errors of both axes can cancel
TAPS = 10  # taps of the interpolation in each direction
TAPS_BEFORE_CELL = TAPS // 2 - 1  # taps before the cell
CLOSE = 0.5  # accepted error in float32 roundings at the test point; errors elsewhere in the cell remain below 1
CELLS_PER_PRODUCT = 64  # cells per matrix product
EDGE_NEIGHBOURS = [(1, 0), (-1, 0), (0, 1), (0, -1)]
NEIGHBOURS = [*EDGE_NEIGHBOURS, (1, 1), (-1, -1), (1, -1), (-1, 1)]
EXTRAPOLATED_NODES = 4  # extrapolated nodes beyond the boundary, for cubic interpolation


def lattice_of(exact: Exact, side: Array, part_of: PartOf | None = None) -> Array:
    """Return values (n, n, m) at ``(side[column], side[row])``, accurate to float32 rounding.

    Exact values are computed at every fourth node. Cells between them use 10-point Lagrange
    interpolation if the values exist, or can be extrapolated, and test points in the cell or its
    neighbours agree; all other nodes are computed exactly.

    Parameters
    ----------
    exact
        Exact function. It is evaluated in cells of STEP nodes next to its domain.
    side : (n,)
        Evenly spaced coordinates; n - 1 is a multiple of STEP.
    part_of
        Parts of the lattice, with discontinuities of value or derivative between them. One part by
        default.

    Examples
    --------
    >>> counts = []
    >>> def waves(at):
    ...     counts.append(len(at))
    ...     return np.where(np.hypot(*at.T) < 1, np.sin(at.sum(axis=1)), np.nan)[:, None]
    >>> found = lattice_of(waves, np.linspace(-1.1, 1.1, 257))
    >>> found.shape, bool(abs(found[100, 130, 0] - np.sin((230 - 256) * 2.2 / 256)) < 1e-8)
    ((257, 257, 1), True)
    >>> sum(counts) < 257**2 / 4
    True
    """

    def at(row: Index, column: Index) -> Array:
        return exact(np.stack([side[column], side[row]], axis=-1))

    cells = (len(side) - 1) // LATTICE_STEP
    coarse = at(*(LATTICE_STEP * np.indices((cells + 1, cells + 1)).reshape(2, -1))).reshape(
        cells + 1, cells + 1, -1
    )
    is_known: Mask = np.asarray(np.isfinite(coarse).all(axis=2))
    parts = np.zeros(is_known.shape, np.intp) if part_of is None else part_of(coarse)
    of_cells = np.full((cells + 1, cells + 1, LATTICE_STEP, LATTICE_STEP, coarse.shape[2]), np.nan)
    done = np.zeros((cells, cells), np.bool_)
    for part in sorted(set(parts[is_known].tolist())):
        row, column, between = _interpolated(coarse, is_known & (parts == part), at)
        of_cells[row, column], done[row, column] = between, True
    values = of_cells.swapaxes(1, 2).reshape(LATTICE_STEP * (cells + 1), -1, coarse.shape[2])[
        : len(side), : len(side)
    ]
    mine = _nodes_of(_windows(np.logical_or, np.pad(is_known, 1), 4) & ~done)
    mine[::LATTICE_STEP, ::LATTICE_STEP] = False
    values[::LATTICE_STEP, ::LATTICE_STEP] = coarse
    row, column = np.nonzero(mine)
    if row.size:
        values[row, column] = at(row, column)
    return values


def _interpolated(
    coarse: Array, is_known: Mask, at: Callable[[Index, Index], Array]
) -> tuple[Index, Index, Array]:
    """Return rows and columns (c,) of smooth cells, from the mask of known coarse values (k, k, m),
    and interpolated values (c, STEP, STEP, m) of their nodes."""
    filled = _filled(np.where(is_known[..., None], coarse, np.nan), TAPS, EDGE_NEIGHBOURS, TAPS - 2)
    inside, smooth = (
        np.pad(_windows(np.logical_and, mask, TAPS), TAPS_BEFORE_CELL)
        for mask in (is_known, np.isfinite(filled[..., 0]))
    )
    row, column = np.nonzero(smooth & _windows(np.logical_and, is_known, 2))
    between = _between(filled, row, column)
    retained = _agree(row, column, between, inside, at)[row, column]
    return row[retained], column[retained], between[retained]


def _agree(
    row: Index, column: Index, between: Array, inside: Mask, at: Callable[[Index, Index], Array]
) -> Mask:
    """Check interpolated values in cells (k, k) at test points; return the cells that pass and have
    no failing neighbour.

    Test points are taken in every other cell, and twice in each cell whose stencil contains
    extrapolated values.
    """
    close = CLOSE * np.spacing(np.abs(between).max(axis=(0, 1, 2), initial=0.0).astype(np.float32))
    answers = np.zeros((2, len(inside) + 2, len(inside) + 2), np.bool_)
    is_inside = inside[row, column]
    for k, (down, right) in enumerate((OFF_MIDDLE, OFF_MIDDLE[::-1])):
        (trials,) = np.nonzero(~is_inside | ((row % 2 == k) & ((row + column) % 2 == 0)))
        if not trials.size:
            continue
        true = at(LATTICE_STEP * row[trials] + down, LATTICE_STEP * column[trials] + right)
        agrees = (np.abs(between[trials, down, right] - true) <= close).all(axis=1)
        answers[agrees.astype(int), row[trials] + 1, column[trials] + 1] = True
    refuted, confirmed = (_windows(np.logical_or, answer, 3) for answer in answers)
    return np.asarray(confirmed & ~refuted)


def weights_between(at: Array, first: Index) -> Array:
    """Return the Lagrange weights of TAPS equidistant values at points (n,) between them.

    >>> (weights_between(np.array([4.5]), np.array([0])) * 2**16)[0, :4]
    array([   35.,  -405.,  2268., -8820.])
    """
    weights = np.zeros((len(at), int(first[-1]) + TAPS))
    for k in range(TAPS):
        others = [j for j in range(TAPS) if j != k]
        weights[np.arange(len(at)), first + k] = np.prod(
            [(at - first - j) / (k - j) for j in others], axis=0
        )
    return weights


def _between(exact: Array, row: Index, column: Index) -> Array:
    """Interpolate coarse values (k, k, m) in cells (c,); return (c, STEP, STEP, m).

    The matrix products are small enough for BLAS to run them in the calling thread; larger ones
    start threads that busy-wait for up to 0.1 s.
    """
    along = weights_between(
        TAPS_BEFORE_CELL + np.arange(LATTICE_STEP) / LATTICE_STEP, np.zeros(LATTICE_STEP, np.intp)
    )
    weights = np.kron(along, along).T
    windows = np.lib.stride_tricks.sliding_window_view(exact, (TAPS, TAPS), axis=(0, 1))
    values = np.empty((len(row), exact.shape[2], LATTICE_STEP**2))
    for first in range(0, len(row), CELLS_PER_PRODUCT):
        part = slice(first, first + CELLS_PER_PRODUCT)
        about = windows[row[part] - TAPS_BEFORE_CELL, column[part] - TAPS_BEFORE_CELL].reshape(
            -1, TAPS**2
        )
        np.matmul(about, weights, out=values[part].reshape(-1, LATTICE_STEP**2))
    return values.reshape(len(row), exact.shape[2], LATTICE_STEP, LATTICE_STEP).transpose(
        0, 2, 3, 1
    )


def _nodes_of(cells: Mask) -> Mask:
    """Return the mask (n, n) of the nodes in and around cells (k, k)."""
    count = LATTICE_STEP * len(cells) + 1
    nodes = np.zeros((count, count), np.bool_)
    wide = cells.repeat(LATTICE_STEP, axis=0).repeat(LATTICE_STEP, axis=1)
    for dx in (0, 1):
        for dy in (0, 1):
            nodes[dy : count - 1 + dy, dx : count - 1 + dx] |= wide
    return nodes


def _windows(combine: np.ufunc, values: Mask, side: int) -> Mask:
    """Combine every ``side`` x ``side`` window of values."""
    for _ in range(2):
        values = combine.reduce([values[i : len(values) - side + 1 + i] for i in range(side)]).T
    return values


def continued(values: Array) -> Array:
    """Extrapolate a lattice (n, n, m) by several nodes beyond its known values, with third
    differences."""
    return _filled(values, 4, NEIGHBOURS, EXTRAPOLATED_NODES)


def _filled(values: Array, terms: int, ways: list[tuple[int, int]], layers: int) -> Array:
    """Extrapolate values (n, n, m) layer by layer with polynomials through ``terms`` collinear
    nodes."""
    is_known: Mask = np.asarray(np.isfinite(values).all(axis=2))
    for _ in range(layers):
        beside = _windows(np.logical_or, np.pad(is_known, 1), 3)
        row, column = np.nonzero(beside & ~is_known)
        values[row, column] = added = _next(values, is_known, row, column, terms, ways)
        is_known[row, column] = np.isfinite(added).all(axis=1)
    return values


def _next(
    values: Array, mask: Mask, row: Index, column: Index, terms: int, ways: list[tuple[int, int]]
) -> Array:
    """Return values (k, m) of nodes: the known values, or the mean extrapolation along the given
    directions."""
    total, weights = np.zeros((len(row), values.shape[2])), np.zeros((len(row), values.shape[2]))
    ahead = [
        -comb(terms, k) * (-1) ** k for k in range(1, terms + 1)
    ]  # finite differences of order ``terms`` vanish
    around = np.pad(mask, terms)
    for dx, dy in ways:
        line = [(row + k * dy, column + k * dx) for k in range(1, terms + 1)]
        (inside,) = np.nonzero(
            around[line[0][0] + terms, line[0][1] + terms]
            & around[line[-1][0] + terms, line[-1][1] + terms]
        )
        guess = sum(a * values[y[inside], x[inside]] for a, (y, x) in zip(ahead, line, strict=True))
        is_known = np.isfinite(guess)
        total[inside] += np.where(is_known, guess, 0.0)
        weights[inside] += is_known
    old = values[row, column]
    with np.errstate(invalid="ignore"):
        return np.where(np.isnan(old), total / weights, old)


# -- Camera tables ---------------------------------------------------------------------------------
#
# A rotationally symmetric camera is tabulated over sin(Omega/2), as in
# :mod:`omnimirror.dewarp._source_coordinates`, with fewer entries. Other cameras are sampled on a
# lattice of pixels over the disc ``sin(Omega/2) (cos phi, sin phi)`` about their axis, which
# resembles the image, with a table of the field boundary and, for mirrors, a lattice of ray origins.

ENTRIES = 2048  # texture width that every WebGL2 implementation supports
LATTICE = 513
LIMITS = 1024
BOUNDARY_ACCURACY = 2e-7  # accuracy of the field boundary in sin(Omega/2)
BOUNDARY_AZIMUTHS = 64  # azimuths of the initial boundary search
CALL = 1024  # number of points whose evaluation takes as long as the overhead of a call
BRACKET_HALF_WIDTHS = (
    BOUNDARY_ACCURACY / 2,
    2.0**-12,
)  # half-widths of the bracket around the interpolated boundary
FIELD_MARGIN = 1.02


class CameraTables(NamedTuple):
    """Table values with their layout."""

    layout: TableLayout
    values: NDArray[np.float32]


class Frame(NamedTuple):
    """World directions (3,) of the camera axis and of the right and lower sides of the image."""

    axis: Array
    right: Array
    down: Array


def frame_of(camera: AnyCamera) -> Frame:
    """Return the frame of the tables of a camera."""
    symmetry = camera.symmetry
    if symmetry is not None:
        return Frame(symmetry.axis, symmetry.right, symmetry.down)
    x, y, _ = camera.mount.rotation().T
    return Frame(camera.axis, -x if camera.mount.image_flipped else x, y)


@lru_cache(maxsize=32)
def camera_tables(camera: AnyCamera) -> CameraTables:
    """Compute the tables of a camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> layout, values = camera_tables(om.load_sensor("paper-spherical"))
    >>> layout.radii, layout.origins, values.shape
    (2048, 2048, (6144,))
    """
    symmetry = camera.symmetry
    if symmetry is None:
        return _lattice_tables(camera)
    t = tables_of(symmetry, ENTRIES, ENTRIES)
    layout = TableLayout(
        first=t.first,
        last=t.last,
        viewpoint_mm=t.viewpoint,
        radii=len(t.radii),
        origins=len(t.origins),
        lattice=0,
        limits=0,
        starts=0,
    )
    return CameraTables(layout, np.concatenate([t.radii, *t.origins.T]).astype(np.float32))


@lru_cache(maxsize=64)
def camera_model(
    id: str, name: str, title: str, options: tuple[str, ...], camera: AnyCamera
) -> CameraInfo:
    """Return the description of a camera for the page, without its tables."""
    field, frame, layout = field_of(camera), frame_of(camera), camera_tables(camera).layout
    centre, radius = _circle(camera)
    return CameraInfo(
        id=id,
        name=name,
        title=title,
        kind=kind_of(camera),
        options=options,
        mount=mount_message(camera.mount),
        mount_in_file=mount_message(camera.mount),
        image_size=camera.image_size,
        centre_px=centre,
        rim_radius_px=radius,
        axis=_vector(frame.axis),
        right=_vector(frame.right),
        down=_vector(frame.down),
        tilt_min_deg=field.tilt_min_deg,
        tilt_max_deg=field.tilt_max_deg,
        pixels_per_degree=field.pixels_per_degree,
        pole=field.pole,
        is_image_reversed=camera.is_image_reversed,
        is_adjustable=camera.symmetry is not None and isinstance(camera, Sensor | MirrorBall),
        tables=layout,
    )


def kind_of(camera: AnyCamera) -> Kind:
    """Return the command-line option for a camera of this kind."""
    return (
        "ocam"
        if isinstance(camera, OCam)
        else "ball"
        if isinstance(camera, MirrorBall)
        else "sensor"
    )


def title_of(camera: AnyCamera) -> str:
    """Return a one-line description of a camera."""
    if isinstance(camera, Sensor):
        return (camera.notes.strip().splitlines() or [f"{camera.mirror.KIND} mirror"])[0]
    if isinstance(camera, OCam):
        return f"OCamCalib, {camera.optics}"
    if isinstance(camera, MirrorBall):
        return f"mirror ball imaged from a large distance, field {camera.field_deg:g}°"
    return f"calibrated {camera.optics}, {camera.KIND.replace('-', ' ')} model"


def mount_message(mount: Mount) -> MountInfo:
    """Convert a mount to a message."""
    return MountInfo(
        camera_looks=mount.camera_looks,
        forward_azimuth_deg=mount.forward_azimuth_deg,
        image_flipped=mount.image_flipped,
        pitch_deg=mount.pitch_deg,
        roll_deg=mount.roll_deg,
    )


# -- Cameras without rotational symmetry -----------------------------------------------------------


def _lattice_tables(camera: AnyCamera) -> CameraTables:
    project = _projection(camera)
    limits = _limits(project)
    end = min(1.0, FIELD_MARGIN * float(limits.max()))
    message = (
        _with_starts(camera, project) if isinstance(camera, Sensor | ViewpointSpline) else project
    )
    message = _within(limits, 2 * end / (LATTICE - 1), message)
    tables = continued(lattice_of(message, np.linspace(-end, end, LATTICE), _sides_of_tube(camera)))
    pixels, starts = np.nan_to_num(tables[..., :2], nan=-1e6), np.nan_to_num(tables[..., 2:])
    layout = TableLayout(
        first=0.0,
        last=end,
        viewpoint_mm=0.0,
        radii=0,
        origins=0,
        lattice=LATTICE,
        limits=LIMITS,
        starts=LATTICE if starts.size else 0,
    )
    return CameraTables(
        layout, np.concatenate([np.ravel(v) for v in (pixels, limits, starts)]).astype(np.float32)
    )


def _within(limits: Array, margin: float, message: Exact) -> Exact:
    """Wrap a function to skip points (n, 2) farther than a margin outside the field boundary."""

    def evaluated(points: Array) -> Array:
        end = np.interp(
            np.arctan2(*points.T[::-1]) % (2 * np.pi), _azimuths(), np.append(limits, limits[0])
        )
        near = np.hypot(*points.T) <= end + margin
        answers = message(points[near])
        values = np.full((len(points), answers.shape[1]), np.nan)
        values[near] = answers
        return values

    return evaluated


def _with_starts(camera: Sensor | ViewpointSpline, project: Exact) -> Exact:
    """Return a function of pixels and ray origins (n, 3), mm along axis, right and down; NaN
    outside the field."""
    axes = np.stack(frame_of(camera), axis=-1)
    if isinstance(camera, Sensor) and not camera.is_axial and camera.secondary is None:
        return _traced_once(camera, axes)

    def traced(points: Array) -> Array:
        pixels = project(points)
        visible = np.isfinite(pixels[:, 0])
        starts = np.full((len(points), 3), np.nan)
        starts[visible] = rotate_vectors(camera.backproject(pixels[visible]).origins, axes)
        return np.concatenate([pixels, starts], axis=1)

    return traced


def _traced_once(sensor: Sensor, axes: Array) -> Exact:
    """Return the same function for a sensor that is ray-traced; the tracer returns pixel and ray
    origin together."""
    train, rotation = sensor.optical_train, sensor.mount.rotation()

    def traced(points: Array) -> Array:
        values = np.full((len(points), 5), np.nan)
        inside, directions = _directions_of(points, axes.T)
        image, start = train.image_and_start_of(
            RayEndpoints.of(rotate_vectors(directions, rotation), distant=True)
        )
        pixels = sensor.image_plane.pixels(image)
        rows = np.concatenate([pixels, rotate_vectors(start, rotation.T @ axes)], axis=1)
        rows[~inside_image(pixels, sensor.image_size)] = np.nan
        values[inside] = rows
        return values

    return traced


def _sides_of_tube(camera: AnyCamera) -> PartOf | None:
    """Return a function of the ray origin: mirror (0), beyond an end of the tube (1), tube (1);
    None without tube."""
    shell = camera.housing.shell if isinstance(camera, Sensor) else None
    if not isinstance(camera, Sensor) or not isinstance(shell, Tube):
        return None
    between = (camera.mirror.rim_radius_mm + shell.radii_mm[1]) / 2
    return lambda rows: (np.hypot(rows[..., 3], rows[..., 4]) > between).astype(np.intp)


def _projection(camera: AnyCamera) -> Exact:
    """Return a function of pixels (n, 2) of points (n, 2) in the disc; NaN outside the field."""
    frame = np.stack(frame_of(camera))

    def project(points: Array) -> Array:
        pixels = np.full((len(points), 2), np.nan)
        inside, directions = _directions_of(points, frame)
        pixels[inside] = camera.project_directions(directions).pixels
        return pixels

    return project


def _directions_of(points: Array, frame: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return the mask of points (n, 2) inside the disc, and their directions (k, 3)."""
    sine2 = np.einsum("ni,ni->n", points, points)  # sin^2 of half the angle
    inside = sine2 <= 1
    across = 2 * np.sqrt(1 - sine2[inside, None]) * points[inside]
    return inside, np.concatenate([1 - 2 * sine2[inside, None], across], axis=1) @ frame


def _limits(project: Exact) -> Array:
    """Return the field boundary, sin(Omega/2), at equidistant azimuths.

    The boundary is searched at some azimuths and interpolated at the others. There, two nearby
    points test if the boundary is between them, with the inner one visible; on failure the bracket
    is widened, and finally the whole range is searched.
    """
    phi = _azimuths()[:-1]
    few = _narrowed(project, phi[:: LIMITS // BOUNDARY_AZIMUTHS], np.zeros(BOUNDARY_AZIMUTHS), 1.0)
    nodes = TAPS // 2 - 1 + np.arange(0.0, 1.0, BOUNDARY_AZIMUTHS / LIMITS)
    beside = np.stack([np.roll(few, TAPS // 2 - 1 - k) for k in range(TAPS)], axis=1)
    estimate = (beside @ weights_between(nodes, np.zeros(len(nodes), int)).T).ravel()
    ends, unknown = np.zeros(LIMITS), np.arange(LIMITS)
    for near in BRACKET_HALF_WIDTHS:
        inner, outer = estimate[unknown] - near, np.minimum(estimate[unknown] + near, 1.0)
        is_there = _seen(project, phi[unknown], inner) & ~_seen(project, phi[unknown], outer)
        settled, unknown = unknown[is_there], unknown[~is_there]
        ends[settled] = _narrowed(project, phi[settled], inner[is_there], 2 * near)
    ends[unknown] = _narrowed(project, phi[unknown], ends[unknown], 1.0)
    return ends


def _narrowed(project: Exact, phi: Array, low: Array, width: float) -> Array:
    """Refine the boundary (n,) at azimuths (n,) within a bracket of given width to :data:`BOUNDARY_ACCURACY`."""
    parts = min(max(CALL // max(len(phi), 1), 2), 16)  # simultaneous subdivisions of the bracket
    while width > BOUNDARY_ACCURACY and len(phi):
        width /= parts
        trials = low + width * np.arange(1, parts)[:, None]
        visible = _seen(
            project, np.broadcast_to(phi, trials.shape).ravel(), trials.ravel()
        ).reshape(trials.shape)
        low = low + width * np.where(visible.all(axis=0), parts - 1, visible.argmin(axis=0))
    return low


def _seen(project: Exact, phi: Array, sine: Array) -> NDArray[np.bool_]:
    """Check if directions at azimuths (n,) and sin(Omega/2) (n,) are in the field."""
    return np.asarray(
        np.isfinite(project(sine[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1))[:, 0])
    )


def _azimuths() -> Array:
    """Return the azimuths of the field boundary over one turn."""
    return np.linspace(0.0, 2 * np.pi, LIMITS + 1)


def _circle(camera: AnyCamera) -> tuple[tuple[float, float], float]:
    """Return the image of the axis and the radius of the field boundary, or of its best-fit circle."""
    symmetry = camera.symmetry
    if symmetry is not None:
        return symmetry.centre_px, float(symmetry.radius_px(np.array([symmetry.omega_max]))[0])
    if isinstance(camera, Sensor):
        return camera.imager.centre, camera.aligned().rim_radius_px
    return camera.centre_px, camera.field_radius_px


def _vector(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
