"""A camera, a board and its projected corners, for estimation tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import omnimirror as om
from omnimirror.calibration.estimation.observations import Observation, RigidTransform
from omnimirror.cameras.models import Unified

BOARD = om.Board("chessboard", 11, 7, 30.0)
SIZE = (640, 480)
TRUTH = Unified(
    xi=0.95,
    focal_px=(158.0, 157.0),
    centre_px=(326.0, 236.0),
    image_size=SIZE,
    k1=-0.12,
    k2=0.012,
    p1=0.001,
    p2=-0.0008,
)
NOISE_PX = 0.1


def detections(
    camera=TRUTH, count: int = 12, noise_px: float = NOISE_PX, seed: int = 0, **more
) -> list[om.Detection]:
    return om.simulate_detections(camera, BOARD, count, noise_px=noise_px, seed=seed, **more)


def directions(camera, count: int = 400, seed: int = 5) -> NDArray[np.float64]:
    """Return camera-frame directions of random pixels in the field."""
    random = np.random.default_rng(seed)
    radius, angle = (
        190 * np.sqrt(random.uniform(0.05, 1, count)),
        random.uniform(0, 2 * np.pi, count),
    )
    pixels = np.stack([326 + radius * np.cos(angle), 236 + radius * np.sin(angle)], axis=1)
    rays = camera.backproject(pixels)
    return rays.directions[rays.valid] @ camera.mount.rotation()


def known_points(pixels, points, **more) -> Observation:
    """Return an observation of points with known positions in the camera frame."""
    return Observation("room", pixels, points, RigidTransform.identity(), is_known=True, **more)
