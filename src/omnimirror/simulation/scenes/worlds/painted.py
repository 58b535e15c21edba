"""Painted faces as surfaces, and scenes made of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ....base.colour import Light
from ....base.typing import Array
from ..boxes import Box, Face, face_of
from ..canvas import ALBEDO, CLEAR, EMISSION, Canvas
from ..contract import Scene
from ..surfaces import Surfaces, Texture


def finished(canvas: Canvas, light: Light) -> Light:
    """Return light emitted and reflected by a face, and its transmittance: (rows, columns, 4)."""
    texels: Light = np.empty((*light.shape[:2], 4), np.float32)
    np.multiply(canvas.texels[..., ALBEDO], light, out=texels[..., :3])
    if canvas.sends:
        texels[..., :3] += canvas.texels[..., EMISSION]
    texels[..., 3] = canvas.texels[..., CLEAR]
    return texels


def surfaces_of(faces: Sequence[Face], pictures: Sequence[Light]) -> Surfaces:
    """Return surfaces from faces with their images (rows, columns, 4), whose first row is the top."""
    places = np.array([(f.point(0.0, f.height_mm), f.width_mm * f.right, -f.height_mm * f.up) for f in faces])
    texels = np.array([((-0.5, -0.5), (p.shape[1], 0), (0, p.shape[0])) for p in pictures], dtype=float)
    count = len(faces)
    textures = tuple(Texture(np.ascontiguousarray(p, np.float32)) for p in pictures)
    return Surfaces.of(places.reshape(-1, 3, 3), texels, np.arange(count), False, textures)


def outsides(boxes: Sequence[Box]) -> list[Face]:
    """Return the six faces of each box, seen from outside."""
    return [face_of(box, i, inside=False) for box in boxes for i in range(6)]


class Surroundings:
    """Surfaces, and their background at infinity.

    Parameters
    ----------
    surfaces
    background
        Background of rays that meet no surface or a transparent one; black if None.
    """

    def __init__(self, surfaces: Surfaces, background: Scene | None = None) -> None:
        self.surfaces, self.background = surfaces, background

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any
        length but 0.
        """
        origins, towards = np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float)
        light, clear, distance = self.surfaces.seen(origins, towards)
        if self.background is not None:
            share = np.where(np.isinf(distance), np.float32(1), clear)
            behind = np.flatnonzero(share)
            light[behind] += share[behind, None] * self.background.radiance(origins[behind], towards[behind])
        return light

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return distances (n,) of rays to the first surface; infinite without intersection."""
        origins, towards = np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float)
        length = np.linalg.norm(towards, axis=1)
        # Unit directions preserve full single precision
        distance: Array = self.surfaces.seen(origins, towards / length[:, None]).distance.astype(float)
        return distance

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings:
        """Return itself for rays from any box (3,), (3,) mm."""
        return self


@runtime_checkable
class Painted(Protocol):
    """Scene that consists of surfaces and a background only, and is supported by the kernels."""

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """Return the surfaces for rays that start in a box between corners (3,), (3,) mm; None if
        the box is not permitted.
        """
        ...


class Landscape:
    """Sky and hills at infinity."""

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) in directions (n, 3)."""
        from .landscape import landscape_light

        return landscape_light(directions)
