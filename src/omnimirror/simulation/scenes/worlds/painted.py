"""Painted faces as surfaces, and the scenes that are made of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ....base.colour import Light
from ..boxes import Box, Face, face_of
from ..canvas import ALBEDO, CLEAR, EMISSION, Canvas
from ..contract import Array, Scene
from ..surfaces import Surfaces, Texture


def finished(canvas: Canvas, light: Light) -> Light:
    """Light that a face sends towards whoever looks, and what it lets through: (rows, columns, 4)."""
    texels: Light = np.empty((*light.shape[:2], 4), np.float32)
    np.multiply(canvas.texels[..., ALBEDO], light, out=texels[..., :3])
    if canvas.sends:
        texels[..., :3] += canvas.texels[..., EMISSION]
    texels[..., 3] = canvas.texels[..., CLEAR]
    return texels


def surfaces_of(faces: Sequence[Face], pictures: Sequence[Light]) -> Surfaces:
    """Faces with their pictures (rows, columns, 4), whose first row is the top."""
    places = np.array([(f.point(0.0, f.height_mm), f.width_mm * f.right, -f.height_mm * f.up) for f in faces])
    texels = np.array([((-0.5, -0.5), (p.shape[1], 0), (0, p.shape[0])) for p in pictures], dtype=float)
    count = len(faces)
    textures = tuple(Texture(np.ascontiguousarray(p, np.float32)) for p in pictures)
    return Surfaces.of(places.reshape(-1, 3, 3), texels, np.arange(count), False, textures)


def outsides(boxes: Sequence[Box]) -> list[Face]:
    """The six faces of each box, seen from outside."""
    return [face_of(box, i, inside=False) for box in boxes for i in range(6)]


class Surroundings:
    """Surfaces, and what is infinitely far behind them.

    Parameters
    ----------
    surfaces
    background
        What rays see that meet no surface, or one that lets light through; nothing, which is black, if None.
    """

    def __init__(self, surfaces: Surfaces, background: Scene | None = None) -> None:
        self.surfaces, self.background = surfaces, background

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Linear RGB (n, 3) of rays from origins (n, 3) mm in directions (n, 3) of any length but 0."""
        origins, towards = np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float)
        light, clear, distance = self.surfaces.seen(origins, towards)
        if self.background is not None:
            share = np.where(np.isinf(distance), np.float32(1), clear)
            behind = np.flatnonzero(share)
            light[behind] += share[behind, None] * self.background.radiance(origins[behind], towards[behind])
        return light

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """How far (n,) rays go to the first surface; infinite where they meet none."""
        origins, towards = np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float)
        length = np.linalg.norm(towards, axis=1)
        # of unit directions, so that single precision has all its digits
        distance: Array = self.surfaces.seen(origins, towards / length[:, None]).distance.astype(float)
        return distance

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings:
        """Themselves, whatever box (3,), (3,) mm rays start in."""
        return self


@runtime_checkable
class Painted(Protocol):
    """A scene that is nothing but surfaces and what is behind them, so that kernels see it by themselves."""

    def surroundings_from(self, low_mm: Array, high_mm: Array) -> Surroundings | None:
        """What rays see that start in a box between corners (3,), (3,) mm; None if some may not start there."""
        ...


class Landscape:
    """Sky and hills, infinitely far away."""

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Linear RGB (n, 3) in directions (n, 3)."""
        from .landscape import landscape_light

        return landscape_light(directions)
