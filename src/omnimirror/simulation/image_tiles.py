"""Image tiles whose rays fit into a cache, one per thread at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..base.colour import Light, srgb_bytes
from ..base.native import usable_cores

Progress = Callable[[int, int], None]
"""Callback with the number of finished rows and the total."""
Tile = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class PixelConversion:
    """Conversion of light to stored pixel values.

    The light of the full image, which needs 4 times the memory of 8-bit values, is never stored.

    Attributes
    ----------
    dtype
        Data type of the image.
    read
        Conversion of the light of a tile to values (rows, columns, 3), elementwise.
    in_order
        True if tiles must be whole consecutive rows, as random numbers are drawn in this order.
    is_grey
        True if the image is (rows, columns), as for a colour mosaic.
    """

    dtype: DTypeLike
    read: Callable[[Light], NDArray[Any]]
    in_order: bool = False
    is_grey: bool = False

    def empty(self, size: tuple[int, int]) -> NDArray[Any]:
        """Return an uninitialised image (rows, columns, 3) of the given columns and rows."""
        return np.empty((size[1], size[0]) if self.is_grey else (size[1], size[0], 3), self.dtype)


LIGHT = PixelConversion(np.float32, lambda light: light)
BYTES = PixelConversion(np.uint8, srgb_bytes)

ROWS_AHEAD = 2  # rows of tiles per thread that are rendered ahead of their readout
RAYS_PER_TILE = 1 << 16  # larger tiles exceed the cache, smaller ones cause idle threads


def render_tiles(
    light_of: Callable[[Tile], Light],
    size: tuple[int, int],
    samples: int,
    on_progress: Progress | None = None,
    workers: int | None = None,
    conversion: PixelConversion = LIGHT,
) -> NDArray[Any]:
    """Render an image (rows, columns, 3) tile by tile with threads; the kernels release the
    interpreter lock.

    Parameters
    ----------
    light_of
        Function that returns the light (rows, columns, 3) of a tile.
    size
        Columns and rows.
    samples
        Rays per pixel.
    on_progress
        Callback in the calling thread.
    workers
        Number of threads; the number of available cores by default.
    conversion
        Conversion of the light to pixel values.
    """
    width, height = size
    image = conversion.empty(size)

    # Initialises caches once instead of once per thread
    light_of((slice(height // 2, height // 2 + 1), slice(0, 1)))
    workers = workers or usable_cores()
    fill = _row_by_row if conversion.in_order else _in_any_order
    for completed_rows in fill(
        image, light_of, _tiles(width, height, samples), conversion, workers
    ):
        if on_progress is not None:
            on_progress(completed_rows, height)
    return image


def _in_any_order(
    image: NDArray[Any],
    light_of: Callable[[Tile], Light],
    tiles: Iterator[Tile],
    conversion: PixelConversion,
    workers: int,
) -> Iterator[int]:
    """Fill an image, with readout in each thread; yield the number of finished rows."""

    def fill(tile: Tile) -> int:
        image[tile] = conversion.read(light_of(tile))
        return int(tile[0].stop)

    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(fill, tiles)


def _row_by_row(
    image: NDArray[Any],
    light_of: Callable[[Tile], Light],
    tiles: Iterator[Tile],
    conversion: PixelConversion,
    workers: int,
) -> Iterator[int]:
    """Fill an image in consecutive rows, with readout in this thread while others render the next
    rows.
    """
    waiting: deque[tuple[slice, list[Future[Light]]]] = deque()

    def read() -> int:
        rows, parts = waiting.popleft()
        image[rows] = conversion.read(np.concatenate([part.result() for part in parts], axis=1))
        return int(rows.stop)

    with ThreadPoolExecutor(workers) as pool:
        for _, beside in groupby(tiles, key=lambda tile: tile[0].start):
            row = list(beside)
            waiting.append((row[0][0], [pool.submit(light_of, tile) for tile in row]))
            if len(waiting) > ROWS_AHEAD * workers:
                yield read()
        while waiting:
            yield read()


def _tiles(width: int, height: int, samples: int) -> Iterator[Tile]:
    across = min(width, max(1, RAYS_PER_TILE // samples))
    down = max(1, RAYS_PER_TILE // (across * samples))
    for top in range(0, height, down):
        for left in range(0, width, across):
            yield slice(top, min(top + down, height)), slice(left, min(left + across, width))
