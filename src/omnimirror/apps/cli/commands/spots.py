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
from .._declarations import SENSOR, DocumentedCommand, add_options, option, setting, values
from .._output import (
    FIGURES,
    column_head,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)

MAX_FOCUSES = 15


@dataclass(frozen=True)
class SpotOptions(ObjectOptions):
    """Spot diagrams, with focus and number of rays."""

    focus_mm: Array | None = option(
        type=values,
        metavar="A:B:STEP",
        help="Focus distances for a through-focus diagram.  [default: the focus of the sensor]",
    )
    rings: int = setting("pupil", 12)
    f_numbers: Array | None = setting("check_blur", type=values)

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
@add_options(SpotOptions, "conditions")
@output_option(
    "-o",
    "--output",
    formats=FIGURES,
    help="Figure of field angles by focus distances (PNG, SVG, PDF).",
)
@output_option("--csv", "csv_file", help="Write widths, radii and centroids.")
@json_option("Write the columns of --csv as a list of objects.")
def command(
    sensor: str,
    conditions: SpotOptions,
    output: Path | None,
    csv_file: Path | None,
    json_file: Path | None,
) -> None:
    """Trace real rays through the whole aperture of SENSOR and compute spot diagrams."""
    camera = load_sensor(sensor)
    console = output_console()
    if conditions.f_numbers is not None:
        if output or csv_file or json_file or conditions.focus_mm is not None:
            raise click.UsageError(
                "check_blur.f_numbers prints the error of the blur formula instead of spots; it must "
                "not be given together with --output, --csv, --json or --focus-mm"
            )
        _print_check(console, camera, conditions.f_numbers, conditions)
        return
    if conditions.focus_mm is not None and (count := len(conditions.focus_mm)) > MAX_FOCUSES:
        raise click.UsageError(f"--focus-mm must be at most {MAX_FOCUSES} distances; got {count}")
    result = conditions.of(camera)
    _print_spots(console, result)
    if csv_file:
        result.to_csv(csv_file)
    if json_file:
        result.to_json(json_file)
    print_written(csv_file, json_file, console=console)
    if output:
        from ....analysis.figures import save_figure
        from ....analysis.figures.aperture import spot_matrix

        print_written(save_figure(spot_matrix(result), output), console=console)


def _print_spots(console: Console, result: Spots) -> None:
    """Print one line per field angle and focus."""
    names = ("chief_px", "rms_radius_px", "rms_t_px", "rms_s_px", "extent_t_px", "extent_s_px")
    table = plain_table(
        column_head("omega_deg"),
        column_head("focus_mm"),
        *map(column_head, names),
        column_head("filled", "%"),
    )
    rms_t, rms_s = result.rms_px()
    columns = (result.chief_px, result.rms_radius_px(), rms_t, rms_s, *result.extent_px())
    for i, omega in enumerate(result.omega_deg):
        for j, focus in enumerate(result.focus_mm):
            numbers = [
                QUANTITIES[name].text(c[i, j]) for name, c in zip(names, columns, strict=True)
            ]
            table.add_row(f"{omega:g}", f"{focus:.6g}", *numbers, f"{100 * result.filled[i]:.4g}")
    console.print(table)


def _print_check(
    console: Console, sensor: Sensor, f_numbers: Array, objects: ObjectOptions
) -> None:
    """Compare the blur of Eq. 28 with real rays, one line per F-number."""
    result = check_blur(
        sensor,
        f_numbers,
        omega_deg=objects.omega_deg,
        object_distance_mm=objects.object_distance_mm,
    )
    low, high = result.omega_deg[[0, -1]]
    console.print(
        f"Maximum difference between real rays and the blur formula, {low:g} to {high:g} "
        "deg: two edge rays, and the full width of the ray fan",
        soft_wrap=True,
        highlight=False,
    )
    names = ("blur_t_px", "edge_t_px", "extent_t_px", "blur_s_px", "edge_s_px", "extent_s_px")
    table = plain_table(column_head("f_number"), *map(column_head, names))
    columns = [result.max_abs(name) for name in names]
    for F, *row in zip(result.f_number, *columns, strict=True):
        table.add_row(
            f"{F:g}",
            *(f"{v:.2f}" if i in (0, 3) else f"{v:.4f}" for i, v in enumerate(np.array(row))),
        )
    console.print(table)
