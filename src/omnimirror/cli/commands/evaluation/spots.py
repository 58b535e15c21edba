"""``omnimirror spots``: spot diagrams by real rays, through focus, and how far the paper's blur holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ....analysis import Spots, check_blur, spots
from ....analysis.aperture.pupil import hexapolar
from ....quantities import QUANTITIES
from ....sensor import Sensor
from ....specs import load_sensor
from ...options.aperture import ObjectOptions
from ...options.common import WHOLE, values
from ...options.declared import takes
from ...outputs import FIGURES, format_option, output_console, output_option, say_written

MOST_FOCUSES = 15


@click.command()
@click.argument("sensor")
@takes(ObjectOptions, "objects")
@click.option("--focus-mm", type=values, metavar="A:B:STEP", help="Focus distances, for spots through focus.")
@click.option("--rings", type=WHOLE, default=12, show_default=True, help="Rings of rays across the aperture.")
@click.option("--f-numbers", type=values, metavar="LIST",
              help="Instead: a table of the blur's error at these F-numbers.")  # fmt: skip
@output_option("-o", "--output", formats=FIGURES, help="Figure: angles by focuses (PNG, SVG, PDF).")
@format_option(FIGURES)
@output_option("--csv", "csv_file", help="Write widths, radii and centroids.")
def command(
    sensor: str,
    objects: ObjectOptions,
    focus_mm: Any,
    rings: int,
    f_numbers: Any,
    output: Path | None,
    csv_file: Path | None,
) -> None:
    """Trace real rays through the whole aperture of SENSOR and show where they land.

    Example: omnimirror spots paper-spherical --omega-deg 0:120:30 --focus-mm 200:220:10 -o spots.png
    """
    seen = load_sensor(sensor)
    console = output_console()
    if f_numbers is not None:
        if output or csv_file or focus_mm is not None:
            raise click.UsageError("--f-numbers prints a table of its own; leave out --output, --csv and --focus-mm")
        _print_check(console, seen, f_numbers, objects)
        return
    if focus_mm is not None and len(focus_mm) > MOST_FOCUSES:
        raise click.UsageError(f"{len(focus_mm)} focuses do not fit into a figure; up to {MOST_FOCUSES} are valid")
    found = spots(
        seen,
        objects.angles(seen),
        focus_mm=focus_mm,
        azimuth_deg=objects.azimuth_deg,
        object_distance_mm=objects.object_distance_mm,
        pupil=hexapolar(rings),
    )
    _print_spots(console, found)
    if csv_file:
        found.to_csv(csv_file)
        say_written(csv_file, console=console)
    if output:
        from ....figures import save_figure
        from ....figures.aperture import spot_matrix

        airy = seen.lens.airy_diameter() / seen.imager.pitch_mm
        say_written(save_figure(spot_matrix(found, airy), output), console=console)


def _print_spots(console: Console, found: Spots) -> None:
    """A line for each angle and focus."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    names = ("chief_px", "rms_radius_px", "rms_t_px", "rms_s_px", "extent_t_px", "extent_s_px")
    widths = (f"{QUANTITIES[name].heading}\n{QUANTITIES[name].unit}" for name in names)
    for heading in ("Omega\ndeg", "L0\nmm", *widths, "passed\n%"):
        table.add_column(heading, justify="right", no_wrap=True)
    rms_t, rms_s = found.rms_px()
    columns = (found.chief_px, found.rms_radius_px(), rms_t, rms_s, *found.extent_px())
    for i, omega in enumerate(found.omega_deg):
        for j, focus in enumerate(found.focus_mm):
            numbers = [f"{c[i, j]:.3f}" for c in columns]
            table.add_row(f"{omega:g}", f"{focus:.6g}", *numbers, f"{100 * found.passed[i]:.4g}")
    console.print(table)


def _print_check(console: Console, sensor: Sensor, f_numbers: Any, objects: ObjectOptions) -> None:
    """The blur of Eq. 28 against real rays, one line per F-number."""
    found = check_blur(sensor, f_numbers, omega_deg=objects.omega_deg, object_distance_mm=objects.object_distance_mm)
    low, high = found.omega_deg[[0, -1]]
    console.print(
        f"Largest difference of real rays from the blur, {low:g} to {high:g} deg, in px: two edge rays, and the full "
        "width of the fan of rays",
        soft_wrap=True, highlight=False,
    )  # fmt: skip
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("F", "blur T", "edges T", "width T", "blur S", "edges S", "width S"):
        table.add_column(heading, justify="right", no_wrap=True)
    names = ("blur_t_px", "edge_t_px", "extent_t_px", "blur_s_px", "edge_s_px", "extent_s_px")
    columns = [found.worst(name) for name in names]
    for F, *row in zip(found.f_number, *columns, strict=True):
        table.add_row(f"{F:g}", *(f"{v:.2f}" if i in (0, 3) else f"{v:.4f}" for i, v in enumerate(np.array(row))))
    console.print(table)
