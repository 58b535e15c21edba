"""Source coordinates of the pixels of a view: exact, tabulated for axially symmetric cameras, or
interpolated with local refinement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.caching import cached_property
from ..base.native import AxialCamera, backend, kernel_array
from ..base.typing import Array, Mask
from ..cameras.camera import AxialSymmetry, Camera, inside_image, pan_tilt_direction, rotate_vectors
from .maps import LatticeMap, PolarMap
from .screens import Panorama, Screen, View, parts_of
from .screens._projections import is_screen, pixels_of_rows
from .view_geometry import Viewpoint, centre_of_projection, is_vertical, projection_of

# -- Tabulated projection of axially symmetric cameras ---------------------------------------------
#
# The tables are built once per camera and indexed by sin(Omega/2), which follows from a direction by
# square roots (cos Omega would have a singular slope on the axis). One table contains the image
# radius, which converts a direction to a pixel by one product; the other contains the ray origins,
# which determine the ray to a point at a finite distance by Newton's method.

ENTRIES = 1 << 15  # linear interpolation error 1e-6 px at 1000 px radius
ORIGINS = 1 << 14  # ray origins on the mirror; error some 1e-5 px near the mirror, the worst case
ANGLE_TOLERANCE_RAD = 1e-9  # radians; the rim itself is inside the field
# Step in sin(Omega/2): the remaining error of a Newton step is about its square
CONVERGENCE_TOLERANCE = 1e-7
MAX_ROOT_RESIDUAL = 0.1  # below any jump of the sine between two directions that differ by 360 deg
MAX_STEPS = 100  # bisection alone requires 25


class Tables(NamedTuple):
    """Tables of a camera at equal steps of sin(Omega/2)."""

    first: float
    last: float
    """Range of sin(Omega/2)."""
    radii: Array
    """Image radii (n,), px."""
    origins: Array
    """Ray origins (m, 2), mm, across and along the axis; (0, 2) if all rays start at the world
    origin.
    """
    viewpoint: float
    """Approximate viewpoint on the axis, mm: intersection of the middle ray with the axis."""


@dataclass(frozen=True)
class RadialTable:
    """Projection of points and directions for a camera with an axis of symmetry."""

    symmetry: AxialSymmetry
    image_size: tuple[int, int]

    def pixels(self, targets: Array, are_points: bool = False) -> Array:
        """Return pixels (..., 2) of directions (..., 3) of any length, or of points in mm; NaN
        outside the field or image.
        """
        return self._project(targets, are_points, None)

    def pixels_and_excess(self, targets: Array, are_points: bool = False) -> tuple[Array, Array]:
        """Return pixels (..., 2) and the approximate distance (...) px outside the field or image:
        <= 0 inside.

        The distance is NaN if unknown.
        """
        excess = np.empty(targets.shape[:-1])
        return self._project(targets, are_points, excess), excess

    def radii_px(self, across: Array, along: Array, are_points: bool) -> Array:
        """Return image radii (n,) px of directions, or points in mm, given across and along the
        axis.

        Radii outside the field are NaN; the image boundary is ignored.
        """
        radii, visible = self._radii_of(self._half_sines(across, along, are_points))
        radii[~visible] = np.nan
        return radii

    @cached_property
    def _tables(self) -> Tables:
        return tables_of(self.symmetry)

    @cached_property
    def _frame(self) -> Array:
        return np.stack([self.symmetry.axis, self.symmetry.right, self.symmetry.down])

    @cached_property
    def _compiled(self) -> AxialCamera:
        (x, y), (width, height) = self.symmetry.centre_px, self.image_size
        return backend.kernels.AxialCamera(self._frame, x, y, width, height, *self._tables)

    def _project(self, targets: Array, are_points: bool, excess: Array | None) -> Array:
        if not backend.is_compiled:
            return self._project_here(targets, are_points, excess)
        pixels = np.empty((*targets.shape[:-1], 2))
        rows = kernel_array(targets, np.float64).reshape(-1, 3)
        flat = None if excess is None else excess.reshape(-1)
        self._compiled.project(rows, are_points, pixels.reshape(-1, 2), flat)
        return pixels

    def _project_here(self, targets: Array, are_points: bool, excess: Array | None) -> Array:
        """Compute the projection in NumPy, several times slower than the compiled module."""
        (x, y), (width, height) = self.symmetry.centre_px, self.image_size
        with np.errstate(invalid="ignore"):  # non-finite targets are not visible
            along, right, down = np.moveaxis(rotate_vectors(targets, self._frame.T), -1, 0)
        across = np.hypot(right, down)
        radii, visible = self._radii_of(self._half_sines(across, along, are_points))
        off_axis = across > 0  # the azimuth is arbitrary on the axis
        positive = np.maximum(radii, 0)
        scale = positive / np.where(off_axis, across, 1.0)
        u, v = (
            x + np.where(off_axis, scale * right, positive),
            y + np.where(off_axis, scale * down, 0.0),
        )
        pixels = np.stack([u, v], axis=-1)
        visible &= inside_image(pixels, self.image_size)
        pixels[~visible] = np.nan
        if excess is not None:
            beyond = np.maximum.reduce([-u, u - (width - 1), -v, v - (height - 1)]) - 0.5
            ends = self._tables.radii[[0, -1]]
            excess[...] = np.where(
                visible, 0.0, np.maximum.reduce([radii - ends[1], ends[0] - radii, beyond])
            )
        return pixels

    def _half_sines(self, across: Array, along: Array, are_points: bool) -> Array:
        if are_points and len(self._tables.origins):
            return _solve_points(self._tables, across, along)
        return _half_angles(across, along)[0]

    def _radii_of(self, half_sines: Array) -> tuple[Array, Mask]:
        """Return image radii (px), extrapolated linearly outside the field, and the mask of the
        field.
        """
        first, last, radii, *_ = self._tables
        low, rise, fraction = _cells(radii, half_sines, self._tables)
        radius: Array = low + fraction * rise
        return radius, (half_sines >= first - ANGLE_TOLERANCE_RAD) & (
            half_sines <= last + ANGLE_TOLERANCE_RAD
        )


def tables_of(symmetry: AxialSymmetry, entries: int = ENTRIES, origins: int = ORIGINS) -> Tables:
    """Return the tables of a camera; with 2048 entries, as on GPUs, radius errors are some 3e-4 px
    at 1000 px.
    """
    first, last = (float(np.sin(omega / 2)) for omega in (symmetry.omega_min, symmetry.omega_max))

    def angles(count: int) -> Array:
        omega: Array = 2 * np.arcsin(np.clip(np.linspace(first, last, count), 0, 1))
        return omega.clip(symmetry.omega_min, symmetry.omega_max)

    radii = symmetry.radius_px(angles(entries))
    if symmetry.origin_mm is None:
        return Tables(first, last, radii, np.empty((0, 2)), 0.0)
    omega = angles(origins)
    x, z = symmetry.origin_mm(omega)
    middle = origins // 2
    viewpoint = float(z[middle] - x[middle] / np.tan(omega[middle]))
    return Tables(first, last, radii, np.stack([x, z], axis=-1), viewpoint)


@lru_cache(maxsize=32)
def radial_table(camera: Camera) -> RadialTable | None:
    """Return the cached table of a camera, as moving views need it in every frame; None without an
    axis of symmetry.
    """
    symmetry = camera.symmetry
    return None if symmetry is None else RadialTable(symmetry, camera.image_size)


# -- Formulas, identical to native/src/sampling/axial_kernel.hpp -----------------------------------


def _cells(table: Array, half_sines: Array, tables: Tables) -> tuple[Array, Array, Array]:
    """Return the first value and the difference of each table cell, and the fraction within it."""
    position = (half_sines - tables.first) * ((len(table) - 1) / (tables.last - tables.first))
    cell = np.nan_to_num(position).clip(0, len(table) - 2).astype(int)
    low: Array = table[cell]
    return low, table[cell + 1] - low, position - cell


def _half_angles(across: Array, along: Array) -> tuple[Array, Array]:
    """Return sine and cosine of half the angle between the axis and directions, without
    cancellation.

    The angle is between -90 and 270 deg; beyond 180 deg the sine is mirrored to remain monotonic.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        # Half-angle formulas: sin^2(W/2) = (1 - cos W) / 2, cos^2(W/2) = (1 + cos W) / 2. The larger
        # one is computed directly, the smaller one from sin W = 2 sin(W/2) cos(W/2), which avoids
        # the cancellation in 1 - |cos W|.
        length = np.hypot(across, along)
        more = np.sqrt((length + np.abs(along)) / (2 * length))
        less = np.abs(across) / (2 * length * more)
    ahead = along > 0
    sine = np.where(ahead, less, more)
    return np.where(across < 0, np.where(ahead, -less, 2 - more), sine), np.where(ahead, more, less)


def _solve_points(tables: Tables, across: Array, along: Array) -> Array:
    """Return the sine of half the field angle of points; outside the range, or NaN, for invisible
    points.

    Solves ``q = sin(phi(q)/2)``, with the direction phi from the origin of ray q to the point, by
    Newton's method within a shrinking bracket. The difference increases at any root; the root is
    therefore unique.
    """
    first, last, _, origins, viewpoint = tables
    per = (len(origins) - 1) / (last - first)
    q = np.clip(np.nan_to_num(_half_angles(across, along - viewpoint)[0], nan=first), first, last)
    low, high = np.full_like(q, 2 * first - last), np.full_like(q, 2 * last - first)
    roots = np.full_like(q, np.nan)
    for _ in range(MAX_STEPS):
        (x, x_rate, fraction), (z, z_rate, _) = (_cells(column, q, tables) for column in origins.T)
        # f(q) = q - sin(phi/2), f' = 1 - cos(phi/2) / 2 * dphi/dq, with the angle phi of (dx, dz)
        # to the axis and dphi/dq = (dx z' - dz x') / (dx^2 + dz^2) for the origin (x, z)(q)
        dx, dz = across - (x + fraction * x_rate), along - (z + fraction * z_rate)
        sine, cosine = _half_angles(dx, dz)
        with np.errstate(invalid="ignore", divide="ignore"):
            miss, rate = (
                q - sine,
                1 - 0.5 * cosine * per * (dx * z_rate - dz * x_rate) / (dx**2 + dz**2),
            )
            newton = q - miss / rate
        low, high = np.where(miss <= 0, q, low), np.where(miss >= 0, q, high)
        inside = (newton >= low) & (newton <= high)
        next_q = np.clip(np.where(inside, newton, (low + high) / 2), first, last)
        beyond = ((miss > 0) & (q <= first)) | ((miss < 0) & (q >= last))
        # A discontinuity isolated by bisection is not a root: the point is inside the mirror or in
        # its shadow.
        roots = np.where(
            beyond, q - miss, np.where(np.abs(miss) < MAX_ROOT_RESIDUAL, newton, np.nan)
        )
        change, q = np.abs(next_q - q).max(initial=0.0), next_q
        if change <= CONVERGENCE_TOLERANCE:
            break
    return roots


# -- Lattice with local refinement -----------------------------------------------------------------
#
# Source coordinates vary slowly over a view, and most pixels are interpolated between exact nodes
# 32, 16 or 8 pixels apart (four-point Lagrange, with an error proportional to the fourth power of
# the step). The interpolation is tested at a node in the middle of each cell and with the fourth
# differences of the nodes in each direction, because two errors of opposite sign cancel in the
# middle. Cells that fail, and cells at the field boundary, are computed pixel by pixel.

Exact = Callable[[Array, Array], Array]
"""Function that returns source pixels (..., 2) of broadcast view pixels u and v; NaN outside the
field.
"""
WithExcess = Callable[[Array, Array], tuple[Array, Array]]
"""Function that also returns the approximate distance (...) px outside the field: <= 0 inside, NaN
if unknown.
"""

TOLERANCE_PX = 0.001  # at the middle of a cell, the maximum of the interpolation error
MIN_CELLS = 6  # minimum number across and down; below it, adjacent nodes of a wide view may be on opposite sides


class NodeSpacing(NamedTuple):
    """Spacing of the nodes of a lattice, tried from wide to narrow."""

    px: int
    min_cells: int
    """Minimum number of cells across and down: coarse lattices of fewer cells are rarely exact."""
    max_exact_fraction: float
    """Maximum fraction of cells computed pixel by pixel before a finer lattice is faster."""


SPACINGS = (
    NodeSpacing(32, 20, 0.0),
    NodeSpacing(16, MIN_CELLS, 0.15),
    NodeSpacing(8, MIN_CELLS, 1.0),
)


def lattice_map(
    exact: Exact,
    size: tuple[int, int],
    source_size: tuple[int, int],
    tolerance: float = TOLERANCE_PX,
    with_excess: WithExcess | None = None,
) -> LatticeMap:
    """Return the lattice map of a view.

    Parameters
    ----------
    exact
        Projection of individual pixels of the view; also evaluated slightly beyond its edges.
    size, source_size : (width, height), px
        Size of the view and of the source images.
    tolerance : px
        Maximum error at the middle of a cell.
    with_excess
        Projection with the distance outside the field; avoids computing cells entirely outside the
        field.

    Examples
    --------
    >>> def bent(u, v):
    ...     u, v = np.broadcast_arrays(u, v)
    ...     return np.stack([np.where(u < 50, u + 1e-4 * v**2, np.nan), np.where(u < 50, v, np.nan)], axis=-1)
    >>> lattice_map(bent, (60, 40), (100, 100)).pixels()[30, [20, 49, 50]].round(3)
    array([[20.09, 30.  ],
           [49.09, 30.  ],
           [  nan,   nan]], dtype=float32)
    """
    evaluate = with_excess or (lambda u, v: _without_excess(exact(u, v)))
    lattice = None
    for spacing in (s for s in SPACINGS if min(size) >= s.min_cells * s.px):
        lattice = _Lattice(evaluate, size, spacing.px)
        patched = lattice.patched(tolerance)
        if patched.sum() <= spacing.max_exact_fraction * patched.size:
            break
    if lattice is None:
        return _pixel_by_pixel(exact, size, source_size, SPACINGS[-1].px)
    cells, patches = lattice.patches(exact, patched)
    return LatticeMap(lattice.nodes_of_kernels(), size, source_size, lattice.step, cells, patches)


def _pixel_by_pixel(
    exact: Exact, size: tuple[int, int], source_size: tuple[int, int], step: int
) -> LatticeMap:
    across, down = (-(-n // step) for n in size)
    cells = np.arange(across * down, dtype=np.int32).reshape(down, across)
    nodes, patches = (
        np.zeros((2, down + 3, across + 3), np.float32),
        _patches(exact, cells >= 0, step),
    )
    return LatticeMap(nodes, size, source_size, step, cells, patches)


def _patches(exact: Exact, where: Mask, step: int) -> NDArray[np.float32]:
    """Return source pixels (n, step, step, 2) of the cells in a mask (down, across), row by row."""
    rows, columns = np.nonzero(where)
    steps = np.arange(step, dtype=np.float64)
    pixels = exact(
        step * columns[:, None, None] + steps, step * rows[:, None, None] + steps[:, None]
    )
    return pixels.astype(np.float32)


def _without_excess(pixels: Array) -> tuple[Array, Array]:
    return pixels, np.where(np.isnan(pixels[..., 0]), np.nan, 0.0)


class _Lattice:
    """Nodes every ``step`` pixels with a margin of one node on each side, and the middles of their
    cells.

    A cell is ``unsure`` if its middle or one of the 16 nodes of its interpolation is outside the
    field, because the field boundary may intersect it. It is ``empty`` if its corners and its
    middle are so far outside, relative to the variation between the surrounding nodes, that the
    field cannot reach it.
    """

    def __init__(self, evaluate: WithExcess, size: tuple[int, int], step: int) -> None:
        self.step = step
        across, down = (-(-n // step) for n in size)
        columns, rows = (step * np.arange(-1.0, cells + 2) for cells in (across, down))
        self.nodes, excess = evaluate(columns, rows[:, None])
        self.middles, excess_within = evaluate(
            columns[1:-2] + step / 2, rows[1:-2, None] + step / 2
        )
        outside, outside_within = ~(excess <= 0), ~(excess_within <= 0)
        self.outside: Mask = outside
        self.unsure: Mask = outside_within
        self.empty: Mask = np.zeros_like(outside_within)
        if outside.any():
            self.nodes[outside] = 0.0  # the sampler would spread NaN
            self.unsure = outside_within | _in_windows(np.logical_or, outside)
            change = _in_windows(np.maximum, excess) - _in_windows(
                np.minimum, excess
            )  # over three cells
            nearest = np.minimum(_in_windows(np.minimum, excess[1:-1, 1:-1], 2), excess_within)
            self.empty = nearest > change / 2

    def patched(self, tolerance: float) -> Mask:
        """Return cells (down, across) to compute pixel by pixel: those at the field boundary, and
        those with errors above the tolerance, at the middle or between nodes.
        """
        miss = np.abs(_half_way(_half_way(self.nodes).swapaxes(0, 1)).swapaxes(0, 1) - self.middles)
        down, across = (
            _bend(self.nodes, self.outside),
            _bend(self.nodes.swapaxes(0, 1), self.outside.T).T,
        )
        exceeds = (miss[..., 0] > tolerance) | (miss[..., 1] > tolerance)
        exceeds |= ~((down <= tolerance) & (across <= tolerance))
        patched: Mask = (exceeds | self.unsure) & ~self.empty
        return patched

    def patches(self, exact: Exact, patched: Mask) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return the cell indices and patches of cells that are computed pixel by pixel."""
        cells = np.full(patched.shape, -1, np.int32)
        patches = np.empty((0, self.step, self.step, 2), np.float32)
        if patched.any():
            patches = _patches(exact, patched, self.step)
            cells[patched] = np.arange(len(patches))
        if self.empty.any():  # one shared patch
            cells[self.empty] = len(patches)
            patches = np.concatenate(
                [patches, np.full_like(patches, np.nan, shape=(1, *patches.shape[1:]))]
            )
        return cells, patches

    def nodes_of_kernels(self) -> NDArray[np.float32]:
        """Return u and v (2, rows, columns)."""
        return np.ascontiguousarray(np.moveaxis(self.nodes, -1, 0), np.float32)


def _half_way(nodes: Array) -> Array:
    """Return the cubic Lagrange midpoint of the inner two of every 4 rows: (n, ...) to
    (n - 3, ...).
    """
    middle: Array = (9 * (nodes[1:-2] + nodes[2:-1]) - nodes[:-3] - nodes[3:]) / 16
    return middle


def _bend(nodes: Array, outside: Mask) -> Array:
    """Estimate the interpolation error (px) along columns (n, m) in the cells (n - 3, m - 3).

    At the midpoint, the error is 3/128 of the fourth difference. The larger difference next to the
    cell is used; NaN if all differences extend outside.
    """
    if len(nodes) < 5:
        return np.zeros((len(nodes) - 3, nodes.shape[1] - 3))
    differences = np.abs(np.diff(nodes, 4, axis=0))
    # A maximum over an axis of length 2 is slow
    fourth = 3 / 128 * np.maximum(differences[..., 0], differences[..., 1])
    if outside.any():
        fourth[np.logical_or.reduce([outside[i : len(outside) - 4 + i] for i in range(5)])] = np.nan
    padded = np.concatenate([fourth[:1], fourth, fourth[-1:]])
    at_rows = np.fmax(padded[:-1], padded[1:])
    bend: Array = np.maximum(
        at_rows[:, 1:-2], at_rows[:, 2:-1]
    )  # the two columns that bound the cell
    return bend


def _in_windows(combine: np.ufunc, values: NDArray[Any], side: int = 4) -> NDArray[Any]:
    """Reduce every ``side`` x ``side`` window of values (n, m) to one value,
    (n - side + 1, m - side + 1).
    """
    for _ in range(2):
        values = combine.reduce([values[i : len(values) - side + 1 + i] for i in range(side)]).T
    return values


# -- Source coordinates of the pixels of a view ----------------------------------------------------

STRIP_PX = 1 << 17  # output pixels per strip: their rays fit into the cache


def source_pixels(
    camera: Camera, view: View, viewpoint: Viewpoint = "exact", exact: bool = False
) -> Array:
    """Return source pixels (height, width, 2) of a view as (u, v); NaN outside the field and
    between views of a mosaic.

    With ``exact`` every pixel is projected individually; otherwise most are interpolated, with
    errors of about 0.001 px.
    """
    pixels_of_screen = exact_pixels if exact else screen_pixels
    if is_screen(view):
        return pixels_of_screen(camera, view, viewpoint)
    pixels = np.full((view.size[1], view.size[0], 2), np.nan)
    for left, top, screen in parts_of(view):
        width, height = screen.size
        pixels[top : top + height, left : left + width] = pixels_of_screen(
            camera, screen, viewpoint
        )
    return pixels


def screen_pixels(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> Array:
    """Return source pixels (height, width, 2) of a screen with the fastest method."""
    if is_separable(camera, screen):
        return polar_map_of(camera, screen, viewpoint).pixels()
    return lattice_map_of(camera, screen, viewpoint).pixels().astype(np.float64)


def lattice_map_of(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> LatticeMap:
    """Return the lattice map of a screen."""
    table: RadialTable | None = radial_table(camera)  # type: ignore[arg-type]  # the cache requires Hashable
    if table is None:
        return lattice_map(
            lambda u, v: _projected(camera, screen, viewpoint, screen.targets_at(u, v)),
            screen.size,
            camera.image_size,
        )
    centre = centre_of_projection(camera, screen, viewpoint)

    def targets(u: Array, v: Array) -> Array:
        points = screen.targets_at(u, v)
        return points - centre if centre is not None and centre.any() else points

    return lattice_map(
        lambda u, v: table.pixels(targets(u, v), centre is None),
        screen.size,
        camera.image_size,
        with_excess=lambda u, v: table.pixels_and_excess(targets(u, v), centre is None),
    )


def exact_pixels(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> Array:
    """Return source pixels (height, width, 2) of a screen, projected individually in strips of
    rows.
    """
    width, height = screen.size
    pixels = np.empty((height, width, 2))
    step = max(1, STRIP_PX // width)
    for first in range(0, height, step):
        last = min(first + step, height)
        pixels[first:last] = rows_of_pixels(camera, screen, first, last, viewpoint)
    return pixels


def rows_of_pixels(
    camera: Camera, screen: Screen, first_row: int, last_row: int, viewpoint: Viewpoint = "exact"
) -> Array:
    """Return source pixels (rows, width, 2) of some rows of a screen, projected individually."""
    return _projected(
        camera,
        screen,
        viewpoint,
        screen.targets_at(*pixels_of_rows(screen.size, first_row, last_row)),
    )


def _projected(camera: Camera, screen: Screen, viewpoint: Viewpoint, targets: Array) -> Array:
    """Return source pixels (..., 2) of screen targets (..., 3), flattened to the (n, 3) of the
    camera interface.
    """
    pixels = projection_of(camera, screen, viewpoint)(targets.reshape(-1, 3)).pixels
    return pixels.reshape(*targets.shape[:-1], 2)


# -- Panoramas about the camera axis ---------------------------------------------------------------


def is_separable(camera: Camera, screen: Screen) -> bool:
    """Return True if rows are circles in the image: a panorama about the vertical axis of the
    camera.
    """
    if (
        not isinstance(screen, Panorama)
        or camera.symmetry is None
        or not is_vertical(camera.symmetry)
    ):
        return False
    return screen.is_distant or not any(screen.offset_mm[:2])


def polar_map_of(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> PolarMap:
    """Return the polar map of a separable screen."""
    symmetry = camera.symmetry
    assert isinstance(screen, Panorama)
    assert symmetry is not None
    across = pan_tilt_direction(screen.pans(), 0.0)
    angles = np.unwrap(np.arctan2(across @ symmetry.down, across @ symmetry.right))
    if screen.is_distant:
        return PolarMap(
            symmetry.centre_px, _radii_of_tilts(symmetry, screen.tilts()), angles, camera.image_size
        )
    centre = centre_of_projection(camera, screen, viewpoint)
    # One column is sufficient by symmetry
    points = screen.targets_at(np.zeros(1), np.arange(screen.size[1], dtype=float))
    points -= 0.0 if centre is None else centre
    table: RadialTable | None = radial_table(camera)  # type: ignore[arg-type]  # the cache requires Hashable
    assert table is not None
    radii = table.radii_px(
        np.hypot(points[:, 0], points[:, 1]), points @ symmetry.axis, centre is None
    )
    return PolarMap(symmetry.centre_px, radii, angles, camera.image_size)


def _radii_of_tilts(symmetry: AxialSymmetry, tilts: Array) -> Array:
    """Return image radii (n,) in px for tilts (n,) in radians; NaN outside the field."""
    omega: Array = np.pi / 2 - symmetry.axis[2] * tilts
    radii = np.full_like(omega, np.nan)
    visible = (omega >= symmetry.omega_min) & (omega <= symmetry.omega_max)
    radii[visible] = symmetry.radius_px(omega[visible])
    return radii
