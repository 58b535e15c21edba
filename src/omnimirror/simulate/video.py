"""Videos of a sensor that moves through a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np

from ..cameras import Camera
from ..errors import InvalidParameter
from ..media.keyframes import Keyframes
from .colour import Light
from .exposure import expose
from .hardware import Hardware
from .scenes.contract import Scene
from .scenes.placed import Placed, Pose

POSE_NAMES = tuple(f.name for f in fields(Pose))
MOST_FRAMES = 100_000


def load_path(path: str | Path) -> Keyframes:
    """Poses over time, a CSV or TOML file with ``time_s`` and any of ``x_mm``, ``y_mm``, ``z_mm``, ``pan_deg``, ..

    Raises
    ------
    MediaError
        No such file, or an entry that is missing, unknown or wrong.
    """
    return Keyframes.load(path, POSE_NAMES)


def frame_times(path: Keyframes, frame_rate: float, duration_s: float | None = None) -> list[float]:
    """Times (s) of a video's frames, from 0 to the last keyframe if nothing else is asked.

    Raises
    ------
    InvalidParameter
        For a rate or a duration that makes no video.

    Examples
    --------
    >>> frame_times(Keyframes({"x_mm": ((0.0, 0.0), (1.0, 500.0))}), 4.0)
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    if duration_s is None:
        duration_s = max(time for track in path.tracks.values() for time, _ in track)
    count = int(np.floor(duration_s * frame_rate + 1e-9)) + 1 if duration_s >= 0 and frame_rate > 0 else 0
    if not 1 <= count <= MOST_FRAMES:
        raise InvalidParameter(
            f"{duration_s:g} s at {frame_rate:g} frames a second make no video; valid are 1 to {MOST_FRAMES} frames"
        )
    return [i / frame_rate for i in range(count)]


def frame_at(
    camera: Camera,
    scene: Scene,
    path: Keyframes,
    time_s: float,
    samples: int = 4,
    blur: bool = False,
    hardware: Hardware | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Light:
    """Linear light (h, w, 3) of the moment ``time_s``; the sensor stands still while it is exposed.

    Raises
    ------
    InvalidParameter
        As :func:`~omnimirror.simulate.expose`, or if the path leads where a sensor cannot be.
    """
    placed = Placed(scene, Pose(**path.at(time_s)))
    return expose(camera, placed, samples, blur, hardware=hardware, seed=seed, progress=progress)
