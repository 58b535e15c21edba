"""What networks learn from: normals, labels and the optical flow to the next frame, of every pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ..radiometry import Radiometry
from ..rendering.sight import sights
from ..scenes.contract import Array, distances_mm
from ..scenes.posed import Pose, PosedScene
from ..scenes.worlds.bodies import SceneWithBodies
from .truth import Mask, Truth, ground_truth

NEIGHBOUR = 2e-4  # radians: rays beside a pixel's own, on the same surface but at edges
SAME_MM, SAME = 1.0, 1e-3  # a point is seen again where a ray ends this near to it: in mm, and of its distance


class Moment(NamedTuple):
    """A scene with its bodies, and where the sensor stands in it."""

    scene: SceneWithBodies
    pose: Pose

    @property
    def seen(self) -> PosedScene:
        """From the sensor's own frame."""
        return PosedScene(self.scene, self.pose)


class LearningTruth(NamedTuple):
    """The truth of a frame, for chief rays of pixel centres; NaN where a pixel sees nothing of the scene."""

    truth: Truth
    normals: Array
    """(h, w, 3) unit normals towards the sensor, in its world frame."""
    labels: NDArray[np.uint16]
    """(h, w): what is seen; 0 is nothing."""
    flow_px: Array
    """(h, w, 2): from a pixel to where what it sees appears in the next frame, (right, down); NaN out of its field."""
    seen_again: Mask
    """(h, w): whether nothing stands before that there."""


def learning_truth(
    camera: Camera, now: Moment, following: Moment, radiometry: Radiometry | None = None
) -> LearningTruth:
    """The truth of a frame, and its flow to the one that follows.

    Normals are those of the plane through three points that neighbouring rays meet, and so exact on flat surfaces.
    """
    truth = ground_truth(camera, now.seen, radiometry)
    shape = truth.depth_mm.shape
    valid = np.isfinite(truth.directions[..., 0])
    origins, towards, depth = truth.origins_mm[valid], truth.directions[valid], truth.depth_mm[valid]
    normals, flow = np.full((*shape, 3), np.nan), np.full((*shape, 2), np.nan)
    labels, again = np.zeros(shape, np.uint16), np.zeros(shape, dtype=bool)
    normals[valid] = _normals(now.seen, origins, towards, depth)
    turn = now.pose.rotation().T
    met = now.scene.labels(now.pose.to_scene(origins), towards @ turn)
    labels[valid] = met
    v, u = np.nonzero(valid)
    moved, again[valid] = _moved(camera, now, following, (origins, towards, depth, met), radiometry)
    flow[valid] = moved - np.stack([u, v], axis=1)
    return LearningTruth(truth, normals, labels, flow, again)


@np.errstate(invalid="ignore")  # of what is infinitely far
def _normals(scene: PosedScene, origins: Array, towards: Array, depth: Array) -> Array:
    """Unit normals (n, 3) towards the origins; NaN at what is infinitely far."""
    points = origins + depth[:, None] * towards
    helper = np.eye(3)[np.abs(towards).argmin(axis=1)]
    across = np.cross(towards, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    one, other = (_along(scene, origins, towards, points, axis) for axis in (across, np.cross(towards, across)))
    normal: Array = np.cross(one, other)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign(np.einsum("ni,ni->n", normal, towards))[:, None]
    return normal


def _along(scene: PosedScene, origins: Array, towards: Array, points: Array, axis: Array) -> Array:
    """Steps (n, 3) on the surface to what a ray meets that is turned along an axis: to the nearer side, at edges."""
    steps = []
    for sign in (NEIGHBOUR, -NEIGHBOUR):
        beside = towards + sign * axis
        beside /= np.linalg.norm(beside, axis=1, keepdims=True)
        far = distances_mm(scene, origins, beside)
        steps.append((far[:, None] * beside + origins - points) / sign)
    lengths = [np.nan_to_num(np.linalg.norm(step, axis=1), nan=np.inf) for step in steps]
    return np.where((lengths[0] <= lengths[1])[:, None], *steps)


def _moved(
    camera: Camera,
    now: Moment,
    following: Moment,
    seen: tuple[Array, Array, Array, NDArray[np.int64]],
    radiometry: Radiometry | None,
) -> tuple[Array, Mask]:
    """Pixels (n, 2) in the following frame of what is seen now, and whether it is seen there."""
    origins, towards, depth, labels = seen
    far = np.isinf(depth)
    points = now.pose.to_scene(origins + np.where(far, 0.0, depth)[:, None] * towards)
    first = 1 + len(now.scene.label_names) - len(now.scene.bodies)
    for number, body in enumerate(now.scene.bodies):
        on = labels == first + number
        before, after = body.pose_at(now.scene.time_s), body.pose_at(following.scene.time_s)
        points[on] = after.to_scene(before.to_sensor(points[on]))
    points = following.pose.to_sensor(points)
    pixels, valid = camera.project(points)
    away = towards @ now.pose.rotation().T @ following.pose.rotation()
    if far.any():
        pixels[far], valid[far] = camera.project_directions(away[far])
    again = valid.copy()
    there = sights(camera, pixels[valid], radiometry)
    with np.errstate(invalid="ignore"):
        ends = np.full(len(there.valid), np.nan)
        ok = there.valid
        ends[ok] = distances_mm(following.seen, there.origins[ok], there.directions[ok])
        wanted = np.where(far[valid], np.inf, np.linalg.norm(points[valid] - there.origins, axis=1))
        same = (ends == wanted) | (np.abs(ends - wanted) <= SAME_MM + SAME * wanted)
    again[valid] = ok & ~there.hidden & same
    pixels[~valid] = np.nan
    return pixels, again
