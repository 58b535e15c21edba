"""``omnimirror colmap``: pictures as a project of COLMAP."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from ....files import write_json
from ....interop.colmap import write_colmap
from ....interop.colmap.rig import RigView
from ....media.batch import expand_inputs
from ....simulate.scenes.posed import Pose
from ....specs import load_camera
from ....straighten import is_video
from ...help_pages import DocumentedCommand
from ...options.common import SENSOR, WHOLE, angle, distance
from ...options.declared import takes
from ...options.orientation import OrientationOptions
from ...options.scene import rows_bar
from ...outputs import json_option, output_console, plain_table, say, say_written


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=(
        "omnimirror colmap paper-spherical walk -o project",
        "omnimirror colmap mine.toml walk.mp4 --every 10 -o project",
        "omnimirror colmap mine.toml walk --poses poses.csv --gsplat -o project",
    ),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@click.argument("pictures", nargs=-1, required=True, metavar="PICTURES...")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="A folder.")
@click.option("--views", "views_around", type=WHOLE, default=6, show_default=True, help="Perspective views around.")
@click.option("--hfov-deg", type=angle, default="75", show_default=True, metavar="DEG", help="Width of a view.")
@click.option("--tilt-deg", type=angle, default="0", show_default=True, metavar="DEG", help="How far up views look.")
@click.option("--size", type=WHOLE, metavar="PX", help="Of a view's sides, or a panorama's width.")
@click.option("--distance-mm", type=distance, default="inf", show_default=True, metavar="MM",
              help="Where views are exact.")  # fmt: skip
@click.option("--panorama", "is_panorama", is_flag=True, help="One EQUIRECTANGULAR camera instead of views.")
@takes(OrientationOptions, "orientation")
@click.option("--every", type=WHOLE, default=1, show_default=True, help="Take one picture, or frame, of so many.")
@click.option("--poses", type=click.Path(path_type=Path, dir_okay=False), metavar="CSV",
              help="Where the sensor stood: a row for each picture or frame, as video sets have them.")  # fmt: skip
@click.option("--gsplat", is_flag=True, help="Also transforms.json, for Nerfstudio and gsplat; needs --poses.")
@json_option("Write the table: views, their sizes, and by how much they are off at each distance.")
def command(
    camera: str,
    pictures: tuple[str, ...],
    output: Path,
    views_around: int,
    hfov_deg: float,
    tilt_deg: float,
    size: int | None,
    distance_mm: float,
    is_panorama: bool,
    orientation: OrientationOptions,
    every: int,
    poses: Path | None,
    gsplat: bool,
    json_file: Path | None,
) -> None:
    """Straighten PICTURES, files, a folder or a video, into a rig of pinhole cameras that COLMAP reconstructs from.

    The folder takes images and masks of every view, database.db, rig_config.json, and with --gsplat transforms.json.
    What is printed is by how much the pinholes are off, px, for things at several distances: a mirror's rays do not
    meet in one point. Lengths are metres.
    """
    _check_views(is_panorama)
    if gsplat != (poses is not None):
        raise click.UsageError("--gsplat and --poses belong together: transforms.json says where pictures were taken")
    if is_video(pictures[0]):
        orientation.report_video(pictures[0])
    else:
        orientation.report(expand_inputs(pictures))
    with rows_bar("Straightening") as progress:
        project = write_colmap(
            load_camera(camera), pictures, output, views_around=views_around, hfov_deg=hfov_deg, tilt_deg=tilt_deg,
            size=size, distance_mm=distance_mm, is_panorama=is_panorama, every=every,
            poses=None if poses is None else _poses(poses),
            stored_orientation=orientation.stored_orientation, progress=progress,
        )  # fmt: skip
    table = plain_table(
        "view", "size", *(f"off at {mm / 1000:g} m\npx" for mm in project.rig[0].errors_px), words=("view", "size")
    )
    for view in project.rig:
        width, height = view.screen.size
        table.add_row(view.name, f"{width} x {height}", *(f"{error:.2g}" for error in view.errors_px.values()))
    console = output_console()
    console.print(table)
    if json_file:
        write_json(json_file, [_record(view) for view in project.rig])
        say_written(json_file, console=console)
    say(f"{output}: {project.pictures} pictures, {len(project.rig)} views each", console=console)


def _check_views(is_panorama: bool) -> None:
    """Refuse what says how views are laid out where there are none."""
    context = click.get_current_context()
    for name in ("views_around", "hfov_deg", "tilt_deg", "distance_mm"):
        if is_panorama and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            option = "views" if name == "views_around" else name.replace("_", "-")
            raise click.UsageError(f"--{option} belongs to views; --panorama is all there is to see")


def _record(view: RigView) -> dict[str, Any]:
    """What the table tells of a view."""
    errors = [{"distance_mm": mm, "error_px": error} for mm, error in view.errors_px.items()]
    return {"view": view.name, "size": view.screen.size, "errors": errors}


def _poses(path: Path) -> list[Pose]:
    """A pose for each row of a file."""
    from ....simulate.datasets.video import load_path

    track = load_path(path)
    times = np.unique([time for entries in track.tracks.values() for time, _ in entries])
    return [Pose(**track.at(float(time))) for time in times]
