"""``omnimirror parts``: selection of a lens and an imager for a mirror."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from ....base.errors import OmnimirrorError
from ....base.files import write_json
from ....base.quantities import QUANTITIES
from ....design.catalogue import read_catalogue
from ....design.component_selection import Combination, choose_parts
from ....optics.lenses import Perspective
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_sensor, save_sensor
from .._declarations import (
    NUMBER,
    SENSOR,
    DocumentedCommand,
    Options,
    add_options,
    distance,
    option,
)
from .._output import (
    column_head,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)


@dataclass(frozen=True)
class SelectionOptions(Options):
    """Selection criteria."""

    min_fill: float = option(
        "--min-fill",
        type=NUMBER,
        default=0.6,
        help="Minimum radius of the rim image as a fraction of half the shorter side of the imager.",
    )
    object_distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="Object distance from the mirror."
    )


@click.command(
    cls=DocumentedCommand,
    page="optimisation",
    examples=(
        "omnimirror parts paper-spherical",
        "omnimirror parts mine.toml catalogue.csv --feasible -o best.toml",
    ),
)
@click.argument("sensor", type=SENSOR)
@click.argument("catalogue", nargs=-1, type=click.Path(path_type=Path))
@add_options(SelectionOptions, "selection")
@click.option("--feasible", is_flag=True, help="List feasible combinations only.")
@output_option("-o", "--output", "out", help="Write the best combination as a sensor file.")
@json_option()
def command(
    sensor: str,
    catalogue: tuple[Path, ...],
    selection: SelectionOptions,
    feasible: bool,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Rank the lenses and imagers of CATALOGUE files for the mirror of SENSOR, with reasons for
    rejections.

    The mirror keeps its position. A catalogue is a TOML or CSV file; without one, common types of
    parts are ranked. omnimirror design --parts designs the mirror for each combination instead.
    """
    combinations = choose_parts(load_sensor(sensor), read_catalogue(*catalogue), **selection.given)
    fitting = [c for c in combinations if c.fits]
    console = output_console()
    listed = fitting if feasible else combinations
    console.print(_table(listed))
    if json_file:
        write_json(json_file, list(map(_record, listed)))
        print_written(json_file, console=console)
    if out:
        if not fitting or fitting[0].sensor is None:
            raise OmnimirrorError(
                "no combination of lens and imager of the catalogue is feasible; no sensor file was written"
            )
        save_sensor(fitting[0].sensor, out)
        print_written(out, console=console)


def _table(combinations: list[Combination]) -> Table:
    area = QUANTITIES["worst_floored_area_deg2"]
    numbers = (
        "fills\n%",
        "rim\npx",
        column_head("f_number"),
        column_head("focus_mm"),
        "ring\nmm",
        f"{area.title}\n{area.unit}",
    )
    table = plain_table(
        "", "lens", "imager", *numbers, "reasons", text_columns=("lens", "imager", "reasons")
    )
    for i, c in enumerate(combinations, start=1):
        cells = ["", "", "", "", "", ""]
        if c.sensor is not None:
            cells = [
                f"{100 * c.fill:.0f}",
                f"{c.rim_radius_px:.0f}",
                f"{_f_number(c.sensor):.1f}",
                f"{c.sensor.lens.focus_distance_mm:.1f}",
                f"{c.ring_mm:g}",
                area.text(c.worst_floored_area_deg2),
            ]
        table.add_row(str(i) if c.fits else "-", c.lens, c.imager, *cells, "; ".join(c.reasons))
    return table


def _record(c: Combination) -> dict[str, Any]:
    """Return a table row of a lens with an imager; None for values that its type of lens does not
    have.
    """
    record = {"lens": c.lens, "imager": c.imager, "fits": c.fits, "reasons": c.reasons}
    if c.sensor is None:
        return record
    lens = c.sensor.lens
    return record | {
        "fill": c.fill,
        "rim_radius_px": c.rim_radius_px,
        "f_number": _f_number(c.sensor),
        "focus_mm": lens.focus_distance_mm,
        "ring_mm": c.ring_mm,
        "worst_floored_area_deg2": c.worst_floored_area_deg2,
    }


def _f_number(sensor: Sensor) -> float:
    """Return the F-number as engraved, or of the image for a telecentric lens."""
    lens = sensor.lens
    return lens.f_number if isinstance(lens, Perspective) else lens.image_f_number()
