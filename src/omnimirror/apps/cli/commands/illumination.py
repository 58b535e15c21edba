"""``omnimirror illumination``: relative illumination over the field."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from ....analysis.relative_illumination import Illumination, illumination
from ....base.arguments import format_value, parse_float
from ....base.quantities import QUANTITIES
from ....base.typing import Array
from ....optics.materials import METALS, Reflectivity
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_sensor
from .._aperture_options import angles_of
from .._declarations import (
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    angle,
    option,
    setting,
    values,
)
from .._output import (
    FIGURES,
    column_head,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)

CURVE, RIM_DEG = 121, 1.5  # points of the curve; refined zone inside the rim


def reflectivity(text: str) -> Reflectivity:
    """Parse a reflectivity: a fraction, a refractive index ``n,k``, or the name of a metal.

    >>> reflectivity("0.9"), reflectivity("0.96,6.69"), reflectivity("silver")
    (0.9, (0.96+6.69j), 'silver')
    """
    if text in METALS:
        return text
    try:
        numbers = [parse_float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 1:
        return numbers[0]
    if len(numbers) == 2:
        return complex(*numbers)
    raise click.BadParameter(
        f"must be a fraction from 0 to 1, an index n,k, or one of {', '.join(METALS)}; got {format_value(text)}"
    )


@dataclass(frozen=True)
class LightOptions(Options):
    """Illumination, with transmission of mirror and lens."""

    omega_deg: Array | None = option(
        type=values, metavar="A:B:STEP", help="Field angles.  [default: every 15 deg of the field]"
    )
    reflectivity: Reflectivity = option(
        type=reflectivity,
        default=1.0,
        metavar="R|N,K|METAL",
        help=f"Reflectivity of the mirror: a fraction, a refractive index, or {', '.join(METALS)}.",
    )
    azimuth_deg: float = setting("field", 0.0, type=angle)
    transmission: float = setting("lens", 1.0)

    def of(self, sensor: Sensor, omega_deg: Array) -> Illumination:
        """Return the illumination at field angles (n,)."""
        return illumination(
            sensor, omega_deg, **self.subset("azimuth_deg", "reflectivity", "transmission")
        )


@click.command(
    cls=DocumentedCommand,
    page="aperture",
    examples=(
        "omnimirror illumination paper-spherical --reflectivity aluminium -o illumination.png",
    ),
)
@click.argument("sensor", type=SENSOR)
@add_options(LightOptions, "light")
@output_option("-o", "--output", formats=FIGURES, help="Output figure (PNG, SVG, PDF).")
@output_option("--csv", "csv_file", help="Write the table as CSV.")
@json_option("Write the columns of --csv as a list of objects.")
def command(
    sensor: str,
    light: LightOptions,
    output: Path | None,
    csv_file: Path | None,
    json_file: Path | None,
) -> None:
    """Compute the relative illumination of SENSOR over its field."""
    camera = load_sensor(sensor)
    result = light.of(camera, angles_of(camera, light.omega_deg))
    console = output_console()
    names = ("irradiance_sr", "relative", "reflectance")
    table = plain_table(
        column_head("omega_deg"), *map(column_head, names), column_head("filled", "%")
    )
    for row in zip(
        result.omega_deg,
        result.irradiance_sr,
        result.relative,
        result.reflectance,
        result.filled,
        strict=True,
    ):
        omega, *numbers, filled = row
        texts = (QUANTITIES[name].text(v) for name, v in zip(names, numbers, strict=True))
        table.add_row(f"{omega:g}", *texts, f"{100 * filled:.4g}")
    console.print(table)
    if csv_file:
        result.to_csv(csv_file)
    if json_file:
        result.to_json(json_file)
    print_written(csv_file, json_file, console=console)
    if output:
        from ....analysis.figures import save_figure
        from ....analysis.figures.aperture import illumination_curves

        dense = np.linspace(result.omega_deg[0], result.omega_deg[-1], CURVE)
        dense = np.union1d(
            dense, np.linspace(max(dense[0], dense[-1] - RIM_DEG), dense[-1], CURVE // 2)
        )
        figure = illumination_curves([(camera.name, light.of(camera, dense))])
        print_written(save_figure(figure, output), console=console)
