"""The picture that a camera takes of a scene.

Pictures are arrays (rows, columns, 3) of uint8 in sRGB and in **RGB order**; OpenCV wants BGR, which
is ``picture[..., ::-1]``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cameras import Camera
from ..errors import InvalidParameter
from .colour import Light, Picture, srgb_bytes
from .scenes.contract import Distant, Scene

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
"""Called with the number of rows done and of all rows."""

T = TypeVar("T")
R = TypeVar("R")

RAYS_PER_TILE = 1 << 16  # larger tiles fall out of the cache, smaller ones keep threads waiting for each other
MOST_SAMPLES = 16


def take_picture(
    camera: Camera,
    scene: Scene,
    samples: int = 2,
    distant: bool = False,
    progress: Progress | None = None,
    workers: int | None = None,
) -> Picture:
    """The picture (rows, columns, 3), uint8 sRGB in RGB order, that a camera takes of a scene.

    It is perfectly sharp: chief rays only, so neither focus nor diffraction blurs it. Each pixel is
    the mean of ``samples`` x ``samples`` rays spread evenly over it, in linear light; where the camera
    sees nothing it is black, and a pixel cut by the rim is dimmed by the share that is cut off.

    Parameters
    ----------
    camera
        Any camera; a mirror sensor looks from its true reflection points.
    scene
    samples
        Rays per pixel and side.
    distant
        Take the scene for infinitely far away (:class:`~omnimirror.simulate.scenes.Distant`).
    progress
        Called in the calling thread, as rows get done.
    workers
        Number of threads; as many as there are processors by default.

    Raises
    ------
    InvalidParameter
        For a number of samples out of range, or if the scene cannot be seen from where the camera is.

    Examples
    --------
    >>> import omnimirror as om
    >>> picture = om.take_picture(om.load_sensor("paper-spherical"), om.Room(texel_mm=40.0), samples=1)
    >>> picture.shape, picture.dtype, picture[0, 0]
    ((1024, 1024, 3), dtype('uint8'), array([0, 0, 0], dtype=uint8))
    """
    _check_samples(samples)
    seen = Distant(scene) if distant else scene
    width, height = camera.image_size
    step = max(1, RAYS_PER_TILE // (width * samples**2))
    tiles = [range(first, min(first + step, height)) for first in range(0, height, step)]
    picture = np.empty((height, width, 3), dtype=np.uint8)

    def expose(rows: range) -> tuple[range, Picture]:
        pixels = _sample_grid(rows, width, samples)
        origins, directions, valid = camera.backproject(pixels.reshape(-1, 2))
        light = np.zeros((valid.size, 3), dtype=np.float32)
        light[valid] = seen.radiance(origins[valid], directions[valid])
        return rows, _develop(light.reshape(*pixels.shape[:2], 3), samples)

    expose(range(height // 2, height // 2 + 1))  # camera and scene prepare themselves once, not once per thread
    for rows, part in _on_threads(expose, tiles, workers):
        picture[rows.start : rows.stop] = part
        if progress is not None:
            progress(rows.stop, height)
    return picture


def pinhole_picture(scene: Scene, directions: ArrayLike, samples: int = 1) -> Picture:
    """The picture that an ideal camera at the world's origin takes: the truth for what was straightened.

    Parameters
    ----------
    scene
    directions : (rows * samples, columns * samples, 3) array
        World directions of any length; NaN comes out black.
    samples
        Directions per pixel and side, averaged in linear light.

    Returns
    -------
    (rows, columns, 3) array, uint8 sRGB in RGB order.

    Raises
    ------
    InvalidParameter
        If the shape of the directions does not fit.

    Examples
    --------
    >>> from omnimirror.frames import pan_tilt_direction
    >>> from omnimirror.simulate.scenes import Room
    >>> pan, tilt = np.meshgrid(np.radians(np.arange(-60, 60, 2)), np.radians(np.arange(30, -30, -2)))
    >>> pinhole_picture(Room(texel_mm=40.0), pan_tilt_direction(pan, tilt)).shape
    (30, 60, 3)
    """
    _check_samples(samples)
    towards = np.asarray(directions, dtype=float)
    if towards.ndim != 3 or towards.shape[2] != 3 or towards.shape[0] % samples or towards.shape[1] % samples:
        raise InvalidParameter(
            f"directions have the shape {towards.shape}; it must be (rows, columns, 3), both a multiple of "
            f"samples = {samples}"
        )
    light = np.zeros(towards.shape, dtype=np.float32)
    valid = np.isfinite(towards).all(axis=2)
    light[valid] = scene.radiance(np.zeros((int(valid.sum()), 3)), towards[valid])
    return _develop(light, samples)


def _check_samples(samples: int) -> None:
    if not (1 <= samples <= MOST_SAMPLES and int(samples) == samples):
        raise InvalidParameter(f"samples = {samples} is not a whole number from 1 to {MOST_SAMPLES}")


def _sample_grid(rows: range, width: int, samples: int) -> Array:
    """Sample places (len(rows) * samples, width * samples, 2) px, spread evenly over each pixel."""
    u = (np.arange(width * samples) + 0.5) / samples - 0.5
    v = rows.start + (np.arange(len(rows) * samples) + 0.5) / samples - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1)


def _develop(light: Light, samples: int) -> Picture:
    """Pixels of the light of their samples, (rows * samples, columns * samples, 3)."""
    rows, columns, _ = light.shape
    return srgb_bytes(light.reshape(rows // samples, samples, columns // samples, samples, 3).mean(axis=(1, 3)))


def _on_threads(function: Callable[[T], R], items: list[T], workers: int | None) -> Iterator[R]:
    """Results in order; NumPy lets go of the interpreter lock, so threads do run side by side."""
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        yield from pool.map(function, items)
