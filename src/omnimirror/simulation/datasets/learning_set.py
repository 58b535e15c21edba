"""Training datasets as WebDataset shards: tar files with a common name for the files of each
sample.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...base.arguments import checked, file_name, whole
from ...base.errors import InvalidParameter
from ...base.escaping import markdown_text, yaml_string
from ...base.files import replacing, write_text
from ...cameras.camera import Camera
from ...io.keyframes import Keyframes
from ...io.pictures.images import encoded
from ...optics.sensor_files import AnyCamera, save_camera
from ..detector import Detector
from ..radiometry import Radiometry
from ..rendering.exposure import expose
from ..scenes.contract import Scene
from ..scenes.posed import Pose
from ..scenes.worlds.bodies import MovingBox, SceneWithBodies
from .frame_truth import LearningTruth, Moment, learning_truth
from .video import frame_times

CARD = "README.md"


@checked
def write_learning_set(
    camera: AnyCamera,
    scene: Scene,
    *,
    path: Keyframes,
    folder: str | Path,
    bodies: Sequence[MovingBox] = (),
    frame_rate: float = 25.0,
    duration_s: float | None = None,
    samples: int = 4,
    blur: bool = False,
    radiometry: Radiometry | None = None,
    detector: Detector | None = None,
    seed: int = 0,
    per_shard: int = 100,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write images of a camera moving through a scene with depth, directions, normals, labels and
    optical flow.

    Parameters
    ----------
    camera
        Sensor, or a calibrated camera.
    scene
        Scene, such as :class:`omnimirror.Room`, which labels walls and furniture; others have a
        single label.
    path
        Path returned by :func:`omnimirror.load_path`.
    folder
        Output folder for ``set-000000.tar``, ..., ``sensor.toml`` and the dataset card,
        ``README.md``.
    bodies
        Moving bodies, such as :class:`omnimirror.MovingBox`.
    frame_rate
        Frames per second.
    duration_s
        Duration, s; up to the last pose by default.
    samples, blur, radiometry, detector, seed
        Rendering parameters, as in :func:`omnimirror.write_video`.
    per_shard
        Number of samples per tar file.
    progress
        Callback with the number of finished frames and the total.

    Returns
    -------
    list of Path
        Paths of the shards.

    Raises
    ------
    InvalidParameter
        If a number is out of range, or the folder contains a dataset.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> camera = om.Unified(0.9, (20.0, 20.0), (15.5, 15.5), (32, 32))
    >>> from omnimirror.io.keyframes import Keyframes
    >>> moves = Keyframes({"x_mm": ((0.0, 0.0), (0.04, 100.0))})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     shards = om.write_learning_set(camera, om.Room(texel_mm=40.0), path=moves, folder=folder, samples=1)
    ...     [shard.name for shard in shards]
    ['set-000000.tar']
    """
    folder, per_shard = file_name("folder", folder), whole("per_shard", per_shard, 1, 1_000_000)
    times = frame_times(path, frame_rate, duration_s)
    if (folder / CARD).exists():
        raise InvalidParameter(f"{folder} holds a set already; remove {folder / CARD} or take another folder")
    reading, moving = detector or Detector(), tuple(bodies)

    def moment(time: float) -> Moment:
        return Moment(SceneWithBodies(scene, moving, time), Pose(**path.at(time)))

    def sample(number: int) -> dict[str, bytes]:
        now, following = moment(times[number]), moment(times[min(number + 1, len(times) - 1)])
        light = expose(camera, now.seen, samples=samples, blur=blur, radiometry=radiometry, seed=seed + number)
        picture = encoded(reading.read(light, seed + number), ".png")
        found = learning_truth(camera, now, following, radiometry)
        if progress is not None:
            progress(number + 1, len(times))
        return {"png": picture, "npz": _arrays(found), "json": _record(now, times[number], number + 1 == len(times))}

    shards = []
    for number, first in enumerate(range(0, len(times), per_shard)):
        shards.append(folder / f"set-{number:06d}.tar")
        _write_shard(shards[-1], ((i, sample(i)) for i in range(first, min(first + per_shard, len(times)))))
    save_camera(camera, folder / "sensor.toml")
    write_text(folder / CARD, _card(camera, moment(times[0]).scene, len(times), frame_rate, [s.name for s in shards]))
    return shards


def _write_shard(path: Path, samples: Iterable[tuple[int, dict[str, bytes]]]) -> None:
    """Write a tar file that is reproducible byte by byte."""
    with replacing(path) as temporary, tarfile.open(temporary, "w", format=tarfile.USTAR_FORMAT) as shard:
        for number, files in samples:
            for ending, content in files.items():
                entry = tarfile.TarInfo(f"{number:06d}.{ending}")
                entry.size = len(content)
                shard.addfile(entry, io.BytesIO(content))


def _arrays(found: LearningTruth) -> bytes:
    truth, into = found.truth, io.BytesIO()
    np.savez_compressed(
        into,
        depth_mm=truth.depth_mm.astype(np.float32),
        directions=truth.directions.astype(np.float32),
        origins_mm=truth.origins_mm.astype(np.float32),
        normals=found.normals.astype(np.float32),
        flow_px=found.flow_px.astype(np.float32),
        labels=found.labels,
        seen_again=found.seen_again,
        hidden=truth.hidden,
    )
    return into.getvalue()


def _record(now: Moment, time_s: float, is_last: bool) -> bytes:
    bodies = {box.name: asdict(box.pose_at(time_s)) for box in now.scene.bodies}
    record = {"time_s": time_s, "pose": asdict(now.pose), "bodies": bodies, "is_last": is_last}
    return json.dumps(record).encode()


def _card(camera: Camera, scene: SceneWithBodies, count: int, frame_rate: float, shards: Sequence[str]) -> str:
    width, height = camera.image_size
    name: Any = getattr(camera, "name", "camera")
    labels = "\n".join(f"| {i} | {markdown_text(label)} |" for i, label in enumerate(("nothing", *scene.label_names)))
    return f"""---
pretty_name: {yaml_string(f"simulated pictures of {name}")}
task_categories: [depth-estimation, image-segmentation]
tags: [synthetic, catadioptric, omnidirectional, optical-flow, webdataset]
---

# Simulated pictures of {markdown_text(name)}

{count} frames of {width} x {height} px, {frame_rate:g} a second, by omnimirror {__version__}, in {len(shards)} shards
({shards[0]} to {shards[-1]}). All of it is synthetic. `sensor.toml` is the camera.

| file of a sample | holds |
|---|---|
| `.png` | the picture, sRGB |
| `.npz` | arrays (rows, columns, ..) for the chief ray of each pixel's centre; NaN where it sees nothing of the scene |
| `.json` | `time_s`; `pose` of the sensor and of `bodies` in the scene (mm, deg); `is_last`: nothing follows it |

| array | holds |
|---|---|
| `depth_mm` | along the ray, from its origin; infinite for what is infinitely far |
| `origins_mm`, `directions` | of the ray, in the sensor's frame: x forward, y left, z up, from the mirror's vertex |
| `normals` | of what is seen, towards the sensor, in that frame |
| `labels` | what is seen |
| `flow_px` | from the pixel to where the same appears in the next frame, right and down; NaN if out of its field |
| `seen_again` | whether nothing stands before it there |
| `hidden` | whether a part of the sensor is what the pixel sees |

| label | |
|---|---|
{labels}
"""
