"""Levelling from upright edges: the vertical vanishing point of a room or street."""

from __future__ import annotations

from dataclasses import replace
from math import comb
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from ..base.typing import Array
from ..cameras.camera import Camera, CameraLooks, Mount, rotate_vectors
from .edge_detection import edge_chains

MAX_TILT_DEG = 40.0
NEAR_DEG = 0.8  # maximum angle between the plane of an upright edge and the vertical
MAX_PAIRED = 80
MIN_UPRIGHT = 3
MAX_CHANCE_FRACTION = 0.01  # expected number of directions with as many edges by chance
REFINED = 4
BENT_DEG = 0.25  # maximum rms deviation of a straight edge from its plane
MIN_EXTENT_DEG = 6.0
MAX_SIDE_PX = 1440
SURE_DEG, SURE_UPRIGHT = 0.6, 8
USUAL_TILT_DEG, USUAL_ROLL_DEG = 20.0, 15.0


class Level(NamedTuple):
    """Tilt of a camera with known orientation, from one image."""

    camera_looks: CameraLooks
    pitch_deg: float
    roll_deg: float
    sigma_deg: float
    """Standard error of the vertical direction, along the larger axis."""
    upright: int
    """Number of upright edges."""

    @property
    def is_reliable(self) -> bool:
        """True if the tilt is reliable: accurate, and within the usual range.

        A camera that looks ahead usually has little roll but any pitch. If the orientation is
        wrong, horizontal edges taken for upright ones rarely satisfy this condition.
        """
        relative_tilt = abs(self.roll_deg) / USUAL_ROLL_DEG
        if self.camera_looks != "forward":
            relative_tilt = float(np.hypot(self.pitch_deg, self.roll_deg)) / USUAL_TILT_DEG
        return self.sigma_deg < SURE_DEG and self.upright >= SURE_UPRIGHT and relative_tilt < 1

    def on(self, mount: Mount) -> Mount:
        """Return the mount with this tilt."""
        return replace(mount, pitch_deg=self.pitch_deg, roll_deg=self.roll_deg)


def level_from_image(
    image: NDArray[Any],
    camera: Camera,
    mount: Mount,
    centre_px: tuple[float, float],
    radius_px: float,
) -> Level | None:
    """Estimate the tilt of a camera from one image; None for too few upright edges.

    Edges are traced, and those that are straight after undistortion define planes of directions. Edges are
    assumed far from the mirror of a camera with several viewpoints. The orientation of the camera
    must be known: horizontal edges of a room are as frequent and parallel as upright ones.

    Parameters
    ----------
    image : (height, width, 3) or (height, width)
        RGB image of any depth; opacity is ignored.
    camera
        Camera of the image.
    mount
        Mount of the camera.
    centre_px, radius_px
        Circle of the field.

    Returns
    -------
    Level or None
        Tilt.

    Examples
    --------
    >>> import omnimirror as om
    >>> ball = om.MirrorBall(
    ...     centre_px=(99.5, 99.5), rim_radius_px=90.0, field_deg=340.0, image_size=(200, 200)
    ... )
    >>> level_from_image(np.zeros((200, 200), np.uint8), ball, ball.mount, (99.5, 99.5), 90.0) is None
    True
    """
    normals, lengths = _straight_edges(image, camera, mount, centre_px, radius_px)
    return level_from_edges(normals, lengths, mount)


def _straight_edges(
    image: NDArray[Any],
    camera: Camera,
    mount: Mount,
    centre_px: tuple[float, float],
    radius_px: float,
) -> tuple[Array, Array]:
    """Return plane normals (n, 3) in the camera frame and lengths (n,) in rad of straight edges.

    Large images are reduced: the accuracy remains sufficient, and edges of fine structures are
    removed.
    """
    import cv2

    scale = max(1.0, max(image.shape[:2]) / MAX_SIDE_PX)
    if scale > 1:
        image = cv2.resize(image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    u, v = ((c + 0.5) / scale - 0.5 for c in centre_px)
    normals, lengths = [], []
    for chain in edge_chains(image, centre_px=(u, v), radius_px=radius_px / scale):
        rays = camera.backproject((chain + 0.5) * scale - 0.5)
        directions = rotate_vectors(rays.directions[rays.valid], mount.rotation())
        if len(directions) < MIN_UPRIGHT or directions[0] @ directions[-1] > np.cos(
            np.radians(MIN_EXTENT_DEG)
        ):
            continue
        moments, axes = np.linalg.eigh(directions.T @ directions / len(directions))
        if moments[0] < np.radians(BENT_DEG) ** 2:
            normals.append(axes[:, 0])
            lengths.append(float(np.arccos(np.clip(directions[0] @ directions[-1], -1, 1))))
    return np.reshape(normals, (-1, 3)), np.array(lengths)


def level_from_edges(normals: Array, lengths: Array, mount: Mount) -> Level | None:
    """Return the tilt for which most edges are upright; None if their number is not significant.

    Each edge is in a plane through the viewpoint, and the planes of upright edges contain the
    vertical. The search covers 40 deg around the vertical of the mount. Any two planes intersect in
    a line, and some of n random planes contain it by chance: the result is accepted if fewer than
    0.01 such lines are expected.

    Parameters
    ----------
    normals : (n, 3)
        Unit normals of the edges' planes in the camera frame.
    lengths : (n,)
        Weights of the edges.
    mount
        Orientation of the camera; its own tilt is ignored.

    Examples
    --------
    >>> tilted = Mount("up", pitch_deg=5.0, roll_deg=-3.0)
    >>> up = tilted.rotation().T @ [0.0, 0.0, 1.0]
    >>> normals = np.cross(up, np.random.default_rng(0).normal(size=(5, 3)))
    >>> level = level_from_edges(normals / np.linalg.norm(normals, axis=1)[:, None], np.ones(5), Mount("up"))
    >>> round(level.pitch_deg, 6), round(level.roll_deg, 6), level.upright
    (5.0, -3.0, 5)
    """
    if len(normals) < MIN_UPRIGHT:
        return None
    to_world = mount.levelled.rotation()
    planes = normals @ to_world.T
    first = np.argsort(-lengths)[:MAX_PAIRED]
    a, b = np.triu_indices(len(first), 1)
    up = np.cross(planes[first[a]], planes[first[b]])
    size = np.linalg.norm(up, axis=1)
    up = up[size > 1e-3] / size[size > 1e-3, None]
    up *= np.sign(up[:, 2:]) + (up[:, 2:] == 0)
    up = up[up[:, 2] > np.cos(np.radians(MAX_TILT_DEG))]
    if not len(up):
        return None
    is_near = np.abs(planes @ up.T) < np.sin(np.radians(NEAR_DEG))
    best = up[int((lengths @ is_near).argmax())]
    for _ in range(REFINED):
        is_upright = np.abs(planes @ best) < np.sin(np.radians(NEAR_DEG))
        if is_upright.sum() < MIN_UPRIGHT:
            return None
        moments = (planes[is_upright] * lengths[is_upright, None] ** 2).T @ planes[is_upright]
        best = np.linalg.eigh(moments)[1][:, 0]
        best = best * np.sign(best[2])
    if _by_chance(int(is_upright.sum()), len(planes)) > MAX_CHANCE_FRACTION:
        return None
    residuals = planes[is_upright] @ best
    weight = lengths[is_upright] ** 2 / (lengths[is_upright] ** 2).mean()
    across = np.linalg.svd(best[None])[2][1:]
    matrix = (across @ (planes[is_upright] * weight[:, None]).T) @ (planes[is_upright] @ across.T)
    noise = float((weight * residuals**2).sum()) / max(int(is_upright.sum()) - 2, 1)
    sigma = np.degrees(np.sqrt(noise / max(float(np.linalg.eigvalsh(matrix)[0]), 1e-12)))
    pitch, roll = (
        np.degrees(np.arcsin(np.clip(best[0], -1, 1))),
        np.degrees(np.arctan2(best[1], best[2])),
    )
    return Level(mount.camera_looks, float(pitch), float(roll), float(sigma), int(is_upright.sum()))


def _by_chance(count: int, planes: int) -> float:
    """Return the expected number of intersection lines that as many random planes contain.

    The probability that a random plane is within an angle of a line is the sine of the angle.
    """
    return comb(planes, 2) * float(bdtrc(count - 3, planes - 2, np.sin(np.radians(NEAR_DEG))))
