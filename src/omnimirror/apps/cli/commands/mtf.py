"""``omnimirror mtf``: tangential and sagittal MTF over the field."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from ....analysis.psf_mtf import mtf
from ....base.quantities import QUANTITIES
from ....base.typing import Array
from ....optics.sensor_files import load_sensor
from .._aperture_options import ImageOptions
from .._declarations import SENSOR, DocumentedCommand, add_options, setting, values
from .._output import (
    FIGURES,
    column_head,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)

PRINTED_CYCLES_PER_PX = (0.125, 0.25, 0.5)  # cycles per pixel, printed on the terminal


@dataclass(frozen=True)
class MtfOptions(ImageOptions):
    """MTF conditions."""

    cycles_per_px: Array | None = setting("mtf", type=values)
    wavelength_nm: Any = setting("light", 550.0, type=values)
    pixel: bool = setting("mtf", True)

    @property
    def frequencies(self) -> Array:
        """Spatial frequencies (k,), cycles/px."""
        return np.linspace(0, 1, 51) if self.cycles_per_px is None else self.cycles_per_px


@click.command(
    cls=DocumentedCommand,
    page="aperture",
    examples=("omnimirror mtf paper-spherical --omega-deg 0:120:30 -o mtf.png --csv mtf.csv",),
)
@click.argument("sensor", type=SENSOR)
@add_options(MtfOptions, "conditions")
@output_option("-o", "--output", formats=FIGURES, help="Output figure (PNG, SVG, PDF).")
@output_option("--csv", "csv_file", help="Write the MTF in cycles/px, lp/mm and cycles/deg.")
@json_option("Write the columns of --csv as a list of objects.")
def command(
    sensor: str,
    conditions: MtfOptions,
    output: Path | None,
    csv_file: Path | None,
    json_file: Path | None,
) -> None:
    """Compute the MTF of SENSOR through its whole aperture."""
    camera = load_sensor(sensor)
    nu, printed = conditions.frequencies, np.array(PRINTED_CYCLES_PER_PX)
    result = mtf(
        camera,
        conditions.angles(camera),
        cycles_per_px=np.concatenate([nu, printed]),
        focus_mm=conditions.focused_at(camera),
        azimuth_deg=conditions.azimuth_deg,
        object_distance_mm=conditions.object_distance_mm,
        kind=conditions.kind,
        wavelength_nm=conditions.wavelength_nm,
        pixel=conditions.pixel,
    )
    console, per_px = output_console(), QUANTITIES["cycles_per_px"].unit
    heads = [column_head("omega_deg")]
    for contrast, scale in (("mtf_t", "dh_domega_px_per_deg"), ("mtf_s", "width_px_per_deg")):
        heads += [
            column_head(scale),
            *(f"{QUANTITIES[contrast].heading} at {f:g}\n{per_px}" for f in printed),
        ]
    table = plain_table(*heads)
    last = slice(-len(printed), None)
    for i, omega in enumerate(result.omega_deg):
        numbers = [
            f"{result.px_per_deg_t[i]:.3f}",
            *(f"{v:.3f}" for v in result.tangential[i, last]),
        ]
        numbers += [
            f"{result.px_per_deg_s[i]:.3f}",
            *(f"{v:.3f}" for v in result.sagittal[i, last]),
        ]
        table.add_row(f"{omega:g}", *numbers)
    console.print(table)
    requested = result.first(len(nu))
    if csv_file:
        requested.to_csv(csv_file)
    if json_file:
        requested.to_json(json_file)
    print_written(csv_file, json_file, console=console)
    if output:
        from ....analysis.figures import save_figure
        from ....analysis.figures.aperture import mtf_curves

        print_written(save_figure(mtf_curves(requested), output), console=console)
