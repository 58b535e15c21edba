"""Polar map: panoramas about the camera axis, whose rows are circles in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.native import backend
from ...base.numerics.lazy import cached_property
from ...base.typing import Array
from ...cameras.camera import inside_image
from ..contracts import Annulus, Averages, Interpolation, Map, RemapJob
from ..sampling.footprints import CELL_PX, RULES, Footprints, squared_sides_of_circles
from .halving import Offset, half, pairs
from .pixels import PixelMap

Floats = NDArray[np.float32]

EVERY_COLUMN = 16  # column spacing of the visibility check


@dataclass(frozen=True, eq=False)
class PolarMap:
    """Map with coordinates ``centre + radii[row] (cos, sin)(angles[column])``; see
    :class:`~omnimirror.dewarp.contracts.Map`.
    """

    centre: tuple[float, float]
    """Centre (u, v), px."""
    radii: Array
    """Radii (rows,), px; NaN outside the field."""
    angles: Array
    """Angles (columns,), radians from right towards down in the image, continuous between columns.
    """
    source_size: tuple[int, int]
    """Size (width, height) of the source images."""
    annulus: Annulus | None = None
    """Image region inside the field, for averages at the field boundary."""

    @property
    def size(self) -> tuple[int, int]:
        """Size (width, height) of the view."""
        return len(self.angles), len(self.radii)

    def pixels(self) -> Array:
        """Return coordinates (rows, columns, 2); NaN outside the image."""
        return self._pixels

    @cached_property
    def _pixels(self) -> Array:
        return self._of_columns(self.angles)

    def _of_columns(self, angles: Array) -> Array:
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        pixels: Array = self.centre + self.radii[:, None, None] * directions
        if not self._lies_within:
            pixels[~inside_image(pixels, self.source_size)] = np.nan
        return pixels

    @property
    def _lies_within(self) -> bool:
        """True if all circles are inside the rectangle of the outermost pixel centres."""
        reach = np.nanmax(self.radii, initial=0.0)
        return all(reach <= c <= length - 1 - reach for c, length in zip(self.centre, self.source_size, strict=True))

    def shows_something(self) -> bool:
        """Return True if part of the image is visible; False also for undecided cases."""
        if self._lies_within:
            return bool(np.isfinite(self.radii).any())
        return bool(np.isfinite(self._of_columns(self.angles[::EVERY_COLUMN])).any())

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """Return the averaging parameters of an interpolation; None if it does not average."""
        return self._footprints.averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _footprints(self) -> Footprints:
        return Footprints(squared_sides_of_circles(self.radii, self.angles), CELL_PX, self.annulus)

    def sample_compiled(self, job: RemapJob) -> None:
        """Sample with the polar kernel."""
        x, y = self.centre
        backend.kernels.remap_polar(job.source, *self._floats, x, y, job.target, *job.how)

    @cached_property
    def _floats(self) -> tuple[Floats, Floats, Floats]:
        """Radii, cosines and sines."""
        radii, cosines, sines = (a.astype(np.float32) for a in (self.radii, np.cos(self.angles), np.sin(self.angles)))
        return radii, cosines, sines

    def halved(self, in_picture: Offset, in_view: Offset) -> Map:
        """Return the map with interpolated circles; at the field boundary one of two rows is
        sufficient.
        """
        annulus = self.annulus and self.annulus.halved(in_picture)
        if not self._lies_within:
            return PixelMap(self._pixels, self.source_size, self.annulus).halved(in_picture, in_view)
        (x, y), radii, angles = in_view, pairs(self.radii), pairs(self.angles)
        at = (1 - y) * radii[:, 0] + y * radii[:, 1]
        at = np.where(np.isnan(at), np.where(np.isnan(radii[:, 0]), radii[:, 1], radii[:, 0]), at)
        centre = (self.centre[0] - in_picture[0]) / 2, (self.centre[1] - in_picture[1]) / 2
        between = (1 - x) * angles[:, 0] + x * angles[:, 1]
        return PolarMap(centre, at / 2, between, half(self.source_size), annulus)
