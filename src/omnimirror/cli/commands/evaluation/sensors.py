"""``omnimirror sensors``: what comes with the package."""

from __future__ import annotations

import click
from rich.table import Table

from ....specs import bundled_sensors, load_sensor
from ...outputs import output_console


@click.command()
def command() -> None:
    """List the bundled sensors; each name can stand wherever a command takes a SENSOR."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("name", no_wrap=True)
    table.add_column("mirror", no_wrap=True)
    table.add_column("field\ndeg", justify="right", no_wrap=True)
    table.add_column("rim\nmm", justify="right", no_wrap=True)
    table.add_column("what it is")
    for name in bundled_sensors():
        sensor = load_sensor(name)
        low, high = sensor.field_deg
        title = sensor.notes.strip().splitlines()[0]
        table.add_row(name, sensor.mirror.KIND, f"{low:.3g}-{high:.4g}", f"{sensor.mirror.rim_radius_mm:g}", title)
    output_console().print(table)
