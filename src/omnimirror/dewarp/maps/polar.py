"""Panoramas about the camera's own axis, whose rows are circles in the picture: no map is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...cameras import inside_image
from ...numerics.lazy import cached_property
from ..sampling.footprints import CELL_PX, RULES, Averages, Ring, averages_of, squares_of_rings
from ..sampling.remapping import Border, FixedMap, Image, Interpolation, remap_polar

Array = NDArray[np.float64]

EVERY_COLUMN = 16  # of so many one tells whether anything is seen


@dataclass(frozen=True)
class Rings:
    """Coordinates ``centre + radii[row] (cos, sin)(angles[column])``."""

    centre: tuple[float, float]
    """(u, v) px."""
    radii: Array
    """(rows,) px; NaN outside the field."""
    angles: Array
    """(columns,) radians from right towards down in the picture; without jumps from one column to the next."""
    ring: Ring | None = None
    """Where in the pictures something is seen, for averages at the end of the field."""

    def coordinates(self, size: tuple[int, int], every: int = 1) -> Array:
        """Pixels (rows, columns, 2) of a picture of a (width, height); NaN outside it. Of every n-th column only."""
        angles = self.angles[::every]
        pixels: Array = self.centre + self.radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        if not self.lie_within(size):
            pixels[~inside_image(pixels, size)] = np.nan
        return pixels

    def lie_within(self, size: tuple[int, int]) -> bool:
        """Whether no ring comes nearer to the edge of a picture of a size than the centres of its outermost pixels."""
        reach = np.nanmax(self.radii, initial=0.0)
        return all(reach <= c <= length - 1 - reach for c, length in zip(self.centre, size, strict=True))

    def show_something(self, size: tuple[int, int]) -> bool:
        """Whether something of a picture of a size is seen; False also where only a closer look would tell."""
        return bool(np.isfinite(self.coordinates(size, EVERY_COLUMN)).any())

    def sample(
        self, image: Image, interpolation: Interpolation = "linear", out: Image | None = None, border: Border = 0
    ) -> Image:
        """The picture's values there; see :func:`omnimirror.dewarp.sampling.remapping.remap`."""
        averages = self.averages(interpolation)
        if averages is None and interpolation in RULES:
            interpolation = "cubic"
        return remap_polar(image, self.radii, self.angles, self.centre, interpolation, out, border, averages)

    def map(self, size: tuple[int, int], interpolation: Interpolation = "linear") -> FixedMap:
        """For the same pictures, and quicker from the third one on."""
        return FixedMap(self.coordinates(size), size, interpolation, self.ring, self.averages(interpolation))

    def averages(self, interpolation: Interpolation) -> Averages | None:
        """What an interpolation averages; None where that is nothing."""
        return self._averages(interpolation) if interpolation in RULES else None

    @cached_property
    def _averages(self) -> Callable[[Interpolation], Averages | None]:
        squares = squares_of_rings(self.radii, self.angles)
        return cache(lambda interpolation: averages_of(squares, CELL_PX, interpolation, self.ring))
