"""``omnimirror rays``: ray tables for renderers."""

from __future__ import annotations

from pathlib import Path

import click

from .....interop.ray_tables import RAY_FORMATS, write_rays
from .....optics.sensor_files import load_camera
from ...help_pages import DocumentedCommand
from ...options.common import SENSOR, WHOLE
from ...outputs import output_console, output_option
from .common import check_one_file, formats_option, print_exported_files


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=("omnimirror rays paper-spherical -o rays.exr",),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@output_option(
    "-o", "--output", required=True, formats=("exr", "npz"),
    help="Output file, whose suffix selects the format, or folder.",
)  # fmt: skip
@formats_option(RAY_FORMATS)
@click.option("--step", type=WHOLE, default=1, show_default=True, help="Spacing of the sampled pixels, px.")
def command(camera: str, output: Path, formats: list[str] | None, step: int) -> None:
    """Write origin, direction and weight of the ray of each pixel for other programs.

    SENSOR|CAMERA is a sensor file, a camera file or a bundled sensor. Lengths are in mm unless the
    format requires another unit; x is forward, y left and z up, with the origin at the mirror
    vertex.
    """
    check_one_file(output, formats, RAY_FORMATS)
    console = output_console()
    with console.status("Tracing"):
        exported = write_rays(load_camera(camera), output, formats=formats, step=step)
    print_exported_files(exported, console)
