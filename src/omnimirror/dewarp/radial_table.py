"""Tabulated projection of axially symmetric cameras, without trigonometric functions and
independent of the mirror.

The tables are built once per camera and indexed by ``sin(Omega/2)``, which follows from a direction
by square roots (``cos Omega`` would have a singular slope on the axis). One table contains the
image radius, which converts a direction to a pixel by one product; the other contains the ray
origins, which determine the ray to a point at a finite distance by Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..base.caching import cached_property
from ..base.native import AxialCamera, backend, kernel_array
from ..base.typing import Array, Mask
from ..cameras.camera import AxialSymmetry, Camera, inside_image
from ..cameras.frames import rotate_vectors

ENTRIES = 1 << 15  # linear interpolation error 1e-6 px at 1000 px radius
ORIGINS = 1 << 14  # ray origins on the mirror; error some 1e-5 px near the mirror, the worst case
ANGLE_TOLERANCE_RAD = 1e-9  # radians; the rim itself is inside the field
CONVERGENCE_TOLERANCE = (
    1e-7  # step in sin(Omega/2): the remaining error of a Newton step is about its square
)
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
