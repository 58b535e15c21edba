"""Which way is up, from what stands upright: the vertical vanishing point of a room or street."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...frames import Mount

Array = NDArray[np.float64]

MOST_LEAN_DEG = 40.0
NEAR_DEG = 0.8  # of an upright edge's plane to the plumb line
MOST_PAIRED = 80
LEAST_UPRIGHT = 3
REFINED = 4


class Level(NamedTuple):
    """How a camera leans, from one picture."""

    pitch_deg: float
    roll_deg: float
    sigma_deg: float
    """standard error of the plumb line, the way in which it is larger"""
    upright: int
    """edges that stand upright"""

    def on(self, mount: Mount) -> Mount:
        """The mount with this lean."""
        return replace(mount, pitch_deg=self.pitch_deg, roll_deg=self.roll_deg)


def level_from(normals: Array, lengths: Array, mount: Mount) -> Level | None:
    """The lean for which most edges stand upright; None if too few do.

    Each edge lies in a plane through the viewpoint, and planes of upright edges hold the plumb line. It is looked for
    within 40 deg of where the mount has it.

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
    off = planes[kept] @ best
    weight = lengths[kept] ** 2 / (lengths[kept] ** 2).mean()
    across = np.linalg.svd(best[None])[2][1:]
    matrix = (across @ (planes[kept] * weight[:, None]).T) @ (planes[kept] @ across.T)
    noise = float((weight * off**2).sum()) / max(int(kept.sum()) - 2, 1)
    sigma = np.degrees(np.sqrt(noise / max(float(np.linalg.eigvalsh(matrix)[0]), 1e-12)))
    pitch, roll = np.degrees(np.arcsin(np.clip(best[0], -1, 1))), np.degrees(np.arctan2(best[1], best[2]))
    return Level(float(pitch), float(roll), float(sigma), int(kept.sum()))
