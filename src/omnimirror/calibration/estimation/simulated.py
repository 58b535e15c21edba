"""Simulated board corners without rendering, to test a calibration against a known camera."""

from __future__ import annotations

import numpy as np

from ...base.arguments import checked, finite, number, whole
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import Camera
from ..targets import Board, Detection
from .bundle.observations import rotation_of

MOST_PICTURES = 10_000
TRIES = 200  # attempts per pose before an error is raised
SEEN = 0.8  # minimum fraction of visible corners
MOST_TILT = np.radians(45.0)
DISTANCES = (0.9, 2.5)  # multiples of the board's diagonal


@checked
def simulate_detections(
    camera: Camera,
    board: Board,
    count: int = 12,
    *,
    noise_px: float = 0.1,
    seed: int = 0,
    points_mm: Array | None = None,
) -> list[Detection]:
    """Simulate corners of a board at random poses around a camera, with normal noise.

    Parameters
    ----------
    camera
        Camera of any type.
    board
        Target, placed 0.9 to 2.5 times its diagonal from the camera and tilted by up to 45 deg.
    count
        Number of images.
    noise_px
        Standard deviation of each coordinate.
    seed
        Random seed of poses and noise.
    points_mm : (n, 3), optional
        True positions of the board's corners, for a board that is not flat.

    Returns
    -------
    list of Detection
        Simulated detections.

    Raises
    ------
    InvalidParameter
        If the camera sees the board at no pose.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> [len(d.ids) > 50 for d in om.simulate_detections(camera, om.Board("chessboard", 11, 7, 30.0), 3)]
    [True, True, True]
    """
    whole("count", count, 1, MOST_PICTURES)
    number("noise_px", noise_px, low=0.0, unit="px")
    random = np.random.default_rng(whole("seed", seed))
    points = board.points_mm if points_mm is None else finite("points_mm", points_mm, last=3)
    detections = []
    for i in range(count):
        for _ in range(TRIES):
            seen = camera.project(_held(camera, points, random))
            if seen.valid.mean() >= SEEN:
                break
        else:
            raise InvalidParameter(f"the camera sees no board of {board} with squares of {board.square_mm:g} mm")
        ids = np.flatnonzero(seen.valid)
        corners = seen.pixels[ids] + random.normal(0.0, noise_px, (len(ids), 2))
        detections.append(Detection(f"picture {i + 1}", camera.image_size, ids, corners))
    return detections


def _held(camera: Camera, points: Array, random: np.random.Generator) -> Array:
    """Return the corners (n, 3) of a board at a random pose in the world frame."""
    size = np.array(camera.image_size)
    while True:
        rays = camera.backproject(random.uniform(0, 1, (1, 2)) * size - 0.5)
        if rays.valid[0]:
            break
    ahead = rays.directions[0]
    middle = points.mean(axis=0)
    diagonal = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    across = np.cross(ahead, random.normal(size=3))
    x = across / np.linalg.norm(across)
    facing = np.stack([x, np.cross(ahead, x), ahead], axis=1)  # Z points away from the viewer
    tilt = random.normal(size=3)
    rotation = rotation_of(random.uniform(0, MOST_TILT) * tilt / np.linalg.norm(tilt)) @ facing
    place = rays.origins[0] + random.uniform(*DISTANCES) * diagonal * ahead
    return np.asarray((points - middle) @ rotation.T + place)
