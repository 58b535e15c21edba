"""Sets of pictures that are ready to use: of known boards with true corners, and videos with poses and depth."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..files import replacing, write_text
from ..media import write_image
from ..media.keyframes import Keyframes
from ..sensor import Sensor
from ..specs import save_sensor
from .colour import Light
from .detector import Detector
from .exposure import expose
from .hardware import Hardware
from .scenes.boards import SQUARE_MM
from .scenes.contract import Scene, distances_mm
from .scenes.hall import Hall
from .scenes.placed import Placed, Pose
from .shells import Shell, seen_through
from .sight import seen_at, sights
from .truth import ground_truth
from .video import POSE_NAMES, Frame, write_video

Array = NDArray[np.float64]

DESCRIPTION = "dataset.json"
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


def seen_corners_px(
    sensor: Sensor, hall: Hall, pose: Pose, hardware: Hardware | None = None, shell: Shell | None = None
) -> dict[str, Array]:
    """True pixels (7, 11, 2) of each board's corners, by the true reflection; NaN where a corner is not in view.

    In view is what its pixel's chief ray meets: past camera, rod and rim, through the wall of a tube or a dome.
    """
    scene, found = Placed(hall, pose), {}
    for name in hall.boards:
        corners = pose.to_sensor(hall.board_corners_mm(name).reshape(-1, 3))
        pixels, valid = seen_at(sensor, corners, hardware, shell)
        origins = sights(sensor, pixels[valid], hardware, shell).origins
        ways = corners[valid] - origins
        met = distances_mm(scene, origins, ways)
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
    truth: bool = False,
    shell: Shell | None = None,
) -> Iterator[Path]:
    """Write pictures of the calibration hall one after the other, and then ``dataset.json``, which describes them.

    Parameters
    ----------
    sensor
    folder
        Takes ``sensor.toml``, ``view-000.png``, .. and ``dataset.json``, which is written last. Stopped by Ctrl-C,
        it describes the pictures that are there.
    views
        How many.
    samples, blur, hardware, detector, seed, hall, shell
        Of the pictures; the seed is of the poses, too.
    truth
        Also write ``view-000.exr``, ..: light, depth, direction and origin of every pixel.

    Yields
    ------
    Path of each picture, and of ``dataset.json``.

    Raises
    ------
    InvalidParameter
        As :func:`view_poses` and :func:`~omnimirror.simulate.expose`.
    """
    folder, hall, detector = Path(folder), hall or Hall(), detector or Detector()
    poses = view_poses(views, seed)
    described = _begin(folder, sensor, "calibration", samples, blur, detector) | {
        "square_mm": SQUARE_MM,
        "boards_mm": {name: hall.board_corners_mm(name).round(6).tolist() for name in hall.boards},
        "views": [],
    }
    try:
        for number, pose in enumerate(poses):
            path = folder / f"view-{number:03d}.png"
            scene = seen_through(sensor, Placed(hall, pose), shell)
            light = expose(sensor, scene, samples, blur, hardware=hardware, seed=seed + number)
            picture = detector.read(light, seed + number)
            record: dict[str, Any] = {"image": path.name, "pose": asdict(pose)}
            if truth:
                record["truth"] = path.with_suffix(".exr").name
                write_truth(folder / record["truth"], sensor, scene, light, hardware)
            write_image(path, picture)
            corners = seen_corners_px(sensor, hall, pose, hardware, shell)
            described["views"].append(record | {"corners_px": _lists(corners)})
            yield path
    except (KeyboardInterrupt, GeneratorExit):
        if described["views"]:
            _finish(folder, described)
        raise
    _finish(folder, described)
    yield folder / DESCRIPTION


def write_video_set(
    sensor: Sensor,
    scene: Scene,
    path: Keyframes,
    folder: str | Path,
    frame_rate: float = 25.0,
    duration_s: float | None = None,
    samples: int = 16,
    blur: bool = True,
    hardware: Hardware | None = None,
    detector: Detector | None = None,
    seed: int = 0,
    truth: bool = False,
    progress: Callable[[int, int], None] | None = None,
    shell: Shell | None = None,
) -> int:
    """Write the video of a sensor that moves through a scene, its poses, and what each pixel sees; count its frames.

    Parameters
    ----------
    folder
        Takes ``sensor.toml``, ``video.mp4``, ``poses.csv`` (one row a frame, as :func:`load_path` reads them) and
        ``dataset.json``, which is written last. Stopped by Ctrl-C, they hold the frames that are there.
    truth
        Also write ``frame-00000.exr``, ..: light, depth, direction and origin of every pixel.
    progress
        Called with the number of frames done, and of all.

    Raises
    ------
    InvalidParameter, MediaError
        As :func:`~omnimirror.simulate.video.write_video`.
    """
    folder, detector = Path(folder), detector or Detector()
    described = _begin(folder, sensor, "video", samples, blur, detector)
    rows = [",".join(["time_s", *POSE_NAMES])]

    def written(frame: Frame, total: int) -> None:
        if truth:
            seen = seen_through(sensor, Placed(scene, frame.pose), shell)
            write_truth(folder / f"frame-{frame.number:05d}.exr", sensor, seen, frame.light, hardware)
        rows.append(",".join(f"{value:.9g}" for value in (frame.time_s, *asdict(frame.pose).values())))
        if progress is not None:
            progress(frame.number + 1, total)

    def finish() -> int:
        frames, files = len(rows) - 1, {"video": "video.mp4", "poses": "poses.csv"}
        write_text(folder / "poses.csv", "\n".join(rows) + "\n")
        if truth:
            files["truth"] = "frame-%05d.exr"
        _finish(folder, described | files | {"frame_rate": frame_rate, "frames": frames})
        return frames

    try:
        write_video(
            sensor, scene, path, folder / "video.mp4", frame_rate, duration_s, samples, blur, hardware, detector, seed,
            written, shell,
        )  # fmt: skip
    except KeyboardInterrupt:
        if len(rows) > 1:
            finish()
        raise
    return finish()


def write_truth(path: Path, sensor: Sensor, scene: Scene, light: Light, hardware: Hardware | None = None) -> None:
    """Write light and :func:`~omnimirror.simulate.ground_truth` as an EXR file."""
    from ..media.exr import write_channels

    truth = ground_truth(sensor, scene, hardware)
    with replacing(path) as temporary:
        write_channels(temporary, truth.channels(light))


def _begin(folder: Path, sensor: Sensor, kind: str, samples: int, blur: bool, detector: Detector) -> dict[str, Any]:
    """Write the sensor, take away what described an earlier set, and say what all sets say."""
    (folder / DESCRIPTION).unlink(missing_ok=True)
    save_sensor(sensor, folder / "sensor.toml")
    return {
        "format": f"omnimirror {kind} set 1",
        "sensor": "sensor.toml",
        "samples": samples,
        "blur": blur,
        "detector": {k: (None if v == np.inf else v) for k, v in asdict(detector).items()},
    }


def _finish(folder: Path, described: dict[str, Any]) -> None:
    write_text(folder / DESCRIPTION, json.dumps(described) + "\n")


def _lists(corners: dict[str, Array]) -> dict[str, Any]:
    """Corners as JSON holds them, null where there is none; boards of which nothing is seen are left out."""
    return {
        name: [[None if np.isnan(u) else [round(float(u), 4), round(float(v), 4)] for u, v in row] for row in pixels]
        for name, pixels in corners.items()
        if np.isfinite(pixels).any()
    }
