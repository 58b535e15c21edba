"""The Camera contract: whatever maps pixels to rays in the world and back.

The mirror sensor satisfies it (:class:`omnimirror.optics.sensor.Sensor`), and so do the models read from
other tools' files (:mod:`omnimirror.cameras.models`). Screens, samplers and viewers know nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Rays(NamedTuple):
    """Rays in the world frame, one per pixel asked for."""

    origins: Array
    """(n, 3) mm; NaN where not valid."""
    directions: Array
    """(n, 3) unit vectors from the sensor to the object; NaN where not valid."""
    valid: Mask
    """(n,) False where the pixel lies outside the picture or sees nothing of the scene."""


class Projection(NamedTuple):
    """Pixels, one per point or direction asked for."""

    pixels: Array
    """(n, 2) px, (u, v) with integers at pixel centres; NaN where not valid."""
    valid: Mask
    """(n,) False where the point is out of view or its image falls outside the picture."""


EDGE_SLACK = 1e-9  # px; a pixel on the very edge comes back from the world as still on it


@dataclass(frozen=True)
class AxialSymmetry:
    """What a camera that is symmetric about an axis tells of itself, so that panoramas separate."""

    centre_px: tuple[float, float]
    """Image of the axis, (u, v)."""
    axis: Array
    """(3,) world direction seen at field angle 0."""
    right: Array
    """(3,) world direction across the axis that is seen right of the centre, in the picture as delivered."""
    down: Array
    """(3,) world direction across the axis that is seen below the centre."""
    omega_min: float
    """Smallest field angle seen, radians from ``axis``."""
    omega_max: float
    """Largest field angle seen, radians from ``axis``."""
    radius_px: Callable[[Array], Array]
    """Image radius (px) of an array of field angles (radians)."""
    origin_mm: Callable[[Array], tuple[Array, Array]] | None = None
    """Where the rays of an array of field angles (radians) start: how far from the axis, on the side to which they
    lead, and how far along ``axis`` from the world's origin. None where all start at that origin."""


@runtime_checkable
class Camera(Protocol):
    """Maps pixels to rays and back; every array is in the world frame of the camera's mount."""

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        ...

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """The axis of symmetry, None for a camera without one."""
        ...

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (n, 2)."""
        ...

    def project(self, points_mm: ArrayLike) -> Projection:
        """Pixels of points (n, 3) in mm."""
        ...

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Pixels of infinitely distant points in directions (n, 3), of any length."""
        ...


def inside_image(pixels: Array, size: tuple[int, int]) -> Mask:
    """Where pixels (n, 2) fall on the picture, whose outermost pixels reach half a pixel beyond their centres."""
    u, v = pixels[..., 0], pixels[..., 1]
    edge = 0.5 + EDGE_SLACK
    with np.errstate(invalid="ignore"):
        return (u >= -edge) & (u <= size[0] - 1 + edge) & (v >= -edge) & (v <= size[1] - 1 + edge)
