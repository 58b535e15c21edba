"""``omnimirror psf``: point-spread functions and encircled energy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import click
import numpy as np

from ....analysis.psf_mtf import Psf, psf
from ....base.files import write_json
from ....optics.sensor_files import load_sensor
from .._aperture_options import ImageOptions
from .._declarations import SENSOR, DocumentedCommand, add_options, setting
from .._output import (
    FIGURES,
    column_head,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_written,
)

MAX_ANGLES = 15
SHARES = (0.5, 0.8)  # fractions of the energy with printed radii


@dataclass(frozen=True)
class PsfOptions(ImageOptions):
    """PSF conditions."""

    wavelength_nm: float = setting("light", 550.0)
    content: Literal["images", "encircled_energy"] = setting("figure", "images")


@click.command(
    cls=DocumentedCommand,
    page="aperture",
    examples=(
        "omnimirror psf paper-spherical --omega-deg 0:120:30 -o psf.png",
        "omnimirror psf paper-spherical --set figure.content=encircled_energy -o energy.png",
    ),
)
@click.argument("sensor", type=SENSOR)
@add_options(PsfOptions, "conditions")
@output_option(
    "-o",
    "--output",
    formats=FIGURES,
    help="Figure of the PSFs or of the encircled energy (PNG, SVG, PDF).",
)
@json_option()
def command(
    sensor: str,
    conditions: PsfOptions,
    output: Path | None,
    json_file: Path | None,
) -> None:
    """Compute the point-spread functions of SENSOR through its whole aperture."""
    camera = load_sensor(sensor)
    angles = np.asarray(conditions.angles(camera))
    if len(angles) > MAX_ANGLES:
        raise click.UsageError(
            f"--omega-deg must be at most {MAX_ANGLES} field angles; got {len(angles)}"
        )
    L0 = conditions.focused_at(camera)
    console = output_console()

    def compute(omega: float, width_px: float | None = None) -> Psf:
        return psf(
            camera,
            omega,
            focus_mm=L0,
            azimuth_deg=conditions.azimuth_deg,
            object_distance_mm=conditions.object_distance_mm,
            kind=conditions.kind,
            wavelength_nm=conditions.wavelength_nm,
            width_px=width_px,
        )

    with console.status("Computing"):
        psfs = [compute(float(omega)) for omega in angles]
    radii = column_head("encircled_radius_px").replace("\n", " {:.0%}\n")
    table = plain_table(
        column_head("omega_deg"),
        column_head("strehl"),
        *map(radii.format, SHARES),
        column_head("ensquared_energy", "%"),
    )
    records = list(map(_record, psfs))
    for record in records:
        omega, strehl, *within, best = record.values()
        ratio = "-" if strehl is None else f"{strehl:.3g}"
        table.add_row(
            f"{omega:g}", ratio, *(f"{radius:.2f}" for radius in within), f"{100 * best:.1f}"
        )
    console.print(table)
    if json_file:
        write_json(json_file, records)
        print_written(json_file, console=console)
    if output:
        from ....analysis.figures import save_figure
        from ....analysis.figures.aperture import encircled_energy, psf_images

        widest = max(2 * float(p.offset_px[-1]) for p in psfs)  # squares of equal size
        psfs = [p if 2 * p.offset_px[-1] == widest else compute(p.omega_deg, widest) for p in psfs]
        draw = psf_images if conditions.content == "images" else encircled_energy
        print_written(save_figure(draw(psfs), output), console=console)


def _record(p: Psf) -> dict[str, Any]:
    """Return a table row of a PSF; without diffraction there is no Strehl ratio."""
    radius = np.linspace(0, float(p.offset_px[-1]), 2000)
    radii = np.interp(SHARES, p.encircled_energy(radius), radius)
    return {
        "omega_deg": float(p.omega_deg),
        "strehl": float(p.strehl) if p.kind == "diffraction" else None,
        **{
            f"encircled_radius_px_{share:.0%}".rstrip("%"): float(r)
            for share, r in zip(SHARES, radii, strict=True)
        },
        "ensquared_energy": float(p.on_pixels().max()),
    }
