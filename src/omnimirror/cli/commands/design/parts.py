"""``omnimirror parts``: which lens and imager out of a list suit a mirror."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from ....components.catalogue import read_catalogue
from ....components.selection import Combination, choose_parts
from ....errors import OmnimirrorError
from ....lenses import Perspective
from ....quantities import QUANTITIES
from ....specs import load_sensor, save_sensor
from ...options.common import NUMBER, distance
from ...outputs import output_console, output_option, say_written


@click.command()
@click.argument("sensor")
@click.argument("catalogue", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--least-fill", type=NUMBER, default=0.6, show_default=True,
              help="Share of half the imager's shorter side that the rim's image has to reach.")  # fmt: skip
@click.option("--object-distance-mm", type=distance, metavar="MM", default="inf", show_default=True,
              help="From the mirror to the object.")  # fmt: skip
@click.option("--best", is_flag=True, help="Only those that fit.")
@output_option("-o", "--out", help="Write the best as a sensor file.")
def command(
    sensor: str,
    catalogue: tuple[Path, ...],
    least_fill: float,
    object_distance_mm: float,
    best: bool,
    out: Path | None,
) -> None:
    """Rank the lenses and imagers of CATALOGUE files before the mirror of SENSOR, and say why others do not fit.

    The mirror stays where it is; a catalogue is TOML or CSV.
    """
    found = choose_parts(
        load_sensor(sensor), read_catalogue(*catalogue), least_fill=least_fill, object_distance_mm=object_distance_mm
    )
    fitting = [c for c in found if c.fits]
    console = output_console()
    console.print(_table(fitting if best else found))
    if out:
        if not fitting or fitting[0].sensor is None:
            raise OmnimirrorError("no lens and imager of the catalogue fit, so there is no sensor to write")
        save_sensor(fitting[0].sensor, out)
        say_written(out, console=console)


def _table(combinations: list[Combination]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    area = QUANTITIES["worst_floored_area_deg2"]
    numbers = ("fills", "rim px", "F", "focus mm", "ring mm", f"{area.title} {area.unit}")
    for heading in ("", "lens", "imager", *numbers, "why not"):
        table.add_column(heading, justify="left" if heading in ("lens", "imager", "why not") else "right")
    for i, c in enumerate(combinations, start=1):
        cells = ["", "", "", "", "", ""]
        if c.sensor is not None:
            lens = c.sensor.lens
            F = lens.f_number if isinstance(lens, Perspective) else lens.image_f_number()
            cells = [
                f"{100 * c.fill:.0f} %", f"{c.rim_radius_px:.0f}", f"{F:.1f}", f"{lens.focus_distance_mm:.1f}",
                f"{c.ring_mm:g}", area.text(c.worst_floored_area_deg2),
            ]  # fmt: skip
        table.add_row(str(i) if c.fits else "-", c.lens, c.imager, *cells, "; ".join(c.reasons))
    return table
