"""Parts of a picture that fill a cache with their rays, one for each thread at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ...base.colour import Light, srgb_bytes
from ...base.native import usable_cores

Progress = Callable[[int, int], None]
"""Called with the number of rows done and of all rows."""
Tile = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Medium:
    """What light falls on: numbers take a quarter of the room of their light, which is never there as a whole.

    Attributes
    ----------
    dtype
        Of the picture.
    read
        Its part (rows, columns, 3) for the light of a part; of each value by itself.
    in_order
        Whether parts have to be whole rows that follow each other, from the first on: chance draws them so.
    is_grey
        Whether a picture is (rows, columns), as a mosaic of colours is.
    """

    dtype: DTypeLike
    read: Callable[[Light], NDArray[Any]]
    in_order: bool = False
    is_grey: bool = False

    def empty(self, size: tuple[int, int]) -> NDArray[Any]:
        """A picture (rows, columns, 3) of so many columns and rows."""
        return np.empty((size[1], size[0]) if self.is_grey else (size[1], size[0], 3), self.dtype)


LIGHT = Medium(np.float32, lambda light: light)
BYTES = Medium(np.uint8, srgb_bytes)

AHEAD = 2  # rows of parts for each thread that are under way before they are read
RAYS_PER_TILE = 1 << 16  # larger tiles fall out of the cache, smaller ones keep threads waiting for each other


def picture_of_tiles(
    light_of: Callable[[Tile], Light],
    size: tuple[int, int],
    samples: int,
    progress: Progress | None = None,
    workers: int | None = None,
    medium: Medium = LIGHT,
) -> NDArray[Any]:
    """The picture (rows, columns, 3) whose parts a function gives, on threads: kernels let go of the interpreter.

    Parameters
    ----------
    light_of
        The light (rows, columns, 3) of a part.
    size
        Columns and rows.
    samples
        Rays of a pixel.
    progress
        Called in this thread.
    workers
        Number of threads; as many as this process may use cores by default.
    medium
        What the light falls on.
    """
    width, height = size
    picture = medium.empty(size)

    light_of((slice(height // 2, height // 2 + 1), slice(0, 1)))  # all prepare themselves once, not once per thread
    workers = workers or usable_cores()
    fill = _row_by_row if medium.in_order else _as_they_come
    for done in fill(picture, light_of, _tiles(width, height, samples), medium, workers):
        if progress is not None:
            progress(done, height)
    return picture


def _as_they_come(
    picture: NDArray[Any], light_of: Callable[[Tile], Light], tiles: Iterator[Tile], medium: Medium, workers: int
) -> Iterator[int]:
    """Fill a picture, each thread reading its own light; how many rows are done."""

    def fill(tile: Tile) -> int:
        picture[tile] = medium.read(light_of(tile))
        return int(tile[0].stop)

    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(fill, tiles)


def _row_by_row(
    picture: NDArray[Any], light_of: Callable[[Tile], Light], tiles: Iterator[Tile], medium: Medium, workers: int
) -> Iterator[int]:
    """The same in whole rows that follow each other, read in this thread while others take what comes next."""
    waiting: deque[tuple[slice, list[Future[Light]]]] = deque()

    def read() -> int:
        rows, parts = waiting.popleft()
        picture[rows] = medium.read(np.concatenate([part.result() for part in parts], axis=1))
        return int(rows.stop)

    with ThreadPoolExecutor(workers) as pool:
        for _, beside in groupby(tiles, key=lambda tile: tile[0].start):
            row = list(beside)
            waiting.append((row[0][0], [pool.submit(light_of, tile) for tile in row]))
            if len(waiting) > AHEAD * workers:
                yield read()
        while waiting:
            yield read()


def _tiles(width: int, height: int, samples: int) -> Iterator[Tile]:
    across = min(width, max(1, RAYS_PER_TILE // samples))
    down = max(1, RAYS_PER_TILE // (across * samples))
    for top in range(0, height, down):
        for left in range(0, width, across):
            yield slice(top, min(top + down, height)), slice(left, min(left + across, width))
