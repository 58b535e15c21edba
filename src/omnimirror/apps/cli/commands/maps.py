"""``omnimirror maps``: view maps for programs that resample images."""

from __future__ import annotations

from pathlib import Path

import click

from ....interop.view_maps import MAP_FORMATS, write_maps
from ....optics.camera_files import load_camera
from .._declarations import SENSOR, DocumentedCommand, add_options
from .._output import output_console, output_option
from .dewarp import ViewOptions
from .rays import check_one_file, formats_option, print_exported_files


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=(
        "omnimirror maps paper-spherical --view perspective --size 640x480 -o ahead --format stmap,opencv",
        "omnimirror maps paper-spherical --view ground --set view.height_mm=800 --size 320x240 -o floor.c --format c99",
    ),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@output_option(
    "-o",
    "--output",
    required=True,
    formats=("npz", "exr"),
    help="Output file, whose suffix selects the format, or folder.",
)
@formats_option(MAP_FORMATS)
@add_options(ViewOptions, "view")
def command(camera: str, output: Path, formats: list[str] | None, view: ViewOptions) -> None:
    """Write the map of a view, the source pixel of each of its pixels, for other programs.

    SENSOR|CAMERA is a sensor file, a camera file or a bundled sensor. The view is specified as for
    omnimirror dewarp.
    """
    view.check()
    loaded_camera = load_camera(camera)
    screen = view.of(loaded_camera)
    check_one_file(output, formats, MAP_FORMATS)
    console = output_console()
    with console.status("Mapping"):
        exported = write_maps(
            loaded_camera, screen, output, formats=formats, viewpoint=view.viewpoint or "exact"
        )
    print_exported_files(exported, console)
