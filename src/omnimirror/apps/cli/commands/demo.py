"""``omnimirror demo``: evaluation, simulation and dewarping of one sensor, with a report."""

from __future__ import annotations

from pathlib import Path

import click

from ....optics.sensor_files import load_sensor
from .._declarations import DocumentedCommand
from .._option_types import SENSOR
from .._output import output_console, say


@click.command(
    cls=DocumentedCommand,
    page="evaluation",
    examples=("omnimirror demo paper-spherical --out demo",),
)
@click.argument("sensor", type=SENSOR, default="paper-spherical")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="omnimirror-demo",
    show_default=True,
    help="Output folder for images, table and report.",
)
@click.option(
    "--blur/--no-blur",
    default=True,
    show_default=True,
    help="Render through the whole aperture, or without blur.",
)
def command(sensor: str, out: Path, blur: bool) -> None:
    """Evaluate SENSOR (paper-spherical by default), render and dewarp an image of a room, and write
    a report.
    """
    from ...reports import write_demo

    console = output_console()
    with console.status("Evaluating") as status:
        report = write_demo(
            load_sensor(sensor),
            out,
            blur=blur,
            progress=lambda what, share: status.update(f"{what}: {share:.0%}"),
        )
    say(f"Wrote {report.resolve()}", console=console)
