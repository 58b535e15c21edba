"""``omnimirror demo``: evaluation, simulation and dewarping of one sensor, with a report."""

from __future__ import annotations

from pathlib import Path

import click

from ....base.logs import forward_steps
from ....optics.sensor_files import load_sensor
from .._declarations import SENSOR, DocumentedCommand
from .._output import output_console, print_line


@click.command(
    cls=DocumentedCommand,
    page="evaluation",
    examples=("omnimirror demo paper-spherical -o demo",),
)
@click.argument("sensor", type=SENSOR, default="paper-spherical")
@click.option(
    "-o",
    "--output",
    "folder",
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
def command(sensor: str, folder: Path, blur: bool) -> None:
    """Evaluate SENSOR (paper-spherical by default), render and dewarp an image of a room, and write
    a report.
    """
    from ...reports import write_demo

    console = output_console()
    step = "Evaluating"

    def on_step(name: str) -> None:
        nonlocal step
        step = name

    with console.status(step) as status, forward_steps(on_step):
        report = write_demo(
            load_sensor(sensor),
            folder,
            blur=blur,
            on_progress=lambda done, total: status.update(f"{step}: {done} %"),
        )
    print_line(f"Wrote {report.resolve()}", console=console)
