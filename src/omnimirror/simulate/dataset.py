"""Calibration sets that are ready to use: pictures of known boards, with poses and true corners."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..files import write_text
from ..media import write_image
from ..sensor import Sensor
from ..specs import save_sensor
from .detector import Detector
from .exposure import expose
from .hardware import Hardware
from .scenes.boards import SQUARE_MM
from .scenes.contract import distances_mm
from .scenes.hall import Hall
from .scenes.placed import Placed, Pose

Array = NDArray[np.float64]

MOST_VIEWS = 10_000
REACH_MM = np.array([700.0, 700.0, 350.0])
"""How far from the hall's middle views are taken: boards stay at least twice as far."""
LEAN_DEG = 12.0
SAME_MM = 2.0  # a corner that is met, and not something before it


def view_poses(count: int, seed: int = 0) -> list[Pose]:
    """Poses in the hall: the first in its middle and upright, the others spread about it.

    Raises
    ------
    InvalidParameter
        For a number that makes no set.

    Examples
    --------
    >>> view_poses(2)[0]
    Pose(x_mm=0.0, y_mm=0.0, z_mm=0.0, pan_deg=0.0, tilt_deg=0.0, roll_deg=0.0)
    """
    if not 1 <= count <= MOST_VIEWS:
        raise InvalidParameter(f"views = {count} is outside 1 to {MOST_VIEWS}")
    chance = np.random.default_rng(seed)
    places = REACH_MM * chance.uniform(-1, 1, (count - 1, 3))
    turns = np.array([180.0, LEAN_DEG, LEAN_DEG]) * chance.uniform(-1, 1, (count - 1, 3))
    return [Pose(), *(Pose(*map(float, np.round(row, 3))) for row in np.concatenate([places, turns], axis=1))]


def seen_corners_px(sensor: Sensor, hall: Hall, pose: Pose) -> dict[str, Array]:
    """True pixels (7, 11, 2) of each board's corners, by the true reflection; NaN where a corner is not in view."""
    scene, found = Placed(hall, pose), {}
    for name in hall.boards:
        corners = pose.to_sensor(hall.board_corners_mm(name).reshape(-1, 3))
        pixels, valid = sensor.project(corners)
        origins = sensor.backproject(pixels[valid]).origins
        ways = corners[valid] - origins
        met = distances_mm(scene, origins, ways)
        pixels[~valid] = np.nan
        pixels[np.flatnonzero(valid)[met < np.linalg.norm(ways, axis=1) - SAME_MM]] = np.nan
        found[name] = pixels.reshape(7, 11, 2)
    return found


def write_calibration_set(
    sensor: Sensor,
    folder: str | Path,
    views: int = 12,
    samples: int = 16,
    blur: bool = True,
    hardware: Hardware | None = None,
    detector: Detector | None = None,
    seed: int = 0,
    hall: Hall | None = None,
) -> Iterator[Path]:
    """Write pictures of the calibration hall one after the other, and then ``dataset.json``, which describes them.

    Parameters
    ----------
    sensor
    folder
        Takes ``sensor.toml``, ``view-000.png``, .. and ``dataset.json``, which is written last.
    views
        How many.
    samples, blur, hardware, detector, seed, hall
        Of the pictures; the seed is of the poses, too.

    Yields
    ------
    Path of each file.

    Raises
    ------
    InvalidParameter
        As :func:`view_poses` and :func:`~omnimirror.simulate.expose`.
    """
    folder, hall, detector = Path(folder), hall or Hall(), detector or Detector()
    poses = view_poses(views, seed)
    save_sensor(sensor, folder / "sensor.toml")
    records = []
    for number, pose in enumerate(poses):
        path = folder / f"view-{number:03d}.png"
        light = expose(sensor, Placed(hall, pose), samples, blur, hardware=hardware, seed=seed + number)
        picture = detector.read(light, seed + number)
        write_image(path, picture if picture.ndim == 2 else np.ascontiguousarray(picture[..., ::-1]))
        corners = seen_corners_px(sensor, hall, pose)
        records.append({"image": path.name, "pose": asdict(pose), "corners_px": _lists(corners)})
        yield path
    described = {
        "format": "omnimirror calibration set 1",
        "sensor": "sensor.toml",
        "samples": samples,
        "blur": blur,
        "detector": {k: (None if v == np.inf else v) for k, v in asdict(detector).items()},
        "square_mm": SQUARE_MM,
        "boards_mm": {name: hall.board_corners_mm(name).round(6).tolist() for name in hall.boards},
        "views": records,
    }
    write_text(folder / "dataset.json", json.dumps(described) + "\n")
    yield folder / "dataset.json"


def _lists(corners: dict[str, Array]) -> dict[str, Any]:
    """Corners as JSON holds them, null where there is none; boards of which nothing is seen are left out."""
    return {
        name: [[None if np.isnan(u) else [round(float(u), 4), round(float(v), 4)] for u, v in row] for row in pixels]
        for name, pixels in corners.items()
        if np.isfinite(pixels).any()
    }
