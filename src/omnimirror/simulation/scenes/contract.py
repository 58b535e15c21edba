"""Scene interface: radiance along rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import vectors
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.typing import Array


@runtime_checkable
class Scene(Protocol):
    """Scene in the world frame (x forward, y left, z up, origin at the mirror vertex).

    Results must not depend on the grouping of rays: images are rendered in tiles by several
    threads.
    """

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3), white at 1 and lamps above, of rays from origins (n, 3) mm in
        directions (n, 3).
        """
        ...


@runtime_checkable
class Measured(Protocol):
    """Scene with distances, for ground truth."""

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return distances (n,) of rays from origins (n, 3) mm in directions (n, 3) of any length;
        infinite without a surface.
        """
        ...


def rays_from(origins_mm: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Return validated rays for scenes: origins (n, 3) and directions (n, 3).

    >>> rays_from([[0, 0, 0]], [[0, 0, -2]])
    (array([[0., 0., 0.]]), array([[ 0.,  0., -2.]]))

    Raises
    ------
    InvalidParameter
        If the arguments are not vectors, differ in number, or a direction is zero or not finite.
    """
    origins = vectors("origins_mm", origins_mm, 3, is_list=True)
    towards = vectors("directions", directions, 3, is_list=True)
    if len(origins) != len(towards):
        raise InvalidParameter(
            f"there are {len(origins)} origins_mm and {len(towards)} directions; valid is one origin for each direction"
        )
    usable = ~np.isnan(towards).any(axis=1) & towards.any(axis=1)
    if not usable.all():
        bad = np.asarray(directions, float)[~usable][0].tolist()
        raise InvalidParameter(f"{bad} is no direction; it needs finite numbers, not all 0")
    return origins, towards


def distances_mm(scene: Scene, origins_mm: Array, directions: Array) -> Array:
    """Return distances (n,) of rays in a scene.

    Raises
    ------
    InvalidParameter
        If the scene provides no distances.
    """
    if not isinstance(scene, Measured):
        raise InvalidParameter(f"a {type(scene).__name__} has no distance_mm(), which depth as ground truth needs")
    return scene.distance_mm(origins_mm, directions)


@dataclass(frozen=True)
class Distant:
    """Scene moved to infinity: every ray has the radiance at the world origin in its direction.

    Images of it have no parallax, independent of the viewpoints of the mirror.

    >>> from omnimirror import Room
    >>> room = Distant(Room(texel_mm=40.0))
    >>> towards = np.array([[1.0, 0.2, 0.1]])
    >>> bool(np.all(room.radiance(np.full((1, 3), 999.0), towards) == room.radiance(np.zeros((1, 3)), towards)))
    True
    """

    scene: Scene

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) in directions (n, 3), independent of the origins."""
        return self.scene.radiance(np.zeros_like(origins_mm), directions)

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """Return infinite distances (n,)."""
        return np.full(len(directions), np.inf)
