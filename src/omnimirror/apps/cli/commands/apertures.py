"""``omnimirror apertures``: F-number and focus with minimum blur and diffraction."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from ....base.files import write_json
from ....design.component_selection import BestAperture, best_apertures
from ....design.requirements import Range
from ....optics.lenses import BlurMode
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_sensor
from .._declarations import (
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    distance,
    number_or_range,
    option,
    setting,
)
from .._output import column_head, json_option, output_console, plain_table, print_written


@dataclass(frozen=True)
class ApertureOptions(Options):
    """Lens settings, and the criterion for their comparison."""

    f_number: Range = option(
        type=number_or_range,
        metavar="F|LOW:HIGH",
        default="0.5:64",
        help="F-number, or range of F-numbers, of the lens.",
    )
    object_distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="Object distance from the mirror."
    )
    omega_min_deg: float = setting("field", 0.0)
    mode: BlurMode = setting("blur", "exact")
    wavelength_nm: float = setting("light", 550.0)

    def best(self, sensor: Sensor) -> list[BestAperture]:
        """Return the optimum apertures of a sensor."""
        return best_apertures(
            sensor,
            self.f_number,
            object_distance_mm=self.object_distance_mm,
            omega_min_deg=self.omega_min_deg,
            mode=self.mode,
            wavelength_nm=self.wavelength_nm,
        )


@click.command(
    cls=DocumentedCommand,
    page="optimisation",
    examples=("omnimirror apertures paper-spherical",),
)
@click.argument("sensors", type=SENSOR, nargs=-1, required=True)
@add_options(ApertureOptions, "apertures")
@json_option()
def command(sensors: tuple[str, ...], apertures: ApertureOptions, json_file: Path | None) -> None:
    """Find the optimum F-number and focus of each of SENSORS: tangential, sagittal and for both
    together.

    A large aperture increases blur, a small one diffraction. The merit is the root sum of squares
    of both, in pixels, at the worst field angle.
    """
    numbers = (
        column_head("f_number"),
        column_head("focus_mm"),
        "worst\npx",
        "blur\npx",
        column_head("airy_px"),
    )
    table = plain_table("sensor", "minimised", *numbers, text_columns=("sensor", "minimised"))
    console = output_console()
    records: list[dict[str, Any]] = []
    for name in sensors:
        sensor = load_sensor(name)
        for b in apertures.best(sensor):
            records.append({"sensor": sensor.name} | asdict(b))
            table.add_row(
                sensor.name,
                b.side,
                f"{b.f_number:.2f}",
                f"{b.focus_mm:.2f}",
                f"{b.worst_px:.3f}",
                f"{b.blur_px:.3f}",
                f"{b.airy_px:.3f}",
            )
    console.print(table)
    if json_file:
        write_json(json_file, records)
        print_written(json_file, console=console)
