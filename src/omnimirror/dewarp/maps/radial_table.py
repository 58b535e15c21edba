"""The projection of a camera symmetric about an axis, from tables: no trigonometry and nothing of the mirror's own.

Built once per camera, the tables are indexed by ``sin(Omega/2)``, which square roots give from a direction
(``cos Omega`` would have a kink on the axis). One holds the image radius, with which a direction becomes a pixel
by one product; the other where the rays start, with which the ray that meets a near point is found by Newton's rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.native import AxialCamera, backend, kernel_array
from ...base.numerics.lazy import cached_property
from ...cameras.camera import AxialSymmetry, Camera, Mask, inside_image
from ...cameras.frames import turned

Array = NDArray[np.float64]

ENTRIES = 1 << 15  # linear interpolation between so many errs by 1e-6 px at 1000 px of radius
ORIGINS = 1 << 14  # of places on the mirror: next to it, where it matters most, some 1e-5 px
SLACK = 1e-9  # radians; the rim itself is seen
CLOSE = 1e-7  # of sin(Omega/2): a Newton step this small leaves an error of about its square
GAP = 0.1  # less than any jump of a sine between two directions that differ by 360 degrees
MOST_STEPS = 100  # bisection alone needs 25


class Tables(NamedTuple):
    """What is known of a camera at even steps of sin(Omega/2)."""

    first: float
    last: float
    """Its ends."""
    radii: Array
    """(n,) px, of the image."""
    origins: Array
    """(m, 2) mm, from the axis and along it, of the rays; (0, 2) where all start at the world's origin."""
    viewpoint: float
    """About where along the axis near things are seen from, mm: where the ray in the middle passes it."""


@dataclass(frozen=True)
class RadialTable:
    """Pixels of points and directions for a camera with an axis of symmetry."""

    symmetry: AxialSymmetry
    image_size: tuple[int, int]

    def pixels(self, targets: Array, are_points: bool = False) -> Array:
        """Pixels (..., 2) of directions (..., 3) of any length, or of points in mm; NaN outside field or picture."""
        return self._project(targets, are_points, None)

    def pixels_and_excess(self, targets: Array, are_points: bool = False) -> tuple[Array, Array]:
        """Pixels (..., 2), and about how far (...) px the targets lie outside field or picture: not above 0 within.

        NaN where there is no telling.
        """
        excess = np.empty(targets.shape[:-1])
        return self._project(targets, are_points, excess), excess

    def radii_px(self, across: Array, along: Array, are_points: bool) -> Array:
        """Image radii (n,) px of directions, or of points in mm, given by their distances from the axis and along it.

        NaN outside the field; whether the picture reaches so far does not matter.
        """
        radii, seen = self._radii_of(self._half_sines(across, along, are_points))
        radii[~seen] = np.nan
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
        """What the compiled module does, several times slower."""
        (x, y), (width, height) = self.symmetry.centre_px, self.image_size
        with np.errstate(invalid="ignore"):  # what is not finite is not seen
            along, right, down = np.moveaxis(turned(targets, self._frame.T), -1, 0)
        across = np.hypot(right, down)
        radii, seen = self._radii_of(self._half_sines(across, along, are_points))
        off_axis = across > 0  # on the axis any azimuth is as good
        positive = np.maximum(radii, 0)
        scale = positive / np.where(off_axis, across, 1.0)
        u, v = x + np.where(off_axis, scale * right, positive), y + np.where(off_axis, scale * down, 0.0)
        pixels = np.stack([u, v], axis=-1)
        seen &= inside_image(pixels, self.image_size)
        pixels[~seen] = np.nan
        if excess is not None:
            beyond = np.maximum.reduce([-u, u - (width - 1), -v, v - (height - 1)]) - 0.5
            ends = self._tables.radii[[0, -1]]
            excess[...] = np.where(seen, 0.0, np.maximum.reduce([radii - ends[1], ends[0] - radii, beyond]))
        return pixels

    def _half_sines(self, across: Array, along: Array, are_points: bool) -> Array:
        if are_points and len(self._tables.origins):
            return _solve_points(self._tables, across, along)
        return _half_angles(across, along)[0]

    def _radii_of(self, half_sines: Array) -> tuple[Array, Mask]:
        """Image radii (px), which go on in a straight line beyond the field, and where the field is."""
        first, last, radii, *_ = self._tables
        low, rise, fraction = _cells(radii, half_sines, self._tables)
        radius: Array = low + fraction * rise
        return radius, (half_sines >= first - SLACK) & (half_sines <= last + SLACK)


def tables_of(symmetry: AxialSymmetry, entries: int = ENTRIES, origins: int = ORIGINS) -> Tables:
    """The tables of a camera; with 2048 entries, as graphics cards take them, radii err by some 3e-4 px at 1000 px."""
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
    """The table of a camera, found once: a view that moves asks in every frame. None without an axis of symmetry."""
    symmetry = camera.symmetry
    return None if symmetry is None else RadialTable(symmetry, camera.image_size)


# -- the formulas, as in native/src/sampling/axial_kernel.hpp -----------------------------------------------


def _cells(table: Array, half_sines: Array, tables: Tables) -> tuple[Array, Array, Array]:
    """Of each cell of a table its first value and its rise, and the place in it."""
    position = (half_sines - tables.first) * ((len(table) - 1) / (tables.last - tables.first))
    cell = np.nan_to_num(position).clip(0, len(table) - 2).astype(int)
    low: Array = table[cell]
    return low, table[cell + 1] - low, position - cell


def _half_angles(across: Array, along: Array) -> tuple[Array, Array]:
    """Sine and cosine of half the angle between the axis and directions, without cancellation anywhere.

    The angle lies between -90 and 270 degrees; past 180 the sine, which would fall again, is mirrored.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        length = np.hypot(across, along)
        more = np.sqrt((length + np.abs(along)) / (2 * length))
        less = np.abs(across) / (2 * length * more)
    ahead = along > 0
    sine = np.where(ahead, less, more)
    return np.where(across < 0, np.where(ahead, -less, 2 - more), sine), np.where(ahead, more, less)


def _solve_points(tables: Tables, across: Array, along: Array) -> Array:
    """Sine of half the field angle under which points are seen; beyond the ends, or NaN, where they are not.

    Solves ``q = sin(phi(q)/2)``, phi the direction to the point from where the ray of q starts, by Newton's rule
    within a bracket that only shrinks. The difference grows at any root, so that the root is unique.
    """
    first, last, _, origins, viewpoint = tables
    per = (len(origins) - 1) / (last - first)
    q = np.clip(np.nan_to_num(_half_angles(across, along - viewpoint)[0], nan=first), first, last)
    low, high = np.full_like(q, 2 * first - last), np.full_like(q, 2 * last - first)
    sought = np.full_like(q, np.nan)
    for _ in range(MOST_STEPS):
        (x, x_rate, fraction), (z, z_rate, _) = (_cells(column, q, tables) for column in origins.T)
        dx, dz = across - (x + fraction * x_rate), along - (z + fraction * z_rate)
        sine, cosine = _half_angles(dx, dz)
        with np.errstate(invalid="ignore", divide="ignore"):
            miss, rate = q - sine, 1 - 0.5 * cosine * per * (dx * z_rate - dz * x_rate) / (dx**2 + dz**2)
            newton = q - miss / rate
        low, high = np.where(miss <= 0, q, low), np.where(miss >= 0, q, high)
        inside = (newton >= low) & (newton <= high)
        following = np.clip(np.where(inside, newton, (low + high) / 2), first, last)
        beyond = ((miss > 0) & (q <= first)) | ((miss < 0) & (q >= last))
        # A gap that bisection closed in on is no root: it is of a point inside the mirror, or in its shadow.
        sought = np.where(beyond, q - miss, np.where(np.abs(miss) < GAP, newton, np.nan))
        moved, q = np.abs(following - q).max(initial=0.0), following
        if moved <= CLOSE:
            break
    return sought
