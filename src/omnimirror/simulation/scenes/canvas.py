"""Painting on a flat surface, in millimetres from its lower left corner as seen by a viewer.

Shapes are painted with the covered fraction of each texel (antialiasing); edges are smooth and
unbiased at any resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...base.colour import Light, hex_colour
from ...base.numerics.lazy import cached_property
from ...base.typing import Array
from .lettering import lettering

ALBEDO, EMISSION, CLEAR, SENT = slice(0, 3), slice(3, 6), 6, slice(3, 7)
"""Channels of a canvas: albedo, emitted light, transmitted fraction of outside light, and the last
two combined.
"""


class Extent(NamedTuple):
    """Rectangle on a canvas, mm from its lower left corner."""

    left: float
    bottom: float
    right: float
    top: float


@dataclass(frozen=True)
class Paint:
    """Surface properties: a reflecting colour, an emitting colour, or clear glass."""

    colour: str = "#000000"
    glow: float = 0.0
    """Emitted light in its colour; white paper in the room is about 0.7."""
    clear: float = 0.0
    """Transmitted fraction of outside light."""

    @property
    def sends(self) -> bool:
        """True if it emits or transmits light."""
        return self.glow != 0 or self.clear != 0

    @cached_property
    def channels(self) -> Light:
        """All seven channels."""
        colour = hex_colour(self.colour)
        lit = colour * (self.glow == 0) * (1 - self.clear)
        return np.concatenate([lit, colour * self.glow, [self.clear]]).astype(np.float32)


class Canvas:
    """Rectangular canvas.

    Parameters
    ----------
    width_mm, height_mm : mm
    texel_mm : mm
        Texel size; rounded to fit a whole number of texels.
    ground
        Initial paint.

    Examples
    --------
    >>> canvas = Canvas(40.0, 20.0, 10.0, Paint("#000000"))
    >>> canvas.rectangle(15.0, 10.0, 40.0, 20.0, Paint("#ffffff"))
    >>> canvas.texels[:, :, 0]  # row 0 is the top
    array([[0. , 0.5, 1. , 1. ],
           [0. , 0. , 0. , 0. ]], dtype=float32)
    """

    def __init__(self, width_mm: float, height_mm: float, texel_mm: float, ground: Paint) -> None:
        columns, rows = (max(1, round(size / texel_mm)) for size in (width_mm, height_mm))
        self.width_mm, self.height_mm = width_mm, height_mm
        self.texel = np.array([width_mm / columns, height_mm / rows])
        self.texels: Light = np.empty((rows, columns, 7), np.float32)
        self.texels[:] = ground.channels
        self.sends = ground.sends
        """True if any texel may emit or transmit light."""

    def rectangle(self, left: float, bottom: float, right: float, top: float, paint: Paint) -> None:
        """Paint a rectangle between two corners, mm."""
        rows, columns, _ = self.texels.shape
        across = _covered(left / self.texel[0], right / self.texel[0], columns)
        down = _covered(rows - top / self.texel[1], rows - bottom / self.texel[1], rows)
        for rows_of, high in down:
            for columns_of, wide in across:
                self._cover(rows_of, columns_of, high * wide, paint)

    def frame(self, left: float, bottom: float, right: float, top: float, thickness: float, paint: Paint) -> None:
        """Paint the border of a rectangle, within it, mm."""
        t = thickness
        self.rectangle(left, bottom, right, bottom + t, paint)
        self.rectangle(left, top - t, right, top, paint)
        self.rectangle(left, bottom + t, left + t, top - t, paint)
        self.rectangle(right - t, bottom + t, right, top - t, paint)

    def disc(self, x: float, y: float, radius: float, paint: Paint) -> None:
        """Paint a disc about (x, y), mm."""
        (dx, dy), (rows, columns, _) = self.texel, self.texels.shape
        reach = radius + dx + dy
        across = _touched((x - reach) / dx, (x + reach) / dx, columns)
        down = _touched(rows - (y + reach) / dy, rows - (y - reach) / dy, rows)
        xs, ys = self.grid()
        distance = np.hypot(xs[across] - x, (ys[down] - y)[:, None])
        self._cover(down, across, np.clip((radius - distance) / self.texel.mean() + 0.5, 0, 1), paint)

    def checkerboard(self, x: float, y: float, tile: float, paint: Paint) -> None:
        """Paint every other square tile, one with its corner at (x, y), mm."""
        xs, ys = self.grid()
        across = _square_wave((xs - x) / tile, self.texel[0] / tile)
        up = _square_wave((ys - y) / tile, self.texel[1] / tile)
        self._cover(slice(None), slice(None), (1 + up[:, None] * across) / 2, paint)

    def text(self, word: str, x: float, y: float, cap_height: float, paint: Paint) -> Extent:
        """Paint a word centred on (x, y), mm, to the nearest texel; return the extent of its ink."""
        ink = lettering(word, cap_height / float(self.texel[1]))
        rows, columns = ink.shape
        left = round(x / self.texel[0] - columns / 2)
        top = round((self.height_mm - y) / self.texel[1] - rows / 2)
        self._cover(slice(top, top + rows), slice(left, left + columns), ink, paint)
        dx, dy = map(float, self.texel)
        return Extent(left * dx, self.height_mm - (top + rows) * dy, (left + columns) * dx, self.height_mm - top * dy)

    def grid(self) -> tuple[Array, Array]:
        """Return the texel centres, mm: x of the columns from the left, y of the rows from the
        bottom.
        """
        rows, columns, _ = self.texels.shape
        return (np.arange(columns) + 0.5) * self.texel[0], self.height_mm - (np.arange(rows) + 0.5) * self.texel[1]

    def _cover(self, down: slice, across: slice, coverage: Array | Light | float, paint: Paint) -> None:
        self.sends |= paint.sends
        window = self.texels[down, across]
        if isinstance(coverage, float) and coverage == 1.0:
            window[:] = paint.channels
        else:
            window += np.asarray(coverage, np.float32)[..., None] * (paint.channels - window)


def _touched(start: float, stop: float, count: int) -> slice:
    """Return the slice of ``count`` cells that an interval overlaps, in cells from the first edge."""
    first = max(0, int(np.floor(start)))
    return slice(first, max(first, min(count, int(np.ceil(stop)))))


def _covered(start: float, stop: float, count: int) -> list[tuple[slice, float]]:
    """Return the cells overlapped by an interval, separately at its ends, with the covered fraction
    of each.

    >>> _covered(0.5, 4.25, 9)
    [(slice(0, 1, None), 0.5), (slice(1, 4, None), 1.0), (slice(4, 5, None), 0.25)]
    """
    cells = _touched(start, stop, count)
    edges = sorted({cells.start, min(cells.start + 1, cells.stop), max(cells.stop - 1, cells.start), cells.stop})
    shares = [float(np.clip(min(stop, cell + 1) - max(start, cell), 0, 1)) for cell in edges[:-1]]
    return [(slice(*ends), share) for ends, share in zip(pairwise(edges), shares, strict=True)]


def _square_wave(x: Array, width: float) -> Array:
    """Return a square wave of +1 on [0, 1) and -1 on [1, 2), averaged over ``width`` about each x."""

    low, high = (1 - np.abs(np.mod(x + shift, 2) - 1) for shift in (-width / 2, width / 2))  # its integral: a triangle
    return np.asarray((high - low) / width)
