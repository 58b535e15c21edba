"""``omnimirror colmap``: dewarped images as a COLMAP project."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from ....base.files import write_json
from ....dewarp.request import is_video
from ....interop.colmap import write_colmap
from ....interop.pinholes import RigCamera
from ....io.batch import expand_inputs
from ....optics.camera_files import load_camera
from ....simulation.scenes.scene import Pose
from .._camera_options import OrientationOptions
from .._declarations import (
    INTEGER,
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    angle,
    distance,
    flag,
    option,
    setting,
)
from .._output import (
    count_bar,
    json_option,
    output_console,
    plain_table,
    print_line,
    print_written,
)


@dataclass(frozen=True)
class RigOptions(Options):
    """Views, with the parameters of :func:`omnimirror.interop.pinholes.camera_rig`."""

    views_around: int = option(
        "--views", type=INTEGER, default=6, help="Number of perspective views."
    )
    hfov_deg: float = option(type=angle, default=75.0, metavar="DEG", help="Field of each view.")
    panorama: bool = option(
        is_flag=True, default=False, help="Write one EQUIRECTANGULAR camera instead of views."
    )
    tilt_deg: float = setting("view", 0.0, type=angle)
    size: int | None = setting("view")
    distance_mm: float = setting("view", np.inf, type=distance)

    def check(self) -> None:
        """Raise UsageError for settings of perspective views with a panorama."""
        for name in self.changed if self.panorama else ():
            if name not in ("panorama", "size"):
                raise click.UsageError(f"{flag(name)} must not be given with --panorama")


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=(
        "omnimirror colmap paper-spherical walk -o project",
        "omnimirror colmap mine.toml walk.mp4 --every 10 -o project",
        "omnimirror colmap mine.toml walk --poses poses.csv -o project",
    ),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@click.argument("images", nargs=-1, required=True, metavar="IMAGES...")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Output folder.",
)
@add_options(RigOptions, "rig")
@add_options(OrientationOptions, "orientation")
@click.option(
    "--every", type=INTEGER, default=1, show_default=True, help="Use every n-th image or frame."
)
@click.option(
    "--poses",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="CSV",
    help="Poses of the sensor, one row per image or frame, as written by simulate; also writes "
    "transforms.json for Nerfstudio and gsplat.",
)
@json_option("Write views, sizes and reprojection errors by distance.")
def command(
    camera: str,
    images: tuple[str, ...],
    output: Path,
    rig: RigOptions,
    orientation: OrientationOptions,
    every: int,
    poses: Path | None,
    json_file: Path | None,
) -> None:
    """Dewarp IMAGES, files, a folder or a video, into a rig of pinhole cameras for COLMAP.

    The output folder contains images and masks of every view, database.db, rig_config.json, and
    with --poses transforms.json. The printed reprojection errors at several object distances, px,
    arise because the rays of a mirror do not meet in one point. Lengths are in metres.
    """
    rig.check()
    if is_video(images[0]):
        orientation.report_video(images[0])
    else:
        orientation.report(expand_inputs(images))
    with count_bar("Dewarping") as progress:
        project = write_colmap(
            load_camera(camera),
            images,
            output,
            **rig.given,
            every=every,
            poses=None if poses is None else _read_poses(poses),
            stored_orientation=orientation.stored_orientation,
            on_progress=progress,
        )
    table = plain_table(
        "view",
        "size",
        *(f"error at {mm / 1000:g} m\npx" for mm in project.rig[0].errors_px),
        text_columns=("view", "size"),
    )
    for view in project.rig:
        width, height = view.screen.size
        table.add_row(
            view.name, f"{width} x {height}", *(f"{error:.2g}" for error in view.errors_px.values())
        )
    console = output_console()
    console.print(table)
    if json_file:
        write_json(json_file, [_record(view) for view in project.rig])
        print_written(json_file, console=console)
    print_line(f"{output}: {project.images} images, {len(project.rig)} views each", console=console)


def _record(view: RigCamera) -> dict[str, Any]:
    """Return a row of the table for JSON."""
    errors = [{"distance_mm": mm, "error_px": error} for mm, error in view.errors_px.items()]
    return {"view": view.name, "size": view.screen.size, "errors": errors}


def _read_poses(path: Path) -> list[Pose]:
    """Return a pose for each row of a file."""
    from ....simulation.simulated_video import load_path

    track = load_path(path)
    times = np.unique([time for entries in track.tracks.values() for time, _ in entries])
    return [Pose(**track.at(float(time))) for time in times]
