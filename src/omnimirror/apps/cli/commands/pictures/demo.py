"""``omnimirror demo``: one sensor through the whole house, onto one page."""

from __future__ import annotations

from pathlib import Path

import click

from .....optics.sensor_files import load_sensor
from ...help_pages import DocumentedCommand
from ...options.common import SENSOR
from ...outputs import output_console, say


@click.command(
    cls=DocumentedCommand,
    page="evaluation",
    examples=("omnimirror demo paper-spherical --out demo",),
)
@click.argument("sensor", type=SENSOR, default="paper-spherical")
@click.option("--out", type=click.Path(path_type=Path), default="omnimirror-demo", show_default=True,
              help="Folder for pictures, table and report.")  # fmt: skip
@click.option("--blur/--no-blur", default=True, show_default=True, help="Look through the whole aperture, or sharp.")
def command(sensor: str, out: Path, blur: bool) -> None:
    """Evaluate SENSOR (paper-spherical by default), take its picture of a room, straighten it, write a report."""
    from ....reports import write_demo

    console = output_console()
    with console.status("Evaluating") as status:
        report = write_demo(
            load_sensor(sensor), out, blur=blur, progress=lambda what, share: status.update(f"{what}: {share:.0%}")
        )
    say(f"Wrote {report.resolve()}", console=console)
