"""A folder that COLMAP takes as it is: pictures of each view, masks, rig and database, and transforms.json."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...arguments import checked, file_name, whole
from ...cameras import Camera
from ...dewarp import Dewarper
from ...errors import InvalidParameter
from ...files import write_text
from ...media import write_image
from ...simulate.scenes.posed import Pose
from .database import quaternion, write_database
from .pictures import pictures_of
from .rig import RigView, mask_of, rig_of, sensor_from_rig

DATABASE = "database.db"
UPRIGHT = np.diag([1.0, -1.0, -1.0])
"""From a camera's right, down and ahead to right, up and back, as OpenGL and transforms.json have them."""


@dataclass(frozen=True)
class ColmapProject:
    """What was written for COLMAP.

    Attributes
    ----------
    folder
    rig
        Its cameras, each with how far off it looks, px, for things at distances, mm.
    pictures
        How many were straightened, each into all views.

    Examples
    --------
    >>> import omnimirror as om
    >>> project = ColmapProject(Path("project"), rig_of(om.load_sensor("paper-spherical"), 4, size=320), 12)
    >>> project.pictures * len(project.rig)  # in its folder of images
    48
    """

    folder: Path
    rig: tuple[RigView, ...]
    pictures: int


@checked
def write_colmap(
    camera: Camera,
    pictures: Iterable[str | Path] | str | Path,
    folder: str | Path,
    *,
    views_around: int = 6,
    hfov_deg: float = 75.0,
    tilt_deg: float = 0.0,
    size: int | None = None,
    distance_mm: float = np.inf,
    is_panorama: bool = False,
    every: int = 1,
    poses: Sequence[Pose] | None = None,
    stored_orientation: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> ColmapProject:
    """Straighten pictures into a rig of pinholes that COLMAP reconstructs from, with masks, database and rig file.

    Lengths are metres. The rays of a mirror do not meet in one point: each view is seen from where it misses them
    least, and how far off that is, is told for several distances.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    pictures
        Files, or a folder of them, in the order in which they were taken; or a video.
    folder
        Takes ``images``, ``masks``, ``database.db`` and ``rig_config.json``.
    views_around, hfov_deg, tilt_deg, size, distance_mm, is_panorama
        As for :func:`omnimirror.interop.colmap.rig_of`.
    every
        One picture, or frame, of so many is taken.
    poses
        Where the sensor stood, one for each picture or frame, also of those that are left out: ``transforms.json`` is
        written, for Nerfstudio and gsplat.
    stored_orientation
        Take pixels as stored, without the orientation in EXIF data or in the display matrix of a video.
    progress
        Called with the number of pictures done, and of all.

    Returns
    -------
    ColmapProject
        The rig, and what it costs.

    Raises
    ------
    InvalidParameter
        A number out of its range, no pictures, or another number of poses.
    MediaError
        A picture cannot be read or is of another size.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/0.png", np.zeros((1024, 1024, 3), np.uint8))
    ...     project = om.write_colmap(sensor, [f"{folder}/0.png"], f"{folder}/project", views_around=4, size=64)
    ...     sorted(path.name for path in project.folder.iterdir()), project.pictures
    (['database.db', 'images', 'masks', 'rig_config.json'], 1)
    """
    folder, every = file_name("folder", folder), whole("every", every, 1)
    taken = pictures_of(pictures, every, stored_orientation=stored_orientation)
    if poses is not None and taken.total is not None:
        _check_poses(len(poses), taken.total)
    if (folder / DATABASE).exists():
        raise InvalidParameter(f"{folder} holds a project already; remove {folder / DATABASE} or take another folder")
    rig = rig_of(
        camera, views_around, hfov_deg=hfov_deg, tilt_deg=tilt_deg, size=size, distance_mm=distance_mm,
        is_panorama=is_panorama,
    )  # fmt: skip
    if poses is not None:
        transforms(rig, [], [])  # refuses a panorama before anything is drawn
    drawn = [(view, Dewarper(camera, view.screen, "cubic")) for view in rig]
    masks = {view.name: mask_of(camera, dewarp) for view, dewarp in drawn}
    names: list[str] = []
    for name, picture in taken.pictures:
        names.append(name)
        for view, dewarp in drawn:
            write_image(folder / "images" / view.name / name, dewarp(picture))
            write_image(folder / "masks" / view.name / f"{name}.png", masks[view.name])
        if progress is not None:
            progress(len(names), max(len(names), -(-(taken.total or 0) // every)))
    write_text(folder / "rig_config.json", json.dumps(rig_config(rig), indent=1) + "\n")
    if poses is not None:
        stood = poses[::every]
        _check_poses(len(stood), len(names))  # of a video that had other frames than it says
        write_text(folder / "transforms.json", json.dumps(transforms(rig, names, stood), indent=1) + "\n")
    write_database(folder / DATABASE, rig, names)
    return ColmapProject(folder, rig, len(names))


def _check_poses(poses: int, pictures: int) -> None:
    if poses != pictures:
        raise InvalidParameter(f"poses has {poses} of them for {pictures} pictures; give one for each")


def rig_config(rig: Sequence[RigView]) -> list[dict[str, Any]]:
    """What ``colmap rig_configurator`` takes, for databases that it makes itself."""
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
            turn, shift = sensor_from_rig(view, rig[0])
            entry |= {"cam_from_rig_rotation": quaternion(turn).tolist(), "cam_from_rig_translation": shift.tolist()}
        cameras.append(entry)
    return [{"cameras": cameras}]


def transforms(rig: Sequence[RigView], names: Sequence[str], poses: Sequence[Pose]) -> dict[str, Any]:
    """What Nerfstudio and gsplat take: every picture with its camera, where that stood (m), and its mask.

    Raises
    ------
    InvalidParameter
        The rig is a panorama, which gsplat does not know.
    """
    if any(view.model != "PINHOLE" for view in rig):
        raise InvalidParameter("transforms.json is of pinholes; leave out is_panorama, or the poses")
    frames = []
    for name, pose in zip(names, poses, strict=True):
        for view in rig:
            placed = np.eye(4)
            placed[:3, :3] = pose.rotation() @ view.rotation @ UPRIGHT
            placed[:3, 3] = pose.to_scene(view.position_mm) / 1000.0
            fx, fy, cx, cy = view.parameters
            width, height = view.screen.size
            frames.append({
                "file_path": f"images/{view.name}/{name}", "mask_path": f"masks/{view.name}/{name}.png",
                "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": width, "h": height,
                "transform_matrix": placed.tolist(),
            })  # fmt: skip
    return {"camera_model": "OPENCV", "frames": frames}
