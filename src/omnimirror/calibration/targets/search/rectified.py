"""Perspective views of an image, dewarped with an approximate camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ....base.typing import Array
from ....cameras.camera import Camera
from .greys import Grey

FIELD_DEG = 80.0
APART_DEG = 45.0
LONGEST_PX = 900


class LocalView(NamedTuple):
    """Perspective view of a part of the image."""

    picture: Grey
    back: Callable[[Array], Array]
    """Mapping of view pixels (k, 2) to image pixels (k, 2); NaN outside the image."""


def local_views(picture: Grey, camera: Camera) -> Iterator[LocalView]:
    """Yield perspective views that together cover the image at its resolution.

    Parameters
    ----------
    picture : (height, width)
        Greyscale image of the camera's size.
    camera
        Camera accurate to a few degrees.
    """
    import cv2

    for direction, density in _directions(camera):
        focal = min(density, LONGEST_PX / 2 / np.tan(np.radians(FIELD_DEG / 2)))
        half = int(focal * np.tan(np.radians(FIELD_DEG / 2)))
        axes = _axes(direction)

        def back(pixels: Array, focal: float = focal, half: int = half, axes: Array = axes) -> Array:
            flat = (pixels - half) / focal
            ways = axes[2] + flat[:, :1] * axes[0] + flat[:, 1:] * axes[1]
            return np.asarray(camera.project_directions(ways).pixels)

        steps = np.arange(2 * half + 1)
        pixels = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2).astype(float)
        source = np.nan_to_num(back(pixels), nan=-10.0).astype(np.float32).reshape(len(steps), len(steps), 2)
        seen = cv2.remap(picture, source[..., 0], source[..., 1], cv2.INTER_LINEAR)
        yield LocalView(np.asarray(seen, np.float32), back)


def _directions(camera: Camera) -> Iterator[tuple[Array, float]]:
    """Yield separate directions (3,) with the image resolution there, pixels per radian."""
    width, height = camera.image_size
    grid = np.stack(np.meshgrid(np.linspace(0, width - 2, 25), np.linspace(0, height - 2, 25)), axis=-1).reshape(-1, 2)
    here, beside, below = (camera.backproject(grid + step) for step in ([0, 0], [1, 0], [0, 1]))
    valid = here.valid & beside.valid & below.valid
    here_, steps = here.directions[valid], [r.directions[valid] - here.directions[valid] for r in (beside, below)]
    density = 1 / np.maximum(np.linalg.norm(np.stack(steps), axis=2).min(axis=0), 1e-6)
    taken: list[Array] = []
    for direction, dense in zip(here_, density, strict=True):
        if all(direction @ other < np.cos(np.radians(APART_DEG)) for other in taken):
            taken.append(direction)
            yield direction, float(dense)


def _axes(direction: Array) -> Array:
    """Return the axes right, down and ahead (3, 3) of a view in a direction, upright in the world."""
    up = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(direction, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
