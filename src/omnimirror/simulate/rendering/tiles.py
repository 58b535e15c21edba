"""Parts of a picture that fill a cache with their rays, one for each thread at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..colour import Light

Progress = Callable[[int, int], None]
"""Called with the number of rows done and of all rows."""
Tile = tuple[slice, slice]
"""Rows and columns."""

RAYS_PER_TILE = 1 << 16  # larger tiles fall out of the cache, smaller ones keep threads waiting for each other


def picture_of_tiles(
    light_of: Callable[[Tile], Light],
    size: tuple[int, int],
    samples: int,
    progress: Progress | None = None,
    workers: int | None = None,
) -> Light:
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
        Number of threads; as many as there are processors by default.
    """
    width, height = size
    light = np.empty((height, width, 3), np.float32)

    def fill(tile: Tile) -> int:
        light[tile] = light_of(tile)
        return int(tile[0].stop)

    fill((slice(height // 2, height // 2 + 1), slice(0, 1)))  # all prepare themselves once, not once per thread
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        for done in pool.map(fill, _tiles(width, height, samples)):
            if progress is not None:
                progress(done, height)
    return light


def _tiles(width: int, height: int, samples: int) -> Iterator[Tile]:
    across = min(width, max(1, RAYS_PER_TILE // samples))
    down = max(1, RAYS_PER_TILE // (across * samples))
    for top in range(0, height, down):
        for left in range(0, width, across):
            yield slice(top, min(top + down, height)), slice(left, min(left + across, width))
