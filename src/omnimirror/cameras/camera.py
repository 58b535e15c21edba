"""Camera interface: conversion between pixels and rays in the world.

The mirror sensor implements it (:class:`omnimirror.optics.sensor.Sensor`), as do the models read
from files of other programs (:mod:`omnimirror.cameras.models`). Screens, samplers and viewers
depend only on this interface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ..base.typing import Array, Mask


class Rays(NamedTuple):
    """Rays in the world frame, one per pixel."""

    origins: Array
    """(n, 3), mm; NaN if invalid."""
    directions: Array
    """(n, 3) unit vectors from the sensor to the object; NaN if invalid."""
    valid: Mask
    """(n,) False if the pixel is outside the image or the field of view."""


class Projection(NamedTuple):
    """Pixels, one per point or direction."""

    pixels: Array
    """(n, 2), px, (u, v) with integers at pixel centres; NaN if invalid."""
    valid: Mask
    """(n,) False if the point is outside the field of view or the image."""


EDGE_SLACK = 1e-9  # px; tolerance of pixels on the image edge after a round trip


@dataclass(frozen=True)
class AxialSymmetry:
    """Properties of a camera with axial symmetry, for separable panoramas."""

    centre_px: tuple[float, float]
    """Image of the axis, (u, v)."""
    axis: Array
    """(3,) world direction of field angle 0."""
    right: Array
    """(3,) world direction perpendicular to the axis, right of the centre in the delivered
    image.
    """
    down: Array
    """(3,) world direction perpendicular to the axis, below the centre."""
    omega_min: float
    """Smallest field angle, radians from ``axis``."""
    omega_max: float
    """Largest field angle, radians from ``axis``."""
    radius_px: Callable[[Array], Array]
    """Image radius (px) as a function of field angles (radians)."""
    origin_mm: Callable[[Array], tuple[Array, Array]] | None = None
    """Ray origins as a function of field angles (radians); None for rays through the world origin.

    The values are the distance from the axis, towards the object, and the position along ``axis``.
    """


@runtime_checkable
class Camera(Protocol):
    """Conversion between pixels and rays in the world frame."""

    @property
    def image_size(self) -> tuple[int, int]:
        """Image size (width, height), px."""
        ...

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """Axial symmetry; None for a camera without one."""
        ...

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (n, 2)."""
        ...

    def project(self, points_mm: ArrayLike) -> Projection:
        """Return the pixels of points (n, 3), mm."""
        ...

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Return the pixels of infinitely distant points in directions (n, 3), of any length."""
        ...


def inside_image(pixels: Array, size: tuple[int, int]) -> Mask:
    """Return which pixels (n, 2) are in the image, including the outer half of the edge pixels."""
    u, v = pixels[..., 0], pixels[..., 1]
    edge = 0.5 + EDGE_SLACK
    with np.errstate(invalid="ignore"):
        return (u >= -edge) & (u <= size[0] - 1 + edge) & (v >= -edge) & (v <= size[1] - 1 + edge)
