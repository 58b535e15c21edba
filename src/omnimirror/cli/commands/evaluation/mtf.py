"""``omnimirror mtf``: tangential and sagittal MTF over the field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from ....analysis import mtf
from ....analysis.aperture.point_spread import KINDS
from ....specs import load_sensor
from ...options.aperture import ObjectOptions
from ...options.common import focus, values
from ...options.declared import takes
from ...outputs import FIGURES, format_option, output_console, output_option, say_written

SHOWN = (0.125, 0.25, 0.5)  # cycles per pixel, on the terminal


@click.command()
@click.argument("sensor")
@takes(ObjectOptions, "objects")
@click.option("--focus-mm", type=focus, metavar="MM|auto", help="Object distance in focus; the sensor's by default.")
@click.option("--cycles-per-px", type=values, metavar="A:B:STEP", help="Spatial frequencies.  [default: 0:1:0.02]")
@click.option("--kind", type=click.Choice(KINDS), default="diffraction", show_default=True,
              help="By waves with all aberrations, or by rays alone.")  # fmt: skip
@click.option("--wavelength-nm", type=values, default="550", metavar="LIST", show_default=True, help="Of equal shares.")
@click.option("--pixel/--no-pixel", default=True, show_default=True, help="Multiply by the MTF of the square pixel.")
@output_option("-o", "--output", formats=FIGURES, help="Figure (PNG, SVG, PDF).")
@format_option(FIGURES)
@output_option("--csv", "csv_file", help="Write it, in cycles/px, lp/mm and cycles/deg.")
def command(
    sensor: str,
    objects: ObjectOptions,
    focus_mm: Any,
    cycles_per_px: Any,
    kind: Any,
    wavelength_nm: Any,
    pixel: bool,
    output: Path | None,
    csv_file: Path | None,
) -> None:
    """Compute the modulation transfer of SENSOR through its whole aperture.

    Example: omnimirror mtf paper-spherical --omega-deg 0:120:30 -o mtf.png --csv mtf.csv
    """
    seen = load_sensor(sensor)
    nu = np.linspace(0, 1, 51) if cycles_per_px is None else cycles_per_px
    shown = np.array(SHOWN)
    found = mtf(
        seen, objects.angles(seen), cycles_per_px=np.concatenate([nu, shown]),
        focus_mm=objects.focus(seen, focus_mm), azimuth_deg=objects.azimuth_deg,
        object_distance_mm=objects.object_distance_mm, kind=kind, wavelength_nm=wavelength_nm, pixel=pixel,
    )  # fmt: skip
    console = output_console()
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("Omega\ndeg", justify="right")
    for way, scale in (("T", "Dh"), ("S", "Dw")):
        table.add_column(f"{scale}\npx/deg", justify="right", no_wrap=True)
        for f in shown:
            table.add_column(f"{way} at {f:g}\ncycles/px", justify="right", no_wrap=True)
    last = slice(-len(shown), None)
    for i, omega in enumerate(found.omega_deg):
        numbers = [f"{found.px_per_deg_t[i]:.3f}", *(f"{v:.3f}" for v in found.tangential[i, last])]
        numbers += [f"{found.px_per_deg_s[i]:.3f}", *(f"{v:.3f}" for v in found.sagittal[i, last])]
        table.add_row(f"{omega:g}", *numbers)
    console.print(table)
    asked = found.first(len(nu))
    if csv_file:
        asked.to_csv(csv_file)
        say_written(csv_file, console=console)
    if output:
        from ....figures import save_figure
        from ....figures.aperture import mtf_curves

        say_written(save_figure(mtf_curves(asked), output), console=console)
