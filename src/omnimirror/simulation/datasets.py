"""Image datasets with ground truth: calibration images, videos and training shards."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from .. import __version__
from ..base import interrupts
from ..base.arguments import file_name, integer, validate_arguments
from ..base.block_runner import is_stopping, run_blocks, workers_in_threads
from ..base.colour import Light
from ..base.errors import InvalidParameter
from ..base.escaping import markdown_text, yaml_string
from ..base.files import atomic_output, write_text
from ..base.typing import Array
from ..io import read_image, write_image
from ..io.batch import Job
from ..io.exr import check_exr_can_be_written
from ..io.images import encoded
from ..optics.camera_files import AnyCamera, save_camera
from .dataset_manifest import (
    FRAMES,
    CalibrationRecipe,
    Manifest,
    Recipe,
    VideoRecipe,
    format_of,
    recipe_record,
)
from .ground_truth_maps import Moment, TrainingGroundTruth, ground_truth, training_ground_truth
from .pixel_rays import project_visible, trace_pixels
from .radiometry import Radiometry
from .rendering import expose
from .scenes.calibration_hall import SQUARE_MM, Hall
from .scenes.moving_objects import SceneWithBodies
from .scenes.scene import POSE_NAMES, Pose, PosedScene, Scene, distances_mm
from .simulated_video import ImageSequence, check_video_can_be_written, encode

# -- Calibration datasets and videos with ground truth ---------------------------------------------

FRAME_PATTERN = f"{FRAMES}/frame-%05d.png"
MAX_VIEWS = 10_000
POSITION_RANGE_MM = np.array([700.0, 700.0, 350.0])
"""Maximum distance of viewpoints from the centre of the hall: boards are at least twice as far."""
MAX_TILT_DEG = 12.0
VISIBILITY_TOLERANCE_MM = 2.0  # tolerance for a visible corner rather than an object in front of it


def view_poses(count: int, seed: int = 0) -> list[Pose]:
    """Return poses in the hall: the first upright at its centre, the others distributed about it.

    Raises
    ------
    InvalidParameter
        If the number is not a valid number of images.

    Examples
    --------
    >>> view_poses(2)[0]
    Pose(x_mm=0.0, y_mm=0.0, z_mm=0.0, pan_deg=0.0, tilt_deg=0.0, roll_deg=0.0)
    """
    if not 1 <= count <= MAX_VIEWS:
        raise InvalidParameter(f"views must be between 1 and {MAX_VIEWS}; got {count}")
    rng = np.random.default_rng(integer("seed", seed))
    positions = POSITION_RANGE_MM * rng.uniform(-1, 1, (count - 1, 3))
    rotations = np.array([180.0, MAX_TILT_DEG, MAX_TILT_DEG]) * rng.uniform(-1, 1, (count - 1, 3))
    return [
        Pose(),
        *(
            Pose(*map(float, np.round(row, 3)))
            for row in np.concatenate([positions, rotations], axis=1)
        ),
    ]


def visible_corners_px(sensor: AnyCamera, hall: Hall, pose: Pose) -> dict[str, Array]:
    """Return true pixels (7, 11, 2) of the corners of each board by true reflection; NaN for
    invisible corners.

    A corner is visible if the chief ray of its pixel meets it: past camera, rod and rim, through
    the wall of a tube or a dome.
    """
    scene, corners_px = PosedScene(hall, pose), {}
    for name in hall.boards:
        corners = pose.to_sensor(hall.board_corners_mm(name).reshape(-1, 3))
        pixels, valid = project_visible(sensor, corners)
        origins = trace_pixels(sensor, pixels[valid]).origins
        vectors = corners[valid] - origins
        distances = distances_mm(scene, origins, vectors)
        pixels[
            np.flatnonzero(valid)[
                distances < np.linalg.norm(vectors, axis=1) - VISIBILITY_TOLERANCE_MM
            ]
        ] = np.nan
        corners_px[name] = pixels.reshape(7, 11, 2)
    return corners_px


@validate_arguments
def write_calibration_dataset(
    recipe: CalibrationRecipe,
    folder: str | Path,
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write images of the calibration hall, and ``dataset.json``, which describes them; return the
    number of images.

    An interrupted dataset is resumed when it is written again; unchanged files are kept.

    Parameters
    ----------
    recipe
        Camera, views and rendering parameters.
    folder
        Output folder for ``sensor.toml`` (the camera file), ``view-000.png``, ... and
        ``dataset.json``, which contains the recipe of the dataset and its completed files; with
        ground truth also for ``view-000.exr``, ...
    on_progress
        Callback with the number of finished images and the total.

    Returns
    -------
    int
        Number of images.

    Raises
    ------
    InvalidParameter
        As in :func:`view_poses` and :func:`~omnimirror.expose`; or if the folder contains another
        dataset.
    MediaError
        If OpenEXR, which ground truth requires, is not installed.

    Examples
    --------
    >>> import omnimirror as om, os, tempfile
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
    >>> recipe = om.CalibrationRecipe(sensor=small, views=1, samples=1, blur=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_calibration_dataset(recipe, folder), sorted(os.listdir(folder))
    (1, ['dataset.json', 'sensor.toml', 'view-000.png'])
    """
    folder = Path(folder)
    sensor, hall, radiometry, seed = recipe.sensor, recipe.hall, recipe.radiometry, recipe.seed
    poses = view_poses(recipe.views, seed)
    manifest = _open_manifest(
        folder,
        recipe,
        {
            "square_mm": SQUARE_MM,
            "boards_mm": {
                name: hall.board_corners_mm(name).round(6).tolist() for name in hall.boards
            },
        },
    )
    names = [f"view-{number:03d}" for number in range(len(poses))]
    files = [[f"{name}.png"] + [f"{name}.exr"] * recipe.truth for name in names]
    records = {
        view["image"]: view
        for view in manifest.entries.get("views", [])
        if manifest.has(view["image"])
    }

    def render(number: int) -> dict[str, Any]:
        scene = PosedScene(hall, poses[number])
        light = expose(
            sensor,
            scene,
            samples=recipe.samples,
            blur=bool(recipe.blur),
            radiometry=radiometry,
            seed=seed + number,
            on_progress=_raise_if_stopping,
        )
        image, *truth = files[number]
        for name in truth:
            write_truth(folder / name, sensor, scene, light, radiometry)
        write_image(folder / image, recipe.detector.read(light, seed + number))
        corners = _corner_lists(visible_corners_px(sensor, hall, poses[number]))
        record = {"image": image, "pose": asdict(poses[number]), "corners_px": corners}
        return record | ({"truth": truth[0]} if truth else {})

    def add_record(record: dict[str, Any]) -> None:
        records[record["image"]] = record
        manifest.entries["views"] = [
            records[name] for name in sorted(records, key=lambda n: (len(n), n))
        ]

    missing = [n for n, own in enumerate(files) if own[0] not in records or not manifest.has(*own)]
    _write_images(manifest, files, missing, render, add_record, on_progress)
    manifest.finish(complete=True)
    return len(files)


@validate_arguments
def write_video_dataset(
    recipe: VideoRecipe,
    folder: str | Path,
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the video of a sensor moving through a scene, its poses and ground truth; return the
    number of frames.

    Frames are kept as images in ``frames`` until all are complete. An interrupted dataset is
    resumed when it is written again.

    Parameters
    ----------
    recipe
        Camera, scene, path and rendering parameters.
    folder
        Output folder for ``sensor.toml``, ``video.mp4``, ``poses.csv`` (one row per frame, in the
        format of :func:`load_path`) and ``dataset.json``; with ground truth also for
        ``frame-00000.exr``, ... After Ctrl-C they contain the completed frames.
    on_progress
        Callback with the number of finished frames and the total.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    InvalidParameter, MediaError
        As in :func:`~omnimirror.simulation.simulated_video.write_video`; or if the folder contains
        another dataset.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/path.csv", "w") as file:
    ...         _ = file.write("time_s,x_mm\\n0,0\\n0.04,100\\n")
    ...     path, room = om.load_path(f"{folder}/path.csv"), om.Room(texel_mm=40.0)
    ...     recipe = om.VideoRecipe(sensor=small, scene=room, path=path, samples=1, blur=False)
    ...     om.write_video_dataset(recipe, f"{folder}/set")
    2
    """
    folder = Path(folder)
    check_video_can_be_written(folder / "video.mp4")
    sequence = recipe.sequence()
    count = len(sequence)
    header: dict[str, Any] = {
        "video": "video.mp4",
        "poses": "poses.csv",
        "frame_rate": recipe.frame_rate,
    }
    manifest = _open_manifest(
        folder, recipe, header | ({"truth": "frame-%05d.exr"} if recipe.truth else {})
    )
    if manifest.is_complete:
        return count
    files = [
        [FRAME_PATTERN % number] + [f"frame-{number:05d}.exr"] * recipe.truth
        for number in range(count)
    ]
    completed = 0

    def render(number: int) -> None:
        light = sequence.light(number, on_progress=_raise_if_stopping)
        image, *truth_names = files[number]
        for name in truth_names:
            scene = sequence.posed_scene(number)
            write_truth(folder / name, recipe.sensor, scene, light, recipe.radiometry)
        write_image(folder / image, sequence.image(number, light))

    def report(done: int, total: int) -> None:
        nonlocal completed
        completed = done
        if on_progress is not None:
            on_progress(done, total)

    missing = [number for number, names in enumerate(files) if not manifest.has(*names)]
    try:
        _write_images(manifest, files, missing, render, lambda _: None, report)
    except KeyboardInterrupt:
        if completed:
            _write_video_files(manifest, sequence, completed)
            manifest.write()
        raise
    _write_video_files(manifest, sequence, count)
    manifest.is_complete = True
    manifest.drop([FRAME_PATTERN % number for number in range(count)])
    (folder / FRAMES).rmdir()
    return count


def _write_video_files(manifest: Manifest, sequence: ImageSequence, count: int) -> None:
    """Write the video of the first frames, and their poses."""
    rows = [",".join(["time_s", *POSE_NAMES])]
    rows += [
        ",".join(f"{v:.9g}" for v in (sequence.times_s[n], *asdict(sequence.pose(n)).values()))
        for n in range(count)
    ]
    write_text(manifest.folder / "poses.csv", "\n".join(rows) + "\n")
    images = (read_image(manifest.folder / (FRAME_PATTERN % number)) for number in range(count))
    encode(manifest.folder / "video.mp4", sequence.camera.image_size, sequence.frame_rate, images)
    manifest.entries["frames"] = count
    manifest.add("poses.csv", "video.mp4")


def write_truth(
    path: Path, sensor: AnyCamera, scene: Scene, light: Light, radiometry: Radiometry | None = None
) -> None:
    """Write light and :func:`~omnimirror.ground_truth` to an EXR file."""
    from ..io.exr import write_channels

    truth = ground_truth(sensor, scene, radiometry)
    with atomic_output(path) as temporary:
        write_channels(temporary, truth.channels(light))


def _open_manifest(folder: Path, recipe: Recipe, header: dict[str, Any]) -> Manifest:
    """Return the manifest of existing files after writing the sensor and dataset.json."""
    record = recipe_record(recipe)
    if recipe.truth:
        check_exr_can_be_written(folder)
    head = {"format": format_of(recipe.KIND), "sensor": "sensor.toml", "recipe": record}
    manifest = Manifest(folder, head | header)
    if not manifest.has("sensor.toml"):
        save_camera(recipe.sensor, folder / "sensor.toml")
        manifest.add("sensor.toml")
    return manifest


T = TypeVar("T")


def _write_images(
    manifest: Manifest,
    files: Sequence[Sequence[str]],
    missing: Sequence[int],
    render: Callable[[int], T],
    on_image: Callable[[T], None],
    on_progress: Callable[[int, int], None] | None,
) -> None:
    """Write the missing images of a dataset and record them in their order.

    An image is a block of :func:`omnimirror.base.block_runner.run_blocks`. After an error, files
    of unrecorded images are removed, and a dataset without recorded images entirely.

    Parameters
    ----------
    manifest
        Manifest of the dataset.
    files
        Names of the files of each image.
    missing
        Numbers of the missing images.
    render
        Function that writes the files of an image by number.
    on_image
        Callback with the result of ``render``, before the image is recorded.
    on_progress
        Callback with the number of finished images and the total.
    """
    manifest.is_complete = False
    blocks = (Job(f"image {n}", partial(render, n), n) for n in missing)
    unrecorded = set(missing)
    try:
        with closing(_in_order(blocks, 1)) as rendered:
            for number, names in enumerate(files):
                if number in unrecorded:
                    on_image(next(rendered)[1])
                    manifest.add(*names)
                    unrecorded.remove(number)
                if on_progress is not None:
                    on_progress(number + 1, len(files))
    except BaseException:
        for number in unrecorded:
            for name in files[number]:
                (manifest.folder / name).unlink(missing_ok=True)
        manifest.end(["sensor.toml"])
        raise


def _corner_lists(corners: dict[str, Array]) -> dict[str, Any]:
    """Convert corners to JSON with null for missing ones; invisible boards are omitted."""
    return {
        name: [
            [None if np.isnan(u) else [round(float(u), 4), round(float(v), 4)] for u, v in row]
            for row in pixels
        ]
        for name, pixels in corners.items()
        if np.isfinite(pixels).any()
    }


# -- Training datasets: WebDataset shards ----------------------------------------------------------

CARD_NAME = "README.md"
MAX_WORKERS = 256


@validate_arguments
def write_training_dataset(
    sequence: ImageSequence,
    folder: str | Path,
    *,
    per_shard: int = 100,
    workers: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write an image sequence with depth, directions, normals, labels and optical flow.

    Parameters
    ----------
    sequence
        Camera, scene, path and rendering parameters. A scene such as :class:`omnimirror.Room` labels
        walls and furniture; others have a single label.
    folder
        Output folder for ``set-000000.tar``, ..., ``sensor.toml`` and the dataset card,
        ``README.md``.
    per_shard
        Number of samples per tar file.
    workers
        Number of frames rendered at a time, each with threads on all cores; without effect on the
        files. Memory increases in proportion.
    on_progress
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
    >>> camera = om.Unified(
    ...     xi=0.9, focal_px=(20.0, 20.0), centre_px=(15.5, 15.5), image_size=(32, 32)
    ... )
    >>> from omnimirror.io.keyframes import Keyframes
    >>> path = Keyframes({"x_mm": ((0.0, 0.0), (0.04, 100.0))})
    >>> sequence = om.ImageSequence(camera, om.Room(texel_mm=40.0), path, samples=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     shards = om.write_training_dataset(sequence, folder)
    ...     [shard.name for shard in shards]
    ['set-000000.tar']
    """
    folder, per_shard = file_name("folder", folder), integer("per_shard", per_shard, 1, 1_000_000)
    workers = integer("workers", workers, 1, MAX_WORKERS)
    dataset, count = TrainingSamples(sequence), len(sequence)
    if (folder / CARD_NAME).exists():
        raise InvalidParameter(
            f"folder must not contain a dataset; remove {folder / CARD_NAME} or choose another folder"
        )

    def samples_in_order() -> Generator[tuple[str, dict[str, bytes]], None, None]:
        frames = (Job(f"frame {n}", partial(dataset.files, n), n) for n in range(count))
        for number, files in _in_order(frames, workers):
            yield f"{number:06d}", files
            if on_progress is not None:
                on_progress(number + 1, count)

    shards = []
    with closing(samples_in_order()) as rendered:
        for number in range(-(-count // per_shard)):
            shards.append(folder / f"set-{number:06d}.tar")
            with atomic_output(shards[-1]) as temporary, temporary.open("wb") as file:
                write_samples(file, islice(rendered, per_shard))
    save_camera(sequence.camera, folder / "sensor.toml")
    write_text(folder / CARD_NAME, _dataset_card(dataset, [shard.name for shard in shards]))
    return shards


def _in_order(frames: Iterable[Job], workers: int) -> Generator[tuple[int, Any], None, None]:
    """Yield number and result of each frame in their order, from threads."""
    with (
        workers_in_threads(workers) as threads,
        closing(run_blocks(frames, threads, is_in_order=True)) as outcomes,
    ):
        for outcome in outcomes:
            yield outcome.block.number, outcome.value()
        if interrupts.is_pending():  # the caller defers signals
            raise KeyboardInterrupt


def _raise_if_stopping(*_: int) -> None:
    if is_stopping():
        raise KeyboardInterrupt


@dataclass(frozen=True)
class TrainingSamples:
    """Samples of a training dataset, each a pure function of its number."""

    sequence: ImageSequence

    def moment(self, number: int) -> Moment:
        """Return scene and pose of a frame; those of the last frame beyond the end."""
        number = min(number, len(self.sequence) - 1)
        time_s = self.sequence.times_s[number]
        scene = SceneWithBodies(self.sequence.scene, tuple(self.sequence.bodies), time_s)
        return Moment(scene, self.sequence.pose(number))

    def files(self, number: int) -> dict[str, bytes]:
        """Render a sample; return the contents of its files by suffix.

        Returns
        -------
        dict
            ``"png"``, ``"npz"`` and ``"json"`` as described in the dataset card.
        """
        sequence, now, following = self.sequence, self.moment(number), self.moment(number + 1)
        image = encoded(sequence.image(number, on_progress=_raise_if_stopping), ".png")
        truth_maps = training_ground_truth(sequence.camera, now, following, sequence.radiometry)
        is_last = number + 1 == len(sequence)
        return {
            "png": image,
            "npz": _arrays(truth_maps),
            "json": _record(now, sequence.times_s[number], is_last),
        }


def write_samples(file: BinaryIO, samples: Iterable[tuple[str, dict[str, bytes]]]) -> None:
    """Write a WebDataset shard, reproducible byte by byte: files by suffix, with the key of their
    sample as name.
    """
    with tarfile.open(fileobj=file, mode="w", format=tarfile.GNU_FORMAT) as shard:
        for key, files in samples:
            for ending, content in files.items():
                entry = tarfile.TarInfo(f"{key}.{ending}")
                entry.size = len(content)
                shard.addfile(entry, io.BytesIO(content))


def _arrays(truth_maps: TrainingGroundTruth) -> bytes:
    truth, into = truth_maps.truth, io.BytesIO()
    np.savez_compressed(
        into,
        depth_mm=truth.depth_mm.astype(np.float32),
        directions=truth.directions.astype(np.float32),
        origins_mm=truth.origins_mm.astype(np.float32),
        normals=truth_maps.normals.astype(np.float32),
        flow_px=truth_maps.flow_px.astype(np.float32),
        labels=truth_maps.labels,
        visible_again=truth_maps.visible_again,
        hidden=truth.hidden,
    )
    return into.getvalue()


def _record(now: Moment, time_s: float, is_last: bool) -> bytes:
    bodies = {box.name: asdict(box.pose_at(time_s)) for box in now.scene.bodies}
    record = {"time_s": time_s, "pose": asdict(now.pose), "bodies": bodies, "is_last": is_last}
    return json.dumps(record).encode()


def _dataset_card(samples: TrainingSamples, shards: Sequence[str]) -> str:
    sequence, scene = samples.sequence, samples.moment(0).scene
    (width, height), rate, count = sequence.camera.image_size, sequence.frame_rate, len(sequence)
    name: Any = getattr(sequence.camera, "name", "camera")
    labels = "\n".join(
        f"| {i} | {markdown_text(label)} |" for i, label in enumerate(("none", *scene.label_names))
    )
    return f"""---
pretty_name: {yaml_string(f"Simulated images of {name}")}
task_categories: [depth-estimation, image-segmentation]
tags: [synthetic, catadioptric, omnidirectional, optical-flow, webdataset]
---

# Simulated images of {markdown_text(name)}

Synthetic dataset of {count} frames of {width} x {height} px at {rate:g} frames/s in {len(shards)} shards
({shards[0]} to {shards[-1]}), rendered with omnimirror {__version__}. `sensor.toml` contains the camera.

| file of a sample | content |
|---|---|
| `.png` | image, sRGB |
| `.npz` | arrays (rows, columns, ...) for the chief ray of each pixel; NaN for rays that miss the scene |
| `.json` | `time_s`; `pose` of the sensor and of `bodies` in the scene (mm, deg); `is_last`: last frame |

| array | content |
|---|---|
| `depth_mm` | distance along the ray from its origin; infinite for the background |
| `origins_mm`, `directions` | ray in the sensor frame: x forward, y left, z up, origin at the mirror vertex |
| `normals` | surface normal in the sensor frame, towards the sensor |
| `labels` | label of the surface |
| `flow_px` | displacement of the object point to the next frame, right and down; NaN outside the field |
| `visible_again` | True if the object point is visible in the next frame |
| `hidden` | True if the pixel observes a part of the sensor |

| label | name |
|---|---|
{labels}
"""
