"""Boards whose mirror images are such boards too: read from the front, from behind, and in flipped pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .observations import Motion, Sighting


def from_the_front(sightings: Sequence[Sighting]) -> tuple[Sighting, ...]:
    """Boards that look the same from behind, with their corners counted as they are read from the front.

    A mirror's picture is reversed, and a detector counts the corners in it as it finds them: the board is then seen
    as if from behind, which is harmless as long as it is flat, and turns a bulge inside out where it is not.
    """
    ends_mm = ends_of(sightings)
    return tuple(_counted_backwards(s, ends_mm) if _is_from_behind(s) else s for s in sightings)


def flipped(sighting: Sighting, ends_mm: float, width: int) -> Sighting:
    """What the picture flipped left to right shows: there a detector counts the columns from the other end.

    Parameters
    ----------
    sighting
        With a motion, from where the flipped board's motion is near.
    ends_mm : mm
        From :func:`ends_of`.
    width
        Of the picture, px.
    """
    board = _counted_backwards(sighting, ends_mm)
    assert board.motion is not None
    across = np.array([-1.0, 1.0, 1.0])
    motion = Motion(across[:, None] * board.motion.rotation * [1.0, 1.0, -1.0], across * board.motion.shift_mm)
    return replace(board, pixels=board.pixels * across[:2] + [width - 1.0, 0.0], motion=motion)


def ends_of(sightings: Sequence[Sighting]) -> float:
    """Sum of the least and the greatest X of all boards: what a column has in X, and the one in its place, mm."""
    x = np.concatenate([np.zeros(0), *(s.points[:, 0] for s in sightings if not s.is_surveyed)])
    return float(x.min() + x.max()) if len(x) else 0.0


def _counted_backwards(sighting: Sighting, ends_mm: float) -> Sighting:
    """A board where it stands, its columns counted from the other end and read from the other side."""
    assert sighting.motion is not None
    rotation, shift = sighting.motion
    points = sighting.points * [-1.0, 1.0, 1.0] + [ends_mm, 0.0, 0.0]
    return replace(
        sighting, points=points, motion=Motion(rotation * [-1.0, 1.0, -1.0], shift + rotation[:, 0] * ends_mm)
    )


def _is_from_behind(sighting: Sighting) -> bool:
    """Whether a board's Z axis, which points away from who reads it, points at the camera."""
    if sighting.is_surveyed or sighting.motion is None:
        return False
    return float(sighting.motion.rotation[:, 2] @ sighting.motion(sighting.points).mean(axis=0)) < 0
