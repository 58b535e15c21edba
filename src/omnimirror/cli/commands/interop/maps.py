"""``omnimirror maps``: where each pixel of a view lies in the picture, for programs that remap."""

from __future__ import annotations

from pathlib import Path

import click

from ....interop.maps import MAP_FORMATS, write_maps
from ....specs import load_camera
from ...help_pages import DocumentedCommand
from ...options.common import SENSOR
from ...options.declared import takes
from ...options.view import ViewOptions
from ...outputs import output_console, output_option
from .common import check_one_file, formats_option, say_handed_over


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=(
        "omnimirror maps paper-spherical --view perspective --size 640x480 -o ahead --format stmap,opencv",
        "omnimirror maps paper-spherical --view ground --height-mm 800 --size 320x240 -o floor.c --format c99",
    ),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@output_option(
    "-o", "--output", required=True, formats=("npz", "exr"),
    help="A file whose suffix says the format, or a folder.",
)  # fmt: skip
@formats_option(MAP_FORMATS)
@takes(ViewOptions, "view")
def command(camera: str, output: Path, formats: list[str] | None, view: ViewOptions) -> None:
    """Write where in the camera's picture each pixel of a view lies.

    Of a sensor file, a camera file or a bundled sensor; the view as of omnimirror dewarp.
    """
    view.check()
    seen_by = load_camera(camera)
    shown = view.of(seen_by)
    check_one_file(output, formats, MAP_FORMATS)
    console = output_console()
    with console.status("Mapping"):
        done = write_maps(seen_by, shown, output, formats=formats, viewpoint=view.viewpoint or "exact")
    say_handed_over(done, console)
