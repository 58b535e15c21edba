"""``omnimirror compare``: comparison of up to six sensors."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ....analysis.comparison import Comparison, compare
from ....optics.sensor_files import load_sensor
from .._declarations import SENSOR, DocumentedCommand, distance
from .._output import (
    json_option,
    output_console,
    output_option,
    print_line,
    print_written,
)

FORMATS = ("png", "html")


@click.command(
    cls=DocumentedCommand,
    page="compare",
    examples=("omnimirror compare paper-spherical paper-hyperboloidal -o comparison.html",),
)
@click.argument("sensors", type=SENSOR, nargs=-1, required=True)
@click.option(
    "--object-distance-mm",
    type=distance,
    metavar="MM",
    default="inf",
    show_default=True,
    help="Object distance from the mirror, for lengths per pixel.",
)
@output_option(
    "-o",
    "--output",
    formats=FORMATS,
    help="Output of table, curves and images of one scene: one .html page or one .png file.",
)
@output_option("--csv", "csv_file", help="Write the table with 17 significant digits.")
@json_option("Write the table, an object per sensor.")
def command(
    sensors: tuple[str, ...],
    object_distance_mm: float,
    output: Path | None,
    csv_file: Path | None,
    json_file: Path | None,
) -> None:
    """Compare up to six SENSORS, files or names of bundled sensors; the best value of each row is
    marked.

    A sensor with a decentred or tilted mirror is compared over its whole image, at all azimuths.
    """
    console = output_console()
    comparison = compare([load_sensor(s) for s in sensors], object_distance_mm)
    print_comparison(console, comparison)
    for note in comparison.notes:
        print_line(("Note: ", "yellow"), note, console=console)
    if csv_file:
        comparison.to_csv(csv_file)
    if json_file:
        comparison.to_json(json_file)
    if output:
        from ...reports.comparison import write_comparison

        with console.status("Drawing, simulating, dewarp_request"):
            write_comparison(comparison, output)
    print_written(csv_file, json_file, output, console=console)


def print_comparison(console: Console, comparison: Comparison) -> None:
    """Print one row per quantity; the best values are bold and starred."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("")
    table.add_column("")
    for name in comparison.names:
        table.add_column(name, justify="right", overflow="fold")
    for row in comparison.rows:
        cells = [
            Text(f"{text} *", style="bold") if best else Text(f"{text}  ")
            for text, best in zip(row.texts, row.best, strict=True)
        ]
        table.add_row(row.quantity.title, row.quantity.unit, *cells)
    console.print(table)
