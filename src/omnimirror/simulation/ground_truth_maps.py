"""Ground truth of each pixel: origin, direction, depth, normals, labels and optical flow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import validate_arguments
from ..base.colour import Light
from ..base.results import Columns, Result, axis_columns, pixel_grid
from ..base.typing import Array, Mask
from ..cameras.camera import Camera
from .pixel_rays import trace_pixels
from .radiometry import Radiometry
from .scenes.moving_objects import SceneWithBodies
from .scenes.scene import Pose, PosedScene, Scene, distances_mm

# -- Ground truth: origin, direction and depth -----------------------------------------------------

ROWS_AT_ONCE = 64


@dataclass(frozen=True)
class GroundTruth(Result):
    """Scene points of the chief rays of pixel centres (rows, columns); NaN for pixels without
    scene.

    A chief ray passes through the centre of the lens aperture. If the housing blocks it, the pixel
    is hidden, even if adjacent rays pass: blur makes the image fade at edges, but not the ground
    truth. Ghosts are ignored.
    """

    origins_mm: Array
    """Origins (h, w, 3) of the rays leaving the sensor, in its world frame: on the mirror, on the
    outer side of a tube or a dome, or at the lens for rays that miss the mirror.
    """
    directions: Array
    """Unit direction vectors (h, w, 3) in the world frame of the sensor."""
    depth_mm: Array
    """Distances (h, w) along the ray from its origin to the scene point; infinite for points at
    infinity.
    """
    hidden: Mask
    """Mask (h, w) of pixels that image camera, rod, rim or a lid, or a part of two mirrors
    themselves.
    """

    def _table(self) -> Columns:
        height, width = self.depth_mm.shape
        rays = axis_columns("origin", self.origins_mm, "_mm") | axis_columns(
            "direction", self.directions
        )
        pixels = pixel_grid(np.arange(width), np.arange(height))
        depth = {"depth_mm": self.depth_mm.ravel(), "hidden": self.hidden.ravel()}
        return {**pixels, **rays, **depth}

    @property
    def points_mm(self) -> Array:
        """Scene points (h, w, 3) in the world frame of the sensor."""
        return self.origins_mm + self.depth_mm[..., None] * self.directions

    def channels(self, light: Light) -> dict[str, NDArray[np.float32]]:
        """Return channels (h, w) of an image file: R G B of the light (h, w, 3), A, H, Z, DX DY DZ
        and OX OY OZ.

        A is 1 if the pixel centre images the scene and otherwise 0, H is 1 if the housing hides it;
        Z is the depth, D the direction and O the origin.
        """
        planes: dict[str, NDArray[Any]] = {name: light[..., i] for i, name in enumerate("RGB")}
        planes |= {"A": np.isfinite(self.directions[..., 0]), "H": self.hidden, "Z": self.depth_mm}
        planes |= {f"D{axis}": self.directions[..., i] for i, axis in enumerate("XYZ")}
        planes |= {f"O{axis}": self.origins_mm[..., i] for i, axis in enumerate("XYZ")}
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}


@validate_arguments
def ground_truth(camera: Camera, scene: Scene, radiometry: Radiometry | None = None) -> GroundTruth:
    """Return the ground truth of each pixel centre by its chief ray.

    Parameters
    ----------
    camera
    scene
    radiometry
        As in :func:`~omnimirror.expose`: determines the visibility past the mirror.

    Returns
    -------
    GroundTruth
        Origin, direction, depth and visibility for each pixel.

    Raises
    ------
    InvalidParameter
        If the scene provides no distances, or radiometry or housing are not supported for the
        camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> truth = om.ground_truth(om.load_sensor("paper-spherical"), om.Room(texel_mm=40.0))
    >>> truth.points_mm[11, 512].round()  # ahead and 44 deg up: a beam under the ceiling
    array([1840.,    2., 1773.])
    """
    width, height = camera.image_size
    origins, directions = np.full((2, height, width, 3), np.nan)
    depth, hidden = np.full((height, width), np.nan), np.zeros((height, width), dtype=bool)
    for top in range(0, height, ROWS_AT_ONCE):
        rows = np.arange(top, min(top + ROWS_AT_ONCE, height))
        pixels = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).reshape(-1, 2)
        rays = trace_pixels(camera, pixels, radiometry)
        band, shape = slice(rows[0], rows[-1] + 1), (len(rows), width)
        origins[band], directions[band] = (
            rays.origins.reshape(*shape, 3),
            rays.directions.reshape(*shape, 3),
        )
        hidden[band] = rays.hidden.reshape(shape)
        valid = rays.valid
        depth[band][valid.reshape(shape)] = distances_mm(
            scene, rays.origins[valid], rays.directions[valid]
        )
    return GroundTruth(origins, directions, depth, hidden)


# -- Ground truth for machine learning: normals, labels and optical flow ---------------------------

NEIGHBOUR_ANGLE = 2e-4  # radians: rays next to that of a pixel, on the same surface except at edges
# Maximum distance of a ray endpoint from a point that is visible again: in mm, and relative
SURFACE_TOLERANCE_MM, SURFACE_TOLERANCE = 1.0, 1e-3


class Moment(NamedTuple):
    """Scene with its bodies, and pose of the sensor, at one time."""

    scene: SceneWithBodies
    pose: Pose

    @property
    def posed_scene(self) -> PosedScene:
        """Scene in the sensor frame."""
        return PosedScene(self.scene, self.pose)


class TrainingGroundTruth(NamedTuple):
    """Ground truth of a frame for the chief rays of pixel centres; NaN for pixels without scene."""

    truth: GroundTruth
    normals: Array
    """Unit normals (h, w, 3) towards the sensor, in its world frame."""
    labels: NDArray[np.uint16]
    """Labels (h, w); 0 for pixels without object."""
    flow_px: Array
    """Optical flow (h, w, 2) to the next frame, (right, down); NaN outside its field."""
    visible_again: Mask
    """Mask (h, w) of points that are not occluded in the next frame."""


def training_ground_truth(
    camera: Camera, now: Moment, following: Moment, radiometry: Radiometry | None = None
) -> TrainingGroundTruth:
    """Return the ground truth of a frame, and its flow to the following one.

    Normals are those of the plane through three points on adjacent rays, on the sides without an
    edge, and therefore exact on flat surfaces.
    """
    truth = ground_truth(camera, now.posed_scene, radiometry)
    shape = truth.depth_mm.shape
    valid = np.isfinite(truth.directions[..., 0])
    origins, towards, depth = (
        truth.origins_mm[valid],
        truth.directions[valid],
        truth.depth_mm[valid],
    )
    normals, flow = np.full((*shape, 3), np.nan), np.full((*shape, 2), np.nan)
    labels, visible = np.zeros(shape, np.uint16), np.zeros(shape, dtype=bool)
    normals[valid] = _normals(now.posed_scene, origins, towards, depth)
    turn = now.pose.rotation().T
    scene_labels = now.scene.labels(now.pose.to_scene(origins), towards @ turn)
    labels[valid] = scene_labels
    v, u = np.nonzero(valid)
    next_pixels, visible[valid] = _next_frame(
        camera, now, following, (origins, towards, depth, scene_labels), radiometry
    )
    flow[valid] = next_pixels - np.stack([u, v], axis=1)
    return TrainingGroundTruth(truth, normals, labels, flow, visible)


@np.errstate(invalid="ignore")  # points at infinity
def _normals(scene: PosedScene, origins: Array, towards: Array, depth: Array) -> Array:
    """Return unit normals (n, 3) towards the origins; NaN for points at infinity."""
    helper = np.eye(3)[np.abs(towards).argmin(axis=1)]
    across = np.cross(towards, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    one, other = (
        _along(scene, origins, towards, depth, axis) for axis in (across, np.cross(towards, across))
    )
    normal: Array = np.cross(one, other)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign(np.einsum("ni,ni->n", normal, towards))[:, None]
    return normal


def _along(scene: PosedScene, origins: Array, towards: Array, depth: Array, axis: Array) -> Array:
    """Return steps (n, 3) on the surface to the point of a ray rotated along an axis, on the side
    without an edge.
    """
    # On a plane with n . p = c, the ray o + t (d + s a) has 1/t = n . (d + s a) / (c - n . o), which is
    # linear in s. The second difference of 1/t at s = 0, h and 2 h is therefore 0 on a flat side, and
    # not 0 if an edge lies between the three rays.
    steps, bends = [], []
    points = origins + depth[:, None] * towards
    for sign in (NEIGHBOUR_ANGLE, -NEIGHBOUR_ANGLE):
        near, far = (_reach(scene, origins, towards + times * sign * axis) for times in (1, 2))
        steps.append((near[:, None] * (towards + sign * axis) + origins - points) / sign)
        bends.append(np.abs(1 / depth - 2 / near + 1 / far))
    chosen: Array = np.where((bends[0] <= bends[1])[:, None], *steps)
    return chosen


def _reach(scene: PosedScene, origins: Array, towards: Array) -> Array:
    """Return distances (n,) along rays, in lengths of their directions."""
    lengths = np.linalg.norm(towards, axis=1)
    reach: Array = distances_mm(scene, origins, towards / lengths[:, None]) / lengths
    return reach


def _next_frame(
    camera: Camera,
    now: Moment,
    following: Moment,
    surface: tuple[Array, Array, Array, NDArray[np.int64]],
    radiometry: Radiometry | None,
) -> tuple[Array, Mask]:
    """Return pixels (n, 2) of the visible points in the following frame, and their visibility."""
    origins, towards, depth, labels = surface
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
    visible = valid.copy()
    next_rays = trace_pixels(camera, pixels[valid], radiometry)
    with np.errstate(invalid="ignore"):
        distances = np.full(len(next_rays.valid), np.nan)
        valid_rays = next_rays.valid
        distances[valid_rays] = distances_mm(
            following.posed_scene, next_rays.origins[valid_rays], next_rays.directions[valid_rays]
        )
        expected = np.where(
            far[valid], np.inf, np.linalg.norm(points[valid] - next_rays.origins, axis=1)
        )
        is_same_point = (distances == expected) | (
            np.abs(distances - expected) <= SURFACE_TOLERANCE_MM + SURFACE_TOLERANCE * expected
        )
    visible[valid] = valid_rays & ~next_rays.hidden & is_same_point
    pixels[~valid] = np.nan
    return pixels, visible
