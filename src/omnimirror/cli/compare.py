"""``omnimirror compare``: up to six sensors side by side."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..analysis import Comparison, compare
from ..specs import load_sensor
from .options import output_console


@click.command()
@click.argument("sensors", nargs=-1, required=True)
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Write table, curves and pictures of one scene as one .html page or one .png.")  # fmt: skip
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), help="Write the table, 17 significant digits.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write the table, an object per sensor.")
def command(sensors: tuple[str, ...], output: Path | None, csv_file: Path | None, json_file: Path | None) -> None:
    """Put up to six SENSORS side by side, files or names of bundled ones; the best of each row is marked.

    Example: omnimirror compare paper-spherical paper-hyperboloidal -o comparison.html
    """
    console = output_console()
    comparison = compare([load_sensor(s) for s in sensors])
    print_comparison(console, comparison)
    if csv_file:
        comparison.to_csv(csv_file)
    if json_file:
        comparison.to_json(json_file)
    if output:
        from ..report.comparison import write_comparison

        with console.status("Drawing, simulating, straightening"):
            write_comparison(comparison, output)
    for path in (csv_file, json_file, output):
        if path:
            console.print(f"Wrote [bold]{path}[/]", highlight=False, soft_wrap=True)


def print_comparison(console: Console, comparison: Comparison) -> None:
    """One row per quantity; the best are bold and starred."""
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
        table.add_row(row.title, row.unit, *cells)
    console.print(table)
