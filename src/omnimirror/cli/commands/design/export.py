"""``omnimirror export``: what a workshop and other programs need of a sensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from ....arguments import float_of
from ....manufacture import DEFAULT_FORMATS, FORMATS, Body, Exported
from ....manufacture.body import TAP_DRILLS_MM
from ....manufacture.drawings.sheet import SHEETS
from ....manufacture.exporter import export
from ....manufacture.parts import drawn_housing
from ....specs import load_sensor
from ...options.common import NUMBER, WHOLE
from ...options.declared import takes
from ...options.housing import HousingOptions
from ...outputs import output_console, output_option

SOLID = (
    "thickness_mm", "bore_diameter_mm", "bore_depth_mm", "thread", "flange_width_mm", "flange_thickness_mm",
)  # fmt: skip
"""The options of the mirror's body; what they do not say is as the rim of the sensor's housing shows it."""


def formats(text: str) -> list[str]:
    """Names of formats, with commas between them.

    >>> formats("step, pdf")
    ['step', 'pdf']
    """
    names = [name.strip() for name in text.split(",")]
    if unknown := [name for name in names if name not in FORMATS]:
        raise click.BadParameter(f"{unknown[0]!r} is not a format; valid are {', '.join(FORMATS)}")
    return names


def scale(text: str) -> float:
    """A drawing scale, paper to nature.

    >>> scale("1:2"), scale("5:1")
    (0.5, 5.0)
    """
    try:
        paper, nature = (float_of(part) for part in text.split(":"))
        number = paper / nature
    except (ValueError, ZeroDivisionError):
        number = 0.0
    if not number > 0:
        raise click.BadParameter(f"{text!r} is not a scale, such as 1:2 or 5:1")
    return number


@click.command()
@click.argument("sensor")
@output_option("-o", "--output", required=True, formats=("csv",),
               help="A folder, or one file whose suffix says what to write; - prints the sag table.")  # fmt: skip
@click.option("--formats", type=formats, metavar="NAME,..",
              help=f"For a folder: of {', '.join(FORMATS)}.  [default: {','.join(DEFAULT_FORMATS)}]")  # fmt: skip
@click.option("--thickness-mm", type=NUMBER, help="Solid: from the rim to the back.  [default: 5]")
@click.option("--bore-diameter-mm", type=NUMBER, help="Solid: bore on the axis, from the back.")
@click.option("--thread", type=click.Choice(list(TAP_DRILLS_MM)), help="Instead: a bore to tap this thread in.")
@click.option("--bore-depth-mm", type=NUMBER, help="Of the bore; 'inf' goes through.  [default: 10]")
@click.option("--flange-width-mm", type=NUMBER, help="Solid: a flange at the back, beyond the rim.")
@click.option("--flange-thickness-mm", type=NUMBER, help="Of the flange.  [default: 2]")
@click.option("--secondary-thickness-mm", type=NUMBER, help="Solid of a second mirror: the same of it.  [default: 5]")
@click.option("--chord-tolerance-um", type=NUMBER, default=10.0, show_default=True, help="STL, 3MF: of the triangles.")
@click.option("--step-mm", type=NUMBER, help="Table: step along x.  [default: a hundredth of the rim radius]")
@click.option("--step-deg", type=NUMBER, help="Table: instead, step of the field angle.")
@click.option("--digits", type=WHOLE, default=6, show_default=True, help="Table: decimals of a millimetre.")
@click.option("--grid-points", type=WHOLE, default=257, show_default=True, help="Grid sag: points along each side.")
@takes(HousingOptions, "housing")
@click.option("--sheet", type=click.Choice(list(SHEETS)), default="A3", show_default=True, help="Drawing: paper.")
@click.option("--scale", type=scale, metavar="1:N", help="Drawing: of the sensor.  [default: the largest that fits]")
def command(sensor: str, output: Path, **options: Any) -> None:
    """Write CAD files, lens files, tables and a drawing of SENSOR, a sensor file or a bundled sensor.

    Every line of the table says how far the file's surface lies from the mirror. Example:

    \b
    omnimirror export paper-spherical -o workshop --thread M6 --bore-depth-mm 12
    """
    camera = load_sensor(sensor)
    solid, thickness = {n: v for n in SOLID if (v := options.pop(n)) is not None}, options.pop("secondary_thickness_mm")
    body = replace(Body.of(camera.housing.rim, camera.mirror), **solid) if solid else None
    second = None if thickness is None else Body(thickness)
    asked: HousingOptions = options.pop("housing")
    housing = asked.of(drawn_housing(camera))
    console = output_console()
    with console.status("Writing"):
        written = export(
            camera, output, formats=options.pop("formats"), body=body, secondary_body=second,
            housing=housing, **options,
        )  # fmt: skip
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("file", no_wrap=True)
    table.add_column("what")
    table.add_column("deviation from the mirror\num", justify="right", no_wrap=True)
    table.add_column("of its rays\ndeg", justify="right", no_wrap=True)
    for file in written:
        table.add_row(str(file.path), file.what, deviation_words(file), ray_words(file))
    console.print(table)
    for file in written:
        if not file.follows:
            console.print(
                f"[yellow]{escape(file.path.name)} does not follow the mirror[/]: its rays are up to "
                f"{ray_words(file)} deg off; no asphere does better, the grid sag (--formats gridsag) does"
            )


def deviation_words(file: Exported) -> str:
    """The deviation of a file as it is printed."""
    if file.deviation_um is None:
        return ""
    return f"{file.deviation_um:.2g}" if file.deviation_um else "exact"


def ray_words(file: Exported) -> str:
    """By how much a lens file's rays leave those of the mirror, as it is printed."""
    if file.ray_deg is None:
        return ""
    return f"{file.ray_deg:.2g}" if file.ray_deg else "exact"
