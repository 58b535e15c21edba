"""``omnimirror rays``: the ray of each pixel, for renderers."""

from __future__ import annotations

from pathlib import Path

import click

from ....interop.rays import RAY_FORMATS, write_rays
from ....specs import load_camera
from ...help_pages import DocumentedCommand
from ...options.common import SENSOR, WHOLE
from ...outputs import output_console, output_option
from .common import check_one_file, formats_option, say_handed_over


@click.command(
    cls=DocumentedCommand,
    page="interoperability",
    examples=("omnimirror rays paper-spherical -o rays.exr",),
)
@click.argument("camera", type=SENSOR, metavar="SENSOR|CAMERA")
@output_option(
    "-o", "--output", required=True, formats=("exr", "npz"),
    help="A file whose suffix says the format, or a folder.",
)  # fmt: skip
@formats_option(RAY_FORMATS)
@click.option("--step", type=WHOLE, default=1, show_default=True, help="Every n-th pixel only, across and down.")
def command(camera: str, output: Path, formats: list[str] | None, step: int) -> None:
    """Write where the ray of each pixel starts, where it goes and how much it weighs.

    Of a sensor file, a camera file or a bundled sensor. Lengths are mm, unless the program wants others; x is forward,
    y left and z up, from the mirror's vertex.
    """
    check_one_file(output, formats, RAY_FORMATS)
    console = output_console()
    with console.status("Tracing"):
        done = write_rays(load_camera(camera), output, formats=formats, step=step)
    say_handed_over(done, console)
