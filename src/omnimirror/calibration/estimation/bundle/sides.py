"""Boards that equal their mirror image: numbering in mirrored and flipped images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .observations import Motion, Sighting


def from_the_front(sightings: Sequence[Sighting]) -> tuple[Sighting, ...]:
    """Return boards that equal their mirror image with corners numbered as seen from the front.

    The image of a mirror is reversed, and a detector numbers the corners in image order: the board
    appears as seen from behind. This has no effect on a flat board, but inverts the sign of a
    bulge.
    """
    ends_mm = ends_of(sightings)
    return tuple(_counted_backwards(s, ends_mm) if _is_from_behind(s) else s for s in sightings)


def flipped(sighting: Sighting, ends_mm: float, width: int) -> Sighting:
    """Return the observation in the image flipped left to right.

    In a flipped image a detector numbers the columns from the other end.

    Parameters
    ----------
    sighting
        Observation with a pose, from which the initial pose of the flipped board follows.
    ends_mm : mm
        Result of :func:`ends_of`.
    width
        Width of the image, px.
    """
    board = _counted_backwards(sighting, ends_mm)
    assert board.motion is not None
    across = np.array([-1.0, 1.0, 1.0])
    motion = Motion(across[:, None] * board.motion.rotation * [1.0, 1.0, -1.0], across * board.motion.shift_mm)
    return replace(board, pixels=board.pixels * across[:2] + [width - 1.0, 0.0], motion=motion)


def ends_of(sightings: Sequence[Sighting]) -> float:
    """Return the sum of the minimum and maximum X of all boards, mm.

    It equals the sum of the X coordinates of a column and its mirror image.
    """
    x = np.concatenate([np.zeros(0), *(s.points[:, 0] for s in sightings if not s.is_surveyed)])
    return float(x.min() + x.max()) if len(x) else 0.0


def _counted_backwards(sighting: Sighting, ends_mm: float) -> Sighting:
    """Return a board at its pose with reversed column numbers, read from the other side."""
    assert sighting.motion is not None
    rotation, shift = sighting.motion
    points = sighting.points * [-1.0, 1.0, 1.0] + [ends_mm, 0.0, 0.0]
    return replace(
        sighting, points=points, motion=Motion(rotation * [-1.0, 1.0, -1.0], shift + rotation[:, 0] * ends_mm)
    )


def _is_from_behind(sighting: Sighting) -> bool:
    """Return whether a board's Z axis, which points away from the viewer, points at the camera."""
    if sighting.is_surveyed or sighting.motion is None:
        return False
    return float(sighting.motion.rotation[:, 2] @ sighting.motion(sighting.points).mean(axis=0)) < 0
