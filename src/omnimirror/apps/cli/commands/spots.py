"""``omnimirror spots``: spot diagrams by real ray tracing, through focus, and accuracy of the blur
of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from ....analysis.ray_bundles import hexapolar
from ....analysis.spot_diagrams import Spots, check_blur, spots
from ....base.quantities import QUANTITIES
from ....base.typing import Array
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_sensor
from .._aperture_options import ObjectOptions
from .._declarations import DocumentedCommand, option, takes
from .._option_types import SENSOR, WHOLE, values
from .._output import (
    FIGURES,
    format_option,
    head,
    json_option,
    output_console,
    output_option,
    plain_table,
    say_written,
)

MOST_FOCUSES = 15


@dataclass(frozen=True)
class SpotOptions(ObjectOptions):
    """Spot diagrams, with focus and number of rays."""

    focus_mm: Array | None = option(
        type=values,
        metavar="A:B:STEP",
        help="Focus distances for a through-focus diagram.  [default: the focus of the sensor]",
    )
    rings: int = option(type=WHOLE, default=12, help="Number of ray rings across the aperture.")
    f_numbers: Array | None = option(
        type=values,
        metavar="LIST",
        help="Print the error of the blur formula at these F-numbers instead of spots.",
    )

    def of(self, sensor: Sensor) -> Spots:
        """Return the spots for the options."""
        return spots(
            sensor,
            self.angles(sensor),
            focus_mm=self.focus_mm,
            azimuth_deg=self.azimuth_deg,
            object_distance_mm=self.object_distance_mm,
            pupil=hexapolar(self.rings),
        )


@click.command(
    cls=DocumentedCommand,
    page="aperture",
    examples=(
        "omnimirror spots paper-spherical --omega-deg 0:120:30 --focus-mm 200:220:10 -o spots.png",
    ),
)
@click.argument("sensor", type=SENSOR)
@takes(SpotOptions, "asked")
@output_option(
    "-o",
    "--output",
    formats=FIGURES,
    help="Figure of field angles by focus distances (PNG, SVG, PDF).",
)
@format_option(FIGURES)
@output_option("--csv", "csv_file", help="Write widths, radii and centroids.")
@json_option("Write what --csv does, as a list of objects.")
def command(
    sensor: str,
    asked: SpotOptions,
    output: Path | None,
    csv_file: Path | None,
    json_file: Path | None,
) -> None:
    """Trace real rays through the whole aperture of SENSOR and compute spot diagrams."""
    seen = load_sensor(sensor)
    console = output_console()
    if asked.f_numbers is not None:
        if output or csv_file or json_file or asked.focus_mm is not None:
            raise click.UsageError(
                "--f-numbers prints a table of its own; leave out --output, --csv, --json and --focus-mm"
            )
        _print_check(console, seen, asked.f_numbers, asked)
        return
    if asked.focus_mm is not None and (count := len(asked.focus_mm)) > MOST_FOCUSES:
        raise click.UsageError(
            f"{count} focuses do not fit into a figure; up to {MOST_FOCUSES} are valid"
        )
    found = asked.of(seen)
    _print_spots(console, found)
    if csv_file:
        found.to_csv(csv_file)
    if json_file:
        found.to_json(json_file)
    say_written(csv_file, json_file, console=console)
    if output:
        from ....analysis.figures import save_figure
        from ....analysis.figures.aperture import spot_matrix

        airy = seen.lens.airy_diameter() / seen.imager.pitch_mm
        say_written(save_figure(spot_matrix(found, airy), output), console=console)


def _print_spots(console: Console, found: Spots) -> None:
    """Print one line per field angle and focus."""
    names = ("chief_px", "rms_radius_px", "rms_t_px", "rms_s_px", "extent_t_px", "extent_s_px")
    table = plain_table(head("omega_deg"), head("focus_mm"), *map(head, names), head("filled", "%"))
    rms_t, rms_s = found.rms_px()
    columns = (found.chief_px, found.rms_radius_px(), rms_t, rms_s, *found.extent_px())
    for i, omega in enumerate(found.omega_deg):
        for j, focus in enumerate(found.focus_mm):
            numbers = [
                QUANTITIES[name].text(c[i, j]) for name, c in zip(names, columns, strict=True)
            ]
            table.add_row(f"{omega:g}", f"{focus:.6g}", *numbers, f"{100 * found.filled[i]:.4g}")
    console.print(table)


def _print_check(
    console: Console, sensor: Sensor, f_numbers: Array, objects: ObjectOptions
) -> None:
    """Compare the blur of Eq. 28 with real rays, one line per F-number."""
    found = check_blur(
        sensor,
        f_numbers,
        omega_deg=objects.omega_deg,
        object_distance_mm=objects.object_distance_mm,
    )
    low, high = found.omega_deg[[0, -1]]
    console.print(
        f"Largest difference of real rays from the blur, {low:g} to {high:g} deg: two edge rays, and the full "
        "width of the fan of rays",
        soft_wrap=True,
        highlight=False,
    )
    names = ("blur_t_px", "edge_t_px", "extent_t_px", "blur_s_px", "edge_s_px", "extent_s_px")
    table = plain_table(head("f_number"), *map(head, names))
    columns = [found.max_abs(name) for name in names]
    for F, *row in zip(found.f_number, *columns, strict=True):
        table.add_row(
            f"{F:g}",
            *(f"{v:.2f}" if i in (0, 3) else f"{v:.4f}" for i, v in enumerate(np.array(row))),
        )
    console.print(table)
