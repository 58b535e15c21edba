"""A transparent tube around a sensor: what is seen through it, dimmed, shifted, and with a ghost."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from ..errors import InvalidParameter
from ..parameters import Parameter
from ..tracing.walls import Passage, through_tube
from .colour import Light
from .scenes.contract import Array, Scene, distances_mm


@dataclass(frozen=True)
class Tube:
    """A clear tube about the mirror's axis.

    Parameters
    ----------
    outer_radius_mm, wall_mm
    refractive_index
        Acrylic by default.

    Raises
    ------
    InvalidParameter
        A number outside its range, or a wall that fills the tube.
    """

    outer_radius_mm: float
    wall_mm: float = 3.0
    refractive_index: float = 1.49

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "outer_radius_mm": Parameter("mm", 1e-3, 1e5, "outer radius"),
        "wall_mm": Parameter("mm", 1e-3, 1e3, "thickness of the wall"),
        "refractive_index": Parameter("", 1.0, 4.0, "of the wall"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        if not self.wall_mm < self.outer_radius_mm:
            raise InvalidParameter(f"wall_mm = {self.wall_mm:g} fills a tube of radius {self.outer_radius_mm:g} mm")


@dataclass(frozen=True)
class ThroughTube:
    """A scene as it is seen from inside a tube.

    Rays are bent at both sides of the wall by Snell's law and dimmed by Fresnel's; what the wall throws back is
    the ghost: it crosses the tube, passes the wall opposite and shows another part of the scene. Ghosts that
    mirror, camera or a lid would stop are shown all the same, and ghosts of ghosts are left out.

    Parameters
    ----------
    scene
    tube
    axis : (x, y, z)
        World direction of the tube, which the mirror's vertex lies on the axis of.

    Examples
    --------
    >>> from omnimirror.simulate import Environment
    >>> white = ThroughTube(Environment(np.ones((4, 8, 3), np.float32)), Tube(60.0))
    >>> white.radiance(np.zeros((1, 3)), np.array([[1.0, 0, 0]])).round(4)  # all but the ghost of the ghost
    array([[0.9944, 0.9944, 0.9944]], dtype=float32)
    """

    scene: Scene
    tube: Tube
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Linear RGB (n, 3) of rays (n, 3) that start inside the tube.

        Raises
        ------
        InvalidParameter
            If a ray starts outside the tube.
        """
        passage = self._passage(np.asarray(origins_mm, dtype=float), np.asarray(directions, dtype=float))
        back = self._passage(passage.met * (1 - 1e-9), passage.thrown_back)
        seen = self.scene.radiance(passage.points, passage.directions)
        ghost = self.scene.radiance(back.points, back.directions)
        through, thrown = passage.passed, (1 - passage.passed) * back.passed
        light: Light = (through[:, None] * seen + thrown[:, None] * ghost).astype(np.float32)
        return light

    def distance_mm(self, origins_mm: Array, directions: Array) -> Array:
        """How far (n,) rays go through the wall: the way inside, and the way behind it."""
        origins = np.asarray(origins_mm, dtype=float)
        passage = self._passage(origins, np.asarray(directions, dtype=float))
        inside = np.linalg.norm(passage.points - origins, axis=1)
        distance: Array = inside + distances_mm(self.scene, passage.points, passage.directions)
        return distance

    def _passage(self, origins: Array, directions: Array) -> Passage:
        tube, axis = self.tube, np.asarray(self.axis, dtype=float)
        beside = np.linalg.norm(np.cross(origins, axis), axis=1)
        inner = tube.outer_radius_mm - tube.wall_mm
        if (beside > inner).any():
            raise InvalidParameter(
                f"a ray starts {beside.max():.4g} mm from the tube's axis, and its inner radius is {inner:g} mm"
            )
        return through_tube(origins, directions, axis, tube.outer_radius_mm, tube.wall_mm, tube.refractive_index)
