"""``omnimirror sensors``: list of bundled sensors."""

from __future__ import annotations

from pathlib import Path

import click

from ....base.files import write_json
from ....optics.sensor_files import bundled_sensors, load_sensor
from .._declarations import DocumentedCommand
from .._output import json_option, output_console, plain_table, print_written


@click.command(
    cls=DocumentedCommand,
    page="sensor-file",
    examples=("omnimirror sensors",),
)
@json_option()
def command(json_file: Path | None) -> None:
    """List the bundled sensors; every SENSOR argument accepts these names."""
    text_columns = ("name", "mirror", "description")
    console = output_console()
    records = []
    table = plain_table(
        "name", "mirror", "field\ndeg", "rim\nmm", "description", text_columns=text_columns
    )
    for name in bundled_sensors():
        sensor = load_sensor(name)
        low, high = sensor.field_deg
        title = sensor.notes.strip().splitlines()[0]
        table.add_row(
            name,
            sensor.mirror.KIND,
            f"{low:.3g}-{high:.4g}",
            f"{sensor.mirror.rim_radius_mm:g}",
            title,
        )
        records.append(
            {
                "name": name,
                "mirror": sensor.mirror.KIND,
                "field_deg": [low, high],
                "rim_radius_mm": sensor.mirror.rim_radius_mm,
                "description": title,
            }
        )
    console.print(table)
    if json_file:
        write_json(json_file, records)
        print_written(json_file, console=console)
