"""Rendering with compiled kernels: environments, and surfaces in front of a distant background.

Rays are not stored, except those that reach the background.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.colour import Light
from ...base.native import backend
from ...base.typing import Array
from ...cameras.frames import turned
from ...optics.sensor import Sensor
from ..radiometry import Radiometry
from ..scenes.contract import Distant, Scene
from ..scenes.environment import Environment
from ..scenes.posed import PosedScene
from ..scenes.worlds.painted import Painted, Surroundings
from .kernel_sensor import SceneFrame, native_optics
from .samples import Samples
from .sight import mirror_net
from .tiles import LIGHT, Medium, Progress, Tile, picture_of_tiles

ROWS_AT_ONCE = 64  # rows of an environment between progress reports
# Relative to the rim radius: maximum distance of ray origins from the box around the mirror grid
BESIDE = 0.02


class _Placed(NamedTuple):
    """Scene without its placement: directions are rotated, and points then shifted, or all moved to
    the shift.
    """

    scene: Scene
    turn: Array
    """Rotation (3, 3) from the sensor world."""
    shift_mm: Array
    """Shift (3,), mm."""
    distant: bool

    def frame(self) -> SceneFrame:
        return SceneFrame(tuple(self.turn.ravel()), tuple(self.shift_mm), self.distant)


def _placed(scene: Scene) -> _Placed:
    if isinstance(scene, Distant):
        return _placed(scene.scene)._replace(distant=True)
    if isinstance(scene, PosedScene):
        inner, pose = _placed(scene.scene), scene.pose
        shift = inner.shift_mm if inner.distant else inner.turn @ pose.shift_mm + inner.shift_mm
        return inner._replace(turn=inner.turn @ pose.rotation(), shift_mm=shift)
    return _Placed(scene, np.eye(3), np.zeros(3), False)


def compiled_light(
    sensor: Sensor,
    scene: Scene,
    plan: Samples,
    radiometry: Radiometry,
    progress: Progress | None = None,
    workers: int | None = None,
    medium: Medium = LIGHT,
) -> NDArray[Any] | None:
    """Render the image (rows, columns, 3) of a scene supported by the kernels; None for others.

    Parameters
    ----------
    sensor
        Sensor supported by the kernels
        (:func:`~omnimirror.simulation.rendering.kernel_sensor.is_for_kernels`).
    scene
    plan
    radiometry
    progress
    workers
    medium
    """
    placed = _placed(scene)
    if isinstance(placed.scene, Environment):
        return _of_environment(sensor, placed.scene, placed, plan, radiometry, progress, medium)
    # Rays past the mirror have arbitrary origins
    if isinstance(placed.scene, Painted) and not radiometry.sees_past:
        starts = turned(mirror_net(sensor).reshape(-1, 3), placed.turn.T) + placed.shift_mm
        starts = np.where(placed.distant, placed.shift_mm, starts)
        margin = 0.0 if placed.distant else BESIDE * sensor.mirror.rim_radius_mm
        surroundings = placed.scene.surroundings_from(starts.min(axis=0) - margin, starts.max(axis=0) + margin)
        if surroundings is not None:
            optics = native_optics(sensor, radiometry, plan.blur, placed.frame())
            light_of = partial(_of_surfaces, optics, surroundings, plan)
            return picture_of_tiles(light_of, sensor.image_size, len(plan.points), progress, workers, medium)
    return None


def _of_environment(
    sensor: Sensor,
    world: Environment,
    placed: _Placed,
    plan: Samples,
    radiometry: Radiometry,
    progress: Progress | None,
    medium: Medium,
) -> NDArray[Any]:
    frame = placed._replace(turn=world.heading() @ placed.turn).frame()
    optics = native_optics(sensor, radiometry, plan.blur, frame)
    width, height = sensor.image_size
    picture = medium.empty((width, height))
    for top in range(0, height, ROWS_AT_ONCE):
        light = np.empty((min(ROWS_AT_ONCE, height - top), width, 3), np.float32)
        backend.kernels.expose_environment(optics, world.native, plan.points, plan.blur, plan.seed, 0, top, light)
        picture[top : top + len(light)] = medium.read(light)
        if progress is not None:
            progress(top + len(light), height)
    return picture


def _of_surfaces(optics: object, surroundings: Surroundings, plan: Samples, tile: Tile) -> Light:
    rows, columns = tile
    light = np.empty((rows.stop - rows.start, columns.stop - columns.start, 3), np.float32)
    behind = surroundings.background
    most = 0 if behind is None else light.size // 3 * len(plan.points)
    pixels, rays = np.empty(most, np.int32), np.empty((most, 7), np.float32)
    surfaces, start = surroundings.surfaces.native, (columns.start, rows.start)
    count = backend.kernels.expose_surfaces(
        optics, surfaces, plan.points, plan.blur, plan.seed, *start, light, pixels, rays
    )
    if behind is not None and count:
        share, origins, directions = np.split(rays[:count].astype(float), (1, 4), axis=1)
        first = np.flatnonzero(np.diff(pixels[:count], prepend=-1))  # rays of a pixel are consecutive
        sums = np.add.reduceat(share * behind.radiance(origins, directions), first, axis=0)
        light.reshape(-1, 3)[pixels[first]] += sums.astype(np.float32)
    return light
