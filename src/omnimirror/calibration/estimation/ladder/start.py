"""Initial values of a calibration: image centre, xi = 1, and a searched focal length.

With xi = 1 the unified model is the stereographic projection ``r = f tan(Omega / 2)``, which
approximates every mirror and fisheye sufficiently. For each of a series of focal lengths, corners
are back-projected to the unit sphere, each target is placed by linear equations, and the median
residuals in pixels are compared. (Angular residuals are unsuitable: they vanish for focal lengths
so short that all corners coincide.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....base.typing import Array
from ..bundle.observations import Motion, Sighting
from .placing import placed

FOCALS = 25
FOCAL_RANGE = (0.08, 1.6)  # relative to the larger image side


class StereographicStart(NamedTuple):
    """Stereographic camera with board poses."""

    focal_px: float
    centre_px: tuple[float, float]
    motions: tuple[Motion | None, ...]
    """Poses; None for boards that could not be placed."""
    median_px: float
    """Median residual."""


def stereographic_start(
    sightings: Sequence[Sighting], image_size: tuple[int, int], centre_px: tuple[float, float], signs: Array
) -> StereographicStart:
    """Return the focal length and the board poses with the smallest median residual.

    ``signs`` (3,) are the signs of right, down and the viewing direction at the image centre along
    X, Y and Z of the camera.
    """
    larger = max(image_size)
    focals = np.geomspace(FOCAL_RANGE[0] * larger, FOCAL_RANGE[1] * larger, FOCALS)
    starts = [_start_at(float(f), sightings, centre_px, signs) for f in focals]
    return min(starts, key=lambda s: s.median_px)


def _start_at(
    focal_px: float, sightings: Sequence[Sighting], centre_px: tuple[float, float], signs: Array
) -> StereographicStart:
    motions: list[Motion | None] = []
    lengths = []
    for sighting in sightings:
        bearings = lifted(sighting.pixels, focal_px, centre_px, signs)
        motion = placed(sighting, bearings)
        motions.append(motion)
        if motion is not None:
            pixels = seen_at(sighting.before(motion), focal_px, centre_px, signs)
            lengths.append(np.hypot(*(pixels - sighting.pixels).T))
    median = float(np.median(np.concatenate(lengths))) if lengths else np.inf
    return StereographicStart(focal_px, centre_px, tuple(motions), median)


def lifted(pixels: Array, focal_px: float, centre_px: tuple[float, float], signs: Array) -> Array:
    """Return unit directions (n, 3) in the camera frame of pixels (n, 2) of a stereographic camera.

    >>> lifted(np.array([[200.0, 100.0]]), 100.0, (100.0, 100.0), np.array([1, 1, -1])).round(12) + 0.0
    array([[1., 0., 0.]])
    """
    x, y = (pixels - centre_px).T / focal_px
    s = x * x + y * y
    return np.asarray(np.stack([2 * x / (1 + s), 2 * y / (1 + s), (1 - s) / (1 + s)], axis=1) * signs)


def seen_at(points: Array, focal_px: float, centre_px: tuple[float, float], signs: Array) -> Array:
    """Return pixels (n, 2) of points (n, 3) in a stereographic camera."""
    right, down, forward = (points * signs).T
    denominator = np.maximum(np.linalg.norm(points, axis=1) + forward, 1e-9)
    return np.asarray(centre_px + focal_px * np.stack([right, down], axis=1) / denominator[:, None])
