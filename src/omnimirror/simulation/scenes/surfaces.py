"""Scenes of flat textured surfaces: parallelograms and triangles with baked light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.colour import Light
from ...base.native import CompiledSurfaces, backend, kernel_array
from ...base.numerics.lazy import cached_property
from ...base.typing import Array

BESIDE = 1e-6  # relative to a side: no gaps between surfaces that share an edge
RAYS_AT_ONCE = 1 << 22  # rays times surfaces, in NumPy


class Texture(NamedTuple):
    """Texture of surfaces."""

    texels: Light
    """Texels (h, w, 4): linear red, green, blue, and the transmitted fraction of the background."""
    repeats: bool = False
    """True for a periodic texture; otherwise its edge is repeated."""


class Seen(NamedTuple):
    """First intersections of rays (n,)."""

    light: Light
    """Light (n, 3), 0 without intersection."""
    clear: NDArray[np.float32]
    """Transmitted fraction (n,) of the background, 0 without intersection."""
    distance: NDArray[np.float32]
    """Distances (n,) in lengths of the direction, infinite without intersection."""


RECORD = np.dtype([
    ("corner", "<f4", 3),
    ("sides", "<f4", (2, 3)),
    ("texel", "<f4", 2),
    ("texel_sides", "<f4", (2, 2)),
    ("kind", "<i4"),
])  # fmt: skip
"""Surface record of the compiled kernels: corner and sides in mm, column and row of the corner in
its texture and the increments along the sides; and the texture index, or -1 minus the index for a
triangle (the half of the parallelogram at the corner).
"""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Two-sided surfaces, each a corner and two sides.

    Parameters
    ----------
    records : (n,) array of :data:`RECORD`
        Records in any order; compilation reorders them in place to the order of their tree, because
        there may be millions.
    textures

    Examples
    --------
    >>> white = Texture(np.array([[[1, 1, 1, 0]]], np.float32))
    >>> wall = np.array([[[5.0, 1, -1], [0, -2, 0], [0, 0, 2]]])
    >>> scene = Surfaces.of(wall, np.zeros((1, 3, 2)), np.zeros(1, int), np.zeros(1, bool), (white,))
    >>> seen = scene.seen(np.zeros((2, 3)), np.array([[1.0, 0, 0], [1.0, 1.0, 0]]))
    >>> seen.distance
    array([ 5., inf], dtype=float32)
    """

    records: NDArray[np.void]
    textures: tuple[Texture, ...]

    @classmethod
    def of(
        cls, places: Array, texture_coordinates: NDArray[np.floating], texture_of: NDArray[np.integer] | int,
        is_triangle: NDArray[np.bool_] | bool, textures: tuple[Texture, ...],
    ) -> Surfaces:  # fmt: skip
        """Create surfaces from their parts.

        Parameters
        ----------
        places : (n, 3, 3) array, mm
            Corner and both sides, in the world frame.
        texture_coordinates : (n, 3, 2) array, texels
            Column and row of the corner in its texture, and the increments along the sides.
        texture_of : (n,) array, or of all
            Texture index of each surface.
        is_triangle : (n,) array, or of all
            True for the half of the parallelogram at the corner.
        textures
        """
        records = np.empty(len(places), RECORD)
        records["corner"], records["sides"] = places[:, 0], places[:, 1:]
        records["texel"], records["texel_sides"] = texture_coordinates[:, 0], texture_coordinates[:, 1:]
        records["kind"] = np.where(is_triangle, -1 - np.asarray(texture_of), texture_of)
        return cls(records, textures)

    def seen(self, origins_mm: Array, directions: Array) -> Seen:
        """Return the first intersections of rays from origins (n, 3) mm in directions (n, 3)."""
        if not backend.is_compiled:
            return self._seen_by_all(origins_mm, directions)
        count = len(origins_mm)
        light, distance = np.empty((count, 4), np.float32), np.empty(count, np.float32)
        origins, towards = (kernel_array(a, np.float32) for a in (origins_mm, directions))
        self.native.radiance(origins, towards, light, distance)
        return Seen(light[:, :3], light[:, 3], distance)

    @cached_property
    def native(self) -> CompiledSurfaces:
        """Compiled surfaces."""
        texels = [t.texels.reshape(-1, 4) for t in self.textures]
        sizes = [(t.texels.shape[1], t.texels.shape[0], t.repeats) for t in self.textures]
        made = backend.kernels.Surfaces(
            np.ascontiguousarray(self.records).view(np.float32).reshape(len(self.records), RECORD.itemsize // 4),
            np.array(sizes, np.int32).reshape(-1, 3),
            np.ascontiguousarray(texels[0] if len(texels) == 1 else np.concatenate(texels), np.float32),
        )
        object.__setattr__(self, "records", made.records.view(RECORD)[:, 0])
        return made

    # -- without the compiled module -------------------------------------------------------------

    def _seen_by_all(self, origins: Array, directions: Array) -> Seen:
        """Intersect every ray with every surface; same results, slowly."""
        step = max(1, RAYS_AT_ONCE // max(1, len(self.records)))
        parts = [
            self._seen_at_once(origins[i : i + step], directions[i : i + step]) for i in range(0, len(origins), step)
        ]
        if not parts:
            return Seen(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32))
        return Seen(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _seen_at_once(self, origins: Array, directions: Array) -> Seen:
        distance, a, b = self._meet(origins, directions)
        first = distance.argmin(axis=1)
        rays = np.arange(len(origins))
        nearest = distance[rays, first]
        hit = np.isfinite(nearest)
        light = np.zeros((len(origins), 4), np.float32)
        met = self.records[first]
        texture_of = np.where(met["kind"] < 0, -1 - met["kind"], met["kind"])
        for number, texture in enumerate(self.textures):
            on = np.flatnonzero(hit & (texture_of == number))
            along_a, along_b = np.moveaxis(met["texel_sides"][on], 1, 0)
            place = met["texel"][on] + a[on, first[on], None] * along_a + b[on, first[on], None] * along_b
            light[on] = _look_up(texture, place)
        return Seen(light[:, :3], light[:, 3], nearest.astype(np.float32))

    def _meet(self, origins: Array, directions: Array) -> tuple[Array, Array, Array]:
        """Return distances (n, surfaces), infinite without intersection, and positions on the sides
        (Moeller and Trumbore, 1997).
        """
        corner, sides = (self.records[name].astype(float) for name in ("corner", "sides"))
        side, other = np.moveaxis(sides, 1, 0)
        p = np.cross(directions[:, None], other)
        start = origins[:, None] - corner
        q = np.cross(start, side)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / np.einsum("sj,nsj->ns", side, p)
            a = np.einsum("nsj,nsj->ns", start, p) * inverse
            b = np.einsum("nj,nsj->ns", directions, q) * inverse
            t = np.einsum("sj,nsj->ns", other, q) * inverse
            end = np.where(self.records["kind"] < 0, a + b, np.maximum(a, b))
            on = (np.minimum(a, b) >= -BESIDE) & (end <= 1 + BESIDE) & (t > 0)
        return np.where(on, t, np.inf), a, b


def joined(one: Surfaces, other: Surfaces) -> Surfaces:
    """Combine surfaces in a canonical order.

    Rays meet the same one of two coincident surfaces, independent of the order of compiled
    surfaces.
    """
    added = other.records.copy()
    added["kind"] += np.where(added["kind"] < 0, -len(one.textures), len(one.textures)).astype(np.int32)
    records = np.concatenate([one.records, added])
    return Surfaces(records[np.argsort(records.view(f"V{RECORD.itemsize}"))], one.textures + other.textures)


def _look_up(texture: Texture, place: Array) -> Light:
    """Return texels (n, 4), interpolated bilinearly, at columns and rows (n, 2)."""
    size = np.array(texture.texels.shape[1::-1])
    if not texture.repeats:
        place = np.clip(place, 0, size - 1)
    first = np.floor(place).astype(int)
    share = (place - first).astype(np.float32)
    (left, top), (right, bottom) = (
        (np.mod(i, size) if texture.repeats else np.minimum(i, size - 1)).T for i in (first, first + 1)
    )
    fx, fy = share[:, :1], share[:, 1:]
    upper = texture.texels[top, left] * (1 - fx) + texture.texels[top, right] * fx
    lower = texture.texels[bottom, left] * (1 - fx) + texture.texels[bottom, right] * fx
    mixed: Light = upper * (1 - fy) + lower * fy
    return mixed
