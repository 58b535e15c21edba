"""``omnimirror apertures``: the F-number and focus that leave the least blur and diffraction."""

from __future__ import annotations

import click
from rich.table import Table

from ....components.apertures import best_apertures
from ....lenses import BlurMode
from ....specs import load_sensor
from ...options.common import NUMBER, distance, number_or_range
from ...outputs import output_console


@click.command()
@click.argument("sensors", nargs=-1, required=True)
@click.option("--f-number", type=number_or_range, metavar="F|LOW:HIGH", default="0.5:64", show_default=True,
              help="What the lens can be set to.")  # fmt: skip
@click.option("--object-distance-mm", type=distance, metavar="MM", default="inf", show_default=True,
              help="From the mirror to the object.")  # fmt: skip
@click.option(
    "--omega-min-deg", type=NUMBER, default=0.0, show_default=True, help="Where the field that counts begins."
)
@click.option("--paper-mode", is_flag=True, help="Blur by the paper's Eq. 29 instead of the exact form.")
@click.option("--wavelength-nm", type=NUMBER, default=550.0, show_default=True, help="Of the Airy disk.")
def command(
    sensors: tuple[str, ...],
    f_number: float | tuple[float, float],
    object_distance_mm: float,
    omega_min_deg: float,
    paper_mode: bool,
    wavelength_nm: float,
) -> None:
    """The best F-number and focus of each of SENSORS, tangentially, sagittally and for both together.

    A wide aperture blurs, a narrow one diffracts; what is least is the root of the squares of both, in pixels, at the
    worst field angle.
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("sensor", "least", "F-number", "focus mm", "worst px", "blur px", "Airy px"):
        table.add_column(heading, justify="left" if heading in ("sensor", "least") else "right")
    for name in sensors:
        sensor = load_sensor(name)
        mode: BlurMode = "paper" if paper_mode else "exact"
        found = best_apertures(
            sensor, f_number, object_distance_mm=object_distance_mm, mode=mode, wavelength_nm=wavelength_nm,
            omega_min_deg=omega_min_deg,
        )  # fmt: skip
        for b in found:
            table.add_row(
                sensor.name, b.side, f"{b.f_number:.2f}", f"{b.focus_mm:.2f}", f"{b.worst_px:.3f}", f"{b.blur_px:.3f}",
                f"{b.airy_px:.3f}",
            )  # fmt: skip
    output_console().print(table)
