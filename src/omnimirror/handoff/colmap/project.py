"""A folder that COLMAP takes as it is: pictures of each view, masks, rig and database, and transforms.json."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...arguments import checked, file_name
from ...cameras import Camera
from ...dewarp import Dewarper
from ...errors import InvalidParameter
from ...files import write_text
from ...media import read_image, write_image
from ...media.batch import expand_inputs
from ...simulate.scenes.posed import Pose
from .database import quaternion, write_database
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
    poses: Sequence[Pose] | None = None,
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
        Files, or a folder of them, in the order in which they were taken.
    folder
        Takes ``images``, ``masks``, ``database.db`` and ``rig_config.json``.
    views_around, hfov_deg, tilt_deg, size, distance_mm, is_panorama
        As for :func:`omnimirror.handoff.colmap.rig_of`.
    poses
        Where the sensor stood, one for each picture: ``transforms.json`` is written, for Nerfstudio and gsplat.
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
    folder = file_name("folder", folder)
    files = expand_inputs([pictures] if isinstance(pictures, str | Path) else list(pictures))
    names = _names(files)
    if poses is not None and len(poses) != len(files):
        raise InvalidParameter(f"poses has {len(poses)} of them for {len(files)} pictures; give one for each")
    if (folder / DATABASE).exists():
        raise InvalidParameter(f"{folder} holds a project already; remove {folder / DATABASE} or take another folder")
    rig = rig_of(
        camera, views_around, hfov_deg=hfov_deg, tilt_deg=tilt_deg, size=size, distance_mm=distance_mm,
        is_panorama=is_panorama,
    )  # fmt: skip
    placed = None if poses is None else transforms(rig, names, poses)
    drawn = [(view, Dewarper(camera, view.screen, "cubic")) for view in rig]
    masks = {view.name: mask_of(camera, dewarp) for view, dewarp in drawn}
    for done, (file, name) in enumerate(zip(files, names, strict=True), start=1):
        picture = read_image(file)
        for view, dewarp in drawn:
            write_image(folder / "images" / view.name / name, dewarp(picture))
            write_image(folder / "masks" / view.name / f"{name}.png", masks[view.name])
        if progress is not None:
            progress(done, len(files))
    write_text(folder / "rig_config.json", json.dumps(rig_config(rig), indent=1) + "\n")
    if placed is not None:
        write_text(folder / "transforms.json", json.dumps(placed, indent=1) + "\n")
    write_database(folder / DATABASE, rig, names)
    return ColmapProject(folder, rig, len(files))


def _names(files: Sequence[Path]) -> list[str]:
    names = [f"{file.stem}.png" for file in files]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InvalidParameter(f"two pictures would both be named {twice}; rename one")
    return names


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
