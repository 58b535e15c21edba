"""Sets of pictures that are ready to use: of known boards with true corners, and videos with poses and depth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked, whole
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.files import replacing, write_text
from ...io import read_image, write_image
from ...io.keyframes import Keyframes
from ...io.pictures.exr import check_exr_can_be_written
from ...optics.sensor_files import AnyCamera, save_camera
from ..detector import Detector
from ..radiometry import Radiometry
from ..rendering.exposure import expose
from ..rendering.sight import seen_at, sights
from ..scenes.contract import Scene, distances_mm
from ..scenes.posed import POSE_NAMES, Pose, PosedScene
from ..scenes.sources import SceneSource
from ..scenes.worlds.boards import SQUARE_MM
from ..scenes.worlds.bodies import MovingBox, with_bodies
from ..scenes.worlds.hall import Hall
from .ledger import DESCRIPTION, FRAMES, Ledger
from .recipe import CalibrationRecipe, Recipe, VideoRecipe, format_of, record_of_recipe
from .truth import ground_truth
from .video import check_video_can_be_written, encode, frame_at, frame_times

Array = NDArray[np.float64]

FRAME = f"{FRAMES}/frame-%05d.png"
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
    chance = np.random.default_rng(whole("seed", seed))
    places = REACH_MM * chance.uniform(-1, 1, (count - 1, 3))
    turns = np.array([180.0, LEAN_DEG, LEAN_DEG]) * chance.uniform(-1, 1, (count - 1, 3))
    return [Pose(), *(Pose(*map(float, np.round(row, 3))) for row in np.concatenate([places, turns], axis=1))]


def seen_corners_px(sensor: AnyCamera, hall: Hall, pose: Pose) -> dict[str, Array]:
    """True pixels (7, 11, 2) of each board's corners, by the true reflection; NaN where a corner is not in view.

    In view is what its pixel's chief ray meets: past camera, rod and rim, through the wall of a tube or a dome.
    """
    scene, found = PosedScene(hall, pose), {}
    for name in hall.boards:
        corners = pose.to_sensor(hall.board_corners_mm(name).reshape(-1, 3))
        pixels, valid = seen_at(sensor, corners)
        origins = sights(sensor, pixels[valid]).origins
        ways = corners[valid] - origins
        met = distances_mm(scene, origins, ways)
        pixels[np.flatnonzero(valid)[met < np.linalg.norm(ways, axis=1) - SAME_MM]] = np.nan
        found[name] = pixels.reshape(7, 11, 2)
    return found


@checked
def write_calibration_set(
    sensor: AnyCamera,
    folder: str | Path,
    *,
    views: int = 12,
    samples: int = 16,
    blur: bool | None = None,
    radiometry: Radiometry | None = None,
    detector: Detector | None = None,
    seed: int = 0,
    hall: Hall | None = None,
    truth: bool = False,
) -> Iterator[Path]:
    """Write pictures of the calibration hall one after the other, and ``dataset.json``, which describes them.

    A set that was ended, however that happened, goes on where it stopped when it is written again: what is there and
    has not changed is kept.

    Parameters
    ----------
    sensor
        Or a calibrated camera.
    folder
        Takes ``sensor.toml`` (the camera's file), ``view-000.png``, .. and ``dataset.json``, which says how the set is
        made, and what of it is there.
    views
        How many.
    samples, blur, radiometry, detector, seed, hall
        Of the pictures; the seed is of the poses, too. A sensor's pictures are blurred unless it is said; nothing
        is known of a calibrated camera's aperture.
    truth
        Also write ``view-000.exr``, ..: light, depth, direction and origin of every pixel.

    Returns
    -------
    Iterator
        Path of each picture as it is written, and of ``dataset.json``.

    Raises
    ------
    InvalidParameter
        As :func:`view_poses` and :func:`~omnimirror.expose`; or the folder holds another set.
    MediaError
        OpenEXR is not installed, which truth needs.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = om.write_calibration_set(small, folder, views=1, samples=1, blur=False)
    ...     [path.name for path in written]
    ['view-000.png', 'dataset.json']
    """
    return take_pictures(
        CalibrationRecipe(
            sensor=sensor, views=views, samples=samples, blur=blur, radiometry=radiometry,
            detector=detector or Detector(), seed=seed, hall=hall or Hall(), truth=truth,
        ),
        Path(folder),
    )  # fmt: skip


def take_pictures(recipe: CalibrationRecipe, folder: Path) -> Iterator[Path]:
    """Write the set of a recipe, as :func:`write_calibration_set` does."""
    sensor, hall, radiometry, seed = recipe.sensor, recipe.hall, recipe.radiometry, recipe.seed
    poses = view_poses(recipe.views, seed)
    ledger = _begin(folder, recipe, {
        "square_mm": SQUARE_MM,
        "boards_mm": {name: hall.board_corners_mm(name).round(6).tolist() for name in hall.boards},
    })  # fmt: skip
    records = {view["image"]: view for view in ledger.entries.get("views", []) if ledger.has(view["image"])}
    with _to_its_end(ledger):
        for number, pose in enumerate(poses):
            name = f"view-{number:03d}"
            files = [f"{name}.png"] + [f"{name}.exr"] * recipe.truth
            if not (files[0] in records and ledger.has(*files)):
                scene = PosedScene(hall, pose)
                light = expose(
                    sensor,
                    scene,
                    samples=recipe.samples,
                    blur=bool(recipe.blur),
                    radiometry=radiometry,
                    seed=seed + number,
                )
                if recipe.truth:
                    write_truth(folder / files[1], sensor, scene, light, radiometry)
                write_image(folder / files[0], recipe.detector.read(light, seed + number))
                corners = _lists(seen_corners_px(sensor, hall, pose))
                record = {"image": files[0], "pose": asdict(pose), "corners_px": corners}
                records[files[0]] = record | ({"truth": files[1]} if recipe.truth else {})
                ledger.entries["views"] = [records[name] for name in sorted(records, key=lambda n: (len(n), n))]
                ledger.add(*files)
            yield folder / files[0]
    ledger.finish(complete=True)
    yield folder / DESCRIPTION


@checked
def write_video_set(
    sensor: AnyCamera,
    scene: Scene | SceneSource,
    *,
    path: Keyframes,
    folder: str | Path,
    bodies: Sequence[MovingBox] = (),
    frame_rate: float = 25.0,
    duration_s: float | None = None,
    samples: int = 16,
    blur: bool | None = None,
    radiometry: Radiometry | None = None,
    detector: Detector | None = None,
    seed: int = 0,
    truth: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the video of a sensor that moves through a scene, its poses, and what each pixel sees; count its frames.

    Until all are done each frame is kept as a picture in ``frames``, and a set that was ended, however that happened,
    goes on from there when it is written again.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives, or a calibrated camera.
    scene
        Of a :class:`SceneSource`, or one of the project, ``dataset.json`` says how it is had again.
    path
        From :func:`omnimirror.load_path`.
    folder
        Takes ``sensor.toml``, ``video.mp4``, ``poses.csv`` (one row a frame, as :func:`load_path` reads them) and
        ``dataset.json``. Stopped by Ctrl-C, they hold the frames that are there.
    bodies
        What moves in the scene, such as :class:`omnimirror.MovingBox`, or what :func:`omnimirror.load_bodies` gives.
    frame_rate
        Frames a second.
    duration_s
        How long, s; to the last pose by default.
    samples
        Rays per pixel.
    blur
        Whether the lens's whole aperture blurs what is out of focus; that of a sensor does by default.
    radiometry
        What the mirror reflects and the lens lets pass, and how the housing looks.
    detector
        The imager's electronics; without noise by default.
    seed
        Of everything drawn at random.
    truth
        Also write ``frame-00000.exr``, ..: light, depth, direction and origin of every pixel.
    progress
        Called with the number of frames done, and of all.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    InvalidParameter, MediaError
        As :func:`~omnimirror.simulation.datasets.video.write_video`; or the folder holds another set.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/path.csv", "w") as file:
    ...         _ = file.write("time_s,x_mm\\n0,0\\n0.04,100\\n")
    ...     om.write_video_set(
    ...         small, om.Room(texel_mm=40.0), path=om.load_path(f"{folder}/path.csv"), folder=f"{folder}/set",
    ...         samples=1, blur=False)
    2
    """
    recipe = VideoRecipe(
        sensor=sensor, scene=scene, path=path, bodies=tuple(bodies), frame_rate=frame_rate, duration_s=duration_s,
        samples=samples, blur=blur, radiometry=radiometry, detector=detector or Detector(), seed=seed, truth=truth,
    )  # fmt: skip
    return take_frames(recipe, Path(folder), progress)


def take_frames(recipe: VideoRecipe, folder: Path, progress: Callable[[int, int], None] | None = None) -> int:
    """Write the set of a recipe, as :func:`write_video_set` does; count its frames."""
    sensor, scene, path, truth = recipe.sensor, recipe.scene, recipe.path, recipe.truth
    times = frame_times(path, recipe.frame_rate, recipe.duration_s)
    check_video_can_be_written(folder / "video.mp4")
    world = scene.load() if isinstance(scene, SceneSource) else scene
    described: dict[str, Any] = {"video": "video.mp4", "poses": "poses.csv", "frame_rate": recipe.frame_rate}
    ledger = _begin(folder, recipe, described | ({"truth": "frame-%05d.exr"} if truth else {}))
    if ledger.is_complete:
        return len(times)
    done = 0

    def expose_frame(number: int, picture: str, exr: str) -> None:
        time, radiometry, seed = times[number], recipe.radiometry, recipe.seed + number
        seen = with_bodies(world, recipe.bodies, time)
        light = frame_at(sensor, seen, path, time, recipe.samples, bool(recipe.blur), radiometry, seed)
        if truth:
            write_truth(folder / exr, sensor, PosedScene(seen, Pose(**path.at(time))), light, radiometry)
        write_image(folder / picture, recipe.detector.read(light, seed))
        ledger.add(picture, *([exr] if truth else []))

    try:
        with _to_its_end(ledger):
            for number in range(len(times)):
                picture, exr = FRAME % number, f"frame-{number:05d}.exr"
                if not ledger.has(picture, *([exr] if truth else [])):
                    expose_frame(number, picture, exr)
                done = number + 1
                if progress is not None:
                    progress(done, len(times))
    except KeyboardInterrupt:
        if done:
            _join(ledger, sensor, path, times[:done], recipe.frame_rate)
            ledger.write()
        raise
    _join(ledger, sensor, path, times, recipe.frame_rate)
    ledger.is_complete = True
    ledger.drop([FRAME % number for number in range(len(times))])
    (folder / FRAMES).rmdir()
    return len(times)


def _join(ledger: Ledger, sensor: AnyCamera, path: Keyframes, times: list[float], frame_rate: float) -> None:
    """Write the video of the frames that are there, and their poses."""
    rows = [",".join(["time_s", *POSE_NAMES])]
    rows += [",".join(f"{v:.9g}" for v in (time, *asdict(Pose(**path.at(time))).values())) for time in times]
    write_text(ledger.folder / "poses.csv", "\n".join(rows) + "\n")
    pictures = (read_image(ledger.folder / (FRAME % number)) for number in range(len(times)))
    encode(ledger.folder / "video.mp4", sensor.image_size, frame_rate, pictures)
    ledger.entries["frames"] = len(times)
    ledger.add("poses.csv", "video.mp4")


def write_truth(
    path: Path, sensor: AnyCamera, scene: Scene, light: Light, radiometry: Radiometry | None = None
) -> None:
    """Write light and :func:`~omnimirror.ground_truth` as an EXR file."""
    from ...io.pictures.exr import write_channels

    truth = ground_truth(sensor, scene, radiometry)
    with replacing(path) as temporary:
        write_channels(temporary, truth.channels(light))


def _begin(folder: Path, recipe: Recipe, described: dict[str, Any]) -> Ledger:
    """What is there of a set, after its sensor and its dataset.json were written."""
    record = record_of_recipe(recipe)
    if recipe.truth:
        check_exr_can_be_written(folder)
    head = {"format": format_of(recipe.KIND), "sensor": "sensor.toml", "recipe": record}
    ledger = Ledger(folder, head | described)
    if not ledger.has("sensor.toml"):
        save_camera(recipe.sensor, folder / "sensor.toml")
        ledger.add("sensor.toml")
    return ledger


@contextmanager
def _to_its_end(ledger: Ledger) -> Iterator[None]:
    """However it ends, dataset.json says what is done, and nothing is left of a set that had only begun."""
    ledger.is_complete = False
    try:
        yield
    except BaseException:
        ledger.end(["sensor.toml"])
        raise


def _lists(corners: dict[str, Array]) -> dict[str, Any]:
    """Corners as JSON holds them, null where there is none; boards of which nothing is seen are left out."""
    return {
        name: [[None if np.isnan(u) else [round(float(u), 4), round(float(v), 4)] for u, v in row] for row in pixels]
        for name, pixels in corners.items()
        if np.isfinite(pixels).any()
    }
