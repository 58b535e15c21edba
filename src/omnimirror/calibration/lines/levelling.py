"""Which way is up, from what stands upright: the vertical vanishing point of a room or street."""

from __future__ import annotations

from dataclasses import replace
from math import comb
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from ...cameras.camera import Camera
from ...cameras.frames import CameraLooks, Mount, turned
from .chains import edge_chains

Array = NDArray[np.float64]

MOST_LEAN_DEG = 40.0
NEAR_DEG = 0.8  # of an upright edge's plane to the plumb line
MOST_PAIRED = 80
LEAST_UPRIGHT = 3
MOST_BY_CHANCE = 0.01  # directions that as many edges would point to if they lay anyhow
REFINED = 4
BENT_DEG = 0.25  # root mean square off its plane, beyond which an edge is not straight
LEAST_EXTENT_DEG = 6.0
LOOKED_AT_PX = 1440
SURE_DEG, SURE_UPRIGHT = 0.6, 8
USUAL_LEAN_DEG, USUAL_ROLL_DEG = 20.0, 15.0


class Level(NamedTuple):
    """How a camera that looks some way leans, from one picture."""

    camera_looks: CameraLooks
    pitch_deg: float
    roll_deg: float
    sigma_deg: float
    """standard error of the plumb line, the way in which it is larger"""
    upright: int
    """edges that stand upright"""

    @property
    def is_sure(self) -> bool:
        """Whether it may be taken unasked: it is exact, and no more than such cameras lean.

        One that looks ahead is held level from side to side, whatever it looks down; where it looks another way than is
        thought, level edges that are taken for upright ones seldom allow that.
        """
        lean = abs(self.roll_deg) / USUAL_ROLL_DEG
        if self.camera_looks != "forward":
            lean = float(np.hypot(self.pitch_deg, self.roll_deg)) / USUAL_LEAN_DEG
        return self.sigma_deg < SURE_DEG and self.upright >= SURE_UPRIGHT and lean < 1

    def on(self, mount: Mount) -> Mount:
        """The mount with this lean."""
        return replace(mount, pitch_deg=self.pitch_deg, roll_deg=self.roll_deg)


def level_in(
    picture: NDArray[Any], camera: Camera, mount: Mount, centre_px: tuple[float, float], radius_px: float
) -> Level | None:
    """How a camera leans that is known but for that, from one picture; None if too few edges stand upright in it.

    Edges are followed, and those that the camera makes straight lie in planes of directions. A camera with several
    viewpoints is taken to look at what is far against its mirror. Which way it looks has to be known: edges of a room
    that lie level are as many and as parallel as those that stand.

    Parameters
    ----------
    picture : (height, width, 3) or (height, width)
        RGB, of any depth; opacity is left out.
    camera
        Which took it.
    mount
        Its mount.
    centre_px, radius_px
        Circle of the field.

    Returns
    -------
    Level or None

    Examples
    --------
    >>> import omnimirror as om
    >>> ball = om.MirrorBall((99.5, 99.5), 90.0, 340.0, (200, 200))
    >>> level_in(np.zeros((200, 200), np.uint8), ball, ball.mount, (99.5, 99.5), 90.0) is None
    True
    """
    normals, lengths = _straight_edges(picture, camera, mount, centre_px, radius_px)
    return level_from(normals, lengths, mount)


def _straight_edges(
    picture: NDArray[Any], camera: Camera, mount: Mount, centre_px: tuple[float, float], radius_px: float
) -> tuple[Array, Array]:
    """Of the edges that are straight for a camera: normals (n, 3) of their planes in its frame, and lengths (n,), rad.

    Large pictures are reduced: an edge's plane is known well enough then, and edges of fine things are left out.
    """
    import cv2

    scale = max(1.0, max(picture.shape[:2]) / LOOKED_AT_PX)
    if scale > 1:
        picture = cv2.resize(picture, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    u, v = ((c + 0.5) / scale - 0.5 for c in centre_px)
    normals, lengths = [], []
    for chain in edge_chains(picture, centre_px=(u, v), radius_px=radius_px / scale):
        rays = camera.backproject((chain + 0.5) * scale - 0.5)
        seen = turned(rays.directions[rays.valid], mount.rotation())
        if len(seen) < LEAST_UPRIGHT or seen[0] @ seen[-1] > np.cos(np.radians(LEAST_EXTENT_DEG)):
            continue
        moments, axes = np.linalg.eigh(seen.T @ seen / len(seen))
        if moments[0] < np.radians(BENT_DEG) ** 2:
            normals.append(axes[:, 0])
            lengths.append(float(np.arccos(np.clip(seen[0] @ seen[-1], -1, 1))))
    return np.reshape(normals, (-1, 3)), np.array(lengths)


def level_from(normals: Array, lengths: Array, mount: Mount) -> Level | None:
    """The lean for which most edges stand upright; None if no more do than would by chance.

    Each edge lies in a plane through the viewpoint, and planes of upright edges hold the plumb line. It is looked for
    within 40 deg of where the mount has it. Any two planes meet in a line, and of n planes that lie anyhow some more
    hold it by chance: so many that less than .01 such lines are to be expected are what counts.

    Parameters
    ----------
    normals : (n, 3)
        Unit normals of the edges' planes, in the camera frame.
    lengths : (n,)
        How much each edge counts.
    mount
        Which way the camera looks; its own lean is not asked.

    Examples
    --------
    >>> tilted = Mount("up", pitch_deg=5.0, roll_deg=-3.0)
    >>> up = tilted.rotation().T @ [0.0, 0.0, 1.0]
    >>> normals = np.cross(up, np.random.default_rng(0).normal(size=(5, 3)))
    >>> level = level_from(normals / np.linalg.norm(normals, axis=1)[:, None], np.ones(5), Mount("up"))
    >>> round(level.pitch_deg, 6), round(level.roll_deg, 6), level.upright
    (5.0, -3.0, 5)
    """
    if len(normals) < LEAST_UPRIGHT:
        return None
    to_world = mount.upright.rotation()
    planes = normals @ to_world.T
    first = np.argsort(-lengths)[:MOST_PAIRED]
    a, b = np.triu_indices(len(first), 1)
    up = np.cross(planes[first[a]], planes[first[b]])
    size = np.linalg.norm(up, axis=1)
    up = up[size > 1e-3] / size[size > 1e-3, None]
    up *= np.sign(up[:, 2:]) + (up[:, 2:] == 0)
    up = up[up[:, 2] > np.cos(np.radians(MOST_LEAN_DEG))]
    if not len(up):
        return None
    near = np.abs(planes @ up.T) < np.sin(np.radians(NEAR_DEG))
    best = up[int((lengths @ near).argmax())]
    for _ in range(REFINED):
        kept = np.abs(planes @ best) < np.sin(np.radians(NEAR_DEG))
        if kept.sum() < LEAST_UPRIGHT:
            return None
        moments = (planes[kept] * lengths[kept, None] ** 2).T @ planes[kept]
        best = np.linalg.eigh(moments)[1][:, 0]
        best = best * np.sign(best[2])
    if _by_chance(int(kept.sum()), len(planes)) > MOST_BY_CHANCE:
        return None
    off = planes[kept] @ best
    weight = lengths[kept] ** 2 / (lengths[kept] ** 2).mean()
    across = np.linalg.svd(best[None])[2][1:]
    matrix = (across @ (planes[kept] * weight[:, None]).T) @ (planes[kept] @ across.T)
    noise = float((weight * off**2).sum()) / max(int(kept.sum()) - 2, 1)
    sigma = np.degrees(np.sqrt(noise / max(float(np.linalg.eigvalsh(matrix)[0]), 1e-12)))
    pitch, roll = np.degrees(np.arcsin(np.clip(best[0], -1, 1))), np.degrees(np.arctan2(best[1], best[2]))
    return Level(mount.camera_looks, float(pitch), float(roll), float(sigma), int(kept.sum()))


def _by_chance(count: int, planes: int) -> float:
    """How many lines are to be expected, of those in which two planes meet, that as many of all hold.

    A plane that lies anyhow comes as near to a line with the sine of that angle as its probability.
    """
    return comb(planes, 2) * float(bdtrc(count - 3, planes - 2, np.sin(np.radians(NEAR_DEG))))
