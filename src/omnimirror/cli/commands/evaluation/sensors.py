"""``omnimirror sensors``: what comes with the package."""

from __future__ import annotations

import click

from ....specs import bundled_sensors, load_sensor
from ...help_pages import DocumentedCommand
from ...outputs import output_console, plain_table


@click.command(
    cls=DocumentedCommand,
    page="sensor-file",
    examples=("omnimirror sensors",),
)
def command() -> None:
    """List the bundled sensors; each name can stand wherever a command takes a SENSOR."""
    words = ("name", "mirror", "what it is")
    table = plain_table("name", "mirror", "field\ndeg", "rim\nmm", "what it is", words=words)
    for name in bundled_sensors():
        sensor = load_sensor(name)
        low, high = sensor.field_deg
        title = sensor.notes.strip().splitlines()[0]
        table.add_row(name, sensor.mirror.KIND, f"{low:.3g}-{high:.4g}", f"{sensor.mirror.rim_radius_mm:g}", title)
    output_console().print(table)
