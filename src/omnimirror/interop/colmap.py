"""COLMAP projects: images and masks of a camera rig, database, rig file and transforms.json.

The database has the tables of COLMAP 4 (``src/colmap/scene/database_sqlite.cc``); COLMAP creates
those that are missing and adds features and matches.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..base.arguments import file_name, integer, validate_arguments
from ..base.errors import InvalidParameter
from ..base.files import atomic_output, write_text
from ..base.results import Columns, Result, table_of
from ..cameras.camera import Camera
from ..dewarp import Dewarper
from ..dewarp.request import is_video
from ..io import read_image, write_image
from ..io.batch import expand_inputs
from ..simulation.scenes.scene import Pose
from .pinholes import RigCamera, camera_rig, view_mask

DATABASE = "database.db"
MODEL_IDS = {"PINHOLE": 1, "EQUIRECTANGULAR": 17}
SENSOR_TYPE_CAMERA = 0
OPENGL_AXES = np.diag([1.0, -1.0, -1.0])
"""Change of camera axes from right, down, forward to right, up, back (OpenGL, transforms.json)."""
SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB,
    prior_focal_length INTEGER NOT NULL);
CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    ref_sensor_id INTEGER NOT NULL, ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX rig_ref_sensor_assignment ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE rig_sensors (rig_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL,
    sensor_type INTEGER NOT NULL, sensor_from_rig BLOB,
    FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX rig_sensor_assignment ON rig_sensors(sensor_id, sensor_type);
CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, rig_id INTEGER NOT NULL,
    FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL,
    sensor_id INTEGER NOT NULL, sensor_type INTEGER NOT NULL,
    FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX frame_sensor_assignment ON frame_data(data_id, sensor_type);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL,
    CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
PRAGMA user_version = 4020100;
"""


@dataclass(frozen=True)
class ColmapProject(Result):
    """Result of :func:`write_colmap`.

    Attributes
    ----------
    folder
        Folder of the project.
    rig
        Virtual cameras with their reprojection errors by object distance.
    images
        Number of source images, each dewarped into all views.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.interop.pinholes import camera_rig
    >>> rig = camera_rig(om.load_sensor("paper-spherical"), 4, size=320)
    >>> project = ColmapProject(Path("project"), rig, 12)
    >>> project.images * len(project.rig)  # files in the folder images
    48
    """

    folder: Path
    rig: tuple[RigCamera, ...]
    images: int

    def _table(self) -> Columns:
        return table_of(
            {
                "name": camera.name,
                "model": camera.model,
                **dict(zip(("x_mm", "y_mm", "z_mm"), camera.position_mm.tolist(), strict=True)),
                **{f"error_at_{d:g}_mm_px": error for d, error in camera.errors_px.items()},
            }
            for camera in self.rig
        )


@validate_arguments
def write_colmap(
    camera: Camera,
    images: Iterable[str | Path] | str | Path,
    folder: str | Path,
    *,
    views_around: int = 6,
    hfov_deg: float = 75.0,
    tilt_deg: float = 0.0,
    size: int | None = None,
    distance_mm: float = np.inf,
    panorama: bool = False,
    every: int = 1,
    poses: Sequence[Pose] | None = None,
    stored_orientation: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> ColmapProject:
    """Dewarp images into a rig of pinhole cameras and write a COLMAP project.

    Lengths are in metres. The rays of a mirror do not meet in one point: each view has the
    position that is nearest to its rays, and the reprojection errors at several object distances
    are returned.

    Parameters
    ----------
    camera
        Sensor or calibrated camera.
    images
        Image files or a folder of them in the order of capture, or one video.
    folder
        Output folder for ``images``, ``masks``, ``database.db`` and ``rig_config.json``.
    views_around, hfov_deg, tilt_deg, size, distance_mm, panorama
        Rig, as for :func:`omnimirror.interop.pinholes.camera_rig`.
    every
        Use every n-th image or frame.
    poses
        Pose of the sensor for each image or frame, including skipped ones; also writes
        ``transforms.json`` for Nerfstudio and gsplat.
    stored_orientation
        Ignore the orientation in EXIF data or in the display matrix of a video.
    on_progress
        Called with the number of processed images and their total number.

    Returns
    -------
    ColmapProject
        Folder, rig and number of images.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, there are no images, the number of poses differs from the
        number of images, or the folder contains a project.
    MediaError
        If an image cannot be read or does not have the size of the camera.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     image = f"{folder}/0.png"
    ...     om.write_image(image, np.zeros((1024, 1024, 3), np.uint8))
    ...     project = om.write_colmap(sensor, [image], f"{folder}/project", views_around=4, size=64)
    ...     sorted(path.name for path in project.folder.iterdir()), project.images
    (['database.db', 'images', 'masks', 'rig_config.json'], 1)
    """
    folder, every = file_name("folder", folder), integer("every", every, 1)
    source = _open_images(images, every, stored_orientation=stored_orientation)
    if poses is not None and source.total is not None:
        _check_poses(len(poses), source.total)
    if (folder / DATABASE).exists():
        raise InvalidParameter(
            f"folder must not contain a project; remove {folder / DATABASE} or choose another folder"
        )
    rig = camera_rig(
        camera,
        views_around,
        hfov_deg=hfov_deg,
        tilt_deg=tilt_deg,
        size=size,
        distance_mm=distance_mm,
        panorama=panorama,
    )
    if poses is not None:
        transforms(rig, [], [])  # raises for a panorama before any image is written
    dewarpers = [(view, Dewarper(camera, view.screen, "cubic")) for view in rig]
    masks = {view.name: view_mask(camera, dewarper) for view, dewarper in dewarpers}
    names: list[str] = []
    for name, image in source.images:
        names.append(name)
        for view, dewarper in dewarpers:
            write_image(folder / "images" / view.name / name, dewarper(image))
            write_image(folder / "masks" / view.name / f"{name}.png", masks[view.name])
        if on_progress is not None:
            expected = -(-(source.total or 0) // every)
            on_progress(len(names), max(len(names), expected))
    write_text(folder / "rig_config.json", json.dumps(rig_config(rig), indent=1) + "\n")
    if poses is not None:
        selected = poses[::every]
        _check_poses(len(selected), len(names))  # the frame count of a video header can be wrong
        content = transforms(rig, names, selected)
        write_text(folder / "transforms.json", json.dumps(content, indent=1) + "\n")
    write_database(folder / DATABASE, rig, names)
    return ColmapProject(folder, rig, len(names))


def _check_poses(poses: int, images: int) -> None:
    if poses != images:
        raise InvalidParameter(
            f"poses must have one entry per image; got {poses} poses for {images} images"
        )


# -- source images -------------------------------------------------------------------------------


class _SourceImages(NamedTuple):
    total: int | None
    """Number of images including skipped ones; None for a video of unknown length."""
    images: Iterator[tuple[str, NDArray[Any]]]
    """Selected images in the order of capture with their output names."""


def _open_images(
    sources: Iterable[str | Path] | str | Path, every: int, *, stored_orientation: bool
) -> _SourceImages:
    """Return every n-th image of files or of a folder, or every n-th frame of a video."""
    paths = [sources] if isinstance(sources, str | Path) else list(sources)
    if not any(is_video(str(path)) for path in paths):
        files = expand_inputs(paths)
        names = _output_names(files)[::every]
        images = (read_image(f, stored_orientation=stored_orientation) for f in files[::every])
        return _SourceImages(len(files), zip(names, images, strict=True))
    if len(paths) > 1:
        raise InvalidParameter(
            f"images must be image files or a single video; got {len(paths)} entries with a video"
        )
    from ..io.video_reader import VideoReader

    with VideoReader(paths[0], with_audio=False) as reader:
        total = reader.expected_frames
    return _SourceImages(total, _video_frames(paths[0], every, stored_orientation))


def _video_frames(
    video: str | Path, every: int, stored_orientation: bool
) -> Iterator[tuple[str, NDArray[Any]]]:
    from ..io.video_frames import image_of_frame
    from ..io.video_reader import VideoReader

    with VideoReader(video, with_audio=False, stored_orientation=stored_orientation) as reader:
        for number, frame in enumerate(reader.frames()):
            if number % every == 0:
                yield f"frame-{number:06d}.png", image_of_frame(frame)


def _output_names(files: Sequence[Path]) -> list[str]:
    names = [f"{file.stem}.png" for file in files]
    if duplicate := next((name for name in names if names.count(name) > 1), None):
        raise InvalidParameter(
            f"images must have different names; two of them would be written as {duplicate}"
        )
    return names


# -- files ---------------------------------------------------------------------------------------


def rig_config(rig: Sequence[RigCamera]) -> list[dict[str, Any]]:
    """Return the content of ``rig_config.json`` for ``colmap rig_configurator``."""
    cameras: list[dict[str, Any]] = []
    for view in rig:
        entry: dict[str, Any] = {
            "image_prefix": f"{view.name}/",
            "camera_model_name": view.model,
            "camera_params": list(view.parameters),
        }
        if view is rig[0]:
            entry["ref_sensor"] = True
        else:
            rotation, shift_m = view.from_reference(rig[0])
            entry["cam_from_rig_rotation"] = _quaternion(rotation).tolist()
            entry["cam_from_rig_translation"] = shift_m.tolist()
        cameras.append(entry)
    return [{"cameras": cameras}]


def transforms(
    rig: Sequence[RigCamera], names: Sequence[str], poses: Sequence[Pose]
) -> dict[str, Any]:
    """Return the content of ``transforms.json`` for Nerfstudio and gsplat.

    Raises
    ------
    InvalidParameter
        If the rig is a panorama, which gsplat does not support.
    """
    if any(view.model != "PINHOLE" for view in rig):
        raise InvalidParameter(
            "transforms.json requires pinhole cameras; omit the panorama or the poses"
        )
    frames = []
    for name, pose in zip(names, poses, strict=True):
        for view in rig:
            camera_to_world = np.eye(4)
            camera_to_world[:3, :3] = pose.rotation() @ view.rotation @ OPENGL_AXES
            camera_to_world[:3, 3] = pose.to_scene(view.position_mm) / 1000.0
            fx, fy, cx, cy = view.parameters
            width, height = view.screen.size
            frames.append(
                {
                    "file_path": f"images/{view.name}/{name}",
                    "mask_path": f"masks/{view.name}/{name}.png",
                    "fl_x": fx,
                    "fl_y": fy,
                    "cx": cx,
                    "cy": cy,
                    "w": width,
                    "h": height,
                    "transform_matrix": camera_to_world.tolist(),
                }
            )
    return {"camera_model": "OPENCV", "frames": frames}


def write_database(path: Path, rig: Sequence[RigCamera], names: Sequence[str]) -> None:
    """Write the COLMAP database of cameras, rig, frames and images.

    Parameters
    ----------
    path
        File to write.
    rig
        Cameras; the first is the reference sensor.
    names
        Names of the images in the folder of each view, in the order of capture.
    """
    with (
        atomic_output(path) as temporary,
        closing(sqlite3.connect(temporary)) as database,
        database,
    ):
        database.executescript(SCHEMA)
        for number, view in enumerate(rig, start=1):
            parameters = np.array(view.parameters).tobytes()
            camera = number, MODEL_IDS[view.model], *view.screen.size, parameters
            database.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)", camera)
        database.execute("INSERT INTO rigs VALUES (1, 1, ?)", (SENSOR_TYPE_CAMERA,))
        for number, view in enumerate(rig[1:], start=2):
            rotation, shift_m = view.from_reference(rig[0])
            pose = np.concatenate([_quaternion(rotation), shift_m]).tobytes()
            sensor = number, SENSOR_TYPE_CAMERA, pose
            database.execute("INSERT INTO rig_sensors VALUES (1, ?, ?, ?)", sensor)
        for frame, name in enumerate(names, start=1):
            database.execute("INSERT INTO frames VALUES (?, 1)", (frame,))
            for number, view in enumerate(rig, start=1):
                image_id = (frame - 1) * len(rig) + number
                image = image_id, f"{view.name}/{name}", number
                database.execute("INSERT INTO images VALUES (?, ?, ?)", image)
                data = frame, image_id, number, SENSOR_TYPE_CAMERA
                database.execute("INSERT INTO frame_data VALUES (?, ?, ?, ?)", data)


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternion (w, x, y, z) of a rotation (3, 3)."""
    xyzw: NDArray[np.float64] = Rotation.from_matrix(rotation).as_quat()
    return np.roll(xyzw, 1)
